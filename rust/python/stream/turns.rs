//! One stream for several threads, which take turns; and for a process that was forked meanwhile.

use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Between two looks whether a stream is free.
const PAUSE: Duration = Duration::from_micros(100);

/// A stream that is locked under the GIL only, and kept without it for long work alone. So a fork finds it whole, or locked by
/// a process that is not its own: then whoever asks for it gets an error, because nobody will ever unlock it.
pub(super) struct Turns<T> {
    stream: Mutex<T>,
    /// The process that did long work last.
    process: AtomicU32,
    /// Threads that wait for it.
    n_waiting: AtomicUsize,
}

impl<T: Send> Turns<T> {
    pub(super) fn new(stream: T) -> Self {
        Self { stream: Mutex::new(stream), process: AtomicU32::new(0), n_waiting: AtomicUsize::new(0) }
    }

    /// The stream, for work that is short and calls nothing of Python's.
    pub(super) fn locked(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, T>> {
        if let Some(stream) = self.free() {
            return Ok(stream);
        }
        if self.process.load(Relaxed) != std::process::id() {
            return Err(PyRuntimeError::new_err(
                "the stream was taking rows in another thread when this process was forked, and is not whole here: make a new one",
            ));
        }
        self.n_waiting.fetch_add(1, Relaxed);
        let stream = loop {
            py.detach(|| std::thread::sleep(PAUSE));
            if let Some(stream) = self.free() {
                break stream;
            }
        };
        self.n_waiting.fetch_sub(1, Relaxed);
        Ok(stream)
    }

    /// Work that is long and calls nothing of Python's, without the GIL.
    pub(super) fn work<R: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut T) -> R + Send) -> PyResult<R> {
        // Who waits would otherwise find the stream locked whenever there is the GIL for a look.
        if self.n_waiting.load(Relaxed) > 0 {
            py.detach(|| std::thread::sleep(2 * PAUSE));
        }
        let mut stream = self.locked(py)?;
        if self.process.swap(std::process::id(), Relaxed) != std::process::id() {
            // Nobody who waited in another process waits in this one.
            self.n_waiting.store(0, Relaxed);
        }
        let stream = &mut *stream;
        Ok(py.detach(|| work(stream)))
    }

    fn free(&self) -> Option<MutexGuard<'_, T>> {
        match self.stream.try_lock() {
            Ok(stream) => Some(stream),
            // Nothing in a stream panics; if it did, no push is left half done that `reset` does not undo.
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}
