//! Feature extraction: unpack, call, map the error.

use numpy::{
    Element, PyArrayDyn, PyArrayMethods, PyReadwriteArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use super::arrays::{contiguous_real, tuple};
use super::spec::{count, PyFeatureSpec};
use crate::extract::Sample;
use crate::{BatchShape, Extractor};

/// Features of one recording `(n_samples, n_axes)` or a batch `(n_recordings, n_samples, n_axes)`.
#[pyfunction]
pub(super) fn extract_features<'py>(
    wrench: &Bound<'py, PyAny>,
    spec: &Bound<'py, PyFeatureSpec>,
    threads: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
    dtype: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = wrench.py();
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
    let extractor = &spec.get().extractor;
    // Before the output is made: an empty batch is to be refused as such.
    let values = wrench.try_readonly()?;
    extractor.check(values.as_slice()?, shape)?;
    let threads = match threads {
        Some(threads) => count(threads, "threads")?,
        None if single => 1,
        None => std::thread::available_parallelism().map_or(1, Into::into),
    };
    let n_features = extractor.n_features(shape.n_samples, shape.n_axes);
    let wanted = if single { vec![n_features] } else { vec![shape.n_recordings, n_features] };
    let out = match out {
        Some(out) => out.clone(),
        None => py.import("numpy")?.call_method1("empty", (wanted.as_slice(), dtype))?,
    };
    let work = Work { extractor, shape, threads, wanted: &wanted };
    if let Ok(out) = out.cast::<PyArrayDyn<f64>>() {
        work.run(values.as_slice()?, out)?;
    } else if let Ok(out) = out.cast::<PyArrayDyn<f32>>() {
        work.run(values.as_slice()?, out)?;
    } else {
        return Err(PyTypeError::new_err(format!(
            "out and dtype must be float64 or float32 in native byte order, got {}",
            out.cast::<PyUntypedArray>()
                .map_or_else(|_| out.get_type().to_string(), |out| out.dtype().to_string())
        )));
    }
    Ok(out)
}

/// Everything but the two arrays.
struct Work<'a> {
    extractor: &'a Extractor,
    shape: BatchShape,
    threads: usize,
    wanted: &'a [usize],
}

impl Work<'_> {
    fn run<T: Element + Sample>(&self, wrench: &[f64], out: &Bound<'_, PyArrayDyn<T>>) -> PyResult<()> {
        if out.shape() != self.wanted {
            let (wanted, got) = (tuple(self.wanted), tuple(out.shape()));
            return Err(PyValueError::new_err(format!("out must have shape {wanted}, got {got}")));
        }
        let mut borrowed = writable(out)?;
        let Ok(target) = borrowed.as_slice_mut() else {
            return Err(PyValueError::new_err("out must be C-contiguous, got a strided array"));
        };
        let Self { extractor, shape, threads, .. } = *self;
        if shape.n_recordings == 1 {
            extractor.extract_as(wrench, shape, threads, target)?;
        } else {
            out.py().detach(|| extractor.extract_as(wrench, shape, threads, target))?;
        }
        Ok(())
    }
}

fn writable<'py, T: Element>(out: &Bound<'py, PyArrayDyn<T>>) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    if !out.getattr("flags")?.getattr("aligned")?.is_truthy()? {
        return Err(PyValueError::new_err("out must be aligned, got an array at an odd address"));
    }
    out.try_readwrite().map_err(|error| {
        PyValueError::new_err(format!("out must be writable and must not overlap wrench: {error}"))
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
    let bins = crate::UniformBins::new(count(n_bins, "bins")?, low, high)?;
    let values = contiguous_real(values, "a")?;
    let values = values.try_readonly()?;
    Ok((bins.count(values.as_slice()?), bins.edges().to_vec()))
}
