//! Weights of the learners, laid out in the order in which they are used.

use crate::kernel::{Isa, Job, LANES};
use crate::memory::filled;
use crate::Error;

/// Weights turned round: for each feature those of all learners, side by side and filled up with zeros to whole vectors.
/// Raw features stand sample by sample, as they come from a sensor, then those of the histograms.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Weights {
    pub(super) n_learners: usize,
    /// Numbers per feature.
    pub(super) lanes: usize,
    /// Features of the raw block.
    pub(super) n_raw: usize,
    n_samples: usize,
    n_axes: usize,
    values: Vec<f64>,
    intercept: Vec<f64>,
}

impl Weights {
    /// From weights by learner and feature. Of a coefficient that `coef` refuses the error is passed on.
    pub(super) fn new<E: From<Error>>(
        n_learners: usize,
        (n_samples, n_axes): (usize, usize),
        (n_raw, n_features): (usize, usize),
        coef: impl Fn(usize, usize) -> Result<f64, E>,
        mut intercept: Vec<f64>,
    ) -> Result<Self, E> {
        // Few learners are not filled up eightfold: a file must not ask for much more memory than it has bytes.
        let lanes = n_learners.next_multiple_of(n_learners.next_power_of_two().min(LANES));
        let mut values = filled(0.0, lanes.saturating_mul(n_features))?;
        for (row, weights) in values.chunks_exact_mut(lanes).enumerate() {
            let feature = if row < n_raw { row % n_axes * n_samples + row / n_axes } else { row };
            for (learner, weight) in weights[..n_learners].iter_mut().enumerate() {
                *weight = coef(learner, feature)?;
            }
        }
        intercept.resize(lanes, 0.0);
        Ok(Self { n_learners, lanes, n_raw, n_samples, n_axes, values, intercept })
    }

    /// Weights of all learners for the feature in place `row`: raw ones sample by sample, then the histograms.
    pub(super) fn row(&self, row: usize) -> &[f64] {
        self.values.get(row * self.lanes..(row + 1) * self.lanes).unwrap_or_default()
    }

    /// Rows of the raw block, then of the histograms.
    pub(super) fn blocks(&self) -> (&[f64], &[f64]) {
        self.values.split_at(self.n_raw * self.lanes)
    }

    /// Intercepts of all learners, filled up with zeros.
    pub(super) fn intercept(&self) -> &[f64] {
        &self.intercept
    }

    /// The weight of a feature in the order of `extract_features`.
    pub(super) fn coef(&self, learner: usize, feature: usize) -> f64 {
        let row = if feature < self.n_raw {
            feature % self.n_samples * self.n_axes + feature / self.n_samples
        } else {
            feature
        };
        self.row(row).get(learner).copied().unwrap_or_default()
    }

    /// Number of features.
    pub(super) fn n_features(&self) -> usize {
        self.values.len() / self.lanes
    }
}

/// Adds `weights * value`: the one place where scores grow, whether a recording comes whole or sample by sample.
#[inline(always)]
pub(crate) fn add(scores: &mut [f64], weights: &[f64], value: f64) {
    for (score, weight) in scores.iter_mut().zip(weights) {
        *score += weight * value;
    }
}

/// Adds rows of weights, each times its value and a scale, in their order.
///
/// Rows of value zero are left out, which changes no bit: a sum that began at zero is never minus zero.
pub(crate) struct AddRows<'a> {
    pub(crate) sums: &'a mut [f64],
    /// One row as long as `sums` for each value.
    pub(crate) rows: &'a [f64],
    pub(crate) values: &'a [f64],
    pub(crate) scale: f64,
}

impl Job for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { sums, rows, values, scale } = self;
        for (weights, value) in rows.chunks_exact(sums.len()).zip(values) {
            if *value != 0.0 {
                add(sums, weights, *value * scale);
            }
        }
    }
}

/// Adds rows of weights to the sums of several recordings at once, so that each row is brought from memory once. For each
/// recording the same bits as [`AddRows`].
pub(super) struct AddTeam<'a> {
    /// As many numbers per recording as a row has.
    pub(super) sums: &'a mut [f64],
    pub(super) lanes: usize,
    pub(super) rows: &'a [f64],
    /// A value per row and recording, recording by recording.
    pub(super) values: &'a [f64],
}

impl Job for AddTeam<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { sums, lanes, rows, values } = self;
        let n_rows = rows.len() / lanes;
        for (row, weights) in rows.chunks_exact(lanes).enumerate() {
            for (sums, values) in sums.chunks_exact_mut(lanes).zip(values.chunks_exact(n_rows)) {
                if values[row] != 0.0 {
                    add(sums, weights, values[row]);
                }
            }
        }
    }
}
