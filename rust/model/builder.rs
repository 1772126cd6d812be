//! What a model is made of, and whether the parts fit together.

use super::decoding::Codes;
use super::metadata::check_names;
use super::rules::{Novelty, NoveltyParts, Rules};
use super::scores::Weights;
use super::tensor::Tensor;
use super::{Loss, Metadata, Model, ModelError};
use crate::error::{short_number, Error};
use crate::features::{finite, not_finite, ranges_refused};
use crate::memory::filled;
use crate::multiband::{n_bands, Block, MultiBand, MultiBandSpec, Scales};
use crate::{BatchShape, Extractor, FeatureSpec};

/// The largest number of classes.
pub const MAX_CLASSES: usize = 1024;

/// The largest number of samples per axis: half an hour at 500 Hz. A small file must not lead to a large window.
pub const MAX_WINDOW: usize = 1 << 20;

/// The largest number of axes.
pub const MAX_AXES: usize = 256;

/// The largest number of bins of all histograms together: their edges take 8 MB.
pub const MAX_BINS_IN_ALL: usize = 1 << 20;

/// The largest number of axes of a multi-band model: each adds twice to the size of a matrix whose resolvents are taken.
pub const MAX_MULTIBAND_AXES: usize = 32;

/// The largest number of values of a recording of a multi-band model: nearly a minute and a half of six axes at 500 Hz. A
/// design takes up to 150 bytes for each, however small the file, and 650 more once it works.
pub const MAX_MULTIBAND_VALUES: usize = 1 << 18;

/// The parts of a [`Model`]: L learners, D features, K classes. Made by [`ModelParts::new`]; then each can be set.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ModelParts<'a> {
    /// What is extracted from a recording.
    pub features: Features<'a>,
    /// Samples of a recording.
    pub n_samples: usize,
    /// Axes of a sample.
    pub n_axes: usize,
    /// Weights (L, D), features in the order of [`Extractor::extract`] or
    /// [`MultiBand::extract_into`].
    pub coef: Tensor<'a>,
    /// Intercepts (L,).
    pub intercept: Tensor<'a>,
    /// Codes (K, L): -1, 0, +1.
    pub coding_matrix: Tensor<'a>,
    /// Labels of the classes.
    pub classes: Vec<String>,
    /// The binary loss.
    pub loss: Loss,
    /// Mean of the training recordings, axis by axis (`n_axes * n_samples`,): what a sample not yet seen is taken for.
    pub raw_mean: Option<Tensor<'a>>,
    /// Samples seen and margin needed (M, 2) for an early answer.
    pub early: Option<Tensor<'a>>,
    /// What the novelty of a recording is computed with; there exactly if the metadata has a rule that refuses unknown
    /// materials.
    pub novelty: Option<NoveltyParts<'a>>,
    /// What describes the model; of all this only the rules are part of an answer.
    pub metadata: Metadata,
}

/// What is extracted from a recording, not checked yet.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Features<'a> {
    /// Samples and histograms: scores add up sample by sample.
    Paper(FeatureSpec),
    /// Multi-band features.
    MultiBand {
        /// Which blocks, and the rate.
        spec: MultiBandSpec,
        /// Typical size of each band and axis in the training recordings (`n_bands`, `n_axes`).
        band_scales: Tensor<'a>,
        /// Typical size of the level of each axis (`n_axes`,); there exactly if the specification has levels.
        level_scales: Option<Tensor<'a>>,
    },
}

impl From<FeatureSpec> for Features<'_> {
    fn from(spec: FeatureSpec) -> Self {
        Self::Paper(spec)
    }
}

