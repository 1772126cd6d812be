//! Confidence rules: which classes a whole recording may be, and whether it is like none, by the novelty score.
//!
//! The rules are made elsewhere, from recordings that did not train, and stand in the file of a model. Source: Vovk,
//! Gammerman, Shafer, "Algorithmic learning in a random world" (2005) for sets of classes.

use serde::Deserialize;

use super::decoding::{best_and_margin, rank};
use super::json::parsed_object;
use super::tensor::Tensor;
use super::{Model, ModelError};
use crate::error::{short_number, Error, Result};
use crate::kernel::{Job, Simd, SimdPath};
use crate::memory::{filled, reserved};

/// Which classes a recording may be.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CandidateRule {
    /// How far the loss of a candidate may exceed the least of the others.
    pub(super) limit: f64,
}

/// Beyond what novelty a recording is like none of the classes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct UnknownRule {
    /// Of the squared distances along the directions, and over all features.
    pub(super) weights: [f64; 2],
    pub(super) threshold: f64,
}

/// Rules of a model for whole recordings; each may be missing. [`Model::identify`] and
/// [`StreamingIdentifier`](crate::stream::StreamingIdentifier) apply them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rules {
    pub(super) candidates: Option<CandidateRule>,
    pub(super) unknown: Option<UnknownRule>,
}

impl Rules {
    /// True if answers name the classes that a recording may be.
    #[must_use]
    pub fn name_candidates(&self) -> bool {
        self.candidates.is_some()
    }

    /// True if answers mark a recording that is like none of the classes.
    #[must_use]
    pub fn refuse_unknown(&self) -> bool {
        self.unknown.is_some()
    }

    /// The rules in what is known of a training, a JSON object: what `CandidateRule.to_dict` and `UnknownRule.to_dict` of the
    /// Python package give, under `confidence`. Each must be whole, and for these classes.
    pub(super) fn read(trained: &str, classes: &[String]) -> std::result::Result<Self, ModelError> {
        // All of it within the usual depth: others than these rules are read in Python.
        parsed_object::<serde_json::Value>("trained", trained)?;
        let TrainedJson { confidence } = parsed_object("trained", trained)?;
        let ConfidenceJson { candidates, unknown } = confidence.unwrap_or_default();
        Ok(Self {
            candidates: candidates.map(|rule| rule.checked(classes)).transpose()?,
            unknown: unknown.map(|rule| rule.checked(classes)).transpose()?,
        })
    }

    /// The novelty of a recording, from sums over its features.
    pub(super) fn novelty_of(&self, novelty: &Novelty, sums: &[f64]) -> f64 {
        self.unknown.as_ref().map_or(f64::NAN, |rule| novelty.score(sums, rule.weights))
    }

    /// Memory for what they find, taken once.
    pub(crate) fn outcome(&self, n_classes: usize) -> RuleOutcome {
        let n_candidates = if self.candidates.is_some() { n_classes } else { 0 };
        RuleOutcome { order: vec![0; n_candidates], n_candidates: 0, unknown: None }
    }
}

/// What is known of a training; only the rules are part of an answer.
#[derive(Deserialize)]
struct TrainedJson {
    confidence: Option<ConfidenceJson>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ConfidenceJson {
    candidates: Option<CandidatesJson>,
    unknown: Option<UnknownJson>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)] // what a rule stands on is part of the format
struct CandidatesJson {
    classes: Vec<String>,
    format: String,
    level: f64,
    mean: f64,
    n_rows: u64,
    n_sessions: u64,
    threshold: f64,
    worst: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)] // as above
struct UnknownJson {
    classes: Vec<String>,
    format: String,
    held_out: String,
    n_calibration: u64,
    share_known: f64,
    threshold: f64,
    weights: [f64; 2],
}

impl CandidatesJson {
    fn checked(self, classes: &[String]) -> std::result::Result<CandidateRule, ModelError> {
        let refused = refusal("trained.confidence.candidates");
        refused(self.format == "granular-id candidates 1", "'format' must be 'granular-id candidates 1'")?;
        refused(self.classes == classes, WRONG_CLASSES)?;
        let is_share = [self.level, self.mean, self.worst].iter().all(|share| (0.0..=1.0).contains(share));
        refused(is_share, "'level', 'mean' and 'worst' must be numbers from 0 to 1")?;
        Ok(CandidateRule { limit: self.threshold })
    }
}

