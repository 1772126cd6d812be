//! Anything array-like as a float64 array of our own, or an exception that names the argument.

use numpy::{
    get_array_module, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A C-ordered, aligned float64 copy of real numbers that nothing else refers to: safe to change without the GIL.
pub(super) fn owned_real<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let py = value.py();
    let keywords = PyDict::new(py);
    keywords.set_item("dtype", numpy::dtype::<f64>(py))?;
    keywords.set_item("order", "C")?;
    let array = real(value, name)?;
    Ok(get_array_module(py)?.call_method("array", (array,), Some(&keywords))?.cast_into()?)
}

/// Real numbers as a C-ordered, aligned float64 array: the caller's own where it is one, else a copy.
pub(super) fn contiguous_real<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if let Some(array) = ready(value) {
        return Ok(array);
    }
    let array = real(value, name)?;
    let float64 = numpy::dtype::<f64>(value.py());
    let numpy = value.py().import("numpy")?;
    Ok(numpy.call_method1("require", (array, float64, ["C", "A"]))?.cast_into()?)
}

/// An array that needs no conversion, found without a call into numpy: a stream is pushed row by row.
fn ready<'py>(value: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArrayDyn<f64>>> {
    let array = value.cast_exact::<PyUntypedArray>().ok()?.cast::<PyArrayDyn<f64>>().ok()?;
    let aligned = array.data().addr().is_multiple_of(align_of::<f64>());
    (aligned && array.is_c_contiguous()).then(|| array.clone())
}

/// The right to read an array, unless another call is writing to it.
pub(super) fn readable<'py>(
    array: &Bound<'py, PyArrayDyn<f64>>,
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    array
        .try_readonly()
        .map_err(|_| PyValueError::new_err(format!("{name} must not be written by another call meanwhile")))
}

/// True for numpy's masked arrays, whose gaps a plain array would show as numbers.
pub(super) fn is_masked(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    value.is_instance(&value.py().import("numpy.ma")?.getattr("MaskedArray")?)
}

/// An array of real numbers of any layout and width.
fn real<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let py = value.py();
    let numpy = get_array_module(py)?;
    let array = if value.is_exact_instance_of::<PyUntypedArray>() {
        value.clone()
    } else {
        if is_masked(value)? {
            let message =
                format!("{name} must be a plain array, got a masked one: fill or drop its gaps first");
            return Err(PyTypeError::new_err(message));
        }
        as_array(&numpy, value, name)?
    };
    let untyped = array.cast::<PyUntypedArray>()?;
    let dtype = untyped.dtype();
    if !matches!(dtype.kind(), b'f' | b'i' | b'u' | b'b') {
        return Err(PyTypeError::new_err(format!("{name} must hold real numbers, got dtype {dtype}")));
    }
    Ok(array)
}

/// `numpy.asarray`, with the name of the argument in its complaints.
fn as_array<'py>(
    numpy: &Bound<'py, PyModule>,
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyAny>> {
    numpy.call_method1("asarray", (value,)).map_err(|error| {
        let py = value.py();
        let message = format!("{name} must be an array of real numbers, got {}: {error}", value.get_type());
        let named = if error.is_instance_of::<PyTypeError>(py) {
            PyTypeError::new_err(message)
        } else if error.is_instance_of::<PyValueError>(py) {
            PyValueError::new_err(message)
        } else {
            return error;
        };
        named.set_cause(py, Some(error));
        named
    })
}

/// The axis as an index from the front; numpy's `AxisError`, a `ValueError` and an `IndexError`, when there is none.
pub(super) fn axis_index(axis: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<usize> {
    let py = axis.py();
    let ndim = shape.len();
    match axis.extract::<isize>() {
        Ok(index) if index >= 0 && index.unsigned_abs() < ndim => Ok(index.unsigned_abs()),
        Ok(index) if index < 0 && index.unsigned_abs() <= ndim => Ok(ndim - index.unsigned_abs()),
        Err(error) if error.is_instance_of::<PyTypeError>(py) => {
            Err(PyTypeError::new_err(format!("axis must be an integer, got {}", axis.get_type())))
        }
        _ => {
            let message = format!(
                "axis must be in [{}, {ndim}) for x of shape {}, got {axis}",
                -signed(ndim),
                tuple(shape)
            );
            let module = py.import("numpy.exceptions").or_else(|_| py.import("numpy"))?;
            Err(PyErr::from_value(module.getattr("AxisError")?.call1((message,))?))
        }
    }
}

fn signed(ndim: usize) -> i64 {
    i64::try_from(ndim).unwrap_or(i64::MAX)
}

/// A shape as Python writes it.
pub(super) fn tuple(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}
