//! Do the parts fit together?

use super::codes::Codes;
use super::fault::Fault;
use super::file;
use super::notes::check_names;
use super::parts::{ModelParts, Tensor, MAX_AXES, MAX_CLASSES, MAX_WINDOW};
use super::trained::Model;
use super::weights::Weights;
use crate::memory::collected;

impl Model {
    /// A model of parts that fit together.
    ///
    /// # Errors
    /// The first [`Fault`] found: sizes, then values, then labels and notes.
    pub fn new(parts: ModelParts<'_>) -> Result<Self, Fault> {
        let ModelParts { features, n_samples, n_axes, coef, intercept, coding_matrix, classes, .. } = &parts;
        let (n_samples, n_axes, n_classes) = (*n_samples, *n_axes, classes.len());
        in_range("n_samples", n_samples, 1, MAX_WINDOW)?;
        in_range("n_axes", n_axes, 1, MAX_AXES)?;
        in_range("classes", n_classes, 2, MAX_CLASSES)?;
        // Sizes before anything is made of them.
        features.check_sizes(n_samples, n_axes)?;
        let extraction = features.ready(n_samples, n_axes)?;
        let (n_raw, n_features) = extraction.n_features(n_samples, n_axes)?;
        let n_learners = intercept.len();
        intercept.check_shape("intercept", &[n_learners.max(1)], || "(L,), one per learner".to_owned())?;
        coef.check_shape("coef", &[n_learners, n_features], || {
            format!("({n_learners}, {n_features}), as many rows as intercept and {n_features} features for n_samples = {n_samples}, n_axes = {n_axes} and the feature_spec")
        })?;
        coding_matrix.check_shape("coding_matrix", &[n_classes, n_learners], || {
            format!("({n_classes}, {n_learners}), one row per class and one column per learner")
        })?;
        check_names("classes", classes)?;
        parts.notes.check(n_axes)?;
        let codes = Codes::new(coding_matrix, n_classes, n_learners, parts.decoding)?;
        let rules = file::rules::read(&parts.notes.trained, classes, &codes)?;
        parts.check_optional(n_raw, n_learners)?;
        intercept.check_finite("intercept")?;
        let weights = Weights::new(
            n_learners,
            (n_samples, n_axes),
            (n_raw, n_features),
            |learner, feature| coef.finite("coef", learner * n_features + feature),
            intercept.to_vec()?,
        )?;
        let owned = |tensor: &Option<Tensor<'_>>| tensor.as_ref().map(Tensor::to_vec).transpose();
        let pairs = |tensor: &Option<Tensor<'_>>| {
            let pairs = |tensor: &Tensor<'_>| {
                collected((0..tensor.len() / 2).map(|i| [tensor.at(2 * i), tensor.at(2 * i + 1)]))
            };
            tensor.as_ref().map(pairs).transpose()
        };
        let model = Self {
            extraction,
            n_samples,
            n_axes,
            weights,
            codes,
            loss: parts.loss,
            decoding: parts.decoding,
            raw_mean: owned(&parts.raw_mean)?,
            raw_low: owned(&parts.raw_low)?,
            raw_high: owned(&parts.raw_high)?,
            early: pairs(&parts.early)?,
            sigmoid: pairs(&parts.sigmoid)?,
            posterior_weights: owned(&parts.posterior_weights)?,
            classes: parts.classes,
            rules,
            notes: parts.notes,
            lacks_digest: false,
        };
        model.check_header()?;
        Ok(model)
    }
}

impl ModelParts<'_> {
    /// The tensors that a model may lack.
    fn check_optional(&self, n_raw: usize, n_learners: usize) -> Result<(), Fault> {
        let of_raw = [("raw_mean", &self.raw_mean), ("raw_low", &self.raw_low), ("raw_high", &self.raw_high)];
        for (name, tensor) in of_raw {
            let Some(tensor) = tensor else { continue };
            if n_raw == 0 {
                return Err(Fault::Alone { name, needed: "raw features" });
            }
            tensor.check_shape(name, &[n_raw], || format!("({n_raw},), n_axes * n_samples"))?;
            tensor.check_finite(name)?;
        }
        match (&self.raw_low, &self.raw_high) {
            (Some(low), Some(high)) => {
                if let Some(index) = (0..n_raw).find(|index| low.at(*index) > high.at(*index)) {
                    return Err(Fault::Reversed { index, low: low.at(index), high: high.at(index) });
                }
            }
            (Some(_), None) => return Err(Fault::Alone { name: "raw_low", needed: "raw_high" }),
            (None, Some(_)) => return Err(Fault::Alone { name: "raw_high", needed: "raw_low" }),
            (None, None) => {}
        }
        if let Some(early) = &self.early {
            self.check_early(early)?;
        }
        if let Some(sigmoid) = &self.sigmoid {
            sigmoid.check_shape("sigmoid", &[n_learners, 2], || {
                format!("({n_learners}, 2), slope and offset per learner")
            })?;
            sigmoid.check_finite("sigmoid")?;
            if self.notes.posterior.is_empty() {
                return Err(Fault::Alone { name: "sigmoid", needed: "a posterior in the metadata" });
            }
        } else if !self.notes.posterior.is_empty() {
            return Err(Fault::Alone { name: "posterior in the metadata", needed: "sigmoid" });
        }
        if let Some(weights) = &self.posterior_weights {
            let name = "posterior_weights";
            weights.check_shape(name, &[n_learners], || format!("({n_learners},), one per learner"))?;
            weights.check_positive(name)?;
            if self.sigmoid.is_none() {
                return Err(Fault::Alone { name, needed: "sigmoid" });
            }
        }
        Ok(())
    }

    fn check_early(&self, early: &Tensor<'_>) -> Result<(), Fault> {
        let rows = early.len() / 2;
        early.check_shape("early", &[rows.max(1), 2], || {
            "(M, 2), samples seen and margin needed".to_owned()
        })?;
        early.check_finite("early")?;
        let n_samples = self.n_samples;
        let mut before = 0.0;
        for row in 0..rows {
            let (seen, margin) = (early.at(2 * row), early.at(2 * row + 1));
            if !(seen > before && seen <= n_samples as f64 && seen.fract() == 0.0 && margin >= 0.0) {
                return Err(Fault::Early { row, n_samples, seen, margin });
            }
            before = seen;
        }
        Ok(())
    }
}

pub(super) fn in_range(what: &'static str, got: usize, least: usize, most: usize) -> Result<(), Fault> {
    if (least..=most).contains(&got) {
        Ok(())
    } else {
        Err(Fault::Count { what, least, most, got })
    }
}
