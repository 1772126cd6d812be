//! What leaves a buffer: rows as they come, and windows of the newest.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::create_exception;
use pyo3::prelude::*;

use crate::arguments::{named, optional, GranularIdError, OrRaise, Raise};
use granular_id::bindings::{collected, reserved, short_number};
use granular_id::buffer::{self, BufferSpec, BufferedRow, Reader};

create_exception!(
    granular_id.live,
    WindowError,
    GranularIdError,
    "There is no such window of a buffer: too few rows, a gap, a new epoch or saturation; the message names which."
);

impl Raise for buffer::WindowError {
    fn raise(self) -> PyErr {
        match self {
            Self::Memory(error) => error.raise(),
            error => WindowError::new_err(error.to_string()),
        }
    }
}

/// Longest time without a look at signals: Ctrl-C ends a wait.
const BETWEEN_SIGNALS: Duration = Duration::from_millis(50);

/// A place in a `WrenchBuffer`: each row is read once, in order, or counted as missed.
///
/// Made by ``WrenchBuffer.reader()``. Several threads may share one; every row then goes to one of them.
///
/// Examples
/// --------
/// >>> from granular_id import WrenchBuffer
/// >>> buffer = WrenchBuffer(seconds=0.01, rate_hz=500.0)
/// >>> reader = buffer.reader()
/// >>> for fz in range(7):
/// ...     taken = buffer.push([0, 0, fz, 0, 0, 0])
/// >>> block = reader.read()
/// >>> block.missed, block.wrench[:, 2].tolist()
/// (2, [2.0, 3.0, 4.0, 5.0, 6.0])
#[pyclass(frozen, name = "WrenchReader", module = "granular_id.live")]
pub(crate) struct PyWrenchReader {
    reader: Mutex<Reader>,
    /// Time between two looks while waiting: an eighth of a period.
    pause: Duration,
}

#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pymethods]
impl PyWrenchReader {
    /// The rows not yet read: never blocks.
    ///
    /// Parameters
    /// ----------
    /// max_rows : int, optional
    ///     Rows to read at most; all by default.
    ///
    /// Returns
    /// -------
    /// Block
    ///     Consecutive rows of one epoch, perhaps none. At the border of an epoch the block ends, and the next read goes on.
    #[pyo3(signature = (max_rows=None))]
    fn read(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = optional::max_rows)] max_rows: Option<usize>,
    ) -> PyResult<PyBlock> {
        let mut reader = self.reader();
        let &BufferSpec { tick_hz, n_axes, .. } = reader.spec();
        let columns = Columns::read(&mut reader, max_rows).or_raise()?;
        drop(reader);
        PyBlock::new(py, columns, tick_hz, n_axes)
    }

    /// Wait until there is a row to read.
    ///
    /// Other Python threads run meanwhile. The buffer is looked at several times a period, every millisecond at most: a
    /// writer that had to wake readers could be held up by them.
    ///
    /// Parameters
    /// ----------
    /// timeout_s : float
    ///     Longest time to wait in seconds; 0 only looks, infinity waits for ever.
    ///
    /// Returns
    /// -------
    /// bool
    ///     True if there is a row; False if the time is over.
    fn wait(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = named::timeout_s)] timeout_s: f64,
    ) -> PyResult<bool> {
        if timeout_s.is_nan() || timeout_s < 0.0 {
            let message = format!("timeout_s must not be negative, got {}", short_number(timeout_s));
            return Err(GranularIdError::new_err(message));
        }
        let start = Instant::now();
        loop {
            // A copy of the place: the lock is never held without the GIL, so that no fork finds it locked.
            let reader = self.reader().clone();
            if reader.n_ahead() > 0 {
                return Ok(true);
            }
            let is_over = py.detach(|| {
                let round = Instant::now();
                while reader.n_ahead() == 0 && round.elapsed() < BETWEEN_SIGNALS {
                    let left_s = timeout_s - start.elapsed().as_secs_f64();
                    if left_s <= 0.0 {
                        return true;
                    }
                    std::thread::sleep(
                        Duration::try_from_secs_f64(left_s).unwrap_or(self.pause).min(self.pause),
                    );
                }
                false
            });
            if is_over {
                return Ok(self.reader().n_ahead() > 0);
            }
            py.check_signals()?;
        }
    }

    fn __repr__(&self) -> String {
        format!("<WrenchReader with {} rows ahead>", self.reader().n_ahead())
    }
}