impl UnknownJson {
    fn checked(self, classes: &[String]) -> std::result::Result<UnknownRule, ModelError> {
        let refused = refusal("trained.confidence.unknown");
        refused(
            self.format == "granular-id unknown rule 1",
            "'format' must be 'granular-id unknown rule 1'",
        )?;
        refused(self.classes == classes, WRONG_CLASSES)?;
        refused(
            0.0 < self.share_known && self.share_known < 1.0,
            "'share_known' must be a number between 0 and 1",
        )?;
        refused(self.weights.iter().all(|weight| *weight >= 0.0), "'weights' must be at least 0")?;
        Ok(UnknownRule { weights: self.weights, threshold: self.threshold })
    }
}

const WRONG_CLASSES: &str = "'classes' must be the labels of the model in their order";

fn refusal(what: &'static str) -> impl Fn(bool, &str) -> std::result::Result<(), ModelError> {
    move |is_good, problem| {
        if is_good {
            Ok(())
        } else {
            Err(ModelError::Json { what, problem: problem.to_owned() })
        }
    }
}

/// What the rules find about one recording, and memory for finding it.
#[derive(Clone, Debug)]
pub(crate) struct RuleOutcome {
    order: Vec<usize>,
    n_candidates: usize,
    unknown: Option<bool>,
}

impl RuleOutcome {
    /// Classes that the recording may be, the likeliest first and at least one; empty without a rule.
    pub(crate) fn candidates(&self) -> &[usize] {
        self.order.get(..self.n_candidates).unwrap_or_default()
    }

    /// True if it is like no class; `None` without a rule.
    pub(crate) fn unknown(&self) -> Option<bool> {
        self.unknown
    }
}

impl Model {
    /// Candidates of recordings, and whether each is like no class, from rows of scores and, where unknown materials are
    /// refused, a novelty for each.
    ///
    /// # Errors
    /// [`Error::Length`] for another number of novelties than of rows; those of [`losses`](Self::losses).
    #[doc(hidden)]
    pub fn rule_outcomes(&self, scores: &[f64], novelty: &[f64]) -> Result<Vec<(Vec<usize>, Option<bool>)>> {
        let losses = self.losses(scores)?;
        let expected = if self.rules.refuse_unknown() { scores.len() / self.n_learners() } else { 0 };
        if novelty.len() != expected {
            return Err(Error::Length { what: "novelty", expected, got: novelty.len() });
        }
        let mut outcome = self.rules.outcome(self.classes.len());
        let rows = losses.chunks_exact(self.classes.len());
        let mut all = reserved(rows.len())?;
        for (row, losses) in rows.enumerate() {
            self.apply_rules(losses, novelty.get(row).copied(), &mut outcome);
            all.push((outcome.candidates().to_vec(), outcome.unknown()));
        }
        Ok(all)
    }

    /// Applies the rules to a whole recording, by its mean losses and its novelty. Allocates nothing.
    pub(crate) fn apply_rules(&self, losses: &[f64], novelty: Option<f64>, outcome: &mut RuleOutcome) {
        let Rules { candidates, unknown } = &self.rules;
        if let Some(rule) = candidates {
            outcome.n_candidates = rule.within(losses, &mut outcome.order);
        }
        outcome.unknown = unknown.as_ref().zip(novelty).map(|(rule, novelty)| novelty > rule.threshold);
    }

    /// Sums of the novelty of a recording; none where unknown materials are not refused.
    pub(crate) fn novelty_width(&self) -> usize {
        self.novelty.as_ref().map_or(0, Novelty::width)
    }

    /// Adds features to the sums of the novelty, from the one in place `first` on, raw ones sample by sample.
    pub(crate) fn add_novelty(&self, path: SimdPath, sums: &mut [f64], first: usize, values: &[f64]) {
        if let Some(novelty) = &self.novelty {
            novelty.add(path, sums, first, values);
        }
    }

    /// The novelty of a recording from the sums over all its features; `None` where unknown materials are not refused.
    pub(crate) fn novelty_of(&self, sums: &[f64]) -> Option<f64> {
        self.novelty.as_ref().map(|novelty| self.rules.novelty_of(novelty, sums))
    }
}

impl CandidateRule {
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

/// What the novelty of a recording is computed with: R directions, numbers rounded to float32.
#[derive(Clone, Debug)]
pub struct NoveltyParts<'a> {
    /// Centre and factor of each feature (2, D): a scaled feature is `(x - centre) * factor`.
    pub scaling: Tensor<'a>,
    /// Directions of scaled features in which the classes differ (R, D).
    pub directions: Tensor<'a>,
    /// Mean scaled features of each class (K, D).
    pub means: Tensor<'a>,
}

