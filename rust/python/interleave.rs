//! Columns as samples.

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::arguments::{shown, GranularIdError, OrRaise};
use crate::arrays::{readable, tuple, writable, wrong_shape, Hold};
use granular_id::bindings::reserved;

/// Puts n columns of float64, shape (T,), side by side into `out`, shape (T, n); tells whether all values are finite.
#[pyfunction]
pub(super) fn interleave(columns: &Bound<'_, PyList>, out: &Bound<'_, PyArrayDyn<f64>>) -> PyResult<bool> {
    let mut asked = reserved(columns.len()).or_raise()?;
    for column in columns {
        let column = column.cast_into::<PyArray1<f64>>().map_err(|error| {
            let came = shown(&error.into_inner());
            PyTypeError::new_err(format!("each column must be a 1-D array of float64, got {came}"))
        })?;
        if !column.is_c_contiguous() {
            return Err(GranularIdError::new_err("columns must be contiguous"));
        }
        asked.push(column.to_dyn().clone());
    }
    let mut arrays = reserved(asked.len() + 1).or_raise()?;
    arrays.extend(asked.iter().map(Bound::as_any));
    arrays.push(out.as_any());
    let hold = Hold::for_values(out.len(), &arrays)?;
    let mut borrowed = reserved(asked.len()).or_raise()?;
    for column in &asked {
        borrowed.push(readable(column, "columns")?);
    }
    let mut slices = reserved(borrowed.len()).or_raise()?;
    for column in &borrowed {
        slices.push(column.as_slice()?);
    }
    let wanted = [slices.first().map_or(0, |slice| slice.len()), slices.len()];
    if out.shape() != wanted {
        return Err(wrong_shape("out", tuple(&wanted), out.shape()));
    }
    let mut samples = writable(out, "columns", &slices)?;
    let samples = samples.as_slice_mut()?;
    hold.work(out.py(), || granular_id::interleave(&slices, samples)).or_raise()
}
