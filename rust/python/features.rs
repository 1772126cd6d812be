//! Feature extraction: unpack, call, map the error.

use std::borrow::Cow;
use std::ffi::CString;

use numpy::{Element, PyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;

use super::arrays::{contiguous_real, is_masked, readable, recordings, tuple, writable, Hold};
use super::pool::threads_for;
use super::scalars::{count, shown};
use super::spec::PyFeatureSpec;
use crate::convert::OrRaise;
use granular_id::dsp::MAX_BINS;
use granular_id::{BatchShape, Extractor};

/// More axes than this are most likely samples.
const MANY_AXES: usize = 32;

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
    let threads = threads_for(threads)?;
    let wrench = contiguous_real(wrench, "wrench")?;
    let (shape, single) = recordings(&wrench, "wrench")?;
    if wrench.is_empty() {
        let shape = tuple(wrench.shape());
        return Err(PyValueError::new_err(format!("wrench must not be empty, got shape {shape}")));
    }
    let designed = &spec.get().extractor;
    let extractor = &if filtered { Cow::Borrowed(designed) } else { Cow::Owned(designed.unfiltered()) };
    // Before the output is made, which may be large.
    let n_features = extractor.check_len(wrench.len(), shape).or_raise()?;
    if shape.n_axes > MANY_AXES.max(shape.n_samples) {
        let message = format!(
            "wrench of shape {} has more axes than samples: is it transposed? The last axis must be the axes of the sensor",
            tuple(wrench.shape())
        );
        PyErr::warn(wrench.py(), &wrench.py().get_type::<PyUserWarning>(), &CString::new(message)?, 2)?;
    }
    let wanted = if single { vec![n_features] } else { vec![shape.n_recordings, n_features] };
    let out = match out {
        Some(out) => out.clone(),
        None => empty(&wanted, dtype)?,
    };
    if is_masked(&out)? {
        return Err(PyTypeError::new_err("out must be a plain array, got a masked one"));
    }
    let work = Work { extractor, shape, threads: threads(single), wanted: &wanted };
    if let Ok(out) = out.cast::<PyArrayDyn<f64>>() {
        work.run(&wrench, out, Extractor::extract_into)?;
    } else if let Ok(out) = out.cast::<PyArrayDyn<f32>>() {
        work.run(&wrench, out, Extractor::extract_into_f32)?;
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

/// Everything but the two arrays.
struct Work<'a> {
    extractor: &'a Extractor,
    shape: BatchShape,
    threads: usize,
    wanted: &'a [usize],
}

impl Work<'_> {
    fn run<T: Element>(
        &self,
        wrench: &Bound<'_, PyArrayDyn<f64>>,
        out: &Bound<'_, PyArrayDyn<T>>,
        extract: Extract<T>,
    ) -> PyResult<()> {
        let n_values = wrench.len().max(out.len());
        let hold = Hold::for_values(n_values, &[wrench.as_any(), out.as_any()])?;
        let wrench = readable(wrench, "wrench")?;
        let wrench = wrench.as_slice()?;
        if out.shape() != self.wanted {
            let (wanted, got) = (tuple(self.wanted), tuple(out.shape()));
            return Err(PyValueError::new_err(format!("out must have shape {wanted}, got {got}")));
        }
        let mut target = writable(out, "wrench", &[wrench])?;
        let target = target.as_slice_mut()?;
        let Self { extractor, shape, threads, .. } = *self;
        hold.work(out.py(), || extract(extractor, wrench, shape, threads, target)).or_raise()?;
        Ok(())
    }
}

/// Counts and edges of uniform bins.
#[pyfunction]
pub(super) fn histogram<'py>(
    values: &Bound<'py, PyAny>,
    n_bins: &Bound<'py, PyAny>,
    low: f64,
    high: f64,
) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let py = values.py();
    let bins = granular_id::UniformBins::new(count(n_bins, "bins", MAX_BINS)?, low, high).or_raise()?;
    let values = contiguous_real(values, "a")?;
    let hold = Hold::for_values(values.len(), &[values.as_any()])?;
    let values = readable(&values, "a")?;
    let values = values.as_slice()?;
    Ok((hold.work(py, || bins.count(values)), bins.edges().to_vec()))
}