impl Model {
    /// A model of parts that fit together.
    ///
    /// # Errors
    /// The first [`ModelError`] found: sizes, then values, then labels and metadata.
    pub fn new(parts: ModelParts<'_>) -> Result<Self, ModelError> {
        let ModelParts { n_samples, n_axes, ref coef, ref intercept, ref coding_matrix, .. } = parts;
        let (n_classes, n_learners) = (parts.classes.len(), intercept.len());
        ModelError::check_range("n_samples", n_samples, 1..=MAX_WINDOW)?;
        ModelError::check_range("n_axes", n_axes, 1..=MAX_AXES)?;
        ModelError::check_range("classes", n_classes, 2..=MAX_CLASSES)?;
        let extraction = parts.features.checked(n_samples, n_axes)?;
        let (n_raw, n_features) = extraction.n_features(n_samples, n_axes)?;
        intercept.check_shape("intercept", &[n_learners.max(1)], "(L,), one per learner")?;
        let wanted = format_args!(
            "({n_learners}, {n_features}), as many rows as intercept and {n_features} features for \
             n_samples = {n_samples}, n_axes = {n_axes} and the feature_spec"
        );
        coef.check_shape("coef", &[n_learners, n_features], wanted)?;
        coding_matrix.check_shape(
            "coding_matrix",
            &[n_classes, n_learners],
            format_args!("({n_classes}, {n_learners}), one row per class and one column per learner"),
        )?;
        check_names("classes", &parts.classes)?;
        parts.metadata.check(n_axes)?;
        let codes = Codes::new(coding_matrix, n_classes, n_learners)?;
        let rules = Rules::read(&parts.metadata.trained, &parts.classes)?;
        parts.check_optional(n_raw)?;
        if rules.refuse_unknown() != parts.novelty.is_some() {
            return Err(ModelError::part(
                "novelty",
                "must be there exactly if a rule refuses unknown materials",
            ));
        }
        intercept.check_finite("intercept")?;
        let weights = Weights::new(coef, intercept.to_vec()?, (n_samples, n_axes), (n_raw, n_features))?;
        let novelty = |parts| Novelty::new(parts, n_classes, n_features, |row| weights.feature_of(row));
        let novelty = parts.novelty.as_ref().map(novelty).transpose()?;
        let model = Self {
            extraction,
            n_samples,
            n_axes,
            weights,
            codes,
            loss: parts.loss,
            raw_mean: parts.raw_mean.as_ref().map(Tensor::to_vec).transpose()?,
            early: parts.early.as_ref().map(Tensor::to_pairs).transpose()?,
            classes: parts.classes,
            rules,
            novelty,
            metadata: parts.metadata,
        };
        model.check_header()?;
        Ok(model)
    }
}

impl<'a> ModelParts<'a> {
    /// What every model has; the paper's loss, and nothing that a model may lack.
    #[must_use]
    pub fn new(
        features: impl Into<Features<'a>>,
        n_samples: usize,
        n_axes: usize,
        coef: Tensor<'a>,
        intercept: Tensor<'a>,
        coding_matrix: Tensor<'a>,
        classes: Vec<String>,
    ) -> Self {
        Self {
            features: features.into(),
            n_samples,
            n_axes,
            coef,
            intercept,
            coding_matrix,
            classes,
            loss: Loss::default(),
            raw_mean: None,
            early: None,
            novelty: None,
            metadata: Metadata::of_axes(n_axes),
        }
    }

    /// The tensors that a model may lack.
    fn check_optional(&self, n_raw: usize) -> Result<(), ModelError> {
        if let Some(mean) = &self.raw_mean {
            if n_raw == 0 {
                return Err(ModelError::no_use("raw_mean", "raw features"));
            }
            mean.check_shape("raw_mean", &[n_raw], format_args!("({n_raw},), n_axes * n_samples"))?;
            mean.check_finite("raw_mean")?;
        }
        if let Some(early) = &self.early {
            self.check_early(early)?;
        }
        Ok(())
    }

    fn check_early(&self, early: &Tensor<'_>) -> Result<(), ModelError> {
        let (rows, n_samples) = (early.len() / 2, self.n_samples);
        early.check_shape("early", &[rows.max(1), 2], "(M, 2), samples seen and margin needed")?;
        early.check_finite("early")?;
        let mut before = 0.0;
        for row in 0..rows {
            let (seen, margin) = (early.at(2 * row), early.at(2 * row + 1));
            if !(seen > before && seen <= n_samples as f64 && seen.fract() == 0.0 && margin >= 0.0) {
                let (seen, margin) = (short_number(seen), short_number(margin));
                let problem = format!(
                    "must be (samples seen, margin): whole, rising, from 1 to {n_samples}; at least 0. \
                     Got ({seen}, {margin})"
                );
                return Err(ModelError::part(format!("early[{row}]"), problem));
            }
            before = seen;
        }
        Ok(())
    }
}

/// What is extracted from a recording, checked and ready.
#[allow(clippy::large_enum_variant)] // a model has one
#[derive(Clone, Debug)]
pub enum Extraction {
    /// Samples as they are, and what counts them.
    Paper {
        /// What extracts all of them.
        extractor: Extractor,
        /// The extractor without the raw block; `None` where there is nothing to count.
        histograms: Option<Extractor>,
    },
    /// Multi-band features.
    MultiBand(MultiBand),
}