/// The novelty score of a recording: `min_k (w_d d_k + w_e e_k)`, the distance to the nearest of some class means, small for
/// what is like one of them.
///
/// With `s = (x - centre) * factor` the scaled features, `d_k` is the squared distance to the mean of class k along
/// directions in which the classes differ, `e_k` that over all features. Sums run over the features in the order of the scores.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Novelty {
    n_directions: usize,
    n_classes: usize,
    /// Centre and factor of each feature, raw ones sample by sample.
    scaling: Vec<[f32; 2]>,
    /// For each feature its part of each direction, then of each mean.
    rows: Vec<f32>,
    /// Where each mean lies along the directions.
    places: Vec<f64>,
}

impl Novelty {
    /// From tensors whose features stand as in the weights of a model; refuses other shapes, NaN and infinity.
    pub(super) fn new(
        parts: &NoveltyParts<'_>,
        n_classes: usize,
        n_features: usize,
        feature_of: impl Fn(usize) -> usize,
    ) -> std::result::Result<Self, ModelError> {
        let NoveltyParts { scaling, directions, means } = parts;
        let n_directions = directions.shape().first().copied().unwrap_or(0);
        for (name, tensor, n_rows, each) in [
            ("unknown_scaling", scaling, 2, "centre and factor"),
            ("unknown_directions", directions, n_directions, "directions"),
            ("unknown_means", means, n_classes, "one per class"),
        ] {
            let wanted = format_args!("({n_rows}, {n_features}), {each}");
            tensor.check_shape(name, &[n_rows, n_features], wanted)?;
        }
        let width = n_directions + n_classes;
        let mut rows = filled(0.0, width.saturating_mul(n_features))?;
        let mut places = filled(0.0, n_classes * n_directions)?;
        for (row, values) in rows.chunks_exact_mut(width).enumerate() {
            let at =
                |name, tensor: &Tensor<'_>, index| single(name, tensor, index * n_features + feature_of(row));
            for (index, value) in values.iter_mut().enumerate() {
                *value = match index.checked_sub(n_directions) {
                    None => at("unknown_directions", directions, index)?,
                    Some(class) => at("unknown_means", means, class)?,
                };
            }
            let (directions, means) = values.split_at(n_directions);
            for (mean, places) in means.iter().zip(places.chunks_exact_mut(n_directions.max(1))) {
                for (direction, place) in directions.iter().zip(places) {
                    *place += f64::from(*direction) * f64::from(*mean);
                }
            }
        }
        let pair = |row| {
            let at = |index| single("unknown_scaling", scaling, index * n_features + feature_of(row));
            Ok([at(0)?, at(1)?])
        };
        let pairs = (0..n_features).map(pair).collect::<std::result::Result<Vec<_>, ModelError>>()?;
        Ok(Self { n_directions, n_classes, scaling: pairs, rows, places })
    }

    /// Scaling, directions and means as tensors: rows of each and its values, features by `row_of`.
    pub(super) fn tensors(&self, row_of: impl Fn(usize) -> usize) -> [(usize, Vec<f32>); 3] {
        let n_features = self.scaling.len();
        let values = |n_rows: usize, at: &dyn Fn(usize, usize) -> f32| {
            let places = (0..n_rows).flat_map(|index| (0..n_features).map(move |feature| (index, feature)));
            (n_rows, places.map(|(index, feature)| at(index, row_of(feature))).collect())
        };
        let part = |index, row| self.rows[row * self.width() + index];
        [
            values(2, &|index, row| self.scaling[row][index]),
            values(self.n_directions, &part),
            values(self.n_classes, &|class, row| part(self.n_directions + class, row)),
        ]
    }

    /// Sums of a recording: along each direction, and of squared distances to each mean.
    pub(super) fn width(&self) -> usize {
        self.n_directions + self.n_classes
    }

    /// Adds features to the sums, from the one in place `first` on.
    pub(super) fn add(&self, path: SimdPath, sums: &mut [f64], first: usize, values: &[f64]) {
        path.run(AddFeatures { novelty: self, sums, first, values });
    }

    /// The score of the sums of all features.
    pub(super) fn score(&self, sums: &[f64], [of_d, of_e]: [f64; 2]) -> f64 {
        let (along, squares) = sums.split_at(self.n_directions);
        let each = squares.iter().enumerate().map(|(class, e)| {
            let place = &self.places[class * self.n_directions..][..self.n_directions];
            let d = along.iter().zip(place).fold(0.0, |sum, (u, place)| sum + (u - place) * (u - place));
            of_d * d + of_e * e
        });
        // A NaN is no distance: such a recording is like no class.
        each.fold(f64::INFINITY, f64::min)
    }
}