impl PyWrenchReader {
    pub(super) fn new(reader: Reader) -> Self {
        let pause_s = (0.125 / reader.spec().rate_hz).clamp(50e-6, 1e-3);
        Self { reader: Mutex::new(reader), pause: Duration::from_secs_f64(pause_s) }
    }

    /// Locked for moments only and never without the GIL. Nothing that runs under this lock panics half-way.
    fn reader(&self) -> MutexGuard<'_, Reader> {
        self.reader.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Consecutive rows of one epoch, as arrays of their own.
///
/// Attributes
/// ----------
/// wrench : ndarray of shape (n, n_axes)
///     Of six axes: forces in N, then torques in N m.
/// time_s : ndarray of shape (n,)
///     Device time in seconds, strictly increasing.
/// ticks : ndarray of shape (n,), uint64
///     The same in ticks of the device's clock, exactly.
/// host_ns : ndarray of shape (n,), uint64
///     Arrival by ``host_ns()``.
/// flags : ndarray of shape (n,), uint8
///     Bits of `granular_id.SampleFlag`.
/// missing_before : ndarray of shape (n,), uint32
///     Instants without a row between each row and the one before it, in the block or before it.
/// epoch : int
///     Number of the epoch; in a block without rows, of the newest row.
/// missed : int
///     Rows overwritten before the first of the block, because the reader came too late for them.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, get_all, name = "Block", module = "granular_id.live")]
pub(crate) struct PyBlock {
    wrench: Py<PyArray2<f64>>,
    time_s: Py<PyArray1<f64>>,
    ticks: Py<PyArray1<u64>>,
    host_ns: Py<PyArray1<u64>>,
    flags: Py<PyArray1<u8>>,
    missing_before: Py<PyArray1<u32>>,
    epoch: u32,
    missed: u64,
}

/// The columns of a block, before they belong to Python.
#[derive(Default)]
struct Columns {
    wrench: Vec<f64>,
    ticks: Vec<u64>,
    host_ns: Vec<u64>,
    flags: Vec<u8>,
    missing_before: Vec<u32>,
    /// Empty, with room.
    time_s: Vec<f64>,
    epoch: u32,
    missed: u64,
}

impl Columns {
    /// All rows not yet read, up to `max_rows`.
    fn read(reader: &mut Reader, max_rows: Option<usize>) -> granular_id::Result<Self> {
        let ahead = usize::try_from(reader.n_ahead()).unwrap_or(usize::MAX).min(reader.capacity());
        let n_rows = max_rows.map_or(ahead, |max_rows| max_rows.min(ahead));
        let mut columns = Self {
            wrench: reserved(n_rows.saturating_mul(reader.spec().n_axes))?,
            ticks: reserved(n_rows)?,
            host_ns: reserved(n_rows)?,
            flags: reserved(n_rows)?,
            missing_before: reserved(n_rows)?,
            time_s: reserved(n_rows)?,
            ..Self::default()
        };
        let taken = reader.read_each(n_rows, |row| columns.push(row));
        columns.missed = taken.missed;
        if taken.n_rows == 0 {
            columns.epoch = reader.latest().map_or(0, |row| row.epoch);
        }
        Ok(columns)
    }

