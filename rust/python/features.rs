//! Feature extraction: what to extract, checked once, and from which recordings.

use std::borrow::Cow;
use std::ffi::CString;
use std::hash::{DefaultHasher, Hash, Hasher};

use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::arguments::{
    contiguous_real, named, new_arguments, optional, output, owned_real, readable, tuple, word, work,
    work_into, wrong_shape, NewArguments, OrRaise, Recordings,
};
use granular_id::dsp::Outside;
use granular_id::features::Initial;
use granular_id::{Extractor, FeatureSpec};

/// More axes than this are most likely samples.
const MANY_AXES: usize = 32;

/// Keywords of a `FeatureSpec`, in order.
const KEYWORDS: &str = "rate_hz cutoff_hz order n_bins bin_range raw hfmh outside density initial";

/// What to extract from a recording, as one checked, immutable, hashable value.
///
/// Parameters
/// ----------
/// rate_hz, cutoff_hz, order, n_bins, bin_range, raw, hfmh, outside, density, initial
///     As in `granular_id.extract_features`, which gives units, defaults and their reasons. Keywords only; each is also
///     an attribute.
///
/// Raises
/// ------
/// TypeError, ValueError
///     If a value has the wrong type or is outside its range; the message names the keyword.
///
/// Notes
/// -----
/// Pickles with protocol 2 and later. Equal specifications give the same features, bit for bit.
///
/// Examples
/// --------
/// >>> import granular_id as gid
/// >>> spec = gid.FeatureSpec(rate_hz=100, cutoff_hz=4.6, raw=False)
/// >>> spec.n_features(n_samples=594, n_axes=6)
/// 600
/// >>> spec == gid.FeatureSpec(rate_hz=100, cutoff_hz=4.6, raw=False)
/// True
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "FeatureSpec", module = "granular_id")]
pub(super) struct PyFeatureSpec {
    pub(super) extractor: Extractor,
}

#[pymethods]
impl PyFeatureSpec {
    #[new]
    #[pyo3(
        signature = (*, rate_hz=500.0, cutoff_hz=23.0, order=8, n_bins=100, bin_range=None, raw=true, hfmh=true,
                     outside="drop", density=false, initial="zero"),
        text_signature = "(*, rate_hz=500.0, cutoff_hz=23.0, order=8, n_bins=100, bin_range=(-1.5, 1.5), \
                          raw=True, hfmh=True, outside='drop', density=False, initial='zero')"
    )]
    #[allow(clippy::too_many_arguments)] // by keyword alone
    fn new(
        #[pyo3(from_py_with = named::rate_hz)] rate_hz: f64,
        #[pyo3(from_py_with = named::cutoff_hz)] cutoff_hz: f64,
        #[pyo3(from_py_with = named::order)] order: usize,
        #[pyo3(from_py_with = named::n_bins)] n_bins: usize,
        bin_range: Option<&Bound<'_, PyAny>>,
        raw: bool,
        hfmh: bool,
        outside: &str,
        density: bool,
        initial: &str,
    ) -> PyResult<Self> {
        let mut spec = FeatureSpec::default()
            .with_rate_hz(rate_hz)
            .with_cutoff_hz(cutoff_hz)
            .with_order(order)
            .with_n_bins(n_bins)
            .with_raw(raw)
            .with_hfmh(hfmh)
            .with_outside(word(outside, "outside", &Outside::NAMED)?)
            .with_density(density)
            .with_initial(word(initial, "initial", &Initial::NAMED)?);
        if let Some(bin_range) = bin_range {
            spec.bin_ranges = ranges(bin_range)?;
        }
        Ok(Self { extractor: Extractor::new(spec).or_raise()? })
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.spec().rate_hz
    }

    #[getter]
    fn cutoff_hz(&self) -> f64 {
        self.spec().cutoff_hz
    }

    #[getter]
    fn order(&self) -> usize {
        self.spec().order
    }

    #[getter]
    fn n_bins(&self) -> usize {
        self.spec().n_bins
    }

    #[getter]
    fn bin_range<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        match self.spec().bin_ranges.as_slice() {
            [one] => one.into_pyobject(py),
            many => PyTuple::new(py, many),
        }
    }

    #[getter]
    fn raw(&self) -> bool {
        self.spec().raw
    }

    #[getter]
    fn hfmh(&self) -> bool {
        self.spec().hfmh
    }

    #[getter]
    fn outside(&self) -> &'static str {
        self.spec().outside.name()
    }

    #[getter]
    fn density(&self) -> bool {
        self.spec().density
    }

    #[getter]
    fn initial(&self) -> &'static str {
        self.spec().initial.name()
    }

    /// Number of features of one recording.
    fn n_features(
        &self,
        #[pyo3(from_py_with = named::n_samples)] n_samples: usize,
        #[pyo3(from_py_with = named::n_axes)] n_axes: usize,
    ) -> PyResult<usize> {
        self.extractor.n_features(n_samples, n_axes).or_raise()
    }

    /// Names of the features of one recording, in order.
    fn feature_names(
        &self,
        #[pyo3(from_py_with = named::n_samples)] n_samples: usize,
        #[pyo3(from_py_with = named::n_axes)] n_axes: usize,
    ) -> PyResult<Vec<String>> {
        self.extractor.feature_names(n_samples, n_axes).or_raise()
    }

    fn __getnewargs_ex__<'py>(slf: &Bound<'py, Self>) -> NewArguments<'py> {
        new_arguments(slf, "", KEYWORDS)
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let shown = |keyword| Ok(format!("{keyword}={}", slf.getattr(keyword)?.repr()?));
        let arguments = KEYWORDS.split_whitespace().map(shown).collect::<PyResult<Vec<_>>>()?;
        Ok(format!("FeatureSpec({})", arguments.join(", ")))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().spec() == self.spec())
    }

    fn __hash__(&self) -> u64 {
        let spec = self.spec();
        let mut hasher = DefaultHasher::new();
        // Adding zero makes -0.0 and 0.0, which are equal, hash alike.
        let bits = |value: f64| (value + 0.0).to_bits();
        (bits(spec.rate_hz), bits(spec.cutoff_hz), spec.order, spec.n_bins).hash(&mut hasher);
        (spec.outside, spec.density, spec.initial, spec.raw, spec.hfmh).hash(&mut hasher);
        for (low, high) in &spec.bin_ranges {
            (bits(*low), bits(*high)).hash(&mut hasher);
        }
        hasher.finish()
    }
}

