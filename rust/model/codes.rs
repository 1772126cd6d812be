//! The codes of the classes, ready for decoding.

use super::fault::Fault;
use super::loss::{Decoding, Loss};
use super::parts::Tensor;
use crate::memory::reserved;

/// Pairs of classes `i < j` in the order of one learner for each: (0, 1), (0, 2), ..., (1, 2), ...
pub(super) fn pairs(n_classes: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n_classes).flat_map(move |i| (i + 1..n_classes).map(move |j| (i, j)))
}

/// A checked coding matrix, learner by learner, and by what the sums of losses are divided.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Codes {
    n_classes: usize,
    /// Code plus one of every class at the first learner, then at the second, ...
    columns: Vec<u8>,
    divisors: Vec<f64>,
}

impl Codes {
    /// Codes of `n_classes` classes at `n_learners` learners, whose shape is checked already.
    pub(super) fn new(
        matrix: &Tensor,
        n_classes: usize,
        n_learners: usize,
        decoding: Decoding,
    ) -> Result<Self, Fault> {
        let mut columns = reserved(n_classes.saturating_mul(n_learners))?;
        for learner in 0..n_learners {
            for class in 0..n_classes {
                let value = matrix.at(class * n_learners + learner);
                // The sign of zero is not looked at.
                columns.push(match value {
                    -1.0 => 0,
                    0.0 => 1,
                    1.0 => 2,
                    _ => return Err(Fault::Code { class, learner, value }),
                });
            }
        }
        for (learner, codes) in columns.chunks_exact(n_classes).enumerate() {
            if !(codes.contains(&0) && codes.contains(&2)) {
                return Err(Fault::OneSided { learner });
            }
        }
        let seen = |class| columns.iter().skip(class).step_by(n_classes).filter(|code| **code != 1).count();
        let counts: Vec<_> = (0..n_classes).map(seen).collect();
        if let Some(class) = counts.iter().position(|count| *count == 0) {
            return Err(Fault::Unseen { class });
        }
        let divisor = |count: &usize| match decoding {
            Decoding::LossWeighted => *count as f64,
            Decoding::LossBased => n_learners as f64,
        };
        let divisors = counts.iter().map(divisor).collect();
        Ok(Self { n_classes, columns, divisors })
    }

    /// Mean loss of each class, added in the order of the learners.
    pub(super) fn mean_losses(&self, loss: Loss, scores: &[f64], losses: &mut [f64]) {
        losses.fill(0.0);
        for (score, codes) in scores.iter().zip(self.columns.chunks_exact(self.n_classes)) {
            let costs = [loss.of_agreement(-score), 0.0, loss.of_agreement(*score)];
            for (sum, code) in losses.iter_mut().zip(codes) {
                *sum += costs[usize::from(*code)];
            }
        }
        for (sum, divisor) in losses.iter_mut().zip(&self.divisors) {
            *sum /= divisor;
        }
    }

    /// Codes plus one of all classes at a learner.
    pub(super) fn column(&self, learner: usize) -> &[u8] {
        self.columns.get(learner * self.n_classes..(learner + 1) * self.n_classes).unwrap_or_default()
    }

    /// By what the summed loss of a class is divided.
    pub(super) fn divisor(&self, class: usize) -> f64 {
        self.divisors.get(class).copied().unwrap_or(1.0)
    }

    /// Binary learners: L.
    pub(super) fn n_learners(&self) -> usize {
        self.columns.len() / self.n_classes.max(1)
    }

    /// Whether there is one learner for each pair of classes `i < j`, in their order, for which `i` is positive.
    pub(super) fn is_of_pairs(&self) -> bool {
        let classes = || 0..self.n_classes;
        self.n_learners() == self.n_classes * (self.n_classes - 1) / 2
            && pairs(self.n_classes).enumerate().all(|(learner, (i, j))| {
                classes()
                    .all(|class| self.code(class, learner) == i8::from(class == i) - i8::from(class == j))
            })
    }

    /// Code -1, 0 or +1 of a class at a learner.
    pub(super) fn code(&self, class: usize, learner: usize) -> i8 {
        self.columns
            .get(learner * self.n_classes + class)
            .map_or(0, |code| i8::from(*code > 1) - i8::from(*code < 1))
    }
}
