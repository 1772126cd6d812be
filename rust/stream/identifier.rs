//! Answers while the samples arrive.

use std::sync::Arc;

use super::scores::{MultiBandStream, PaperStream};
use super::{Position, Windows};
use crate::error::Result;
use crate::memory::filled;
use crate::model::{best_and_margin, Extraction, Model, RuleOutcome};

/// Names the material while its samples arrive.
///
/// The answer of a complete window is that of [`Model::identify`] for the same samples, bit for bit. Before that it is
/// provisional.
///
/// - **Samples and histograms**: scores are linear in the features, so they grow with each sample. Samples that have not
///   arrived count as the mean of the training recordings (as zero where the model has none), and histograms are scaled
///   up to a whole window. With a hop they are those of a filter that never stops, as of a
///   [`StreamingExtractor`](super::StreamingExtractor). [`next_window`](Self::next_window) adds up the samples that
///   windows share once more, in their new places: about as much work as pushing them.
/// - **Multi-band features**: the rows so far are taken as the beginning of a recording, and its features are computed with
///   each answer. With a hop each window is a recording of its own.
///
/// All memory is allocated at construction. [`push`](Self::push), [`standing`](Self::standing) and the others allocate
/// nothing and never block.
#[derive(Clone, Debug)]
pub struct StreamingIdentifier {
    model: Arc<Model>,
    stream: Stream,
    /// True while scores and losses are those of the samples so far.
    is_fresh: bool,
    scores: Vec<f64>,
    losses: Vec<f64>,
    /// True once the rules have been applied to them.
    is_judged: bool,
    outcome: RuleOutcome,
}

/// How samples become scores.
#[derive(Clone, Debug)]
enum Stream {
    Paper(Box<PaperStream>),
    MultiBand(Box<MultiBandStream>),
}

/// Where a window stands.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
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
    /// Whether the margin meets the rule for early answers of the model.
    pub is_sure: bool,
    /// As of [`Answer`](crate::model::Answer); empty before the window is complete.
    pub candidates: &'a [usize],
    /// As of [`Answer`](crate::model::Answer); `None` before the window is complete.
    pub unknown: Option<bool>,
}

impl StreamingIdentifier {
    /// A stream before its first row: windows of the model's size, one or every `hop` samples.
    pub fn new(model: Arc<Model>, hop: Option<usize>) -> Result<Self> {
        let windows = Windows::new(model.n_samples(), model.n_axes()).with_hop(hop);
        let stream = match model.extraction() {
            Extraction::Paper { extractor, .. } => {
                Stream::Paper(Box::new(PaperStream::new(&model, extractor, windows)?))
            }
            Extraction::MultiBand(multiband) => {
                Stream::MultiBand(Box::new(MultiBandStream::new(&model, multiband, windows)?))
            }
        };
        Ok(Self {
            stream,
            is_fresh: false,
            scores: filled(0.0, model.n_learners())?,
            losses: vec![0.0; model.classes().len()],
            is_judged: false,
            outcome: model.rules().outcome(model.classes().len()),
            model,
        })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Rows of the current window so far.
    #[must_use]
    pub fn n_seen(&self) -> usize {
        self.position().n_seen
    }

    /// Whether all rows of the window are there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.position().is_complete()
    }

    /// Rows of the stream before the current window.
    #[must_use]
    pub fn first_row(&self) -> u64 {
        self.position().first_row
    }

    /// Takes rows of one value per axis, in N and N m, until the window is complete. Returns how many it took.
    ///
    /// # Errors
    /// Those of [`StreamingExtractor::push`](super::StreamingExtractor::push); nothing has changed then.
    pub fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let n_taken = match &mut self.stream {
            Stream::Paper(stream) => stream.push(&self.model, rows)?,
            Stream::MultiBand(stream) => stream.push(rows)?,
        };
        self.is_fresh &= n_taken == 0;
        Ok(n_taken)
    }

    /// Goes on to the next window, as [`StreamingExtractor::next_window`](super::StreamingExtractor::next_window) does.
    pub fn next_window(&mut self) -> Result<()> {
        match &mut self.stream {
            Stream::Paper(stream) => stream.next_window(&self.model)?,
            Stream::MultiBand(stream) => stream.next_window()?,
        }
        self.is_fresh = false;
        Ok(())
    }

    /// Back to the state before the first row.
    pub fn reset(&mut self) {
        match &mut self.stream {
            Stream::Paper(stream) => stream.reset(),
            Stream::MultiBand(stream) => stream.reset(),
        }
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

    /// Everything about the answer so far.
    ///
    /// # Errors
    /// As [`scores`](Self::scores).
    pub fn standing(&mut self) -> Result<Standing<'_>> {
        self.refresh()?;
        let n_seen = self.n_seen();
        let (best, margin) = best_and_margin(&self.losses);
        let is_final = self.is_complete();
        if is_final && !self.is_judged {
            let novelty = match &mut self.stream {
                Stream::Paper(stream) => stream.novelty(&self.model),
                Stream::MultiBand(stream) => stream.novelty(&self.model),
            };
            self.model.apply_rules(&self.losses, novelty, &mut self.outcome);
            self.is_judged = true;
        }
        Ok(Standing {
            n_seen,
            scores: &self.scores,
            losses: &self.losses,
            best,
            margin,
            is_final,
            is_sure: self.model.margin_needed(n_seen).is_some_and(|needed| margin >= needed),
            candidates: if is_final { self.outcome.candidates() } else { &[] },
            unknown: if is_final { self.outcome.unknown() } else { None },
        })
    }

    fn position(&self) -> &Position {
        match &self.stream {
            Stream::Paper(stream) => stream.stream.position(),
            Stream::MultiBand(stream) => stream.position(),
        }
    }

    /// Brings scores and losses up to the last sample.
    fn refresh(&mut self) -> Result<()> {
        if self.is_fresh {
            return Ok(());
        }
        match &mut self.stream {
            Stream::Paper(stream) => stream.scores(&self.model, &mut self.scores),
            Stream::MultiBand(stream) => stream.scores(&self.model, &mut self.scores)?,
        }
        self.model.decode(&self.scores, &mut self.losses)?;
        (self.is_fresh, self.is_judged) = (true, false);
        Ok(())
    }
}
