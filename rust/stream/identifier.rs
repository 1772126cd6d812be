//! Answers that grow with the samples.

use std::sync::Arc;

use super::extractor::{StreamingExtractor, Windows};
use super::outlook::{Outlook, SoFar};
use super::settled::Race;
use crate::error::Result;
use crate::lanes::Path;
use crate::model::{best_and_margin, AddRows, Model};

/// Names the material while its samples arrive.
///
/// Scores are linear in the features, so they grow with each sample. The answer of a complete window is that of
/// [`Model::identify`] for the same samples, bit for bit; with a hop the histograms are those of a filter that never
/// stops, as [`StreamingExtractor`] says. Before that the answer is provisional: samples that have not arrived count as the
/// mean of the training recordings (as zero where the model has none), and histograms are scaled up to a whole window.
///
/// All memory is allocated at construction. [`push`](Self::push), [`standing`](Self::standing) and the others allocate
/// nothing and never block. [`advance`](Self::advance) adds up the samples that windows share once more, in their new
/// places: about as much work as pushing them.
#[derive(Clone, Debug)]
pub struct StreamingIdentifier {
    model: Arc<Model>,
    stream: StreamingExtractor,
    outlook: Outlook,
    path: Path,
    /// Sums of the raw block so far.
    raw: Vec<f64>,
    /// Whether scores and losses are those of the samples so far.
    is_fresh: bool,
    scores: Vec<f64>,
    losses: Vec<f64>,
    /// Room for a row, histogram features, sums over them, bounds of scores.
    row: Vec<f64>,
    values: Vec<f64>,
    sums: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    race: Race,
}

/// Where a window stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing<'a> {
    /// Rows of the window so far.
    pub n_seen: usize,
    /// Score of each learner.
    pub scores: &'a [f64],
    /// Mean loss of each class.
    pub losses: &'a [f64],
    /// Index of the class with the smallest loss; the first of equal ones.
    pub best: usize,
    /// By how much the second loss is larger than the first.
    pub margin: f64,
    /// Whether all rows of the window are there.
    pub is_final: bool,
    /// Whether the answer can no longer change, as [`StreamingIdentifier::is_settled`] says.
    pub is_settled: bool,
    /// Whether the margin meets the rule for early answers of the model.
    pub is_sure: bool,
}

impl StreamingIdentifier {
    /// A stream before its first row: windows of the model's size, one or every `hop` samples.
    pub fn new(model: Arc<Model>, hop: Option<usize>) -> Result<Self> {
        let windows = Windows { n_samples: model.n_samples(), n_axes: model.n_axes(), hop };
        let stream = StreamingExtractor::new(model.extractor(), windows)?;
        let lanes = model.lanes();
        Ok(Self {
            outlook: Outlook::new(&model),
            path: Path::detect(),
            row: vec![0.0; model.n_axes()],
            raw: vec![0.0; lanes],
            is_fresh: false,
            scores: vec![0.0; model.n_learners()],
            losses: vec![0.0; model.classes().len()],
            values: vec![0.0; model.n_features() - model.n_raw()],
            sums: vec![0.0; lanes],
            low: vec![0.0; lanes],
            high: vec![0.0; lanes],
            race: Race::new(&model),
            stream,
            model,
        })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The samples: how many there are, and their features.
    #[must_use]
    pub fn stream(&self) -> &StreamingExtractor {
        &self.stream
    }

    /// Takes rows of one value per axis, in N and N m, until the window is complete. Returns how many it took.
    ///
    /// # Errors
    /// Those of [`StreamingExtractor::push`]; nothing has changed then.
    pub fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let (first, ahead) = (self.stream.n_seen(), self.stream.ahead());
        let n_taken = self.stream.push(rows)?;
        self.is_fresh &= n_taken == 0;
        let n_axes = self.model.n_axes();
        let of_window = rows[..n_taken * n_axes].get(ahead.saturating_mul(n_axes)..).unwrap_or_default();
        self.add_raw(first, of_window);
        Ok(n_taken)
    }

