//! Rows that a reader brought, as arrays.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use granular_id::bindings::reserved;
use granular_id::buffer::{BufferedRow, Reader};
use granular_id::Result;

/// Consecutive rows of one epoch, as arrays of their own.
///
/// Attributes
/// ----------
/// wrench : ndarray of shape (n, 6)
///     Forces in N, then torques in N m.
/// time_s : ndarray of shape (n,)
///     Device time in seconds, strictly increasing.
/// ticks : ndarray of shape (n,), uint64
///     The same in ticks of the device's clock, exactly.
/// host_ns : ndarray of shape (n,), uint64
///     Arrival by ``host_ns()``.
/// flags : ndarray of shape (n,), uint8
///     Bits of ``granular_id.recording.SampleFlag``.
/// missing_before : ndarray of shape (n,), uint32
///     Instants without a row between each row and the one before it, in the block or before it.
/// epoch : int
///     Number of the epoch; in a block without rows, of the newest row.
/// missed : int
///     Rows overwritten before the first of the block, because the reader came too late for them.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "Block", module = "granular_id.live")]
pub(crate) struct PyBlock {
    #[pyo3(get)]
    wrench: Py<PyArray2<f64>>,
    #[pyo3(get)]
    time_s: Py<PyArray1<f64>>,
    #[pyo3(get)]
    ticks: Py<PyArray1<u64>>,
    #[pyo3(get)]
    host_ns: Py<PyArray1<u64>>,
    #[pyo3(get)]
    flags: Py<PyArray1<u8>>,
    #[pyo3(get)]
    missing_before: Py<PyArray1<u32>>,
    #[pyo3(get)]
    epoch: u32,
    #[pyo3(get)]
    missed: u64,
    n_rows: usize,
}

/// The columns of a block, before they belong to Python.
#[derive(Default)]
pub(super) struct Columns {
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
    pub(super) fn read(reader: &mut Reader, max_rows: Option<usize>) -> Result<Self> {
        let ahead = usize::try_from(reader.n_ahead()).unwrap_or(usize::MAX).min(reader.capacity());
        let n_rows = max_rows.map_or(ahead, |max_rows| max_rows.min(ahead));
        let mut columns = Self {
            wrench: reserved(6 * n_rows)?,
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

    pub(super) fn one(row: &BufferedRow) -> Self {
        let mut columns = Self::default();
        columns.push(row);
        columns
    }

    fn push(&mut self, row: &BufferedRow) {
        self.wrench.extend_from_slice(&row.row.wrench);
        self.ticks.push(row.row.ticks);
        self.host_ns.push(row.row.host_ns);
        self.flags.push(row.row.flags);
        self.missing_before.push(row.missing_before);
        self.epoch = row.epoch;
    }
}

impl PyBlock {
    pub(super) fn new(py: Python<'_>, mut columns: Columns, tick_hz: f64) -> PyResult<Self> {
        let n_rows = columns.ticks.len();
        columns.time_s.extend(columns.ticks.iter().map(|ticks| *ticks as f64 / tick_hz));
        Ok(Self {
            wrench: PyArray1::from_vec(py, columns.wrench).reshape([n_rows, 6])?.unbind(),
            time_s: PyArray1::from_vec(py, columns.time_s).unbind(),
            ticks: PyArray1::from_vec(py, columns.ticks).unbind(),
            host_ns: PyArray1::from_vec(py, columns.host_ns).unbind(),
            flags: PyArray1::from_vec(py, columns.flags).unbind(),
            missing_before: PyArray1::from_vec(py, columns.missing_before).unbind(),
            epoch: columns.epoch,
            missed: columns.missed,
            n_rows,
        })
    }
}

#[pymethods]
impl PyBlock {
    fn __len__(&self) -> usize {
        self.n_rows
    }

    fn __repr__(&self) -> String {
        format!("<Block of {} rows, epoch {}, {} missed before>", self.n_rows, self.epoch, self.missed)
    }
}
