//! Scores of samples and histograms, which grow with each sample.

use super::extractor::StreamingExtractor;
use super::outlook::{Outlook, SoFar};
use super::settled::Race;
use super::windows::Windows;
use crate::error::Result;
use crate::kernel::SimdPath;
use crate::memory::filled;
use crate::model::{AddRows, Model};
use crate::Extractor;

/// Sums over the samples so far, and what the rest may add.
#[derive(Clone, Debug)]
pub(super) struct Growing {
    pub(super) stream: StreamingExtractor,
    outlook: Outlook,
    path: SimdPath,
    /// Sums of the raw block so far.
    raw: Vec<f64>,
    /// Room for a row, histogram features, sums over them, bounds of scores.
    row: Vec<f64>,
    values: Vec<f64>,
    sums: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    race: Race,
}

impl Growing {
    pub(super) fn new(model: &Model, extractor: &Extractor, windows: Windows) -> Result<Self> {
        let lanes = model.lanes();
        Ok(Self {
            stream: StreamingExtractor::new(extractor, windows)?,
            outlook: Outlook::new(model, extractor)?,
            path: SimdPath::detect()?,
            raw: filled(0.0, lanes)?,
            row: filled(0.0, model.n_axes())?,
            values: filled(0.0, model.n_features() - model.n_raw())?,
            sums: filled(0.0, lanes)?,
            low: filled(0.0, lanes)?,
            high: filled(0.0, lanes)?,
            race: Race::new(model),
        })
    }

    pub(super) fn push(&mut self, model: &Model, rows: &[f64]) -> Result<usize> {
        let (first, ahead) = (self.stream.n_seen(), self.stream.ahead());
        let n_taken = self.stream.push(rows)?;
        let n_axes = model.n_axes();
        let of_window = rows[..n_taken * n_axes].get(ahead.saturating_mul(n_axes)..).unwrap_or_default();
        self.add_raw(model, first, of_window);
        Ok(n_taken)
    }

    /// Adds up the samples that windows share once more, in their new places.
    pub(super) fn advance(&mut self, model: &Model) -> Result<()> {
        self.stream.advance()?;
        self.raw.fill(0.0);
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
    }

    /// Scores of the learners from the samples so far, and what is expected of the others.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) {
        let (n_seen, n_samples) = (self.stream.n_seen(), model.n_samples());
        self.sums.fill(0.0);
        if let Some(counts) = self.stream.counts() {
            let extractor = self.stream.extractor();
            counts.write(extractor, &mut self.values);
            // Of a whole window exactly 1; densities are those of a whole window already.
            let scale = if extractor.spec().density { 1.0 } else { n_samples as f64 / n_seen.max(1) as f64 };
            let (rows, values) = (model.rows_from(0), &self.values);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale });
        }
        let expected = if n_seen < n_samples { self.outlook.expected(n_seen) } else { None };
        for (learner, (score, hist)) in out.iter_mut().zip(&self.sums).enumerate() {
            let mut raw = self.raw[learner];
            if let Some(expected) = expected {
                raw += expected[learner];
            }
            *score = (model.intercept()[learner] + raw) + hist;
        }
    }

    /// Whether class `best` wins wherever the rest of the samples lies; after [`scores`](Self::scores).
    pub(super) fn is_settled(&mut self, model: &Model, best: usize) -> bool {
        let so_far = SoFar {
            n_seen: self.stream.n_seen(),
            raw: &self.raw,
            histograms: self.stream.counts().map(|counts| (counts, &self.values[..])),
            extractor: self.stream.extractor(),
        };
        let (low, high) = (&mut self.low, &mut self.high);
        self.outlook.bound_scores(self.path, model, &so_far, &mut self.sums, low, high)
            && self.race.is_won(model, best, low, high)
    }

    /// Adds rows of samples from `first` on to the sums of the raw block.
    fn add_raw(&mut self, model: &Model, first: usize, values: &[f64]) {
        let rows = model.raw_rows(first);
        self.path.run(AddRows { sums: &mut self.raw, rows, values, scale: 1.0 });
    }
}