    fn push(&mut self, row: &BufferedRow<&[f64]>) {
        self.wrench.extend_from_slice(row.row.wrench);
        self.ticks.push(row.row.ticks);
        self.host_ns.push(row.row.host_ns);
        self.flags.push(row.row.flags);
        self.missing_before.push(row.missing_before);
        self.epoch = row.epoch;
    }
}

impl PyBlock {
    pub(super) fn one(py: Python<'_>, row: &BufferedRow<&[f64]>, tick_hz: f64) -> PyResult<Self> {
        let mut columns = Columns::default();
        columns.push(row);
        Self::new(py, columns, tick_hz, row.row.wrench.len())
    }

    fn new(py: Python<'_>, mut columns: Columns, tick_hz: f64, n_axes: usize) -> PyResult<Self> {
        let n_rows = columns.ticks.len();
        columns.time_s.extend(columns.ticks.iter().map(|ticks| *ticks as f64 / tick_hz));
        Ok(Self {
            wrench: PyArray1::from_vec(py, columns.wrench).reshape([n_rows, n_axes])?.unbind(),
            time_s: PyArray1::from_vec(py, columns.time_s).unbind(),
            ticks: PyArray1::from_vec(py, columns.ticks).unbind(),
            host_ns: PyArray1::from_vec(py, columns.host_ns).unbind(),
            flags: PyArray1::from_vec(py, columns.flags).unbind(),
            missing_before: PyArray1::from_vec(py, columns.missing_before).unbind(),
            epoch: columns.epoch,
            missed: columns.missed,
        })
    }
}

#[pymethods]
impl PyBlock {
    fn __len__(&self, py: Python<'_>) -> usize {
        self.ticks.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let n_rows = self.__len__(py);
        format!("<Block of {n_rows} rows, epoch {}, {} missed before>", self.epoch, self.missed)
    }
}

/// The last instants of a buffer, oldest first, as arrays of their own.
///
/// Attributes
/// ----------
/// wrench : ndarray of shape (m, n_axes)
///     Of six axes: forces in N, then torques in N m; m is n with a fill, and the number of rows measured without.
/// mask : ndarray of shape (n,), bool
///     Whether a row was measured at each instant.
/// time_s : ndarray of shape (m,)
///     Device time in seconds; interpolated where a row is filled in.
/// ticks : ndarray of shape (m,), uint64
///     The same in ticks of the device's clock.
/// host_ns : ndarray of shape (m,), uint64
///     Arrival by ``host_ns()``; interpolated where a row is filled in.
/// flags : ndarray of shape (m,), uint8
///     Bits of `granular_id.SampleFlag`.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, get_all, name = "Window", module = "granular_id.live")]
pub(crate) struct PyWindow {
    wrench: Py<PyArray2<f64>>,
    mask: Py<PyArray1<bool>>,
    time_s: Py<PyArray1<f64>>,
    ticks: Py<PyArray1<u64>>,
    host_ns: Py<PyArray1<u64>>,
    flags: Py<PyArray1<u8>>,
}

impl PyWindow {
    pub(super) fn new(py: Python<'_>, window: buffer::Window, spec: &BufferSpec) -> PyResult<Self> {
        let n_rows = window.ticks.len();
        let time_s = collected(window.ticks.iter().map(|ticks| *ticks as f64 / spec.tick_hz)).or_raise()?;
        let wrench = PyArray1::from_vec(py, window.wrench).reshape([n_rows, spec.n_axes])?;
        Ok(Self {
            wrench: wrench.unbind(),
            mask: PyArray1::from_vec(py, window.mask).unbind(),
            time_s: PyArray1::from_vec(py, time_s).unbind(),
            ticks: PyArray1::from_vec(py, window.ticks).unbind(),
            host_ns: PyArray1::from_vec(py, window.host_ns).unbind(),
            flags: PyArray1::from_vec(py, window.flags).unbind(),
        })
    }
}

#[pymethods]
impl PyWindow {
    fn __repr__(&self, py: Python<'_>) -> String {
        let (n_instants, n_rows) = (self.mask.bind(py).len(), self.ticks.bind(py).len());
        format!("<Window of {n_instants} instants, {n_rows} rows>")
    }
}
