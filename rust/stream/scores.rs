//! Scores of a stream: those of samples and histograms grow with each sample, those of multi-band features are computed when
//! somebody asks.

use super::extractor::StreamingExtractor;
use super::{Position, Windows};
use crate::error::{Error, Result};
use crate::kernel::SimdPath;
use crate::memory::filled;
use crate::model::{AddRows, Model};
use crate::multiband::{MultiBand, Workspace, TOO_LOUD};
use crate::Extractor;

/// Sums over the samples so far, and what the rest is expected to add.
#[derive(Clone, Debug)]
pub(super) struct PaperStream {
    pub(super) stream: StreamingExtractor,
    /// Row `t`: what samples from `t` on add if they are the mean of the training recordings. Empty without a mean.
    expected: Vec<f64>,
    path: SimdPath,
    /// Sums of the raw block so far.
    raw: Vec<f64>,
    /// Sums of the novelty over the raw block so far, then over all features; empty where unknown materials are not refused.
    novelty: [Vec<f64>; 2],
    /// Room for a row, histogram features, sums over them.
    row: Vec<f64>,
    values: Vec<f64>,
    sums: Vec<f64>,
}

impl PaperStream {
    pub(super) fn new(model: &Model, extractor: &Extractor, windows: Windows) -> Result<Self> {
        let lanes = model.lanes();
        Ok(Self {
            stream: StreamingExtractor::new(extractor, windows)?,
            expected: expected_sums(model)?,
            path: SimdPath::detect()?,
            raw: filled(0.0, lanes)?,
            novelty: [filled(0.0, model.novelty_width())?, filled(0.0, model.novelty_width())?],
            row: filled(0.0, model.n_axes())?,
            values: filled(0.0, model.n_features() - model.n_raw())?,
            sums: filled(0.0, lanes)?,
        })
    }

    pub(super) fn push(&mut self, model: &Model, rows: &[f64]) -> Result<usize> {
        let Position { n_seen: first, ahead, .. } = *self.stream.position();
        let n_taken = self.stream.push(rows)?;
        let n_axes = model.n_axes();
        let of_window = rows[..n_taken * n_axes].get(ahead.saturating_mul(n_axes)..).unwrap_or_default();
        self.add_raw(model, first, of_window);
        Ok(n_taken)
    }

    /// Adds up the samples that windows share once more, in their new places.
    pub(super) fn next_window(&mut self, model: &Model) -> Result<()> {
        self.stream.next_window()?;
        self.raw.fill(0.0);
        self.novelty[0].fill(0.0);
        let mut row = std::mem::take(&mut self.row);
        for t in 0..self.stream.n_seen() {
            if self.stream.raw_row(t, &mut row) {
                self.add_raw(model, t, &row);
            }
        }
        self.row = row;
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.stream.reset();
        self.raw.fill(0.0);
        self.novelty[0].fill(0.0);
    }

    /// Scores of the learners from the samples so far, and what is expected of the others.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) {
        let (n_seen, n_samples) = (self.stream.n_seen(), model.n_samples());
        self.sums.fill(0.0);
        if let Some(histograms) = self.stream.histograms() {
            let extractor = self.stream.extractor();
            histograms.write(extractor, &mut self.values);
            // Of a whole window exactly 1; densities are those of a whole window already.
            let scale = if extractor.spec().density { 1.0 } else { n_samples as f64 / n_seen.max(1) as f64 };
            let (rows, values) = (model.rows_from(0), &self.values);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale });
        }
        let is_expected = n_seen < n_samples && !self.expected.is_empty();
        let rest = is_expected.then(|| &self.expected[n_seen * model.lanes()..]);
        for (learner, (score, hist)) in out.iter_mut().zip(&self.sums).enumerate() {
            let mut raw = self.raw[learner];
            if let Some(rest) = rest {
                raw += rest[learner];
            }
            *score = (model.intercept()[learner] + raw) + hist;
        }
    }

    /// The novelty of the whole window whose scores were computed last.
    pub(super) fn novelty(&mut self, model: &Model) -> Option<f64> {
        let [raw, all] = &mut self.novelty;
        all.copy_from_slice(raw);
        model.add_novelty(self.path, all, model.n_raw(), &self.values);
        model.novelty_of(all)
    }

    /// Adds rows of samples from `first` on to the sums of the raw block.
    fn add_raw(&mut self, model: &Model, first: usize, values: &[f64]) {
        let rows = model.raw_rows(first);
        self.path.run(AddRows { sums: &mut self.raw, rows, values, scale: 1.0 });
        if model.n_raw() > 0 {
            model.add_novelty(self.path, &mut self.novelty[0], first * model.n_axes(), values);
        }
    }
}

