//! `FeatureSpec`: what to extract, checked once.

use std::hash::{DefaultHasher, Hash, Hasher};

use numpy::{PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use super::arrays::{owned_real, tuple};
use super::scalars::{count, flag, number, word};
use crate::convert::OrRaise;
use granular_id::dsp::MAX_ORDER;
use granular_id::dsp::{Outside, MAX_BINS};
use granular_id::features::Initial;
use granular_id::{Extractor, FeatureSpec};

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
        self.extractor
            .n_features(count(n_samples, "n_samples", usize::MAX)?, count(n_axes, "n_axes", usize::MAX)?)
            .or_raise()
    }

    /// Names of the features of one recording, in order.
    fn feature_names(
        &self,
        n_samples: &Bound<'_, PyAny>,
        n_axes: &Bound<'_, PyAny>,
    ) -> PyResult<Vec<String>> {
        self.extractor
            .feature_names(count(n_samples, "n_samples", usize::MAX)?, count(n_axes, "n_axes", usize::MAX)?)
            .or_raise()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        Ok((PyTuple::empty(py), self.keywords(py)?))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let mut arguments = Vec::new();
        for (name, value) in self.keywords(py)? {
            arguments.push(format!("{name}={}", value.repr()?));
        }
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

    fn keywords<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let keywords = PyDict::new(py);
        keywords.set_item("rate_hz", self.rate_hz())?;
        keywords.set_item("cutoff_hz", self.cutoff_hz())?;
        keywords.set_item("order", self.order())?;
        keywords.set_item("n_bins", self.n_bins())?;
        keywords.set_item("bin_range", self.bin_range(py)?)?;
        keywords.set_item("raw", self.raw())?;
        keywords.set_item("hfmh", self.hfmh())?;
        keywords.set_item("outside", self.outside())?;
        keywords.set_item("density", self.density())?;
        keywords.set_item("initial", self.initial())?;
        Ok(keywords)
    }
}

/// One range `(low, high)`, or one per axis.
fn ranges(value: &Bound<'_, PyAny>) -> PyResult<Vec<(f64, f64)>> {
    let array = owned_real(value, "bin_range")?;
    if !matches!(array.shape(), [2] | [_, 2]) || array.is_empty() {
        let shape = tuple(array.shape());
        return Err(PyValueError::new_err(format!(
            "bin_range must be (low, high), or one such pair per axis, got an array of shape {shape}"
        )));
    }
    let array = array.try_readonly()?;
    Ok(array.as_slice()?.as_chunks().0.iter().map(|[low, high]| (*low, *high)).collect())
}
