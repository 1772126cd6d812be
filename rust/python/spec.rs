//! `FeatureSpec`: what to extract, checked once.

use std::hash::{DefaultHasher, Hash, Hasher};

use numpy::{PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use super::arrays::{owned_real, tuple};
use crate::features::Initial;
use crate::histogram::Outside;
use crate::{Extractor, FeatureSpec};

/// What to extract from a recording, as one checked, immutable, picklable value.
#[pyclass(frozen, name = "FeatureSpec", module = "granular_id")]
pub(super) struct PyFeatureSpec {
    pub(super) extractor: Extractor,
}

#[pymethods]
impl PyFeatureSpec {
    #[new]
    #[pyo3(
        signature = (
            *, rate_hz = 500.0, cutoff_hz = 23.0, order = None, n_bins = None, bin_range = None, raw = true,
            hfmh = true, outside = "drop", density = false, initial = "zero",
        ),
        text_signature = "(*, rate_hz=500.0, cutoff_hz=23.0, order=8, n_bins=100, bin_range=(-1.5, 1.5), \
                          raw=True, hfmh=True, outside='drop', density=False, initial='zero')"
    )]
    #[allow(clippy::too_many_arguments, clippy::fn_params_excessive_bools)] // keywords of the Python class
    fn new(
        rate_hz: f64,
        cutoff_hz: f64,
        order: Option<&Bound<'_, PyAny>>,
        n_bins: Option<&Bound<'_, PyAny>>,
        bin_range: Option<&Bound<'_, PyAny>>,
        raw: bool,
        hfmh: bool,
        outside: &str,
        density: bool,
        initial: &str,
    ) -> PyResult<Self> {
        let outside = match outside {
            "drop" => Outside::Drop,
            "clip" => Outside::Clip,
            _ => return Err(choice("outside", "'drop' or 'clip'", outside)),
        };
        let initial = match initial {
            "zero" => Initial::Zero,
            "steady" => Initial::Steady,
            _ => return Err(choice("initial", "'zero' or 'steady'", initial)),
        };
        let default = FeatureSpec::default();
        let bin_ranges = bin_range.map_or(Ok(default.bin_ranges), ranges)?;
        let order = order.map_or(Ok(default.order), |order| count(order, "order"))?;
        let n_bins = n_bins.map_or(Ok(default.n_bins), |n_bins| count(n_bins, "n_bins"))?;
        let spec = FeatureSpec {
            rate_hz,
            cutoff_hz,
            order,
            n_bins,
            bin_ranges,
            outside,
            density,
            initial,
            raw,
            hfmh,
        };
        Ok(Self { extractor: Extractor::new(spec)? })
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
        match self.spec().outside {
            Outside::Drop => "drop",
            Outside::Clip => "clip",
        }
    }

    #[getter]
    fn density(&self) -> bool {
        self.spec().density
    }

    #[getter]
    fn initial(&self) -> &'static str {
        match self.spec().initial {
            Initial::Zero => "zero",
            Initial::Steady => "steady",
        }
    }

    /// Number of features of one recording.
    fn n_features(&self, n_samples: &Bound<'_, PyAny>, n_axes: &Bound<'_, PyAny>) -> PyResult<usize> {
        Ok(self.extractor.n_features(count(n_samples, "n_samples")?, count(n_axes, "n_axes")?))
    }

    /// Names of the features of one recording, in order.
    fn feature_names(
        &self,
        n_samples: &Bound<'_, PyAny>,
        n_axes: &Bound<'_, PyAny>,
    ) -> PyResult<Vec<String>> {
        Ok(self.extractor.feature_names(count(n_samples, "n_samples")?, count(n_axes, "n_axes")?))
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

fn choice(name: &str, wanted: &str, got: &str) -> PyErr {
    PyValueError::new_err(format!("{name} must be {wanted}, got {got:?}"))
}

/// A number of things: an integer of at least zero.
pub(super) fn count(value: &Bound<'_, PyAny>, name: &str) -> PyResult<usize> {
    value.extract().map_err(|error: PyErr| {
        if error.is_instance_of::<PyTypeError>(value.py()) {
            PyTypeError::new_err(format!("{name} must be an integer, got {}", value.get_type()))
        } else {
            PyValueError::new_err(format!("{name} must be an integer of at least 0, got {value}"))
        }
    })
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
