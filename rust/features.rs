//! From recordings to feature vectors: what to compute ([`FeatureSpec`]) and the tool that does
//! ([`Extractor`]).

mod batch;

use crate::dsp::{butterworth, Band, Outside, Sos, UniformBins};
use crate::error::{Error, Result};
use crate::memory::reserved;
use crate::specs::{choices, setters};
use crate::wrench::{axis_name, BatchShape};

/// The largest number of samples of a recording: counts are 32 bits wide.
pub const MAX_SAMPLES: usize = u32::MAX as usize;

/// The largest number of names that are written out: as many as a model file of the usual limit has weights. They take
/// 400 MB.
const MAX_NAMES: usize = 1 << 21;

/// State of the high-pass before the first sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Initial {
    /// At rest, as in the paper: an offset of the sensor starts a transient that leaks into the histogram.
    #[default]
    Zero,
    /// As if the first sample had lasted for ever: an offset leaves no trace.
    Steady,
}

choices! { Initial: "zero" Zero, "steady" Steady, }

/// What to compute from a recording. The default is the paper's feature vector.
///
/// Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
/// Measurements" (arXiv 2403.17606).
///
/// ```
/// use granular_id::FeatureSpec;
///
/// let spec = FeatureSpec::default().with_cutoff_hz(30.0).with_raw(false);
/// assert_eq!((spec.cutoff_hz, spec.order), (30.0, 8));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct FeatureSpec {
    /// Sampling rate of the recordings, in hertz.
    pub rate_hz: f64,
    /// Cut-off of the Butterworth high-pass before the histogram, in hertz.
    pub cutoff_hz: f64,
    /// Order of the high-pass.
    pub order: usize,
    /// Bins of each histogram.
    pub n_bins: usize,
    /// Ranges of the histograms, in newton and newton metre: one for all axes, or one per axis.
    pub bin_ranges: Vec<(f64, f64)>,
    /// What happens to values outside the range.
    pub outside: Outside,
    /// Densities that integrate to one instead of counts.
    pub density: bool,
    /// State of the high-pass before the first sample.
    pub initial: Initial,
    /// Include the raw samples.
    pub raw: bool,
    /// Include the high-frequency magnitude histograms.
    pub hfmh: bool,
}

impl Default for FeatureSpec {
    fn default() -> Self {
        Self {
            rate_hz: 500.0,
            cutoff_hz: 23.0,
            order: 8,
            n_bins: 100,
            bin_ranges: vec![(-1.5, 1.5)],
            outside: Outside::Drop,
            density: false,
            initial: Initial::Zero,
            raw: true,
            hfmh: true,
        }
    }
}

setters! {
    FeatureSpec:
    with_rate_hz rate_hz f64,
    with_cutoff_hz cutoff_hz f64,
    with_order order usize,
    with_n_bins n_bins usize,
    with_bin_ranges bin_ranges Vec<(f64, f64)>,
    with_outside outside Outside,
    with_density density bool,
    with_initial initial Initial,
    with_raw raw bool,
    with_hfmh hfmh bool,
}

/// Extracts features; a checked [`FeatureSpec`] with its filter and bins. Immutable, shared between threads.
///
/// ```
/// use granular_id::{BatchShape, Extractor, FeatureSpec};
///
/// let extractor = Extractor::new(FeatureSpec::default())?;
/// let shape = BatchShape { n_recordings: 2, n_samples: 1600, n_axes: 6 };
/// let features = extractor.extract(&vec![0.0; 2 * 9600], shape, 1)?;
/// assert_eq!(features.len(), 2 * 10_200);
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Extractor {
    spec: FeatureSpec,
    sos: Sos,
    /// State of each section per unit of the first sample; empty for `Initial::Zero`.
    start: Vec<[f64; 2]>,
    bins: Vec<UniformBins>,
}

impl Extractor {
    /// Checks the specification and designs its filter and bins.
    pub fn new(spec: FeatureSpec) -> Result<Self> {
        if !(spec.raw || spec.hfmh) {
            return Err(Error::argument("raw or hfmh", "be true", "false for both"));
        }
        let sos = butterworth(spec.order, Band::Highpass(spec.cutoff_hz), spec.rate_hz)?;
        let start = match spec.initial {
            Initial::Zero => Vec::new(),
            Initial::Steady => sos.steady_state()?,
        };
        let bins: Vec<_> = spec
            .bin_ranges
            .iter()
            .map(|(low, high)| UniformBins::new(spec.n_bins, *low, *high))
            .collect::<Result<_>>()?;
        if bins.is_empty() {
            return Err(ranges_refused(0, 1));
        }
        Ok(Self { spec, sos, start, bins })
    }

    /// The specification.
    #[must_use]
    pub fn spec(&self) -> &FeatureSpec {
        &self.spec
    }

    /// The high-pass.
    #[must_use]
    pub fn sos(&self) -> &Sos {
        &self.sos
    }

