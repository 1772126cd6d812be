//! From scores to classes: the binary losses, the codes of the classes, and the answer that both give.
//!
//! Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141; Escalera, Pujol, Radeva
//! (2010), "On the decoding process in ternary error-correcting output codes", IEEE TPAMI 32:120-134.

use super::tensor::Tensor;
use super::{Model, ModelError};
use crate::error::{short_number, Error};
use crate::memory::{filled, reserved};
use crate::specs::choices;

/// A binary loss of the agreement `z` of a code with a score: 1/2 where the score is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Loss {
    /// `max(0, 1 - z) / 2`: that of support vector machines, and the paper's.
    #[default]
    Hinge,
    /// `(1 - r(min(1, z))) / 2`, `r(x) = sign(x) sqrt(|x|)`: half way from the votes (power 0) to the hinge (power 1).
    Root,
}

choices! { Loss: "hinge" Hinge, "root" Root, }

impl Loss {
    /// The loss of a class whose code agrees with the score by `z` (code times score).
    #[must_use]
    pub fn of_agreement(self, z: f64) -> f64 {
        match self {
            Self::Hinge => (1.0 - z).max(0.0) / 2.0,
            Self::Root => (1.0 - z.min(1.0).abs().sqrt().copysign(z)) / 2.0,
        }
    }
}

/// A checked coding matrix, learner by learner, and how many learners saw each class, which divides its summed loss.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Codes {
    n_classes: usize,
    /// Code plus one of every class at the first learner, then at the second, ...
    columns: Vec<u8>,
    divisors: Vec<f64>,
}

impl Codes {
    /// Of `n_classes` classes at `n_learners` learners; the shape of the matrix is checked already.
    pub(super) fn new(matrix: &Tensor, n_classes: usize, n_learners: usize) -> Result<Self, ModelError> {
        let mut columns = reserved(n_classes.saturating_mul(n_learners))?;
        for learner in 0..n_learners {
            for class in 0..n_classes {
                let value = matrix.at(class * n_learners + learner);
                // The sign of zero is not looked at.
                columns.push(match value {
                    -1.0 => 0,
                    0.0 => 1,
                    1.0 => 2,
                    _ => {
                        let what = format!("coding_matrix[{class}, {learner}]");
                        return Err(ModelError::must_be(what, "-1, 0 or 1", short_number(value)));
                    }
                });
            }
        }
        let mut sides = columns.chunks_exact(n_classes);
        if let Some(learner) = sides.position(|codes| !(codes.contains(&0) && codes.contains(&2))) {
            let what = format!("coding_matrix column {learner}");
            return Err(ModelError::part(what, "must hold both 1 and -1"));
        }
        let seen = |class| columns.iter().skip(class).step_by(n_classes).filter(|code| **code != 1).count();
        let counts: Vec<_> = (0..n_classes).map(seen).collect();
        if let Some(class) = counts.iter().position(|count| *count == 0) {
            let what = format!("coding_matrix row {class}");
            return Err(ModelError::part(what, "is all 0: no learner ever sees this class"));
        }
        let divisors = counts.into_iter().map(|count| count as f64).collect();
        Ok(Self { n_classes, columns, divisors })
    }

    /// Binary learners: L.
    pub(super) fn n_learners(&self) -> usize {
        self.columns.len() / self.n_classes
    }

    /// Code -1, 0 or +1; 0 where there is none.
    pub(super) fn code(&self, class: usize, learner: usize) -> i8 {
        if class >= self.n_classes || learner >= self.n_learners() {
            return 0;
        }
        [-1, 0, 1][usize::from(self.columns[learner * self.n_classes + class])]
    }
}

/// The answer of a model about one recording.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Answer {
    /// Index of the class with the smallest loss; the first of equal ones.
    pub best: usize,
    /// Score of each learner.
    pub scores: Vec<f64>,
    /// Mean loss of each class.
    pub losses: Vec<f64>,
    /// Indices of the classes that the recording may be by the [`Rules`](super::Rules) of the model, the likeliest first
    /// and at least one; empty without such a rule.
    pub candidates: Vec<usize>,
    /// True if the recording is like none of the classes: `best` is then the nearest of the wrong ones. `None` without such a rule.
    pub unknown: Option<bool>,
}

impl Answer {
    /// Classes by their loss, the smallest first; of equal ones the first.
    #[must_use]
    pub fn ranking(&self) -> Vec<usize> {
        ranking(&self.losses)
    }

    /// By how much the second loss is larger than the first.
    #[must_use]
    pub fn margin(&self) -> f64 {
        best_and_margin(&self.losses).1
    }
}

