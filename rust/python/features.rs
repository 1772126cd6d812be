//! Feature extraction: what to extract, checked once, and from which recordings.

use std::borrow::Cow;
use std::ffi::CString;
use std::hash::{DefaultHasher, Hash, Hasher};

use numpy::{Element, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyUserWarning};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arguments::{
    count, flag, new_arguments, number, samples_and_axes, shown, word, GranularIdError, NewArguments, OrRaise,
};
use crate::arrays::{contiguous_real, is_masked, owned_real, tuple, work_into, work_on, Recordings};
use granular_id::dsp::{Outside, MAX_BINS, MAX_ORDER};
use granular_id::features::Initial;
use granular_id::{BatchShape, Extractor, FeatureSpec};

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
        signature = (**keywords),
        text_signature = "(*, rate_hz=500.0, cutoff_hz=23.0, order=8, n_bins=100, bin_range=(-1.5, 1.5), \
                          raw=True, hfmh=True, outside='drop', density=False, initial='zero')"
    )]
    fn new(keywords: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut spec = FeatureSpec::default();
        for (name, value) in keywords.into_iter().flatten() {
            let name = name.extract::<String>()?;
            let (value, named) = (&value, name.as_str());
            match named {
                "rate_hz" => spec.rate_hz = number(value, named)?,
                "cutoff_hz" => spec.cutoff_hz = number(value, named)?,
                "order" => spec.order = count(value, named, MAX_ORDER)?,
                "n_bins" => spec.n_bins = count(value, named, MAX_BINS)?,
                "bin_range" => spec.bin_ranges = ranges(value)?,
                "raw" => spec.raw = flag(value, named)?,
                "hfmh" => spec.hfmh = flag(value, named)?,
                "outside" => spec.outside = word(value, named, &Outside::NAMED)?,
                "density" => spec.density = flag(value, named)?,
                "initial" => spec.initial = word(value, named, &Initial::NAMED)?,
                _ => {
                    return Err(PyTypeError::new_err(format!(
                        "FeatureSpec() got an unexpected keyword argument '{name}'"
                    )))
                }
            }
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
    fn n_features(&self, n_samples: &Bound<'_, PyAny>, n_axes: &Bound<'_, PyAny>) -> PyResult<usize> {
        let (n_samples, n_axes) = samples_and_axes(n_samples, n_axes)?;
        self.extractor.n_features(n_samples, n_axes).or_raise()
    }

    /// Names of the features of one recording, in order.
    fn feature_names(
        &self,
        n_samples: &Bound<'_, PyAny>,
        n_axes: &Bound<'_, PyAny>,
    ) -> PyResult<Vec<String>> {
        let (n_samples, n_axes) = samples_and_axes(n_samples, n_axes)?;
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
        let shape = tuple(array.shape());
        return Err(GranularIdError::new_err(format!(
            "bin_range must be (low, high), or one such pair per axis, got an array of shape {shape}"
        )));
    }
    let array = array.try_readonly()?;
    Ok(array.as_slice()?.as_chunks().0.iter().map(|[low, high]| (*low, *high)).collect())
}

/// Features of one recording `(n_samples, n_axes)` or a batch `(n_recordings, n_samples, n_axes)`; not `filtered`, the
/// histograms are those of the samples.
#[pyfunction]
#[pyo3(signature = (wrench, spec, threads, out, dtype, *, filtered = true))]
pub(super) fn extract_features<'py>(
    wrench: &Bound<'py, PyAny>,
    spec: &Bound<'py, PyFeatureSpec>,
    threads: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
    dtype: &Bound<'py, PyAny>,
    filtered: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let recordings = Recordings::new(wrench, "wrench", threads, None)?;
    let (wrench, shape) = (&recordings.array, recordings.shape);
    let given = tuple(wrench.shape());
    if wrench.is_empty() {
        return Err(GranularIdError::new_err(format!("wrench must not be empty, got shape {given}")));
    }
    let designed = &spec.get().extractor;
    let extractor = &if filtered { Cow::Borrowed(designed) } else { Cow::Owned(designed.unfiltered()) };
    // Before the output is made, which may be large.
    let n_features = extractor.check_len(wrench.len(), shape).or_raise()?;
    if shape.n_axes > MANY_AXES.max(shape.n_samples) {
        let message = format!(
            "wrench of shape {given} has more axes than samples: is it transposed? The last axis must be the axes of the sensor"
        );
        PyErr::warn(wrench.py(), &wrench.py().get_type::<PyUserWarning>(), &CString::new(message)?, 2)?;
    }
    let wanted = recordings.rows(&[n_features]);
    let out = out.map_or_else(|| empty(&wanted, dtype), |out| Ok(out.clone()))?;
    if is_masked(&out)? {
        return Err(PyTypeError::new_err("out must be a plain array, got a masked one"));
    }
    if let Ok(out) = out.cast::<PyArrayDyn<f64>>() {
        extract(extractor, &recordings, (out, &wanted), Extractor::extract_into)?;
    } else if let Ok(out) = out.cast::<PyArrayDyn<f32>>() {
        extract(extractor, &recordings, (out, &wanted), Extractor::extract_into_f32)?;
    } else {
        let got = out
            .cast::<PyUntypedArray>()
            .map_or_else(|_| out.get_type().to_string(), |out| out.dtype().to_string());
        return Err(PyTypeError::new_err(format!(
            "out and dtype must be float64 or float32 in native byte order, got {got}"
        )));
    }
    Ok(out)
}

/// A new array, once `dtype` is known to be one.
fn empty<'py>(shape: &[usize], dtype: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let numpy = dtype.py().import("numpy")?;
    let dtype = numpy.call_method1("dtype", (dtype,)).map_err(|_| {
        PyTypeError::new_err(format!("dtype must be float64 or float32, got {}", shown(dtype)))
    })?;
    numpy.call_method1("empty", (shape, dtype))
}

/// Extraction into numbers of one type.
type Extract<T> = fn(&Extractor, &[f64], BatchShape, usize, &mut [T]) -> granular_id::Result<()>;

fn extract<T: Element>(
    extractor: &Extractor,
    recordings: &Recordings<'_>,
    out: (&Bound<'_, PyArrayDyn<T>>, &[usize]),
    extract: Extract<T>,
) -> PyResult<()> {
    let Recordings { array, shape, threads } = recordings;
    let n_values = array.len().max(out.0.len());
    work_into(out, array, "wrench", n_values, |values, out| extract(extractor, values, *shape, *threads, out))
}

/// Counts and edges of uniform bins.
#[pyfunction]
pub(super) fn histogram<'py>(
    values: &Bound<'py, PyAny>,
    n_bins: &Bound<'py, PyAny>,
    low: f64,
    high: f64,
) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let bins = granular_id::UniformBins::new(count(n_bins, "bins", MAX_BINS)?, low, high).or_raise()?;
    let values = contiguous_real(values, "a")?;
    let counts = work_on(&values, "a", values.len(), |values| bins.count(values))?;
    Ok((counts, bins.edges().to_vec()))
}
