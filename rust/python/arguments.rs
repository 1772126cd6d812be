//! Single values from Python, or an exception that names the argument; errors of the core as exceptions.

use granular_id::Error;
use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

create_exception!(
    granular_id,
    GranularIdError,
    PyValueError,
    "Input that granular_id refuses: a ValueError whose message names the argument or file, and what is wanted.\n\nAll refusals of values are of this class or one below it, so that one ``except`` separates them from bugs."
);

/// An error of the core that Python can raise.
pub(super) trait Raise {
    fn raise(self) -> PyErr;
}

impl Raise for Error {
    fn raise(self) -> PyErr {
        let message = self.to_string();
        match self {
            Self::Memory { .. } => PyMemoryError::new_err(message),
            _ => GranularIdError::new_err(message),
        }
    }
}

/// `work().or_raise()?` in a function that answers to Python.
pub(super) trait OrRaise<T> {
    fn or_raise(self) -> PyResult<T>;
}

impl<T, E: Raise> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(Raise::raise)
    }
}

/// A value of a type, or an exception that names the argument; what the value's own code raised stays.
fn converted<T>(value: &Bound<'_, PyAny>, name: &str, wanted: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    value.extract().map_err(|error: PyErr| {
        let py = value.py();
        let message = || format!("{name} must be {wanted}, got {}", shown(value));
        if error.is_instance_of::<PyTypeError>(py) {
            PyTypeError::new_err(message())
        } else if error.is_instance_of::<PyOverflowError>(py) || error.is_instance_of::<PyValueError>(py) {
            GranularIdError::new_err(message())
        } else {
            error
        }
    })
}

/// A real number.
pub(super) fn number(value: &Bound<'_, PyAny>, name: &str) -> PyResult<f64> {
    converted(value, name, "a real number that float64 can hold")
}

/// A whole number.
pub(super) fn whole<T>(value: &Bound<'_, PyAny>, name: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    converted(value, name, &format!("an integer from 0 to 2^{} - 1", 8 * size_of::<T>()))
}

fn index(value: &Bound<'_, PyAny>, name: &str) -> PyResult<isize> {
    converted(value, name, "an integer")
}

/// A number of things.
fn count(value: &Bound<'_, PyAny>, name: &str) -> PyResult<usize> {
    let wanted = "an integer of at least 1";
    match converted(value, name, wanted)? {
        0 => Err(GranularIdError::new_err(format!("{name} must be {wanted}, got 0"))),
        count => Ok(count),
    }
}

fn optional_count(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Option<usize>> {
    if value.is_none() {
        Ok(None)
    } else {
        count(value, name).map(Some)
    }
}

fn optional_number(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Option<f64>> {
    if value.is_none() {
        Ok(None)
    } else {
        number(value, name).map(Some)
    }
}

fn optional_whole(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Option<u64>> {
    if value.is_none() {
        Ok(None)
    } else {
        whole(value, name).map(Some)
    }
}

macro_rules! converters {
    ($($convert:ident $type:ty: $($name:ident)*;)*) => {$($(
        pub(crate) fn $name(value: &Bound<'_, PyAny>) -> PyResult<$type> {
            super::$convert(value, stringify!($name))
        }
    )*)*}
}

/// Converters for `from_py_with`, each called as its argument: by itself `PyO3` raises an `OverflowError` without a name
/// for a negative count.
pub(super) mod named {
    use pyo3::prelude::*;

    converters! {
        number f64: rate_hz cutoff_hz seconds tick_hz timeout_s;
        whole u64: host_ns;
        whole u32: max_gap;
        whole usize: reorder_depth;
        index isize: axis;
        count usize: n n_axes n_bins n_samples max_file_bytes order;
    }
}

/// The same where None is a value.
pub(super) mod optional {
    use pyo3::prelude::*;

    converters! {
        optional_number Option<f64>: t;
        optional_whole Option<u64>: host_ns now_ns;
        optional_count Option<usize>: hop max_rows n_axes n_samples threads;
    }
}

/// One of some words.
pub(super) fn word<T: Copy>(value: &str, name: &str, words: &[(&str, T)]) -> PyResult<T> {
    words.iter().find(|(word, _)| value == *word).map(|(_, meaning)| *meaning).ok_or_else(|| {
        let (wanted, start) =
            (granular_id::bindings::listed(words), value.chars().take(60).collect::<String>());
        GranularIdError::new_err(format!("{name} must be {wanted}, got {start:?}"))
    })
}

/// What `__getnewargs_ex__` gives: attributes as positional arguments and as keywords, both by their names.
pub(super) fn new_arguments<'py>(
    object: &Bound<'py, PyAny>,
    positional: &str,
    keywords: &str,
) -> NewArguments<'py> {
    let py = object.py();
    let positional = positional.split_whitespace().map(|name| object.getattr(name));
    let positional = PyTuple::new(py, positional.collect::<PyResult<Vec<_>>>()?)?;
    let given = PyDict::new(py);
    for keyword in keywords.split_whitespace() {
        given.set_item(keyword, object.getattr(keyword)?)?;
    }
    Ok((positional, given))
}

/// Arguments with which an object can be made again.
pub(super) type NewArguments<'py> = PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)>;

/// How Python shows a value and its type; only the type where the value is long or cannot be shown.
pub(super) fn shown(value: &Bound<'_, PyAny>) -> String {
    let kind = value.get_type().name().map_or_else(|_| "object".to_owned(), |name| name.to_string());
    let text = value.repr();
    match text.as_ref().map(|text| text.to_str()) {
        Ok(Ok(text)) if text.chars().take(61).count() <= 60 => format!("{text} ({kind})"),
        _ => kind,
    }
}