impl PyFeatureSpec {
    fn spec(&self) -> &FeatureSpec {
        self.extractor.spec()
    }
}

/// One range `(low, high)`, or one per axis.
fn ranges(value: &Bound<'_, PyAny>) -> PyResult<Vec<(f64, f64)>> {
    let array = owned_real(value, "bin_range")?;
    if !matches!(array.shape(), [2] | [_, 2]) || array.is_empty() {
        return Err(wrong_shape("bin_range", "(2,), a pair (low, high), or (n_axes, 2)", array.shape()));
    }
    let array = array.try_readonly()?;
    Ok(array.as_slice()?.as_chunks().0.iter().map(|[low, high]| (*low, *high)).collect())
}

/// Features of one recording `(n_samples, n_axes)` or a batch `(n_recordings, n_samples, n_axes)`; not `filtered`, the
/// histograms are those of the samples.
#[pyfunction]
#[pyo3(signature = (wrench, spec, threads=None, out=None, *, filtered=true))]
pub(super) fn extract_features<'py>(
    wrench: &Bound<'py, PyAny>,
    spec: &Bound<'py, PyFeatureSpec>,
    #[pyo3(from_py_with = optional::threads)] threads: Option<usize>,
    out: Option<&Bound<'py, PyAny>>,
    filtered: bool,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let recordings = Recordings::new(wrench, "wrench", threads, None)?;
    let (py, wrench, shape) = (wrench.py(), &recordings.array, recordings.shape);
    let designed = &spec.get().extractor;
    let extractor = &if filtered { Cow::Borrowed(designed) } else { Cow::Owned(designed.unfiltered()) };
    // Before the output is made, which may be large.
    let n_features = extractor.check_len(wrench.len(), shape).or_raise()?;
    if shape.n_axes > MANY_AXES.max(shape.n_samples) {
        let given = tuple(wrench.shape());
        let message = format!(
            "wrench of shape {given} has more axes than samples: is it transposed? The last axis must be the axes of the sensor"
        );
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &CString::new(message)?, 2)?;
    }
    let wanted = recordings.rows(&[n_features]);
    let out = output(py, out, &wanted)?;
    work_into((&out, &wanted), wrench, "wrench", |values, out| {
        extractor.extract_into(values, shape, recordings.threads, out)
    })?;
    Ok(out)
}

/// Counts and edges of uniform bins.
#[pyfunction]
pub(super) fn histogram(
    values: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = named::n_bins)] n_bins: usize,
    low: f64,
    high: f64,
) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let bins = granular_id::UniformBins::new(n_bins, low, high).or_raise()?;
    let array = contiguous_real(values, "a")?;
    let array = readable(&array, "a")?;
    let slice = array.as_slice()?;
    let counts = work(values.py(), slice.len(), || bins.count(slice));
    Ok((counts, bins.edges().to_vec()))
}
