//! Confidence rules, what is said of a whole recording beside its label: which classes it may be, and whether it is like
//! none.
//!
//! The rules are made elsewhere, from recordings that did not train, and stand in the file of a model. Sources: Vovk,
//! Gammerman, Shafer, "Algorithmic learning in a random world" (2005) for sets of classes; [`NearestMean`] for the distance.

use super::decoding::{best_and_margin, pairs, rank, Loss};
use super::Model;
use crate::error::{Error, Result};
use crate::memory::{collected, filled, reserved};

/// Which classes a recording may be.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ConformalRule {
    /// How far the loss of a candidate may exceed the least of the others.
    pub(super) limit: f64,
}

/// Beyond what distance to the nearest class a recording is like none.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct UnknownRule {
    /// Of the scores of the learners, or of the losses of the classes, negated.
    pub(super) nearest: NearestMean,
    pub(super) threshold: f64,
}

/// Rules of a model for whole recordings; each may be missing. [`Model::identify`] and
/// [`StreamingIdentifier`](crate::stream::StreamingIdentifier) apply them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rules {
    pub(super) conformal: Option<ConformalRule>,
    pub(super) unknown: Option<UnknownRule>,
}

impl Rules {
    /// Whether answers name the classes that a recording may be.
    #[must_use]
    pub fn name_candidates(&self) -> bool {
        self.conformal.is_some()
    }

    /// Whether answers say that a recording is like none of the classes.
    #[must_use]
    pub fn refuse_unknown(&self) -> bool {
        self.unknown.is_some()
    }

    /// Memory for what they say, taken once.
    pub(crate) fn verdict(&self, n_classes: usize) -> Verdict {
        let n_candidates = if self.conformal.is_some() { n_classes } else { 0 };
        let n_values = if self.unknown.is_some() { n_classes } else { 0 };
        Verdict {
            order: vec![0; n_candidates],
            n_candidates: 0,
            unknown: None,
            values: vec![0.0; n_values],
            white: vec![0.0; n_values],
        }
    }
}

/// What the rules say of one recording, and memory for finding it out.
#[derive(Clone, Debug)]
pub(crate) struct Verdict {
    order: Vec<usize>,
    n_candidates: usize,
    unknown: Option<bool>,
    values: Vec<f64>,
    white: Vec<f64>,
}

impl Verdict {
    /// Classes that the recording may be, the likeliest first and at least one; empty without a rule.
    pub(crate) fn candidates(&self) -> &[usize] {
        self.order.get(..self.n_candidates).unwrap_or_default()
    }

    /// Whether it is like no class; `None` without a rule.
    pub(crate) fn unknown(&self) -> Option<bool> {
        self.unknown
    }
}

/// What the rules say of many recordings.
pub struct Verdicts {
    candidates: Vec<usize>,
    /// Candidates of all recordings up to each one, and whether it is like no class.
    rows: Vec<(usize, Option<bool>)>,
}

impl Verdicts {
    pub fn n_rows(&self) -> usize {
        self.rows.len()
    }

    pub fn n_candidates(&self) -> usize {
        self.candidates.len()
    }

    /// Candidates of each recording, and whether it is like no class.
    pub fn rows(&self) -> impl Iterator<Item = (&[usize], Option<bool>)> {
        let mut start = 0;
        self.rows.iter().map(move |(end, unknown)| {
            (&self.candidates[std::mem::replace(&mut start, *end)..*end], *unknown)
        })
    }
}

impl Model {
    /// What the rules say of recordings, from rows of scores.
    #[doc(hidden)]
    pub fn verdicts(&self, scores: &[f64]) -> Result<Verdicts> {
        let losses = self.losses(scores)?;
        let mut verdict = self.rules().verdict(self.classes().len());
        let rows = losses.chunks_exact(self.classes().len()).zip(scores.chunks_exact(self.n_learners()));
        let mut all = Verdicts { candidates: Vec::new(), rows: reserved(rows.len())? };
        for (losses, scores) in rows {
            self.judge(losses, scores, &mut verdict);
            let candidates = verdict.candidates();
            let bytes = size_of_val(&*all.candidates).saturating_add(size_of_val(candidates));
            all.candidates.try_reserve(candidates.len()).map_err(|_| Error::Memory { bytes })?;
            all.candidates.extend_from_slice(candidates);
            all.rows.push((all.candidates.len(), verdict.unknown()));
        }
        Ok(all)
    }

