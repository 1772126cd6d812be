//! What is said of a whole recording beside its label: which classes it may be, and whether it is like none.
//!
//! The rules are made elsewhere, from recordings that did not train. Sources: Vovk, Gammerman, Shafer, "Algorithmic learning
//! in a random world" (2005) for sets of classes; [`NearestMean`] for the distance.

use super::nearest::NearestMean;
use super::scores::{best_and_margin, ranking};
use super::Model;
use crate::error::{Error, Result};

/// A limit of the distance to the nearest class.
#[derive(Clone, Debug, PartialEq)]
pub struct Strangeness {
    /// What is measured.
    pub nearest: NearestMean,
    /// Whether it is measured of the losses of the classes, negated, and not of the scores of the learners.
    pub of_losses: bool,
    /// Recordings farther away are like none of the classes.
    pub threshold: f64,
}

/// Rules for whole recordings; each may be missing.
///
/// ```
/// use granular_id::model::Rules;
///
/// let rules = Rules { limits: Some(vec![0.1; 3]), strangeness: None };
/// assert_eq!(rules.candidates(&[0.50, 0.45, 0.90]), [1, 0]);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rules {
    /// For each class by how much its loss may exceed the least of the others to be a candidate.
    pub limits: Option<Vec<f64>>,
    /// Beyond what a recording is like no class.
    pub strangeness: Option<Strangeness>,
}

impl Rules {
    /// Refuses rules that are none, or that are for other classes or learners than a model has.
    ///
    /// # Errors
    /// [`Error::Rules`].
    pub fn check(&self, model: &Model) -> Result<()> {
        let n_classes = model.classes().len();
        let refuse = |problem| Err(Error::Rules { problem });
        if let Some(limits) = &self.limits {
            if limits.len() != n_classes || limits.iter().any(|limit| limit.is_nan()) {
                return refuse("limits must be one number for each class, none of them NaN");
            }
        }
        if let Some(Strangeness { nearest, of_losses, threshold }) = &self.strangeness {
            if threshold.is_nan() {
                return refuse("threshold must not be NaN");
            }
            if nearest.n_classes() != n_classes {
                return refuse("means must be those of the classes");
            }
            let expected = if *of_losses { n_classes } else { model.n_learners() };
            if nearest.width() != expected || nearest.is_of_pairs() && (*of_losses || !model.is_of_pairs()) {
                return refuse("means must be of what the learners or the losses of the model are");
            }
        }
        Ok(())
    }

    /// Classes that a recording may be, by its mean losses: the likeliest first, and the best one where no other is. None
    /// without a rule.
    #[must_use]
    pub fn candidates(&self, losses: &[f64]) -> Vec<usize> {
        let Some(limits) = &self.limits else { return Vec::new() };
        let (best, margin) = best_and_margin(losses);
        let mut within = ranking(losses);
        within.retain(|class| {
            let behind = if *class == best { -margin } else { losses[*class] - losses[best] };
            limits.get(*class).is_some_and(|limit| behind <= *limit)
        });
        if within.is_empty() {
            within.push(best);
        }
        within
    }

    /// Whether a recording is like no class, by its mean losses and the scores of the learners; `None` without a rule.
    ///
    /// # Errors
    /// As [`NearestMean::distances`].
    pub fn is_unknown(&self, losses: &[f64], scores: &[f64]) -> Result<Option<bool>> {
        let Some(Strangeness { nearest, of_losses, threshold }) = &self.strangeness else { return Ok(None) };
        let distances = if *of_losses {
            nearest.distances(&losses.iter().map(|loss| -loss).collect::<Vec<_>>())?
        } else {
            nearest.distances(scores)?
        };
        Ok(distances.first().map(|distance| *distance > *threshold))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_by_their_distance_from_the_best_other() {
        let of = |limits: [f64; 3], losses: [f64; 3]| {
            Rules { limits: Some(limits.to_vec()), strangeness: None }.candidates(&losses)
        };
        assert_eq!(of([0.25; 3], [0.5, 0.25, 1.0]), [1, 0]);
        assert_eq!(of([f64::INFINITY; 3], [0.5, 0.25, 0.25]), [1, 2, 0]);
        // The best one alone, though it is not clear enough.
        assert_eq!(of([-0.5; 3], [0.5, 0.25, 1.0]), [1]);
        assert_eq!(of([0.3, -0.5, 0.0], [0.5, 0.25, 1.0]), [0]);
        assert!(Rules::default().candidates(&[0.1, 0.2]).is_empty());
    }

    #[test]
    fn far_from_all_is_unknown() {
        let nearest = NearestMean::new(&[0.0, 0.0, 4.0, 0.0], &[1.0, 0.0, 0.0, 1.0]).unwrap();
        let rules = |of_losses| {
            let strangeness = Strangeness { nearest: nearest.clone(), of_losses, threshold: 1.0 };
            Rules { limits: None, strangeness: Some(strangeness) }
        };
        assert_eq!(rules(false).is_unknown(&[9.0, 9.0], &[4.0, 1.0]), Ok(Some(false)));
        assert_eq!(rules(false).is_unknown(&[9.0, 9.0], &[2.0, 0.0]), Ok(Some(true)));
        assert_eq!(rules(true).is_unknown(&[-4.0, 0.5], &[9.0, 9.0]), Ok(Some(false)));
        assert!(rules(false).is_unknown(&[], &[f64::NAN, 0.0]).is_err());
        assert_eq!(Rules::default().is_unknown(&[], &[]), Ok(None));
    }
}
