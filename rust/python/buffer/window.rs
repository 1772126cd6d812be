//! A window as arrays.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{OrRaise, Raise};
use granular_id::bindings::collected;
use granular_id::buffer;

create_exception!(
    granular_id.live,
    WindowError,
    PyValueError,
    "There is no such window of a buffer: too few rows, a gap, a new epoch or saturation; the message says which."
);

impl Raise for buffer::WindowError {
    fn raise(self) -> PyErr {
        match self {
            Self::Memory(error) => error.raise(),
            error => WindowError::new_err(error.to_string()),
        }
    }
}

/// The last instants of a buffer, oldest first, as arrays of their own.
///
/// Attributes
/// ----------
/// wrench : ndarray of shape (m, 6)
///     Forces in N, then torques in N m; m is n with a fill, and the number of rows measured without.
/// mask : ndarray of shape (n,), bool
///     Whether a row was measured at each instant.
/// time_s : ndarray of shape (m,)
///     Device time in seconds; interpolated where a row is filled in.
/// ticks : ndarray of shape (m,), uint64
///     The same in ticks of the device's clock.
/// host_ns : ndarray of shape (m,), uint64
///     Arrival by ``host_ns()``; interpolated where a row is filled in.
/// flags : ndarray of shape (m,), uint8
///     Bits of ``granular_id.recording.SampleFlag``.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "Window", module = "granular_id.live")]
pub(crate) struct PyWindow {
    #[pyo3(get)]
    wrench: Py<PyArray2<f64>>,
    #[pyo3(get)]
    mask: Py<PyArray1<bool>>,
    #[pyo3(get)]
    time_s: Py<PyArray1<f64>>,
    #[pyo3(get)]
    ticks: Py<PyArray1<u64>>,
    #[pyo3(get)]
    host_ns: Py<PyArray1<u64>>,
    #[pyo3(get)]
    flags: Py<PyArray1<u8>>,
    shape: (usize, usize),
}

impl PyWindow {
    pub(super) fn new(py: Python<'_>, window: buffer::Window, tick_hz: f64) -> PyResult<Self> {
        let n_rows = window.ticks.len();
        let shape = (n_rows, window.mask.len());
        let time_s = collected(window.ticks.iter().map(|ticks| *ticks as f64 / tick_hz)).or_raise()?;
        let wrench = PyArray1::from_vec(py, window.wrench.into_flattened()).reshape([n_rows, 6])?;
        Ok(Self {
            wrench: wrench.unbind(),
            mask: PyArray1::from_vec(py, window.mask).unbind(),
            time_s: PyArray1::from_vec(py, time_s).unbind(),
            ticks: PyArray1::from_vec(py, window.ticks).unbind(),
            host_ns: PyArray1::from_vec(py, window.host_ns).unbind(),
            flags: PyArray1::from_vec(py, window.flags).unbind(),
            shape,
        })
    }
}

#[pymethods]
impl PyWindow {
    fn __repr__(&self) -> String {
        format!("<Window of {} instants, {} rows>", self.shape.1, self.shape.0)
    }
}
