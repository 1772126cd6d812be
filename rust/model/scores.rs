//! From recordings to scores: the weights of the learners, and sums in the order that a model promises.

use super::rules::Novelty;
use super::tensor::Tensor;
use super::{Model, ModelError};
use crate::error::Error;
use crate::kernel::{Job, Simd, SimdPath, LANES};
use crate::memory::{collected, filled};
use crate::parallel::in_pieces;
use crate::BatchShape;

/// Recordings of a block: they share each row of weights on its way through the caches.
const BLOCK: usize = 4;

/// Weights turned round: for each feature those of all learners, side by side and filled up with zeros to whole vectors.
/// Raw features stand sample by sample, as they come from a sensor, then all others.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Weights {
    pub(super) n_learners: usize,
    /// Features of the raw block.
    pub(super) n_raw: usize,
    /// Numbers per feature.
    lanes: usize,
    n_samples: usize,
    n_axes: usize,
    values: Vec<f64>,
    intercept: Vec<f64>,
}

impl Weights {
    /// From weights whose shape is checked already; refuses NaN and infinity.
    pub(super) fn new(
        coef: &Tensor<'_>,
        mut intercept: Vec<f64>,
        (n_samples, n_axes): (usize, usize),
        (n_raw, n_features): (usize, usize),
    ) -> Result<Self, ModelError> {
        let n_learners = intercept.len();
        // Few learners are not filled up eightfold: a model must not take much more memory than its file has bytes.
        let lanes = n_learners.next_multiple_of(n_learners.next_power_of_two().min(LANES));
        let mut values = filled(0.0, lanes.saturating_mul(n_features))?;
        for (row, weights) in values.chunks_exact_mut(lanes).enumerate() {
            let feature = place(row, n_raw, n_samples, n_axes);
            for (learner, weight) in weights[..n_learners].iter_mut().enumerate() {
                *weight = coef.finite("coef", learner * n_features + feature)?;
            }
        }
        intercept.resize(lanes, 0.0);
        Ok(Self { n_learners, n_raw, lanes, n_samples, n_axes, values, intercept })
    }

    pub(super) fn n_features(&self) -> usize {
        self.values.len() / self.lanes
    }

    /// The feature, in the order of names, that a row of weights is for.
    pub(super) fn feature_of(&self, row: usize) -> usize {
        place(row, self.n_raw, self.n_samples, self.n_axes)
    }

    /// The row of weights of a feature.
    pub(super) fn row_of(&self, feature: usize) -> usize {
        place(feature, self.n_raw, self.n_axes, self.n_samples)
    }

    /// The weight of a feature in the order of its names; 0 where there is none.
    pub(super) fn coef(&self, learner: usize, feature: usize) -> f64 {
        if learner >= self.n_learners || feature >= self.n_features() {
            return 0.0;
        }
        self.values[self.row_of(feature) * self.lanes + learner]
    }

    /// Rows of the raw block, then of all other features.
    fn blocks(&self) -> (&[f64], &[f64]) {
        self.values.split_at(self.n_raw * self.lanes)
    }
}

/// The place of a raw value, in rows of `n_columns`, after turning rows and columns round; of another value its own.
fn place(index: usize, n_raw: usize, n_rows: usize, n_columns: usize) -> usize {
    if index < n_raw {
        index % n_columns * n_rows + index / n_columns
    } else {
        index
    }
}

/// Adds `weights * value`: the one place where scores grow, whether a recording comes whole or sample by sample.
#[inline(always)]
fn add(scores: &mut [f64], weights: &[f64], value: f64) {
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
    fn run<S: Simd>(self, _simd: S) {
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
struct AddRowsToBlock<'a> {
    /// As many numbers per recording as a row has.
    sums: &'a mut [f64],
    lanes: usize,
    rows: &'a [f64],
    /// A value per row and recording, recording by recording.
    values: &'a [f64],
}

impl Job for AddRowsToBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) {
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

impl Model {
    /// The size of a batch for this model.
    #[must_use]
    pub fn batch(&self, n_recordings: usize) -> BatchShape {
        BatchShape { n_recordings, n_samples: self.n_samples, n_axes: self.n_axes }
    }

    /// Scores of all learners into `out`, one row per recording of `wrench`
    /// (`[(recording * n_samples + sample) * n_axes + axis]`). 1 and n threads give the same bits.
    ///
    /// On an error `out` holds unspecified numbers.
    pub fn scores_into(
        &self,
        wrench: &[f64],
        n_recordings: usize,
        threads: usize,
        out: &mut [f64],
    ) -> Result<(), Error> {
        self.measure_into(wrench, n_recordings, threads, None, out)
    }

    /// Scores of all learners, one row per recording, and the novelty of each where the model refuses unknown materials.
    #[doc(hidden)]
    pub fn scores_and_novelty(
        &self,
        wrench: &[f64],
        n_recordings: usize,
        threads: usize,
    ) -> Result<(Vec<f64>, Option<Vec<f64>>), Error> {
        let Some(unknown) = &self.novelty else {
            return Ok((self.scores(wrench, n_recordings, threads)?, None));
        };
        self.extraction.check(wrench, self.batch(n_recordings))?;
        let width = self.n_learners() + 1;
        let mut rows = filled(0.0, n_recordings.saturating_mul(width))?;
        self.measure_into(wrench, n_recordings, threads, Some(unknown), &mut rows)?;
        let novelty = collected(rows.chunks_exact(width).map(|row| row[width - 1]))?;
        let mut next = 0;
        rows.retain(|_| {
            next += 1;
            next % width != 0
        });
        Ok((rows, Some(novelty)))
    }