impl PartialEq for Extraction {
    /// The same features, bit for bit.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Paper { extractor: a, .. }, Self::Paper { extractor: b, .. }) => a.spec() == b.spec(),
            (Self::MultiBand(a), Self::MultiBand(b)) => (a.spec(), a.scales()) == (b.spec(), b.scales()),
            _ => false,
        }
    }
}

impl Features<'_> {
    /// The extractor of these features, once its size is checked.
    fn checked(&self, n_samples: usize, n_axes: usize) -> Result<Extraction, ModelError> {
        match self {
            Self::Paper(spec) => {
                let ranges = spec.bin_ranges.len();
                if ranges != 1 && ranges != n_axes {
                    return Err(ranges_refused(ranges, n_axes).into());
                }
                let n_bins = spec.n_bins.saturating_mul(ranges);
                ModelError::check_range("n_bins of all axes together", n_bins, 1..=MAX_BINS_IN_ALL)?;
                let extractor = Extractor::new(spec.clone())?;
                let histograms = spec.hfmh.then(|| extractor.without_raw());
                Ok(Extraction::Paper { extractor, histograms })
            }
            Self::MultiBand { spec, band_scales, level_scales } => {
                ModelError::check_range("n_axes of multi-band features", n_axes, 1..=MAX_MULTIBAND_AXES)?;
                let values = n_samples.saturating_mul(n_axes);
                ModelError::check_range(
                    "values of a recording of multi-band features",
                    values,
                    1..=MAX_MULTIBAND_VALUES,
                )?;
                let bands = n_bands(n_samples);
                let wanted =
                    format_args!("({bands}, {n_axes}), one per band of {n_samples} samples and axis");
                band_scales.check_shape("band_scales", &[bands, n_axes], wanted)?;
                band_scales.check_positive("band_scales")?;
                let level = match (spec.wants(Block::Level), level_scales) {
                    (true, None) => return Err(ModelError::missing_tensor("level_scales")),
                    (false, Some(_)) => return Err(ModelError::no_use("level_scales", "the block 'level'")),
                    (false, None) => filled(1.0, n_axes)?,
                    (true, Some(levels)) => {
                        let wanted = format_args!("({n_axes},), one per axis");
                        levels.check_shape("level_scales", &[n_axes], wanted)?;
                        levels.check_positive("level_scales")?;
                        levels.to_vec()?
                    }
                };
                let scales = Scales { bands: band_scales.to_vec()?, level };
                Ok(Extraction::MultiBand(MultiBand::new(*spec, n_samples, n_axes, &scales)?))
            }
        }
    }
}

impl Extraction {
    /// Number of raw features and of all features of a recording.
    fn n_features(&self, n_samples: usize, n_axes: usize) -> Result<(usize, usize), Error> {
        match self {
            Self::Paper { extractor, .. } => {
                let n_raw = if extractor.spec().raw { n_samples * n_axes } else { 0 };
                Ok((n_raw, extractor.n_features(n_samples, n_axes)?))
            }
            Self::MultiBand(multiband) => Ok((0, multiband.n_features())),
        }
    }

    /// Refuses a batch of another size than `wrench` has.
    pub(super) fn check(&self, wrench: &[f64], shape: BatchShape) -> Result<(), Error> {
        match self {
            Self::Paper { extractor, .. } => extractor.check_len(wrench.len(), shape).map(drop),
            Self::MultiBand(multiband) => multiband.check_batch(wrench.len(), shape),
        }
    }

    /// All features but raw ones, recording by recording; none where there are no others.
    pub(super) fn extract(&self, wrench: &[f64], shape: BatchShape) -> Result<Vec<f64>, Error> {
        match self {
            Self::Paper { histograms: Some(histograms), .. } => histograms.extract(wrench, shape, 1),
            Self::MultiBand(multiband) => {
                let mut out = filled(0.0, shape.n_recordings.saturating_mul(multiband.n_features()))?;
                multiband.extract_batch(wrench, shape, 1, &mut out)?;
                Ok(out)
            }
            Self::Paper { .. } if finite(wrench) => Ok(Vec::new()),
            Self::Paper { .. } => Err(not_finite(wrench, shape)),
        }
    }
}
