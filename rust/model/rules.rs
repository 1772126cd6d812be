//! Confidence rules: which classes a whole recording may be, and whether it is like none.
//!
//! The rules are made elsewhere, from recordings that did not train, and stand in the file of a model. Source: Vovk,
//! Gammerman, Shafer, "Algorithmic learning in a random world" (2005) for sets of classes.

use serde::Deserialize;

use super::decoding::{best_and_margin, rank};
use super::json::parsed_object;
use super::novelty::Novelty;
use super::{Model, ModelError};
use crate::error::{Error, Result};
use crate::kernel::SimdPath;
use crate::memory::reserved;

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
}
