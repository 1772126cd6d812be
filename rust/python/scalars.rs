//! Single values from Python, or an exception that names the argument.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;

/// A real number.
pub(super) fn number(value: &Bound<'_, PyAny>, name: &str) -> PyResult<f64> {
    value.extract().map_err(|error: PyErr| {
        if error.is_instance_of::<PyTypeError>(value.py()) {
            PyTypeError::new_err(format!("{name} must be a real number, got {}", shown(value)))
        } else {
            PyValueError::new_err(format!(
                "{name} must be a number that float64 can hold, got {}",
                shown(value)
            ))
        }
    })
}

/// A number of things, from one to `most`; `usize::MAX` is no limit worth naming.
pub(super) fn count(value: &Bound<'_, PyAny>, name: &str, most: usize) -> PyResult<usize> {
    match value.extract::<usize>() {
        Ok(count) if (1..=most).contains(&count) => return Ok(count),
        Err(error) if error.is_instance_of::<PyTypeError>(value.py()) => {
            return Err(PyTypeError::new_err(format!("{name} must be an integer, got {}", shown(value))));
        }
        _ => {}
    }
    let wanted = if most == usize::MAX { "of at least 1".to_owned() } else { format!("from 1 to {most}") };
    Err(PyValueError::new_err(format!("{name} must be an integer {wanted}, got {}", shown(value))))
}

/// A whole number from 0 to `most`.
pub(super) fn whole<T>(value: &Bound<'_, PyAny>, name: &str, most: T) -> PyResult<T>
where
    T: Copy + PartialOrd + std::fmt::Display + for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    match value.extract::<T>() {
        Ok(whole) if whole <= most => Ok(whole),
        Err(error) if error.is_instance_of::<PyTypeError>(value.py()) => {
            Err(PyTypeError::new_err(format!("{name} must be an integer, got {}", shown(value))))
        }
        _ => Err(PyValueError::new_err(format!(
            "{name} must be an integer from 0 to {most}, got {}",
            shown(value)
        ))),
    }
}

/// Python's or numpy's True or False.
pub(super) fn flag(value: &Bound<'_, PyAny>, name: &str) -> PyResult<bool> {
    value
        .extract()
        .map_err(|_| PyTypeError::new_err(format!("{name} must be True or False, got {}", shown(value))))
}

/// One of some words.
pub(super) fn word<T: Copy>(value: &Bound<'_, PyAny>, name: &str, words: &[(&str, T)]) -> PyResult<T> {
    // Looked at where it is: it may be of any length.
    let text = value.cast::<PyString>().ok().and_then(|text| text.to_str().ok());
    if let Some((_, meaning)) = words.iter().find(|(word, _)| text == Some(*word)) {
        return Ok(*meaning);
    }
    let message = format!("{name} must be {}, got {}", granular_id::bindings::listed(words), shown(value));
    if value.is_instance_of::<PyString>() {
        Err(PyValueError::new_err(message))
    } else {
        Err(PyTypeError::new_err(message))
    }
}

/// How Python shows a value and its type; only the type where the value is long or cannot be shown.
pub(super) fn shown(value: &Bound<'_, PyAny>) -> String {
    let kind = value.get_type().name().map_or_else(|_| "object".to_owned(), |name| name.to_string());
    let text = value.repr();
    match text.as_ref().map(|text| text.to_str()) {
        Ok(Ok(text)) if text.chars().take(61).count() <= 60 => format!("{text} ({kind})"),
        _ => kind,
    }
}
