//! A checked model and what it is made of.

use super::codes::Codes;
use super::extraction::Extraction;
use super::loss::{Decoding, Loss};
use super::notes::Notes;
use super::rules::Rules;
use super::weights::Weights;
use crate::multiband::MultiBand;
use crate::Extractor;

/// A trained identifier: features of a recording, a score per linear learner, a mean loss per class.
///
/// Made by [`Model::new`] from parts, or read by [`Model::read`] and [`Model::from_bytes`]; immutable, shared between
/// threads.
///
/// ```
/// use granular_id::model::{Decoding, Loss, ModelParts, Notes, Tensor};
/// use granular_id::{FeatureSpec, Model};
///
/// // Two materials, told apart by the second of three samples of one axis.
/// let spec = FeatureSpec { hfmh: false, ..FeatureSpec::default() };
/// let model = Model::new(ModelParts {
///     features: spec.into(),
///     n_samples: 3,
///     n_axes: 1,
///     coef: Tensor::new(vec![1, 3], &[0.0, 2.0, 0.0]),
///     intercept: Tensor::new(vec![1], &[-1.0]),
///     coding_matrix: Tensor::new(vec![2, 1], &[1.0, -1.0]),
///     classes: vec!["rice".to_owned(), "salt".to_owned()],
///     loss: Loss::Hinge,
///     decoding: Decoding::LossWeighted,
///     raw_mean: None,
///     raw_low: None,
///     raw_high: None,
///     early: None,
///     sigmoid: None,
///     posterior_weights: None,
///     notes: Notes::of_axes(1),
/// })?;
/// let answer = model.identify(&[0.1, 0.9, 0.2])?;
/// assert_eq!(model.classes()[answer.best], "rice");
/// assert_eq!(Model::from_bytes(&model.to_bytes()?, 1 << 20)?, model);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Model {
    pub(super) extraction: Extraction,
    pub(super) n_samples: usize,
    pub(super) n_axes: usize,
    pub(super) weights: Weights,
    pub(super) codes: Codes,
    pub(super) loss: Loss,
    pub(super) decoding: Decoding,
    pub(super) raw_mean: Option<Vec<f64>>,
    pub(super) raw_low: Option<Vec<f64>>,
    pub(super) raw_high: Option<Vec<f64>>,
    pub(super) early: Option<Vec<[f64; 2]>>,
    pub(super) sigmoid: Option<Vec<[f64; 2]>>,
    pub(super) posterior_weights: Option<Vec<f64>>,
    pub(super) classes: Vec<String>,
    pub(super) rules: Rules,
    pub(super) notes: Notes,
    pub(super) lacks_digest: bool,
}

impl PartialEq for Model {
    /// The same parts, and therefore the same answers, wherever they came from.
    fn eq(&self, other: &Self) -> bool {
        let options = |model: &Self| {
            let optional = [&model.raw_mean, &model.raw_low, &model.raw_high, &model.posterior_weights];
            (optional.map(Clone::clone), model.early.clone(), model.sigmoid.clone())
        };
        self.extraction == other.extraction
            && (self.n_samples, self.n_axes) == (other.n_samples, other.n_axes)
            && (self.loss, self.decoding) == (other.loss, other.decoding)
            && (&self.weights, &self.codes) == (&other.weights, &other.codes)
            && (&self.classes, &self.notes) == (&other.classes, &other.notes)
            && options(self) == options(other)
    }
}

impl Model {
    /// What is extracted from a recording; `None` for multi-band features.
    #[must_use]
    pub fn extractor(&self) -> Option<&Extractor> {
        match &self.extraction {
            Extraction::Additive { extractor, .. } => Some(extractor),
            Extraction::MultiBand(_) => None,
        }
    }

    /// The multi-band features that are extracted; `None` for samples and histograms.
    #[must_use]
    pub fn multiband(&self) -> Option<&MultiBand> {
        match &self.extraction {
            Extraction::Additive { .. } => None,
            Extraction::MultiBand(multiband) => Some(multiband),
        }
    }

    /// Sampling rate of a recording, in hertz.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.extraction.rate_hz()
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

