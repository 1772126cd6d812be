//! A reader: rows as they come.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::super::scalars::{count, number};
use super::block::{Columns, PyBlock};
use crate::convert::OrRaise;
use granular_id::bindings::brief;
use granular_id::buffer::Reader;

/// Longest time without a look at signals: Ctrl-C ends a wait.
const BETWEEN_SIGNALS: Duration = Duration::from_millis(50);

/// A place in a `WrenchBuffer`: each row is read once, in order, or counted as missed.
///
/// Made by ``WrenchBuffer.reader()``. Several threads may share one; every row then goes to one of them.
///
/// Examples
/// --------
/// >>> from granular_id.live import WrenchBuffer
/// >>> buffer = WrenchBuffer(seconds=0.01, rate_hz=500.0)
/// >>> reader = buffer.reader()
/// >>> for fz in range(7):
/// ...     taken = buffer.push([0, 0, fz, 0, 0, 0])
/// >>> block = reader.read()
/// >>> block.missed, block.wrench[:, 2].tolist()
/// (2, [2.0, 3.0, 4.0, 5.0, 6.0])
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "WrenchReader", module = "granular_id.live")]
pub(crate) struct PyWrenchReader {
    reader: Mutex<Reader>,
    tick_hz: f64,
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
    fn read(&self, py: Python<'_>, max_rows: Option<&Bound<'_, PyAny>>) -> PyResult<PyBlock> {
        let max_rows = max_rows.map(|value| count(value, "max_rows", usize::MAX)).transpose()?;
        let columns = Columns::read(&mut self.reader(), max_rows).or_raise()?;
        PyBlock::new(py, columns, self.tick_hz)
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
    fn wait(&self, py: Python<'_>, timeout_s: &Bound<'_, PyAny>) -> PyResult<bool> {
        let timeout_s = number(timeout_s, "timeout_s")?;
        if timeout_s.is_nan() || timeout_s < 0.0 {
            let message = format!("timeout_s must not be negative, got {}", brief(timeout_s));
            return Err(PyValueError::new_err(message));
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
        let spec = reader.spec();
        let pause_s = (0.125 / spec.rate_hz).clamp(50e-6, 1e-3);
        let (tick_hz, pause) = (spec.tick_hz, Duration::from_secs_f64(pause_s));
        Self { reader: Mutex::new(reader), tick_hz, pause }
    }

    /// Locked for moments only and never without the GIL. Nothing that runs under this lock panics half-way.
    fn reader(&self) -> MutexGuard<'_, Reader> {
        self.reader.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