/// Row `t` of the result: what raw samples from `t` on add to the scores if they are the mean of the training recordings.
/// Empty for a model that knows no mean.
fn expected_sums(model: &Model) -> Result<Vec<f64>> {
    let Some(mean) = model.raw_mean() else { return Ok(Vec::new()) };
    let (lanes, n_samples) = (model.lanes(), model.n_samples());
    let mut sums = filled(0.0, (n_samples + 1).saturating_mul(lanes))?;
    for t in (0..n_samples).rev() {
        let (here, later) = sums[t * lanes..].split_at_mut(lanes);
        here.copy_from_slice(&later[..lanes]);
        for (axis, weights) in model.raw_rows(t).chunks_exact(lanes).take(model.n_axes()).enumerate() {
            let mean = mean[axis * n_samples + t];
            for (sum, weight) in here.iter_mut().zip(weights) {
                *sum += weight * mean;
            }
        }
    }
    Ok(sums)
}

/// The rows of a window, and room for their features.
#[derive(Clone, Debug)]
pub(super) struct MultiBandStream {
    position: Position,
    /// Room for the rows of a window, side by side as a recording has them.
    values: Vec<f64>,
    multiband: MultiBand,
    work: Workspace,
    features: Vec<f64>,
    sums: Vec<f64>,
    /// Sums of the novelty; empty where unknown materials are not refused.
    novelty: Vec<f64>,
    path: SimdPath,
}

impl MultiBandStream {
    pub(super) fn new(model: &Model, multiband: &MultiBand, windows: Windows) -> Result<Self> {
        windows.check(1)?;
        Ok(Self {
            position: Position::new(windows),
            values: filled(0.0, windows.n_samples * windows.n_axes)?,
            work: multiband.workspace()?,
            features: filled(0.0, multiband.n_features())?,
            sums: filled(0.0, model.lanes())?,
            novelty: filled(0.0, model.novelty_width())?,
            path: SimdPath::detect()?,
            multiband: multiband.clone(),
        })
    }

    pub(super) fn position(&self) -> &Position {
        &self.position
    }

    /// Takes rows of magnitudes up to the limit of each axis; on an error none.
    pub(super) fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let Position { windows: Windows { n_axes, .. }, n_seen, ahead, .. } = self.position;
        let rows = self.position.taken(rows)?;
        let n_taken = rows.len() / n_axes;
        let passed = ahead.min(n_taken);
        let of_window = &rows[passed * n_axes..];
        for (row, values) in (passed..).zip(of_window.chunks_exact(n_axes)) {
            let mut limits = values.iter().zip(self.multiband.limits());
            if let Some(axis) = limits.position(|(value, limit)| value.abs() > *limit) {
                return Err(Error::TooLargeRow { row, axis, value: values[axis], limit: TOO_LOUD });
            }
        }
        self.values[n_seen * n_axes..][..of_window.len()].copy_from_slice(of_window);
        self.position.ahead -= passed;
        self.position.n_seen += n_taken - passed;
        Ok(n_taken)
    }

    /// Goes on to the next window, which is a recording of its own.
    pub(super) fn next_window(&mut self) -> Result<()> {
        let leaving = self.position.next_window()?;
        self.values.copy_within(leaving * self.position.windows.n_axes.., 0);
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.position = Position::new(self.position.windows);
    }

    /// The novelty of the window whose scores were computed last.
    pub(super) fn novelty(&mut self, model: &Model) -> Option<f64> {
        self.novelty.fill(0.0);
        model.add_novelty(self.path, &mut self.novelty, 0, &self.features);
        model.novelty_of(&self.novelty)
    }

    /// Scores of the learners from the rows so far; before the first the intercepts.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) -> Result<()> {
        self.sums.fill(0.0);
        if self.position.n_seen > 0 {
            let seen = &self.values[..self.position.n_seen * self.position.windows.n_axes];
            self.multiband.extract_on(self.path, seen, &mut self.work, &mut self.features)?;
            let (rows, values) = (model.rows_from(0), &self.features);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale: 1.0 });
        }
        for ((score, sum), intercept) in out.iter_mut().zip(&self.sums).zip(model.intercept()) {
            *score = intercept + sum;
        }
        Ok(())
    }
}