    /// Whether there is one learner for each pair of classes `i < j`, in their order, for which `i` is positive.
    #[must_use]
    pub fn is_of_pairs(&self) -> bool {
        self.codes.is_of_pairs()
    }

    /// The binary loss.
    #[must_use]
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// By what the summed loss of a class is divided.
    #[must_use]
    pub fn decoding(&self) -> Decoding {
        self.decoding
    }

    /// The weight of a feature, in the order of [`Extractor::extract`] or
    /// [`MultiBand::extract_into`]; 0 where there is none.
    #[must_use]
    pub fn coef(&self, learner: usize, feature: usize) -> f64 {
        if feature < self.n_features() {
            self.weights.coef(learner, feature)
        } else {
            0.0
        }
    }

    /// The intercepts of the learners.
    #[must_use]
    pub fn intercepts(&self) -> &[f64] {
        &self.weights.intercept()[..self.n_learners()]
    }

    /// Code -1, 0 or +1 of a class at a learner; 0 where there is none.
    #[must_use]
    pub fn code(&self, class: usize, learner: usize) -> i8 {
        if class < self.classes.len() && learner < self.n_learners() {
            self.codes.code(class, learner)
        } else {
            0
        }
    }

    /// Mean of the training recordings, axis by axis.
    #[must_use]
    pub fn raw_mean(&self) -> Option<&[f64]> {
        self.raw_mean.as_deref()
    }

    /// Smallest and largest values of the training recordings, axis by axis.
    #[must_use]
    pub fn raw_range(&self) -> Option<(&[f64], &[f64])> {
        self.raw_low.as_deref().zip(self.raw_high.as_deref())
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

    /// Slope and offset of the sigmoid of each learner.
    #[must_use]
    pub fn sigmoid(&self) -> Option<&[[f64; 2]]> {
        self.sigmoid.as_deref()
    }

    /// Sum of the weights of the training rows behind each learner.
    #[must_use]
    pub fn posterior_weights(&self) -> Option<&[f64]> {
        self.posterior_weights.as_deref()
    }

    /// What is said of a whole recording beside its label.
    #[must_use]
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// What describes the model; of all this only [`rules`](Self::rules) are part of an answer.
    #[must_use]
    pub fn notes(&self) -> &Notes {
        &self.notes
    }

    /// Whether it was read from a file without a digest, as earlier versions wrote them: had the numbers been damaged,
    /// nobody would know.
    #[must_use]
    pub fn lacks_digest(&self) -> bool {
        self.lacks_digest
    }

    /// The same model as one of a file without a digest.
    #[doc(hidden)]
    #[must_use]
    pub fn without_digest(self) -> Self {
        Self { lacks_digest: true, ..self }
    }
}

/// For streams: the same weights in the same order of addition. Rows have [`lanes`](Self::lanes) numbers, those beyond the
/// number of learners zero.
impl Model {
    /// Numbers in a row of weights.
    pub(crate) fn lanes(&self) -> usize {
        self.weights.lanes
    }

    /// By what the summed loss of a class is divided.
    pub(crate) fn divisor(&self, class: usize) -> f64 {
        self.codes.divisor(class)
    }

    /// Codes plus one of all classes at a learner.
    pub(crate) fn codes_of(&self, learner: usize) -> &[u8] {
        self.codes.column(learner)
    }

    /// Rows of weights of raw samples from `sample` on, axis by axis for each; empty without a raw block.
    pub(crate) fn raw_rows(&self, sample: usize) -> &[f64] {
        let (raw, _) = self.weights.blocks();
        raw.get(sample * self.n_axes * self.lanes()..).unwrap_or_default()
    }

    /// Rows of weights of features behind the raw ones, from the one in place `first` on.
    pub(crate) fn rows_from(&self, first: usize) -> &[f64] {
        let (_, rest) = self.weights.blocks();
        rest.get(first * self.lanes()..).unwrap_or_default()
    }

    /// What is extracted.
    #[doc(hidden)]
    #[must_use]
    pub fn extraction(&self) -> &Extraction {
        &self.extraction
    }

    /// Intercepts of all learners.
    pub(crate) fn intercept(&self) -> &[f64] {
        self.weights.intercept()
    }
}