/// The first of the smallest losses, and by how much the next one is larger.
pub(crate) fn best_and_margin(losses: &[f64]) -> (usize, f64) {
    let (mut best, mut first, mut second) = (0, f64::INFINITY, f64::INFINITY);
    for (class, loss) in losses.iter().enumerate() {
        if *loss < first {
            (best, first, second) = (class, *loss, first);
        } else {
            second = second.min(*loss);
        }
    }
    (best, second - first)
}

/// Classes by their loss, the smallest first; of equal ones the first.
#[doc(hidden)]
#[must_use]
pub fn ranking(losses: &[f64]) -> Vec<usize> {
    let mut order = vec![0; losses.len()];
    rank(losses, &mut order);
    order
}

/// The same into as many places as there are losses. Allocates nothing.
pub(super) fn rank(losses: &[f64], order: &mut [usize]) {
    for (class, place) in order.iter_mut().enumerate() {
        *place = class;
    }
    order.sort_unstable_by(|a, b| losses[*a].total_cmp(&losses[*b]).then(a.cmp(b)));
}

impl Model {
    /// Mean loss of each class from the scores of all learners, added in their order; the smallest wins, the first of
    /// equal ones. Allocates nothing.
    ///
    /// # Errors
    /// [`Error::Length`] for another number of scores than learners or of losses than classes, [`Error::Score`] for a score
    /// that is not finite.
    pub fn decode(&self, scores: &[f64], losses: &mut [f64]) -> Result<(), Error> {
        let lengths =
            [("scores", self.n_learners(), scores.len()), ("losses", self.classes.len(), losses.len())];
        for (what, expected, got) in lengths {
            if got != expected {
                return Err(Error::Length { what, expected, got });
            }
        }
        self.check_scores(scores)?;
        let Codes { n_classes, columns, divisors } = &self.codes;
        losses.fill(0.0);
        for (score, codes) in scores.iter().zip(columns.chunks_exact(*n_classes)) {
            let costs = [self.loss.of_agreement(-score), 0.0, self.loss.of_agreement(*score)];
            for (sum, code) in losses.iter_mut().zip(codes) {
                *sum += costs[usize::from(*code)];
            }
        }
        for (sum, divisor) in losses.iter_mut().zip(divisors) {
            *sum /= divisor;
        }
        Ok(())
    }

    /// Mean losses of the classes from scores, row by row of one per learner, as [`decode`](Self::decode) has them.
    ///
    /// # Errors
    /// [`Error::Length`] for scores of no whole number of rows, [`Error::Score`] for one that is not finite.
    pub fn losses(&self, scores: &[f64]) -> Result<Vec<f64>, Error> {
        let (n_learners, n_classes) = (self.n_learners(), self.classes.len());
        let n_rows = scores.len() / n_learners;
        if n_rows * n_learners != scores.len() {
            return Err(Error::Length { what: "scores", expected: n_rows * n_learners, got: scores.len() });
        }
        let mut losses = filled(0.0, n_rows.saturating_mul(n_classes))?;
        let rows = scores.chunks_exact(n_learners).zip(losses.chunks_exact_mut(n_classes));
        for (row, (scores, losses)) in rows.enumerate() {
            self.decode(scores, losses).map_err(|error| error.after(row))?;
        }
        Ok(losses)
    }

    /// The answers for a batch of recordings.
    pub fn identify_batch(
        &self,
        wrench: &[f64],
        n_recordings: usize,
        threads: usize,
    ) -> Result<Vec<Answer>, Error> {
        let (scores, novelty) = self.scores_and_novelty(wrench, n_recordings, threads)?;
        let mut outcome = self.rules.outcome(self.classes.len());
        let answers = scores.chunks_exact(self.n_learners()).enumerate().map(|(row, scores)| {
            let mut losses = vec![0.0; self.classes.len()];
            self.decode(scores, &mut losses)?;
            let (best, _) = best_and_margin(&losses);
            let novelty = novelty.as_ref().map(|novelty| novelty[row]);
            self.apply_rules(&losses, novelty, &mut outcome);
            let (candidates, unknown) = (outcome.candidates().to_vec(), outcome.unknown());
            Ok(Answer { best, scores: scores.to_vec(), losses, candidates, unknown })
        });
        answers.collect()
    }

    /// The answer for one recording of `n_samples * n_axes` values, sample by sample.
    pub fn identify(&self, wrench: &[f64]) -> Result<Answer, Error> {
        let mut answers = self.identify_batch(wrench, 1, 1)?;
        answers.pop().ok_or(Error::Empty { what: "wrench", shape: vec![0] })
    }
}
