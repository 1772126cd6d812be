//! Columns of a table as samples: unpack, call, map the error.

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyList;

use super::arrays::tuple;
use super::features::writable;
use super::scalars::shown;

/// Puts n columns of float64, shape (T,), side by side into `out`, shape (T, n); tells whether all values are finite.
#[pyfunction]
pub(super) fn interleave(columns: &Bound<'_, PyList>, out: &Bound<'_, PyArrayDyn<f64>>) -> PyResult<bool> {
    let columns = columns.iter().map(readable).collect::<PyResult<Vec<_>>>()?;
    let mut slices = Vec::with_capacity(columns.len());
    for column in &columns {
        slices.push(column.as_slice().map_err(|_| PyValueError::new_err("columns must be contiguous"))?);
    }
    let wanted = [slices.first().map_or(0, |slice| slice.len()), slices.len()];
    if out.shape() != wanted {
        return Err(PyValueError::new_err(format!(
            "out must have shape {}, got {}",
            tuple(&wanted),
            tuple(out.shape())
        )));
    }
    let mut samples = writable(out, "columns", &slices)?;
    let samples = samples.as_slice_mut()?;
    Ok(out.py().detach(|| crate::interleave(&slices, samples))?)
}

fn readable(column: Bound<'_, PyAny>) -> PyResult<PyReadonlyArray1<'_, f64>> {
    let array = column.cast_into::<PyArray1<f64>>().map_err(|error| {
        let came = shown(&error.into_inner());
        PyTypeError::new_err(format!("each column must be a 1-D array of float64, got {came}"))
    })?;
    array
        .try_readonly()
        .map_err(|_| PyValueError::new_err("columns must not be written by another call meanwhile"))
}
