//! Features and answers while samples arrive, in Python, and what both classes share.

mod extractor;
mod identifier;
mod turns;

use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

pub(super) use extractor::PyStreamingExtractor;
pub(super) use identifier::PyStreamingIdentifier;

use self::turns::Turns;
use super::arrays::{contiguous_real, readable, tuple, writable, zeros, Hold};
use super::scalars::shown;
use crate::convert::OrRaise;

/// Rows from which on other threads may run meanwhile: some 20 microseconds of work, more than the way back costs.
const MANY_ROWS: usize = 128;

/// Rows of `n_axes` values into a stream, without the GIL when they are many.
fn push_rows<T: Send>(
    wrench: &Bound<'_, PyAny>,
    n_axes: usize,
    stream: &Turns<T>,
    push: fn(&mut T, &[f64]) -> granular_id::Result<usize>,
) -> PyResult<usize> {
    let py = wrench.py();
    let array = contiguous_real(wrench, "wrench")?;
    if !matches!(array.shape(), [columns] | [_, columns] if *columns == n_axes) {
        let shape = tuple(array.shape());
        let message = format!("wrench must have shape (k, {n_axes}) or ({n_axes},), got shape {shape}");
        return Err(PyValueError::new_err(message));
    }
    if array.len() >= MANY_ROWS * n_axes {
        let hold = Hold::new(&[array.as_any()])?;
        if hold.detaches() {
            let rows = readable(&array, "wrench")?;
            let values = rows.as_slice()?;
            return stream.work(py, |stream| push(stream, values))?.or_raise();
        }
    }
    // First the stream, which others may run for; then the rows, in which nobody may meddle.
    let mut stream = stream.locked(py)?;
    let taken = push(&mut stream, readable(&array, "wrench")?.as_slice()?);
    taken.or_raise()
}

/// A float64 vector of `len` values, the caller's `out` or a new one, after `write` has written it.
fn written<'py, T: Send>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    len: usize,
    stream: &Turns<T>,
    write: impl FnOnce(&mut T, &mut [f64]) -> granular_id::Result<()> + Send,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let out = match out {
        None => zeros(py, &[len])?,
        Some(out) => out.cast::<PyArrayDyn<f64>>().cloned().map_err(|_| {
            let got = shown(out);
            PyTypeError::new_err(format!("out must be a float64 array in native byte order, got {got}"))
        })?,
    };
    let borrowed = || {
        if out.shape() != [len] {
            let got = tuple(out.shape());
            return Err(PyValueError::new_err(format!("out must have shape ({len},), got {got}")));
        }
        writable(&out, "", &[])
    };
    let hold = Hold::for_values(len, &[out.as_any()])?;
    if hold.detaches() {
        let mut target = borrowed()?;
        let target = target.as_slice_mut()?;
        stream.work(py, |stream| write(stream, target))?.or_raise()?;
    } else {
        // As above: first the stream, then the array.
        let mut stream = stream.locked(py)?;
        write(&mut stream, borrowed()?.as_slice_mut()?).or_raise()?;
    }
    Ok(out)
}
