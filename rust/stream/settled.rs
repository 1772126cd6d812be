//! Can another class still win?

use crate::model::Model;

/// Sums over the learners, one per class.
#[derive(Clone, Debug)]
pub(super) struct Race {
    gaps: Vec<f64>,
    sizes: Vec<f64>,
}

impl Race {
    pub(super) fn new(n_classes: usize) -> Self {
        Self { gaps: vec![0.0; n_classes], sizes: vec![0.0; n_classes] }
    }

    /// True when the mean loss of class `best` stays below that of every other, wherever the scores end within their
    /// bounds.
    ///
    /// Learners are taken one by one. The difference of what a score costs two classes is a monotone function of it, for
    /// every loss and any codes, so its least value lies at one of the bounds.
    pub(super) fn is_won(&mut self, model: &Model, best: usize, low: &[f64], high: &[f64]) -> bool {
        let n_learners = model.n_learners();
        let of = |score: f64| [model.loss().of_agreement(-score), 0.0, model.loss().of_agreement(score)];
        self.gaps.fill(0.0);
        self.sizes.fill(0.0);
        for (learner, (low, high)) in low.iter().zip(high).enumerate().take(n_learners) {
            let ends = [of(*low), of(*high)];
            let costs = |class| {
                let place = match model.code(class, learner) {
                    -1 => 0,
                    0 => 1,
                    _ => 2,
                };
                ends.map(|end| end[place] / model.divisor(class))
            };
            let own = costs(best);
            for (class, (gap, size)) in self.gaps.iter_mut().zip(&mut self.sizes).enumerate() {
                let other = costs(class);
                *gap += (other[0] - own[0]).min(other[1] - own[1]);
                *size += other.iter().chain(&own).map(|cost| cost.abs()).sum::<f64>();
            }
        }
        let rounding = (4 * n_learners + 64) as f64 * f64::EPSILON;
        let mut others = self.gaps.iter().zip(&self.sizes).enumerate().filter(|(class, _)| *class != best);
        others.all(|(_, (gap, size))| *gap > rounding * size)
    }
}