    /// Applies the rules to a whole recording, by its mean losses and the scores of the learners. Allocates nothing.
    pub(crate) fn judge(&self, losses: &[f64], scores: &[f64], verdict: &mut Verdict) {
        let Rules { conformal, unknown } = &self.rules;
        if let Some(rule) = conformal {
            verdict.n_candidates = rule.within(losses, &mut verdict.order);
        }
        verdict.unknown = unknown.as_ref().map(|UnknownRule { nearest, threshold }| {
            let Verdict { values, white, .. } = verdict;
            let novelty = if nearest.of_pairs {
                nearest.distance(scores, values, white)
            } else {
                for (value, loss) in values.iter_mut().zip(losses) {
                    *value = -loss;
                }
                nearest.distance(values, &mut [], white)
            };
            // What is no number is like nothing.
            novelty.is_nan() || novelty > *threshold
        });
    }
}

impl ConformalRule {
    /// Puts the classes that a recording may be first in `order`, the likeliest first, and gives their number: the best one
    /// alone where none fits well enough. `order` has a place for each class.
    fn within(&self, losses: &[f64], order: &mut [usize]) -> usize {
        let (best, margin) = best_and_margin(losses);
        rank(losses, order);
        let mut n_within = 0;
        for place in 0..order.len() {
            let class = order[place];
            let excess = if class == best { -margin } else { losses[class] - losses[best] };
            if excess <= self.limit {
                order[n_within] = class;
                n_within += 1;
            }
        }
        if n_within == 0 {
            order[0] = best;
        }
        n_within.max(1)
    }
}

/// How far the scores of a recording lie from those of the nearest class: means of some classes, and the matrix that makes
/// the covariance within them the unit matrix.
///
/// The Mahalanobis distance of Lee, Lee, Lee, Shin, "A simple unified framework for detecting out-of-distribution samples
/// and adversarial attacks" (2018): the covariance within classes makes all directions alike first.
///
/// ```
/// use granular_id::model::NearestMean;
///
/// let nearest = NearestMean::new(&[0.0, 0.0, 3.0, 4.0], &[1.0, 0.0, 0.0, 2.0])?;
/// assert_eq!(nearest.distances(&[3.0, 3.0, 1.0, 0.0])?, [2.0, 1.0]);
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct NearestMean {
    /// Row by row.
    whitener: Vec<f64>,
    /// Products of the means with the whitener, one after the other.
    means: Vec<f64>,
    /// Numbers of a recording that are whitened.
    n_values: usize,
    /// Whether the values of a recording are made of scores, one for each pair of them.
    of_pairs: bool,
}

impl NearestMean {
    /// For recordings of S values each.
    ///
    /// # Arguments
    /// - `means`: S numbers of one class after the other.
    /// - `whitener`: S x S; the product of a mean with it is a mean of whitened values.
    ///
    /// # Errors
    /// [`Error::Length`]: a whitener that is not square, means that are not whole.
    pub fn new(means: &[f64], whitener: &[f64]) -> Result<Self> {
        let n_values = whitener.len().isqrt();
        if n_values == 0 || n_values * n_values != whitener.len() {
            return Err(Error::Length {
                what: "whitener",
                expected: n_values.max(1).pow(2),
                got: whitener.len(),
            });
        }
        let n_classes = (means.len() / n_values).max(1);
        if n_classes * n_values != means.len() {
            return Err(Error::Length { what: "means", expected: n_classes * n_values, got: means.len() });
        }
        let mut white = filled(0.0, means.len())?;
        for (mean, white) in means.chunks_exact(n_values).zip(white.chunks_exact_mut(n_values)) {
            whiten(whitener, mean, white);
        }
        Ok(Self { whitener: collected(whitener.iter().copied())?, means: white, n_values, of_pairs: false })
    }

    /// For class values that are made of the scores of one learner for each pair of S classes: minus their mean losses
    /// under the hinge.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of_pairs(means: &[f64], whitener: &[f64]) -> Result<Self> {
        Ok(Self { of_pairs: true, ..Self::new(means, whitener)? })
    }

    /// Means: K.
    #[must_use]
    pub fn n_classes(&self) -> usize {
        self.means.len() / self.n_values
    }

    /// Numbers of one recording.
    #[must_use]
    pub fn width(&self) -> usize {
        if self.of_pairs {
            self.n_values * (self.n_values - 1) / 2
        } else {
            self.n_values
        }
    }

    /// Distance of each recording to the nearest mean. Every recording has the same bits alone and among others.
    ///
    /// # Errors
    /// [`Error::Length`]: not [`width`](Self::width) numbers for each; [`Error::Score`]: one that is not finite.
    pub fn distances(&self, scores: &[f64]) -> Result<Vec<f64>> {
        // A single class has no pairs.
        let width = self.width().max(1);
        if !scores.len().is_multiple_of(width) {
            let expected = scores.len().next_multiple_of(width);
            return Err(Error::Length { what: "scores", expected, got: scores.len() });
        }
        if let Some(index) = scores.iter().position(|score| !score.is_finite()) {
            let (recording, learner) = (index / width, index % width);
            return Err(Error::Score { recording, learner, value: scores[index] });
        }
        let (mut values, mut white) = (filled(0.0, self.n_values)?, filled(0.0, self.n_values)?);
        let one = |scores: &[f64]| self.distance(scores, &mut values, &mut white);
        collected(scores.chunks_exact(width).map(one))
    }

    /// Distance of one recording of [`width`](Self::width) numbers, with memory for two times `n_values`.
    fn distance(&self, scores: &[f64], values: &mut [f64], white: &mut [f64]) -> f64 {
        if self.of_pairs {
            hinge_values(scores, values);
            whiten(&self.whitener, values, white);
        } else {
            whiten(&self.whitener, scores, white);
        }
        let squares = self
            .means
            .chunks_exact(self.n_values)
            .map(|mean| white.iter().zip(mean).fold(0.0, |sum, (x, mean)| sum + (x - mean) * (x - mean)));
        squares.fold(f64::INFINITY, f64::min).sqrt()
    }
}

