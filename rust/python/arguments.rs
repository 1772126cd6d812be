//! Single values from Python, or an exception that names the argument; errors of the core as exceptions.

use granular_id::Error;
use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyIterator, PyString, PyTuple};

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

/// Why a value could not be converted: its type, or its size, of which `wrong` tells; what its own code raised stays.
pub(super) fn refused(
    error: PyErr,
    value: &Bound<'_, PyAny>,
    wanted: impl std::fmt::Display,
    wrong: impl FnOnce() -> PyErr,
) -> PyErr {
    let py = value.py();
    if error.is_instance_of::<PyTypeError>(py) {
        PyTypeError::new_err(format!("{wanted}, got {}", shown(value)))
    } else if error.is_instance_of::<PyOverflowError>(py) || error.is_instance_of::<PyValueError>(py) {
        wrong()
    } else {
        error
    }
}

/// A real number.
pub(super) fn number(value: &Bound<'_, PyAny>, name: &str) -> PyResult<f64> {
    let wrong = || {
        let got = shown(value);
        GranularIdError::new_err(format!("{name} must be a number that float64 can hold, got {got}"))
    };
    let wanted = format_args!("{name} must be a real number");
    value.extract().map_err(|error| refused(error, value, wanted, wrong))
}

/// An integer in some range, which `range` describes.
fn integer<T>(
    value: &Bound<'_, PyAny>,
    name: &str,
    fits: impl FnOnce(T) -> bool,
    range: impl FnOnce() -> String,
) -> PyResult<T>
where
    T: Copy + for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    let wrong = || {
        let (range, got) = (range(), shown(value));
        GranularIdError::new_err(format!("{name} must be an integer {range}, got {got}"))
    };
    match value.extract::<T>() {
        Ok(integer) if fits(integer) => Ok(integer),
        Ok(_) => Err(wrong()),
        Err(error) => Err(refused(error, value, format_args!("{name} must be an integer"), wrong)),
    }
}

/// A number of things, from one to `most`; `usize::MAX` is no limit worth naming.
pub(super) fn count(value: &Bound<'_, PyAny>, name: &str, most: usize) -> PyResult<usize> {
    let range = || match most {
        usize::MAX => "of at least 1".to_owned(),
        _ => format!("from 1 to {most}"),
    };
    integer(value, name, |count| (1..=most).contains(&count), range)
}

/// A whole number from 0 to `most`.
pub(super) fn whole<T>(value: &Bound<'_, PyAny>, name: &str, most: T) -> PyResult<T>
where
    T: Copy + PartialOrd + std::fmt::Display + for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    integer(value, name, |whole| whole <= most, || format!("from 0 to {most}"))
}

/// Size of a recording, of any limits.
pub(super) fn samples_and_axes(
    n_samples: &Bound<'_, PyAny>,
    n_axes: &Bound<'_, PyAny>,
) -> PyResult<(usize, usize)> {
    Ok((count(n_samples, "n_samples", usize::MAX)?, count(n_axes, "n_axes", usize::MAX)?))
}

/// Each of a sequence, which text is not: `wrong` tells of what.
pub(super) fn each<'py>(
    value: &Bound<'py, PyAny>,
    wrong: impl FnOnce() -> PyErr,
) -> PyResult<Bound<'py, PyIterator>> {
    if value.is_instance_of::<PyString>() {
        return Err(wrong());
    }
    let is_type_error = |error: &PyErr| error.is_instance_of::<PyTypeError>(value.py());
    value.try_iter().map_err(|error| if is_type_error(&error) { wrong() } else { error })
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
        Err(GranularIdError::new_err(message))
    } else {
        Err(PyTypeError::new_err(message))
    }
}

/// Threads that are asked for; all cores by default, and one for a single recording.
pub(super) fn threads(asked: Option<&Bound<'_, PyAny>>) -> PyResult<impl Fn(bool) -> usize> {
    let asked = asked.map(|asked| count(asked, "threads", usize::MAX)).transpose()?;
    Ok(move |single| asked.unwrap_or_else(|| if single { 1 } else { granular_id::bindings::cores() }))
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
