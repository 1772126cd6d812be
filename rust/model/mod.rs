//! What a trained identifier is at run time: features, linear learners, output codes, classes; and its file.
//!
//! Nothing here learns. A [`Model`] is checked once, when it is made or read, and never changes: it may be shared between
//! threads, and none of its methods panics.
//!
//! **The order of addition** is part of what a model is, so that a stream, a batch and any other reader of the file give the
//! same bits. For each learner, with `x` the wrench and `h` the histogram features:
//!
//! ```text
//! raw = 0;  for sample: for axis: raw += coef[axis * n_samples + sample] * x[sample, axis]
//! hist = 0; for j, where h[j] != 0: hist += coef[n_raw + j] * h[j]
//! score = (intercept + raw) + hist
//! ```
//!
//! Multi-band features stand in the place of `h`, in their order, and there are no raw ones. The sums of the novelty score
//! run over all features in this order.

mod builder;
mod decoding;
mod error;
mod file;
mod json;
mod metadata;
mod rules;
mod scores;
mod tensor;

#[doc(hidden)]
pub use builder::Extraction;
pub use builder::{
    Features, ModelParts, MAX_AXES, MAX_BINS_IN_ALL, MAX_CLASSES, MAX_MULTIBAND_AXES, MAX_MULTIBAND_VALUES,
    MAX_WINDOW,
};
pub(crate) use decoding::best_and_margin;
#[doc(hidden)]
pub use decoding::ranking;
pub use decoding::{Answer, Loss};
pub use error::{ModelError, ModelFileError};
pub use file::{MAX_FILE_BYTES, MAX_HEADER_BYTES};
pub use metadata::{Metadata, MAX_NAME_BYTES};
pub(crate) use rules::RuleOutcome;
pub use rules::{NoveltyParts, Rules};
pub(crate) use scores::AddRows;
pub use tensor::Tensor;

use crate::multiband::MultiBand;
use crate::Extractor;
use decoding::Codes;
use rules::Novelty;
use scores::Weights;

/// A trained identifier: features of a recording, a score per linear learner, a mean loss per class.
///
/// Made by [`Model::new`] from parts, or read by [`Model::read`] and [`Model::from_bytes`]; immutable, shared between
/// threads.
///
/// ```
/// use granular_id::model::{ModelParts, Tensor};
/// use granular_id::{FeatureSpec, Model};
///
/// // Two materials that differ in the second of three samples of one axis.
/// let spec = FeatureSpec::default().with_hfmh(false);
/// let coef = Tensor::new(vec![1, 3], &[0.0, 2.0, 0.0]);
/// let intercept = Tensor::new(vec![1], &[-1.0]);
/// let coding_matrix = Tensor::new(vec![2, 1], &[1.0, -1.0]);
/// let classes = vec!["rice".to_owned(), "salt".to_owned()];
/// let model = Model::new(ModelParts::new(spec, 3, 1, coef, intercept, coding_matrix, classes))?;
/// let answer = model.identify(&[0.1, 0.9, 0.2])?;
/// assert_eq!(model.classes()[answer.best], "rice");
/// assert_eq!(Model::from_bytes(&model.to_bytes()?, 1 << 20)?, model);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    extraction: Extraction,
    n_samples: usize,
    n_axes: usize,
    weights: Weights,
    codes: Codes,
    loss: Loss,
    raw_mean: Option<Vec<f64>>,
    early: Option<Vec<[f64; 2]>>,
    classes: Vec<String>,
    rules: Rules,
    novelty: Option<Novelty>,
    metadata: Metadata,
}

impl Model {
    /// What is extracted from a recording; `None` for multi-band features.
    #[must_use]
    pub fn extractor(&self) -> Option<&Extractor> {
        match &self.extraction {
            Extraction::Paper { extractor, .. } => Some(extractor),
            Extraction::MultiBand(_) => None,
        }
    }

    /// The multi-band features that are extracted; `None` for samples and histograms.
    #[must_use]
    pub fn multiband(&self) -> Option<&MultiBand> {
        match &self.extraction {
            Extraction::Paper { .. } => None,
            Extraction::MultiBand(multiband) => Some(multiband),
        }
    }

    /// Sampling rate of a recording, in hertz.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        match &self.extraction {
            Extraction::Paper { extractor, .. } => extractor.spec().rate_hz,
            Extraction::MultiBand(multiband) => multiband.spec().rate_hz,
        }
    }

    /// Samples of a recording.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.n_samples
    }

    /// Axes of a sample.
    #[must_use]
    pub fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// Features of a recording: D.
    #[must_use]
    pub fn n_features(&self) -> usize {
        self.weights.n_features()
    }

    /// Features of the raw block; 0 without one.
    #[must_use]
    pub fn n_raw(&self) -> usize {
        self.weights.n_raw
    }

    /// Binary learners: L.
    #[must_use]
    pub fn n_learners(&self) -> usize {
        self.weights.n_learners
    }

    /// Labels of the K classes.
    #[must_use]
    pub fn classes(&self) -> &[String] {
        &self.classes
    }

    /// The binary loss.
    #[must_use]
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// The weight of a feature, in the order of [`Extractor::extract`] or
    /// [`MultiBand::extract_into`]; 0 where there is none.
    #[must_use]
    pub fn coef(&self, learner: usize, feature: usize) -> f64 {
        self.weights.coef(learner, feature)
    }

    /// The intercepts of the learners.
    #[must_use]
    pub fn intercepts(&self) -> &[f64] {
        &self.intercept()[..self.n_learners()]
    }

    /// Code -1, 0 or +1 of a class at a learner; 0 where there is none.
    #[must_use]
    pub fn code(&self, class: usize, learner: usize) -> i8 {
        self.codes.code(class, learner)
    }

    /// Mean of the training recordings, axis by axis.
    #[must_use]
    pub fn raw_mean(&self) -> Option<&[f64]> {
        self.raw_mean.as_deref()
    }

    /// The rule for early answers: samples seen (rising) and the margin needed from there on.
    #[must_use]
    pub fn early(&self) -> Option<&[[f64; 2]]> {
        self.early.as_deref()
    }

    /// The margin that an early answer needs after `n_seen` samples: that of the latest row of [`early`](Self::early)
    /// reached. `None` before the first, and without a rule.
    #[must_use]
    pub fn margin_needed(&self, n_seen: usize) -> Option<f64> {
        let rows = self.early()?;
        let reached = rows.partition_point(|[from, _]| *from <= n_seen as f64);
        rows[..reached].last().map(|[_, margin]| *margin)
    }

    /// Rules for whole recordings: candidates, and refusal of unknown materials.
    #[must_use]
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// What describes the model; of all this only [`rules`](Self::rules) are part of an answer.
    #[must_use]
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// What the novelty is computed with, where unknown materials are refused: rows and values of scaling, directions and
    /// means.
    #[doc(hidden)]
    #[must_use]
    pub fn novelty(&self) -> Option<[(usize, Vec<f32>); 3]> {
        Some(self.novelty.as_ref()?.tensors(|feature| self.weights.row_of(feature)))
    }

    /// What is extracted.
    #[doc(hidden)]
    #[must_use]
    pub fn extraction(&self) -> &Extraction {
        &self.extraction
    }
}
