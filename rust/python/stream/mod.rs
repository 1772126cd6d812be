//! Features and answers while samples arrive, in Python, and what both classes share.

mod extractor;
mod identifier;

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;

pub(super) use extractor::PyStreamingExtractor;
pub(super) use identifier::PyStreamingIdentifier;

use super::arrays::{contiguous_real, readable, tuple};
use super::features::writable;
use super::scalars::shown;

/// Rows from which on other threads may run meanwhile: some 20 microseconds of work, more than the way back costs.
const MANY_ROWS: usize = 128;

/// The stream, for work that calls nothing of Python's: so no thread can wait here for one that waits for it.
fn locked<'a, T>(stream: &'a Mutex<T>, py: Python<'a>) -> MutexGuard<'a, T> {
    // Nothing in a stream panics; if it did, no push is left half done that `reset` does not undo.
    stream.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}

/// Rows of `n_axes` values into a stream, without the GIL when they are many.
fn push_rows<T: Send>(
    wrench: &Bound<'_, PyAny>,
    n_axes: usize,
    stream: &Mutex<T>,
    push: fn(&mut T, &[f64]) -> crate::Result<usize>,
) -> PyResult<usize> {
    let rows = rows(wrench, n_axes)?;
    let values = rows.as_slice()?;
    let taken = if values.len() < MANY_ROWS * n_axes {
        push(&mut locked(stream, wrench.py()), values)
    } else {
        wrench.py().detach(|| push(&mut stream.lock().unwrap_or_else(PoisonError::into_inner), values))
    };
    Ok(taken?)
}

/// A float64 vector of `len` values, the caller's `out` or a new one, after `write` has written it.
fn written<'py>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    len: usize,
    write: impl FnOnce(&mut [f64]) -> crate::Result<()>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let Some(out) = out else {
        let new = PyArray1::zeros(py, len, false);
        write(new.try_readwrite()?.as_slice_mut()?)?;
        return Ok(new.to_dyn().clone());
    };
    let out = out.cast::<PyArrayDyn<f64>>().map_err(|_| {
        PyTypeError::new_err(format!("out must be a float64 array in native byte order, got {}", shown(out)))
    })?;
    if out.shape() != [len] {
        let got = tuple(out.shape());
        return Err(PyValueError::new_err(format!("out must have shape ({len},), got {got}")));
    }
    write(writable(out, "", &[])?.as_slice_mut()?)?;
    Ok(out.clone())
}

/// Rows of one value per axis.
fn rows<'py>(wrench: &Bound<'py, PyAny>, n_axes: usize) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = contiguous_real(wrench, "wrench")?;
    match array.shape() {
        [columns] | [_, columns] if *columns == n_axes => readable(&array, "wrench"),
        shape => {
            let shape = tuple(shape);
            let message = format!("wrench must have shape (k, {n_axes}) or ({n_axes},), got shape {shape}");
            Err(PyValueError::new_err(message))
        }
    }
}