/// Values times a matrix.
fn whiten(matrix: &[f64], values: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (value, row) in values.iter().zip(matrix.chunks_exact(out.len())) {
        for (sum, factor) in out.iter_mut().zip(row) {
            *sum += value * factor;
        }
    }
}

/// Minus the mean losses of classes under the hinge: of the pair `i < j` a positive score speaks for `i`.
fn hinge_values(scores: &[f64], values: &mut [f64]) {
    values.fill(0.0);
    let n_classes = values.len();
    for ((i, j), score) in pairs(n_classes).zip(scores) {
        values[i] -= Loss::Hinge.of_agreement(*score);
        values[j] -= Loss::Hinge.of_agreement(-score);
    }
    let n_others = (n_classes as f64 - 1.0).max(1.0);
    for value in values {
        *value /= n_others;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_by_their_distance_from_the_best_other() {
        let of = |limit, losses: [f64; 3]| {
            let mut order = [0; 3];
            let n = ConformalRule { limit }.within(&losses, &mut order);
            order[..n].to_vec()
        };
        assert_eq!(of(0.25, [0.5, 0.25, 1.0]), [1, 0]);
        assert_eq!(of(f64::INFINITY, [0.5, 0.25, 0.25]), [1, 2, 0]);
        // The best one alone, though it is not clear enough.
        assert_eq!(of(-0.5, [0.5, 0.25, 1.0]), [1]);
    }

    const UNIT: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    #[test]
    fn pairs_become_class_values() {
        // Those of the decoding of [2, 1/2, -1] under the hinge.
        let nearest = NearestMean::of_pairs(&[-0.125, -1.25, -0.375, 9.0, 9.0, 9.0], &UNIT).unwrap();
        assert_eq!(nearest.width(), 3);
        assert_eq!(nearest.distances(&[2.0, 0.5, -1.0]).unwrap(), [0.0]);
    }

    #[test]
    fn a_recording_among_others_is_the_same() {
        let nearest = NearestMean::new(&[0.3, -0.7, 1.1, 0.9, 0.2, -0.4], &UNIT).unwrap();
        let scores: Vec<f64> = (0..30).map(|i| (0.7 * f64::from(i)).sin()).collect();
        let together = nearest.distances(&scores).unwrap();
        let alone = scores.chunks_exact(3).flat_map(|one| nearest.distances(one).unwrap());
        assert_eq!(together, alone.collect::<Vec<_>>());
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let got = |means: &[f64], whitener: &[f64]| NearestMean::new(means, whitener).unwrap_err();
        assert_eq!(got(&[1.0], &[]), Error::Length { what: "whitener", expected: 1, got: 0 });
        assert_eq!(got(&[1.0], &[1.0; 3]), Error::Length { what: "whitener", expected: 1, got: 3 });
        assert_eq!(got(&[], &[1.0; 4]), Error::Length { what: "means", expected: 2, got: 0 });
        assert_eq!(got(&[1.0; 5], &[1.0; 4]), Error::Length { what: "means", expected: 4, got: 5 });
        let nearest = NearestMean::new(&[0.0; 3], &UNIT).unwrap();
        let error = Error::Length { what: "scores", expected: 6, got: 4 };
        assert_eq!(nearest.distances(&[0.0; 4]), Err(error));
        let error = nearest.distances(&[0.0, 0.0, 0.0, 1.0, f64::INFINITY, 0.0]).unwrap_err();
        assert_eq!(error, Error::Score { recording: 1, learner: 1, value: f64::INFINITY });
        assert_eq!(NearestMean::of_pairs(&[1.0], &[1.0]).unwrap().distances(&[]), Ok(Vec::new()));
    }
}
