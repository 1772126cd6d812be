//! Tables of numbers: CSV text from columns and back, columns as samples.

use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::create_exception;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyList};

use crate::arguments::{shown, OrRaise, Raise};
use crate::arrays::{contiguous_real, readable, tuple, writable, wrong_shape, Hold};
use granular_id::bindings::{collected, reserved};
use granular_id::number_table::{parse, write, Column, ParseError, ParseErrorKind};

create_exception!(
    granular_id._core,
    NumberTableError,
    PyValueError,
    "A text that is no table of numbers; ``args`` are row and column (from 0; None: the whole row) and the problem."
);

impl Raise for ParseError {
    fn raise(self) -> PyErr {
        match self.kind {
            ParseErrorKind::Memory(error) => error.raise(),
            kind => NumberTableError::new_err((self.row, self.column, kind.to_string())),
        }
    }
}

/// The numbers of a CSV text from byte `start` on, shape (rows, `n_columns`).
#[pyfunction]
pub(super) fn parse_number_table<'py>(
    py: Python<'py>,
    text: &[u8],
    start: usize,
    n_columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let text = text.get(start..).unwrap_or_default();
    let values = py.detach(|| parse(text, n_columns)).or_raise()?;
    let rows = values.len() / n_columns.max(1);
    PyArray1::from_vec(py, values).reshape([rows, n_columns])
}

/// Columns of equal length, float64 or uint8, as lines of text.
#[pyfunction]
pub(super) fn write_number_table<'py>(columns: &Bound<'py, PyList>) -> PyResult<Bound<'py, PyBytes>> {
    let py = columns.py();
    let mut owned = reserved(columns.len()).or_raise()?;
    for column in columns {
        owned.push(Owned::new(&column)?);
    }
    let columns = collected(owned.iter().map(Owned::borrow)).or_raise()?;
    let text = py.detach(|| write(&columns)).or_raise()?;
    bytes(py, text.as_bytes())
}

/// Bytes of Python; a `MemoryError` where there is no room for them.
pub(super) fn bytes<'py>(py: Python<'py>, from: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
    PyBytes::new_with(py, from.len(), |bytes| {
        bytes.copy_from_slice(from);
        Ok(())
    })
}

/// A column copied from an array of any layout, which other threads may change meanwhile.
enum Owned {
    Numbers(Vec<f64>),
    Whole(Vec<u8>),
}

impl Owned {
    fn new(column: &Bound<'_, PyAny>) -> PyResult<Self> {
        if column.cast::<PyArray1<f64>>().is_ok() {
            // Steps that are no multiple of the item are numpy's matter.
            let column = contiguous_real(column, "columns")?;
            Ok(Self::Numbers(
                collected(readable(&column, "columns")?.as_slice()?.iter().copied()).or_raise()?,
            ))
        } else if let Ok(column) = column.extract::<PyReadonlyArray1<'_, u8>>() {
            Ok(Self::Whole(collected(column.as_array().iter().copied()).or_raise()?))
        } else {
            Err(PyTypeError::new_err(format!(
                "each column must be a 1-D array of float64 or uint8, got {}",
                shown(column)
            )))
        }
    }

    fn borrow(&self) -> Column<'_> {
        match self {
            Self::Numbers(values) => Column::Numbers(values),
            Self::Whole(values) => Column::Whole(values),
        }
    }
}

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
            return Err(PyValueError::new_err("columns must be contiguous"));
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
