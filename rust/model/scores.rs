//! From recordings to scores, losses and answers.

use super::trained::Model;
use super::weights::AddTeam;
use crate::error::{Error, Result};
use crate::extract::in_tasks;
use crate::kernel::SimdPath;
use crate::memory::{filled, room};
use crate::BatchShape;

/// Recordings that share each row of weights on its way through the caches.
const TEAM: usize = 4;

/// What a model says of one recording.
#[derive(Clone, Debug, PartialEq)]
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
    /// Whether the recording is like none of the classes: `best` then says nothing. `None` without such a rule.
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

/// The same, into as many places as there are losses. Allocates nothing.
pub(super) fn rank(losses: &[f64], order: &mut [usize]) {
    for (class, place) in order.iter_mut().enumerate() {
        *place = class;
    }
    order.sort_unstable_by(|a, b| losses[*a].total_cmp(&losses[*b]).then(a.cmp(b)));
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
    ) -> Result<()> {
        let shape = self.batch(n_recordings);
        self.extraction.check(wrench, shape)?;
        let path = SimdPath::detect()?;
        in_tasks(wrench, shape, self.n_learners(), threads, out, |wrench, shape, out| {
            let features = self.extraction.extract(wrench, shape)?;
            let n_features = features.len() / shape.n_recordings;
            let mut sums = filled(0.0, 2 * TEAM * self.lanes())?;
            let teams =
                wrench.chunks(TEAM * shape.recording_len()).zip(out.chunks_mut(TEAM * self.n_learners()));
            for (team, (wrench, out)) in teams.enumerate() {
                let first = team * TEAM;
                let features = features.get(first * n_features..).unwrap_or_default();
                self.team(path, wrench, features, &mut sums, out);
            }
            self.all_finite(out)
        })
    }

    /// Scores of all learners, one row per recording.
    pub fn scores(&self, wrench: &[f64], n_recordings: usize, threads: usize) -> Result<Vec<f64>> {
        self.extraction.check(wrench, self.batch(n_recordings))?;
        let mut out = filled(0.0, n_recordings.saturating_mul(self.n_learners()))?;
        self.scores_into(wrench, n_recordings, threads, &mut out)?;
        Ok(out)
    }

    /// Scores of a few recordings, each row of weights read once.
    fn team(&self, path: SimdPath, wrench: &[f64], features: &[f64], sums: &mut [f64], out: &mut [f64]) {
        let lanes = self.lanes();
        let (raw_rows, other_rows) = self.weights.blocks();
        let (raw, hist) = sums.split_at_mut(TEAM * lanes);
        for (sums, rows, values) in [(&mut *raw, raw_rows, wrench), (&mut *hist, other_rows, features)] {
            sums.fill(0.0);
            path.run(AddTeam { sums, lanes, rows, values });
        }
        let sums = raw.chunks_exact(lanes).zip(hist.chunks_exact(lanes));
        for (out, (raw, hist)) in out.chunks_exact_mut(self.n_learners()).zip(sums) {
            for (((score, intercept), raw), hist) in out.iter_mut().zip(self.intercept()).zip(raw).zip(hist) {
                *score = (intercept + raw) + hist;
            }
        }
    }

    /// Refuses scores that are NaN or infinite, one row per recording.
    fn all_finite(&self, scores: &[f64]) -> Result<()> {
        match scores.iter().position(|score| !score.is_finite()) {
            None => Ok(()),
            Some(index) => Err(Error::Score {
                recording: index / self.n_learners(),
                learner: index % self.n_learners(),
                value: scores[index],
            }),
        }
    }

    /// Mean loss of each class from the scores of all learners; the smallest wins, the first of equal ones. Allocates
    /// nothing.
    ///
    /// # Errors
    /// [`Error::Length`] for another number of scores than learners or of losses than classes, [`Error::Score`] for a score
    /// that is not finite.
    pub fn decode(&self, scores: &[f64], losses: &mut [f64]) -> Result<()> {
        let lengths =
            [("scores", self.n_learners(), scores.len()), ("losses", self.classes.len(), losses.len())];
        for (what, expected, got) in lengths {
            if got != expected {
                return Err(Error::Length { what, expected, got });
            }
        }
        self.all_finite(scores)?;
        self.codes.mean_losses(self.loss, scores, losses);
        Ok(())
    }

    /// The answers for a batch of recordings.
    pub fn identify_batch(&self, wrench: &[f64], n_recordings: usize, threads: usize) -> Result<Vec<Answer>> {
        let scores = self.scores(wrench, n_recordings, threads)?;
        let numbers = self.n_learners() + self.classes.len();
        let candidates = self.classes.len() * size_of::<usize>();
        let per_answer = size_of::<Answer>() + numbers * size_of::<f64>() + candidates;
        room(n_recordings.saturating_mul(per_answer))?;
        let mut verdict = self.rules.verdict();
        let answers = scores.chunks_exact(self.n_learners()).map(|scores| {
            let mut losses = vec![0.0; self.classes.len()];
            self.decode(scores, &mut losses)?;
            let (best, _) = best_and_margin(&losses);
            self.judge(&losses, scores, &mut verdict);
            let (candidates, unknown) = (verdict.candidates().to_vec(), verdict.unknown());
            Ok(Answer { best, scores: scores.to_vec(), losses, candidates, unknown })
        });
        answers.collect()
    }

    /// The answer for one recording of `n_samples * n_axes` values, sample by sample.
    pub fn identify(&self, wrench: &[f64]) -> Result<Answer> {
        let mut answers = self.identify_batch(wrench, 1, 1)?;
        answers.pop().ok_or(Error::Empty { what: "wrench", shape: vec![0] })
    }
}
