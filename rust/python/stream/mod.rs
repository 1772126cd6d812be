//! Features and answers while samples arrive, in Python, and what both classes share.

mod extractor;
mod identifier;
mod turns;

use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

pub(super) use extractor::PyStreamingExtractor;
pub(super) use identifier::PyStreamingIdentifier;

use self::turns::Turns;
use super::arrays::{briefly_readable, contiguous_real, readable, tuple, writable, zeros};
use super::scalars::shown;

/// Rows from which on other threads may run meanwhile: some 20 microseconds of work, more than the way back costs.
const MANY_ROWS: usize = 128;

/// Rows of `n_axes` values into a stream, without the GIL when they are many.
fn push_rows<T: Send>(
    wrench: &Bound<'_, PyAny>,
    n_axes: usize,
    stream: &Turns<T>,
    push: fn(&mut T, &[f64]) -> crate::Result<usize>,
) -> PyResult<usize> {
    let py = wrench.py();
    let array = contiguous_real(wrench, "wrench")?;
    if !matches!(array.shape(), [columns] | [_, columns] if *columns == n_axes) {
        let shape = tuple(array.shape());
        let message = format!("wrench must have shape (k, {n_axes}) or ({n_axes},), got shape {shape}");
        return Err(PyValueError::new_err(message));
    }
    let taken = if array.len() < MANY_ROWS * n_axes {
        // First the stream, which others may run for; then the rows, in which nobody may meddle.
        let mut stream = stream.locked(py)?;
        push(&mut stream, briefly_readable(&array, "wrench")?.as_slice()?)
    } else {
        let rows = readable(&array, "wrench")?;
        let values = rows.as_slice()?;
        stream.work(py, |stream| push(stream, values))?
    };
    Ok(taken?)
}

/// A float64 vector of `len` values, the caller's `out` or a new one, after `write` has written it.
fn written<'py>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    len: usize,
    write: impl FnOnce(&mut [f64]) -> PyResult<()>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let Some(out) = out else {
        let new = zeros(py, &[len])?;
        write(new.try_readwrite()?.as_slice_mut()?)?;
        return Ok(new);
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
