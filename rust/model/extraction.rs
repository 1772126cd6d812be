//! What a model computes from a recording before it weighs anything.

use super::checks::in_range;
use super::fault::Fault;
use super::parts::{Tensor, MAX_BINS_IN_ALL};
use crate::error::Error;
use crate::extract::{finite, not_finite};
use crate::memory::filled;
use crate::multiband::{n_bands, MultiBand, MultiBandSpec, Scales};
use crate::{BatchShape, Extractor, FeatureSpec};

/// The largest number of axes of a multi-band model: each adds twice to the size of a matrix whose logarithm is taken.
pub const MAX_MULTIBAND_AXES: usize = 32;

/// The largest number of values of a recording of a multi-band model: nearly a minute and a half of six axes at 500 Hz. A
/// design takes up to 150 bytes for each, however small the file that asks for it, and 650 more once it works.
pub const MAX_MULTIBAND_VALUES: usize = 1 << 18;

/// What is extracted from a recording, before anybody has looked at it.
#[derive(Clone, Debug)]
pub enum Features<'a> {
    /// Samples and histograms: scores add up sample by sample.
    Additive(FeatureSpec),
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
        Self::Additive(spec)
    }
}

/// The same, checked and ready.
#[allow(clippy::large_enum_variant)] // a model has one
#[derive(Clone, Debug)]
pub enum Extraction {
    /// Samples as they are, and what counts them.
    Additive {
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
            (Self::Additive { extractor: a, .. }, Self::Additive { extractor: b, .. }) => {
                a.spec() == b.spec()
            }
            (Self::MultiBand(a), Self::MultiBand(b)) => (a.spec(), a.scales()) == (b.spec(), b.scales()),
            _ => false,
        }
    }
}

impl Features<'_> {
    /// Number of raw features and of all, for recordings whose size is within the limits.
    ///
    /// # Errors
    /// Sizes that a small file must not ask for, and scales of another shape.
    pub(super) fn check_sizes(&self, n_samples: usize, n_axes: usize) -> Result<(), Fault> {
        match self {
            Self::Additive(spec) => {
                let ranges = spec.bin_ranges.len();
                if ranges != 1 && ranges != n_axes {
                    return Err(Error::RangeCount { ranges, axes: n_axes }.into());
                }
                let n_bins = spec.n_bins.saturating_mul(ranges);
                in_range("n_bins of all axes together", n_bins, 1, MAX_BINS_IN_ALL)
            }
            Self::MultiBand { spec, band_scales, level_scales } => {
                in_range("n_axes of multi-band features", n_axes, 1, MAX_MULTIBAND_AXES)?;
                let values = n_samples.saturating_mul(n_axes);
                in_range("values of a recording of multi-band features", values, 1, MAX_MULTIBAND_VALUES)?;
                let bands = n_bands(n_samples);
                band_scales.check_shape("band_scales", &[bands, n_axes], || {
                    format!("({bands}, {n_axes}), one per band of {n_samples} samples and axis")
                })?;
                band_scales.check_positive("band_scales")?;
                match (spec.level, level_scales) {
                    (true, None) => Err(Fault::MissingTensor { name: "level_scales" }),
                    (false, Some(_)) => {
                        Err(Fault::Alone { name: "level_scales", needed: "the block 'level'" })
                    }
                    (false, None) => Ok(()),
                    (true, Some(levels)) => {
                        levels.check_shape("level_scales", &[n_axes], || {
                            format!("({n_axes},), one per axis")
                        })?;
                        levels.check_positive("level_scales")
                    }
                }
            }
        }
    }

    /// The tool for the work; sizes are checked already.
    pub(super) fn ready(&self, n_samples: usize, n_axes: usize) -> Result<Extraction, Fault> {
        match self {
            Self::Additive(spec) => {
                let extractor = Extractor::new(spec.clone())?;
                let histograms = spec.hfmh.then(|| extractor.without_raw());
                Ok(Extraction::Additive { extractor, histograms })
            }
            Self::MultiBand { spec, band_scales, level_scales } => {
                let level = level_scales.as_ref().map_or_else(|| filled(1.0, n_axes), Tensor::to_vec)?;
                let scales = Scales { bands: band_scales.to_vec()?, level };
                Ok(Extraction::MultiBand(MultiBand::new(*spec, n_samples, n_axes, &scales)?))
            }
        }
    }
}

impl Extraction {
    /// Number of raw features and of all features of a recording.
    pub(super) fn n_features(&self, n_samples: usize, n_axes: usize) -> Result<(usize, usize), Error> {
        match self {
            Self::Additive { extractor, .. } => {
                let n_raw = if extractor.spec().raw { n_samples * n_axes } else { 0 };
                Ok((n_raw, extractor.n_features(n_samples, n_axes)?))
            }
            Self::MultiBand(multiband) => Ok((0, multiband.n_features())),
        }
    }

    /// Sampling rate of the recordings, in hertz.
    pub(super) fn rate_hz(&self) -> f64 {
        match self {
            Self::Additive { extractor, .. } => extractor.spec().rate_hz,
            Self::MultiBand(multiband) => multiband.spec().rate_hz,
        }
    }

    /// Refuses a batch of another size than `wrench` has.
    pub(super) fn check(&self, wrench: &[f64], shape: BatchShape) -> Result<(), Error> {
        match self {
            Self::Additive { extractor, .. } => extractor.check(wrench, shape).map(drop),
            Self::MultiBand(_) => {
                let BatchShape { n_recordings, n_samples, n_axes } = shape;
                if n_recordings == 0 {
                    return Err(Error::Empty {
                        what: "wrench",
                        shape: vec![n_recordings, n_samples, n_axes],
                    });
                }
                let expected = n_recordings.saturating_mul(shape.recording_len());
                if wrench.len() != expected {
                    return Err(Error::Length { what: "wrench", expected, got: wrench.len() });
                }
                Ok(())
            }
        }
    }

    /// All features but raw ones, recording by recording; none where there are no others.
    pub(super) fn extract(&self, wrench: &[f64], shape: BatchShape) -> Result<Vec<f64>, Error> {
        match self {
            Self::Additive { histograms: Some(histograms), .. } => histograms.extract(wrench, shape, 1),
            Self::MultiBand(multiband) => {
                let mut out = filled(0.0, shape.n_recordings.saturating_mul(multiband.n_features()))?;
                multiband.extract_batch(wrench, shape, 1, &mut out)?;
                Ok(out)
            }
            Self::Additive { .. } if finite(wrench) => Ok(Vec::new()),
            Self::Additive { .. } => Err(not_finite(wrench, shape)),
        }
    }
}