    /// Goes on to the next window, as [`StreamingExtractor::advance`] does.
    pub fn advance(&mut self) -> Result<()> {
        self.stream.advance()?;
        self.is_fresh = false;
        self.raw.fill(0.0);
        let mut row = std::mem::take(&mut self.row);
        for t in 0..self.stream.n_seen() {
            if self.stream.raw_row(t, &mut row) {
                self.add_raw(t, &row);
            }
        }
        self.row = row;
        Ok(())
    }

    /// Back to the state before the first row.
    pub fn reset(&mut self) {
        self.stream.reset();
        self.raw.fill(0.0);
        self.is_fresh = false;
    }

    /// Scores of the learners: those of [`Model::scores`] once the window is complete, provisional before.
    ///
    /// # Errors
    /// [`Error::Score`](crate::Error::Score) when a score leaves float64.
    pub fn scores(&mut self) -> Result<&[f64]> {
        self.refresh()?;
        Ok(&self.scores)
    }

    /// Mean losses of the classes; the smallest wins, the first of equal ones.
    ///
    /// # Errors
    /// As [`scores`](Self::scores).
    pub fn losses(&mut self) -> Result<&[f64]> {
        self.refresh()?;
        Ok(&self.losses)
    }

    /// Whether the answer can no longer change: the best class so far wins wherever the remaining forces lie within the
    /// range that the training recordings had at their instants, and wherever their counts fall. Rigorous, rounding
    /// included. Always true once the window is complete; never before for a model with raw features and no such range.
    ///
    /// # Errors
    /// As [`scores`](Self::scores).
    pub fn is_settled(&mut self) -> Result<bool> {
        self.refresh()?;
        if self.stream.is_complete() {
            return Ok(true);
        }
        let so_far = SoFar {
            n_seen: self.stream.n_seen(),
            raw: &self.raw,
            histograms: self.stream.counts().map(|counts| (counts, &self.values[..])),
        };
        let best = best_and_margin(&self.losses).0;
        Ok(self.outlook.bound_scores(
            self.path,
            &self.model,
            &so_far,
            &mut self.sums,
            &mut self.low,
            &mut self.high,
        ) && self.race.is_won(&self.model, best, &self.low, &self.high))
    }

    /// Everything about the answer so far.
    ///
    /// # Errors
    /// As [`scores`](Self::scores).
    pub fn standing(&mut self) -> Result<Standing<'_>> {
        let is_settled = self.is_settled()?;
        let n_seen = self.stream.n_seen();
        let (best, margin) = best_and_margin(&self.losses);
        Ok(Standing {
            n_seen,
            scores: &self.scores,
            losses: &self.losses,
            best,
            margin,
            is_final: self.stream.is_complete(),
            is_settled,
            is_sure: self.model.margin_needed(n_seen).is_some_and(|needed| margin >= needed),
        })
    }

    /// Adds rows of samples from `first` on to the sums of the raw block.
    fn add_raw(&mut self, first: usize, values: &[f64]) {
        let rows = self.model.raw_rows(first);
        self.path.run(AddRows { sums: &mut self.raw, rows, values, scale: 1.0 });
    }

    /// Brings scores and losses up to the last sample.
    fn refresh(&mut self) -> Result<()> {
        if self.is_fresh {
            return Ok(());
        }
        let (n_seen, n_samples) = (self.stream.n_seen(), self.model.n_samples());
        self.sums.fill(0.0);
        if let Some(counts) = self.stream.counts() {
            let extractor = self.model.extractor();
            counts.write(extractor, &mut self.values);
            // Of a whole window exactly 1; densities are those of a whole window already.
            let scale = if extractor.spec().density { 1.0 } else { n_samples as f64 / n_seen.max(1) as f64 };
            let (rows, values) = (self.model.hist_rows(0), &self.values);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale });
        }
        let expected = if n_seen < n_samples { self.outlook.expected(n_seen) } else { None };
        for (learner, (score, hist)) in self.scores.iter_mut().zip(&self.sums).enumerate() {
            let mut raw = self.raw[learner];
            if let Some(expected) = expected {
                raw += expected[learner];
            }
            *score = (self.model.intercept()[learner] + raw) + hist;
        }
        self.model.decode(&self.scores, &mut self.losses)?;
        self.is_fresh = true;
        Ok(())
    }
}
