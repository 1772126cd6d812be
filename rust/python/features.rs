//! Feature extraction: unpack, call, map the error.

use std::ffi::CString;

use numpy::{
    BorrowError, Element, PyArrayDyn, PyArrayMethods, PyReadwriteArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;

use super::arrays::{contiguous_real, is_masked, readable, tuple};
use super::scalars::{count, shown};
use super::spec::PyFeatureSpec;
use crate::histogram::MAX_BINS;
use crate::{BatchShape, Extractor};

/// More axes than this are most likely samples.
const MANY_AXES: usize = 32;

/// Features of one recording `(n_samples, n_axes)` or a batch `(n_recordings, n_samples, n_axes)`.
#[pyfunction]
pub(super) fn extract_features<'py>(
    wrench: &Bound<'py, PyAny>,
    spec: &Bound<'py, PyFeatureSpec>,
    threads: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
    dtype: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let wrench = contiguous_real(wrench, "wrench")?;
    let (shape, single) = match *wrench.shape() {
        [n_samples, n_axes] => (BatchShape { n_recordings: 1, n_samples, n_axes }, true),
        [n_recordings, n_samples, n_axes] => (BatchShape { n_recordings, n_samples, n_axes }, false),
        _ => {
            return Err(PyValueError::new_err(format!(
            "wrench must have shape (n_samples, n_axes) or (n_recordings, n_samples, n_axes), got shape {}",
            tuple(wrench.shape())
        )))
        }
    };
    if wrench.is_empty() {
        let shape = tuple(wrench.shape());
        return Err(PyValueError::new_err(format!("wrench must not be empty, got shape {shape}")));
    }
    let extractor = &spec.get().extractor;
    // Before the output is made, which may be large.
    let values = readable(&wrench, "wrench")?;
    let n_features = extractor.check(values.as_slice()?, shape)?;
    if shape.n_axes > MANY_AXES.max(shape.n_samples) {
        let message = format!(
            "wrench of shape {} has more axes than samples: is it transposed? The last axis must be the axes of the sensor",
            tuple(wrench.shape())
        );
        PyErr::warn(wrench.py(), &wrench.py().get_type::<PyUserWarning>(), &CString::new(message)?, 2)?;
    }
    let threads = match threads {
        Some(threads) => count(threads, "threads", usize::MAX)?,
        None if single => 1,
        None => crate::pool::cores(),
    };
    let wanted = if single { vec![n_features] } else { vec![shape.n_recordings, n_features] };
    let out = match out {
        Some(out) => out.clone(),
        None => empty(&wanted, dtype)?,
    };
    let work = Work { extractor, shape, threads, wanted: &wanted };
    if is_masked(&out)? {
        return Err(PyTypeError::new_err("out must be a plain array, got a masked one"));
    }
    if let Ok(out) = out.cast::<PyArrayDyn<f64>>() {
        work.run(values.as_slice()?, out, Extractor::extract_into)?;
    } else if let Ok(out) = out.cast::<PyArrayDyn<f32>>() {
        work.run(values.as_slice()?, out, Extractor::extract_into_f32)?;
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
type Extract<T> = fn(&Extractor, &[f64], BatchShape, usize, &mut [T]) -> crate::Result<()>;

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
        wrench: &[f64],
        out: &Bound<'_, PyArrayDyn<T>>,
        extract: Extract<T>,
    ) -> PyResult<()> {
        if out.shape() != self.wanted {
            let (wanted, got) = (tuple(self.wanted), tuple(out.shape()));
            return Err(PyValueError::new_err(format!("out must have shape {wanted}, got {got}")));
        }
        let mut borrowed = writable(out, "wrench", &[wrench])?;
        let target = borrowed.as_slice_mut()?;
        let Self { extractor, shape, threads, .. } = *self;
        if shape.n_recordings == 1 {
            extract(extractor, wrench, shape, threads, target)?;
        } else {
            out.py().detach(|| extract(extractor, wrench, shape, threads, target))?;
        }
        Ok(())
    }
}

/// The right to write to `out`, if that cannot harm anyone.
pub(super) fn writable<'py, T: Element>(
    out: &Bound<'py, PyArrayDyn<T>>,
    name: &str,
    inputs: &[&[f64]],
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    if !out.is_c_contiguous() {
        return Err(PyValueError::new_err("out must be C-contiguous, got a strided array"));
    }
    if !out.getattr("flags")?.getattr("aligned")?.is_truthy()? {
        return Err(PyValueError::new_err("out must be aligned, got an array at an odd address"));
    }
    // Views of the same memory by way of different objects: the borrow below knows nothing of each other's.
    let start = out.data().addr();
    let end = start + out.len() * size_of::<T>();
    for read in inputs.iter().map(|input| input.as_ptr_range()) {
        if start < read.end.addr() && read.start.addr() < end {
            return Err(PyValueError::new_err(format!("out must not overlap {name}")));
        }
    }
    out.try_readwrite().map_err(|error| {
        PyValueError::new_err(match error {
            BorrowError::NotWriteable => "out must be writable, got a read-only array",
            _ => "out must not be in use by another call",
        })
    })
}

/// Counts and edges of uniform bins.
#[pyfunction]
pub(super) fn histogram<'py>(
    values: &Bound<'py, PyAny>,
    n_bins: &Bound<'py, PyAny>,
    low: f64,
    high: f64,
) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let bins = crate::UniformBins::new(count(n_bins, "bins", MAX_BINS)?, low, high)?;
    let values = contiguous_real(values, "a")?;
    let values = readable(&values, "a")?;
    Ok((bins.count(values.as_slice()?), bins.edges().to_vec()))
}