#[allow(clippy::cast_possible_truncation)] // what the file holds
fn single(name: &str, tensor: &Tensor<'_>, index: usize) -> std::result::Result<f32, ModelError> {
    let value = tensor.finite(name, index)? as f32;
    if value.is_finite() {
        return Ok(value);
    }
    Err(ModelError::must_be(name, "in the range of float32", short_number(tensor.at(index))))
}

struct AddFeatures<'a> {
    novelty: &'a Novelty,
    sums: &'a mut [f64],
    first: usize,
    values: &'a [f64],
}

impl Job for AddFeatures<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) {
        let Self { novelty, sums, first, values } = self;
        let width = novelty.width();
        let (along, squares) = sums.split_at_mut(novelty.n_directions);
        let scaling = novelty.scaling[first..].iter();
        let rows = novelty.rows[first * width..].chunks_exact(width);
        for ((value, [centre, factor]), row) in values.iter().zip(scaling).zip(rows) {
            let scaled = (value - f64::from(*centre)) * f64::from(*factor);
            let (directions, means) = row.split_at(novelty.n_directions);
            for (sum, direction) in along.iter_mut().zip(directions) {
                *sum += scaled * f64::from(*direction);
            }
            for (sum, mean) in squares.iter_mut().zip(means) {
                let off = scaled - f64::from(*mean);
                *sum += off * off;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_by_their_distance_from_the_best_other() {
        let of = |limit, losses: [f64; 3]| {
            let mut order = [0; 3];
            let n = CandidateRule { limit }.within(&losses, &mut order);
            order[..n].to_vec()
        };
        assert_eq!(of(0.25, [0.5, 0.25, 1.0]), [1, 0]);
        assert_eq!(of(f64::INFINITY, [0.5, 0.25, 0.25]), [1, 2, 0]);
        // The best one alone, though it is not clear enough.
        assert_eq!(of(-0.5, [0.5, 0.25, 1.0]), [1]);
    }

    /// Two classes, one direction, three features of which the first two stand the other way round in the file.
    #[test]
    fn the_score_is_the_weighted_distance_to_the_nearest_mean() {
        let tensor = |values: &'static [f64]| Tensor::new(vec![values.len() / 3, 3], values);
        let parts = NoveltyParts {
            scaling: tensor(&[1.0, 0.0, 0.0, 2.0, 1.0, 1.0]),
            directions: tensor(&[1.0, 0.0, -1.0]),
            means: tensor(&[0.0, 0.0, 0.0, 4.0, 1.0, 2.0]),
        };
        let novelty = Novelty::new(&parts, 2, 3, |row| [1, 0, 2][row]).unwrap();
        let [scaling, directions, means] = novelty.tensors(|feature| [1, 0, 2][feature]);
        assert_eq!(scaling, (2, vec![1.0, 0.0, 0.0, 2.0, 1.0, 1.0]));
        assert_eq!(directions, (1, vec![1.0, 0.0, -1.0]));
        assert_eq!(means, (2, vec![0.0, 0.0, 0.0, 4.0, 1.0, 2.0]));
        let (path, mut sums) = (SimdPath::detect().unwrap(), vec![0.0; novelty.width()]);
        // Scaled features, as in the file: 4, 3, 1.
        novelty.add(path, &mut sums, 0, &[3.0, 3.0]);
        novelty.add(path, &mut sums, 2, &[1.0]);
        assert_eq!(sums, [3.0, 26.0, 5.0]);
        assert_eq!(novelty.score(&sums, [2.0, 1.0]), f64::min(2.0 * 9.0 + 26.0, 2.0 * 1.0 + 5.0));
    }

    #[test]
    fn numbers_beyond_float32_are_refused() {
        let huge = [1e300; 2];
        let parts = |scaling| NoveltyParts {
            scaling: Tensor::new(vec![2, 1], scaling),
            directions: Tensor::new(vec![0, 1], &[]),
            means: Tensor::new(vec![1, 1], &[0.5]),
        };
        let error = Novelty::new(&parts(&huge), 1, 1, |row| row).unwrap_err();
        assert_eq!(error.to_string(), "unknown_scaling must be in the range of float32, got 1e300");
        let novelty = Novelty::new(&parts(&[0.0, 1.0]), 1, 1, |row| row).unwrap();
        assert_eq!(novelty.score(&[4.0], [1.0, 0.5]), 2.0);
    }
}
