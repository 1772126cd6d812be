//! Confidence rules, what is said of a whole recording beside its label: which classes it may be, and whether it is like
//! none.
//!
//! The rules are made elsewhere, from recordings that did not train, and stand in the file of a model. Source: Vovk,
//! Gammerman, Shafer, "Algorithmic learning in a random world" (2005) for sets of classes.

use super::decoding::{best_and_margin, rank};
use super::novelty::Novelty;
use super::Model;
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
    /// Whether answers name the classes that a recording may be.
    #[must_use]
    pub fn name_candidates(&self) -> bool {
        self.candidates.is_some()
    }

    /// Whether answers say that a recording is like none of the classes.
    #[must_use]
    pub fn refuse_unknown(&self) -> bool {
        self.unknown.is_some()
    }

    /// The novelty of a recording, from sums over its features.
    pub(super) fn novelty_of(&self, novelty: &Novelty, sums: &[f64]) -> f64 {
        self.unknown.as_ref().map_or(f64::NAN, |rule| novelty.score(sums, rule.weights))
    }

    /// Memory for what they say, taken once.
    pub(crate) fn verdict(&self, n_classes: usize) -> Verdict {
        let n_candidates = if self.candidates.is_some() { n_classes } else { 0 };
        Verdict { order: vec![0; n_candidates], n_candidates: 0, unknown: None }
    }
}

/// What the rules say of one recording, and memory for finding it out.
#[derive(Clone, Debug)]
pub(crate) struct Verdict {
    order: Vec<usize>,
    n_candidates: usize,
    unknown: Option<bool>,
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
    /// What the rules say of recordings, from rows of scores and, where unknown materials are refused, a novelty for each.
    ///
    /// # Errors
    /// [`Error::Length`] for another number of novelties than of rows; those of [`losses`](Self::losses).
    #[doc(hidden)]
    pub fn verdicts(&self, scores: &[f64], novelty: &[f64]) -> Result<Verdicts> {
        let losses = self.losses(scores)?;
        let expected = if self.rules.refuse_unknown() { scores.len() / self.n_learners() } else { 0 };
        if novelty.len() != expected {
            return Err(Error::Length { what: "novelty", expected, got: novelty.len() });
        }
        let mut verdict = self.rules().verdict(self.classes().len());
        let rows = losses.chunks_exact(self.classes().len());
        let mut all = Verdicts { candidates: Vec::new(), rows: reserved(rows.len())? };
        for (row, losses) in rows.enumerate() {
            self.judge(losses, novelty.get(row).copied(), &mut verdict);
            let candidates = verdict.candidates();
            let bytes = size_of_val(&*all.candidates).saturating_add(size_of_val(candidates));
            all.candidates.try_reserve(candidates.len()).map_err(|_| Error::Memory { bytes })?;
            all.candidates.extend_from_slice(candidates);
            all.rows.push((all.candidates.len(), verdict.unknown()));
        }
        Ok(all)
    }

    /// Applies the rules to a whole recording, by its mean losses and its novelty. Allocates nothing.
    pub(crate) fn judge(&self, losses: &[f64], novelty: Option<f64>, verdict: &mut Verdict) {
        let Rules { candidates, unknown } = &self.rules;
        if let Some(rule) = candidates {
            verdict.n_candidates = rule.within(losses, &mut verdict.order);
        }
        verdict.unknown = unknown.as_ref().zip(novelty).map(|(rule, novelty)| novelty > rule.threshold);
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