    /// A row of scores for each recording, with its novelty behind them where that is wanted.
    fn measure_into(
        &self,
        wrench: &[f64],
        n_recordings: usize,
        threads: usize,
        novelty: Option<&Novelty>,
        out: &mut [f64],
    ) -> Result<(), Error> {
        let shape = self.batch(n_recordings);
        self.extraction.check(wrench, shape)?;
        let path = SimdPath::detect()?;
        let width = self.n_learners() + usize::from(novelty.is_some());
        in_pieces(wrench, shape, (width, BLOCK), threads, out, |wrench, shape, out| {
            let features = self.extraction.extract(wrench, shape)?;
            let n_features = features.len() / shape.n_recordings;
            let mut sums = filled(0.0, 2 * BLOCK * self.lanes())?;
            let blocks = wrench.chunks(BLOCK * shape.recording_len()).zip(out.chunks_mut(BLOCK * width));
            for (block, (wrench, out)) in blocks.enumerate() {
                let first = block * BLOCK;
                let features = features.get(first * n_features..).unwrap_or_default();
                self.block_scores(path, wrench, features, &mut sums, (out, width));
            }
            let mut sums = filled(0.0, novelty.map_or(0, Novelty::width))?;
            for (recording, row) in out.chunks_exact_mut(width).enumerate() {
                let (scores, rest) = row.split_at_mut(self.n_learners());
                self.check_scores(scores).map_err(|error| error.after(recording))?;
                let Some(novelty) = novelty else { continue };
                sums.fill(0.0);
                let raw = &wrench[recording * shape.recording_len()..][..self.n_raw()];
                novelty.add(path, &mut sums, 0, raw);
                novelty.add(path, &mut sums, self.n_raw(), &features[recording * n_features..][..n_features]);
                rest.fill(self.rules.novelty_of(novelty, &sums));
            }
            Ok(())
        })
    }

    /// Scores of all learners, one row per recording.
    pub fn scores(&self, wrench: &[f64], n_recordings: usize, threads: usize) -> Result<Vec<f64>, Error> {
        self.extraction.check(wrench, self.batch(n_recordings))?;
        let mut out = filled(0.0, n_recordings.saturating_mul(self.n_learners()))?;
        self.scores_into(wrench, n_recordings, threads, &mut out)?;
        Ok(out)
    }

    /// Scores of a block of recordings, each row of weights read once.
    fn block_scores(
        &self,
        path: SimdPath,
        wrench: &[f64],
        features: &[f64],
        sums: &mut [f64],
        (out, width): (&mut [f64], usize),
    ) {
        let lanes = self.lanes();
        let (raw_rows, other_rows) = self.weights.blocks();
        let (raw, hist) = sums.split_at_mut(BLOCK * lanes);
        for (sums, rows, values) in [(&mut *raw, raw_rows, wrench), (&mut *hist, other_rows, features)] {
            sums.fill(0.0);
            path.run(AddRowsToBlock { sums, lanes, rows, values });
        }
        let sums = raw.chunks_exact(lanes).zip(hist.chunks_exact(lanes));
        for (out, (raw, hist)) in out.chunks_exact_mut(width).zip(sums) {
            let out = &mut out[..self.n_learners()];
            for (((score, intercept), raw), hist) in out.iter_mut().zip(self.intercept()).zip(raw).zip(hist) {
                *score = (intercept + raw) + hist;
            }
        }
    }

    /// Refuses scores that are NaN or infinite, one row per recording.
    pub(super) fn check_scores(&self, scores: &[f64]) -> Result<(), Error> {
        let Some(index) = scores.iter().position(|score| !score.is_finite()) else { return Ok(()) };
        let (recording, learner) = (index / self.n_learners(), index % self.n_learners());
        Err(Error::Score { recording, learner, value: scores[index] })
    }
}

/// For streams: the same weights in the same order of addition. Rows have [`lanes`](Self::lanes) numbers, those beyond the
/// number of learners zero.
impl Model {
    /// Numbers in a row of weights.
    pub(crate) fn lanes(&self) -> usize {
        self.weights.lanes
    }

    /// Rows of weights of raw samples from `sample` on, axis by axis for each; empty without a raw block.
    pub(crate) fn raw_rows(&self, sample: usize) -> &[f64] {
        let (raw, _) = self.weights.blocks();
        raw.get(sample * self.n_axes * self.lanes()..).unwrap_or_default()
    }

    /// Rows of weights of features behind the raw ones, from the one in place `first` on.
    pub(crate) fn rows_from(&self, first: usize) -> &[f64] {
        let (_, rest) = self.weights.blocks();
        rest.get(first * self.lanes()..).unwrap_or_default()
    }

    /// Intercepts of all learners, filled up with zeros.
    pub(crate) fn intercept(&self) -> &[f64] {
        &self.weights.intercept
    }
}
