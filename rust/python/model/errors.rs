//! Faults of models and their files as exceptions.

use std::ffi::OsString;
use std::io;

use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::convert::Raise;
use granular_id::model::{Fault, FileFault};
use granular_id::Error;

create_exception!(
    granular_id._core,
    ModelFileError,
    PyValueError,
    "A file that holds no model; the message says what is wrong with it."
);

/// Parts come from the caller, not from a file.
#[allow(clippy::needless_pass_by_value)] // for `map_err`
pub(super) fn bad_part(fault: Fault) -> PyErr {
    match fault {
        Fault::Spec(error) => error.raise(),
        fault => PyValueError::new_err(fault.to_string()),
    }
}

/// Bytes that are no model.
#[allow(clippy::needless_pass_by_value)] // for `map_err`
pub(super) fn no_model(fault: Fault) -> PyErr {
    match fault {
        Fault::Spec(error @ Error::Memory { .. }) => error.raise(),
        fault => ModelFileError::new_err(fault.to_string()),
    }
}

/// A file that is no model or cannot be read.
pub(super) fn bad_file(py: Python<'_>, fault: FileFault) -> PyErr {
    match fault {
        FileFault::Unreadable { ref source, .. } if source.kind() == io::ErrorKind::OutOfMemory => {
            PyMemoryError::new_err(fault.to_string())
        }
        FileFault::Unreadable { path, source } => {
            unreadable(py, path.into(), &source).unwrap_or_else(|error| error)
        }
        FileFault::NoModel { fault: Fault::Spec(error @ Error::Memory { .. }), .. } => error.raise(),
        fault @ FileFault::NoModel { .. } => ModelFileError::new_err(fault.to_string()),
    }
}

/// The exception that Python's own `open` would raise.
fn unreadable(py: Python<'_>, path: OsString, error: &io::Error) -> PyResult<PyErr> {
    let Some(code) = error.raw_os_error() else { return Ok(PyOSError::new_err((error.to_string(), path))) };
    let text: String = py.import("os")?.call_method1("strerror", (code,))?.extract()?;
    Ok(PyOSError::new_err((code, text, path)))
}