    /// The same without the high-pass: histograms of the samples themselves.
    #[must_use]
    pub fn unfiltered(&self) -> Self {
        Self { sos: Sos::none(), start: Vec::new(), ..self.clone() }
    }

    /// The same without the raw block.
    pub(crate) fn without_raw(&self) -> Self {
        Self { spec: FeatureSpec { raw: false, ..self.spec.clone() }, ..self.clone() }
    }

    /// The state of each section before the first sample, per unit of that sample; empty when at rest.
    pub(crate) fn start(&self) -> &[[f64; 2]] {
        &self.start
    }

    /// The bins of one axis; `None` for an axis beyond the ranges given.
    #[must_use]
    pub fn bins(&self, axis: usize) -> Option<&UniformBins> {
        self.bins.get(if self.bins.len() == 1 { 0 } else { axis })
    }

    /// Number of features of one recording: the raw block, then the histogram block.
    pub fn n_features(&self, n_samples: usize, n_axes: usize) -> Result<usize> {
        let block =
            |wanted: bool, per_axis: usize| if wanted { n_axes.checked_mul(per_axis) } else { Some(0) };
        block(self.spec.raw, n_samples)
            .zip(block(self.spec.hfmh, self.spec.n_bins))
            .and_then(|(raw, hfmh)| raw.checked_add(hfmh))
            .ok_or_else(|| too_many_features(n_samples, n_axes))
    }

    /// Names of the features, in order: `fx_0000 ... tz_1599, hfmh_fx_00 ... hfmh_tz_99`.
    pub fn feature_names(&self, n_samples: usize, n_axes: usize) -> Result<Vec<String>> {
        let digits = |n: usize, least: usize| n.saturating_sub(1).to_string().len().max(least);
        let (sample_digits, bin_digits) = (digits(n_samples, 4), digits(self.spec.n_bins, 2));
        let n_features = self.n_features(n_samples, n_axes)?;
        if n_features > MAX_NAMES {
            return Err(too_many_features(n_samples, n_axes));
        }
        let mut names = reserved(n_features)?;
        if self.spec.raw {
            for axis in (0..n_axes).map(|axis| axis_name(axis, n_axes)) {
                names.extend((0..n_samples).map(|sample| format!("{axis}_{sample:0sample_digits$}")));
            }
        }
        if self.spec.hfmh {
            for axis in (0..n_axes).map(|axis| axis_name(axis, n_axes)) {
                names.extend((0..self.spec.n_bins).map(|bin| format!("hfmh_{axis}_{bin:0bin_digits$}")));
            }
        }
        Ok(names)
    }

    /// Refuses a batch that is empty, not of `len` values, or of a number of axes without ranges. Returns the
    /// number of features of a recording.
    #[doc(hidden)]
    pub fn check_len(&self, len: usize, shape: BatchShape) -> Result<usize> {
        shape.check(len)?;
        self.check_size(shape.n_samples, shape.n_axes)?;
        self.n_features(shape.n_samples, shape.n_axes)
    }

    /// Refuses recordings too long to count, or of a number of axes without ranges.
    pub(crate) fn check_size(&self, n_samples: usize, n_axes: usize) -> Result<()> {
        if self.spec.hfmh && self.bins.len() != 1 && self.bins.len() != n_axes {
            return Err(ranges_refused(self.bins.len(), n_axes));
        }
        Error::check_range("n_samples", n_samples, 0..=MAX_SAMPLES)
    }
}

pub(crate) fn finite(wrench: &[f64]) -> bool {
    wrench.iter().all(|value| value.is_finite())
}

/// Finds out why a result is not finite: the first bad value, or values too large to filter.
pub(crate) fn not_finite(wrench: &[f64], shape: BatchShape) -> Error {
    let place = |index: usize| {
        let (recording, rest) = (index / shape.recording_len(), index % shape.recording_len());
        (recording, rest / shape.n_axes, rest % shape.n_axes)
    };
    if let Some(index) = wrench.iter().position(|value| !value.is_finite()) {
        let (recording, sample, axis) = place(index);
        return Error::NonFinite { recording, sample, axis, value: wrench[index] };
    }
    let (mut index, mut largest) = (0, 0.0);
    for (i, value) in wrench.iter().enumerate() {
        if value.abs() > largest {
            (index, largest) = (i, value.abs());
        }
    }
    Error::TooLarge { recording: place(index).0, largest, limit: "which overflows float64" }
}

pub(crate) fn ranges_refused(n_ranges: usize, n_axes: usize) -> Error {
    let got = format_args!("{n_ranges} ranges for {n_axes} axes");
    Error::argument("bin_range", "hold one range, or one per axis", got)
}

pub(crate) fn too_many_features(n_samples: usize, n_axes: usize) -> Error {
    Error::argument("n_samples and n_axes", "give fewer features", format_args!("{n_samples} and {n_axes}"))
}
