//! Can another class still win?

use crate::model::Model;

/// The classes' room to differ, and memory for it.
#[derive(Clone, Debug)]
pub(super) struct Race {
    /// One over what the sum of the losses of each class is divided by.
    shares: Vec<f64>,
    /// Per class: by how much more than the best it loses at least.
    gaps: Vec<f64>,
    /// Per class: the magnitudes that were added up.
    sizes: Vec<f64>,
}

impl Race {
    pub(super) fn new(model: &Model) -> Self {
        let n_classes = model.classes().len();
        let shares = (0..n_classes).map(|class| 1.0 / model.divisor(class)).collect();
        Self { shares, gaps: vec![0.0; n_classes], sizes: vec![0.0; n_classes] }
    }

    /// True when the mean loss of class `best` stays below that of every other, wherever the scores end within their
    /// bounds.
    ///
    /// Learners are taken one by one. The difference of what a score costs two classes is a monotone function of it, for
    /// every loss and any codes, so its least value lies at one of the bounds.
    pub(super) fn is_won(&mut self, model: &Model, best: usize, low: &[f64], high: &[f64]) -> bool {
        let n_learners = model.n_learners();
        let costs = |score: f64| [model.loss().of_agreement(-score), 0.0, model.loss().of_agreement(score)];
        self.gaps.fill(0.0);
        self.sizes.fill(0.0);
        for (learner, (low, high)) in low.iter().zip(high).enumerate().take(n_learners) {
            let codes = model.codes_of(learner);
            let (at_low, at_high) = (costs(*low), costs(*high));
            let of = |class: usize| {
                let code = codes.get(class).map_or(1, |code| usize::from(*code));
                (at_low[code] * self.shares[class], at_high[code] * self.shares[class])
            };
            let own = of(best);
            for (class, (gap, size)) in self.gaps.iter_mut().zip(&mut self.sizes).enumerate() {
                let other = of(class);
                *gap += (other.0 - own.0).min(other.1 - own.1);
                *size += other.0.abs() + other.1.abs() + own.0.abs() + own.1.abs();
            }
        }
        // Some roundings per learner, here and in the losses that will be compared, and then some.
        let rounding = (4 * n_learners + 64) as f64 * f64::EPSILON;
        let mut others = self.gaps.iter().zip(&self.sizes).enumerate().filter(|(class, _)| *class != best);
        others.all(|(_, (gap, size))| *gap > rounding * size)
    }
}
