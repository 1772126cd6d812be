//! What is said of a whole recording beside its label: which classes it may be, and whether it is like none.
//!
//! The rules are made elsewhere, from recordings that did not train, and stand in the file of a model. Sources: Vovk,
//! Gammerman, Shafer, "Algorithmic learning in a random world" (2005) for sets of classes; Romano, Sesia, Candes,
//! "Classification with valid and adaptive coverage" (2020) for the cumulative one; [`NearestMean`] for the distance.

use super::nearest::NearestMean;
use super::scores::{best_and_margin, rank};
use super::Model;
use crate::{
    error::{Error, Result},
    memory::reserved,
};

/// How badly a class fits a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Misfit {
    /// By how much its loss exceeds the least of the others.
    Margin,
    /// Minus its probability: shares of the exponentials of minus the losses.
    Probability,
    /// The probability of all classes down to it, the likeliest first.
    Cumulative,
}

impl Misfit {
    pub(super) const NAMED: [(&'static str, Self); 3] =
        [("margin", Self::Margin), ("probability", Self::Probability), ("cumulative", Self::Cumulative)];
}

/// Which classes a recording may be.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Candidates {
    pub(super) misfit: Misfit,
    /// Losses are divided by it before they become probabilities.
    pub(super) temperature: f64,
    /// For each class how badly a candidate may fit.
    pub(super) limits: Vec<f64>,
}

/// How strange a recording is.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Strangeness {
    /// Distance of the scores of the learners to those of the nearest class.
    OfScores(NearestMean),
    /// Distance of the losses of the classes, negated.
    OfLosses(NearestMean),
    /// How clearly the least clear learner of the best class speaks for it, negated.
    LeastClear,
    LeastLoss,
    /// The least loss minus the second.
    Margin,
}

/// Beyond what a recording is like no class.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Refusal {
    pub(super) strangeness: Strangeness,
    pub(super) threshold: f64,
}

/// Rules of a model for whole recordings; each may be missing. [`Model::identify`] and
/// [`StreamingIdentifier`](crate::stream::StreamingIdentifier) apply them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rules {
    pub(super) candidates: Option<Candidates>,
    pub(super) refusal: Option<Refusal>,
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
        self.refusal.is_some()
    }

    /// Memory for what they say, taken once.
    pub(crate) fn verdict(&self) -> Verdict {
        let n_classes = self.candidates.as_ref().map_or(0, |rule| rule.limits.len());
        let nearest = match &self.refusal {
            Some(Refusal {
                strangeness: Strangeness::OfScores(nearest) | Strangeness::OfLosses(nearest),
                ..
            }) => nearest.n_values(),
            _ => 0,
        };
        Verdict {
            order: vec![0; n_classes],
            n_candidates: 0,
            unknown: None,
            values: vec![0.0; nearest.max(n_classes)],
            white: vec![0.0; nearest],
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
    /// What the rules say of recordings, from rows of losses and of scores.
    #[doc(hidden)]
    pub fn verdicts(&self, losses: &[f64], scores: &[f64]) -> Result<Verdicts> {
        let mut verdict = self.rules().verdict();
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
}

impl Model {
    /// Applies the rules to a whole recording, by its mean losses and the scores of the learners. Allocates nothing.
    pub(crate) fn judge(&self, losses: &[f64], scores: &[f64], verdict: &mut Verdict) {
        let Rules { candidates, refusal } = &self.rules;
        if let Some(rule) = candidates {
            verdict.n_candidates = rule.within(losses, &mut verdict.order, &mut verdict.values);
        }
        verdict.unknown = refusal.as_ref().map(|Refusal { strangeness, threshold }| {
            let Verdict { values, white, .. } = verdict;
            let strangeness = match strangeness {
                Strangeness::OfScores(nearest) => {
                    nearest.distance(scores, &mut values[..nearest.n_values()], white)
                }
                Strangeness::OfLosses(nearest) => {
                    for (value, loss) in values.iter_mut().zip(losses) {
                        *value = -loss;
                    }
                    nearest.distance(&values[..losses.len()], &mut [], white)
                }
                Strangeness::LeastClear => {
                    let best = best_and_margin(losses).0;
                    let sides =
                        scores.iter().enumerate().map(|(learner, score)| (self.code(best, learner), score));
                    let clear =
                        sides.filter(|(side, _)| *side != 0).map(|(side, score)| f64::from(side) * score);
                    -clear.fold(f64::INFINITY, f64::min)
                }
                Strangeness::LeastLoss => losses.iter().copied().fold(f64::INFINITY, f64::min),
                Strangeness::Margin => -best_and_margin(losses).1,
            };
            // What is no number is like nothing.
            strangeness.is_nan() || strangeness > *threshold
        });
    }
}

impl Candidates {
    /// Puts the classes that a recording may be first in `order`, the likeliest first, and gives their number: the best one
    /// alone where none fits well enough. `order` and `shares` have a place for each class.
    fn within(&self, losses: &[f64], order: &mut [usize], shares: &mut [f64]) -> usize {
        let (best, margin) = best_and_margin(losses);
        rank(losses, order);
        let mut sum = 0.0;
        if self.misfit != Misfit::Margin {
            let largest = -losses[best] / self.temperature;
            for (share, loss) in shares.iter_mut().zip(losses) {
                *share = libm::exp(-loss / self.temperature - largest);
                sum += *share;
            }
        }
        let (mut n_within, mut seen) = (0, 0.0);
        for place in 0..order.len() {
            let class = order[place];
            let misfit = match self.misfit {
                Misfit::Margin if class == best => -margin,
                Misfit::Margin => losses[class] - losses[best],
                Misfit::Probability => -(shares[class] / sum),
                Misfit::Cumulative => {
                    seen += shares[class] / sum;
                    seen
                }
            };
            if misfit <= self.limits[class] {
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

    fn within(misfit: Misfit, limits: [f64; 3], losses: [f64; 3]) -> Vec<usize> {
        let rule = Candidates { misfit, temperature: 0.5, limits: limits.to_vec() };
        let (mut order, mut shares) = ([0; 3], [0.0; 3]);
        let n = rule.within(&losses, &mut order, &mut shares);
        order[..n].to_vec()
    }

    #[test]
    fn candidates_by_their_distance_from_the_best_other() {
        let of = |limits, losses| within(Misfit::Margin, limits, losses);
        assert_eq!(of([0.25; 3], [0.5, 0.25, 1.0]), [1, 0]);
        assert_eq!(of([f64::INFINITY; 3], [0.5, 0.25, 0.25]), [1, 2, 0]);
        // The best one alone, though it is not clear enough.
        assert_eq!(of([-0.5; 3], [0.5, 0.25, 1.0]), [1]);
        assert_eq!(of([0.3, -0.5, 0.0], [0.5, 0.25, 1.0]), [0]);
    }

    #[test]
    fn candidates_by_their_probability() {
        // Shares of 1, 1/4 and 1/2.
        let losses = [0.0, 2.0_f64.ln(), 2.0_f64.ln() / 2.0];
        let of = |misfit, limit| within(misfit, [limit; 3], losses);
        assert_eq!(of(Misfit::Probability, -0.2), [0, 2]);
        assert_eq!(of(Misfit::Probability, -0.1), [0, 2, 1]);
        assert_eq!(of(Misfit::Probability, -0.9), [0]);
        assert_eq!(of(Misfit::Cumulative, 0.9), [0, 2]);
        assert_eq!(of(Misfit::Cumulative, 0.1), [0]);
    }
}
