//! The RDT receiver: unpack, call, map the error.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::exceptions::{PyConnectionError, PyConnectionRefusedError, PyRuntimeError, PyTimeoutError};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::arguments::{word, GranularIdError, OrRaise, Raise};
use crate::live::PyWrenchBuffer;
use granular_id::rdt::{RdtError, Receiver, Scale, Settings, State, Variant};

impl Raise for RdtError {
    fn raise(self) -> PyErr {
        let message = self.to_string();
        match self {
            RdtError::Setting { .. } => GranularIdError::new_err(message),
            RdtError::Refused { .. } => PyConnectionRefusedError::new_err(message),
            RdtError::Silent { .. } => PyTimeoutError::new_err(message),
            // the host and the system, and what is to come
            _ => PyConnectionError::new_err(message),
        }
    }
}

/// A thread that receives records of a sensor box and writes them into a buffer.
///
/// `granular_id.live.rdt.RdtSource` is the documented face of it.
#[pyclass(frozen, name = "RdtReceiver", module = "granular_id._core")]
pub(super) struct PyRdtReceiver {
    settings: Settings,
    place: Mutex<Place>,
}

/// The receiver, or what is left of it. Locked for moments only and never without the GIL, so that nobody waits for the
/// GIL while another waits for the lock, and no fork finds it locked.
enum Place {
    Idle { counters: Vec<(&'static str, u64)> },
    Busy,
    Running { receiver: Receiver, buffer: Py<PyWrenchBuffer> },
}

#[pymethods]
impl PyRdtReceiver {
    #[new]
    #[pyo3(signature = (
        host, port, *, variant, counts_per_newton, counts_per_newton_metre, limits, rate_hz, buffered
    ))]
    #[allow(clippy::too_many_arguments)] // called from one place, by keyword
    fn new(
        host: &str,
        port: u16,
        variant: &str,
        counts_per_newton: f64,
        counts_per_newton_metre: f64,
        limits: [f64; 6],
        rate_hz: f64,
        buffered: bool,
    ) -> PyResult<Self> {
        let variant = word(variant, "variant", &Variant::NAMED)?;
        let scale = Scale::new(counts_per_newton, counts_per_newton_metre).or_raise()?;
        let settings = Settings::new(host, scale)
            .with_port(port)
            .with_variant(variant)
            .with_limits(limits)
            .with_rate_hz(rate_hz)
            .with_buffered(buffered);
        settings.check().or_raise()?;
        Ok(Self { settings, place: Mutex::new(Place::Idle { counters: Vec::new() }) })
    }

    /// Request the stream, wait for its first record, and write into `buffer` from then on.
    fn start(&self, buffer: &Bound<'_, PyWrenchBuffer>) -> PyResult<()> {
        let writer = {
            let mut place = self.place();
            if !matches!(*place, Place::Idle { .. }) {
                return Err(PyRuntimeError::new_err("the source runs already: stop it first"));
            }
            let writer = buffer.get().take_writer()?;
            *place = Place::Busy;
            writer
        };
        let settings = self.settings.clone();
        let (place, result) = match buffer.py().detach(|| Receiver::start(settings, writer)) {
            Ok(receiver) => (Place::Running { receiver, buffer: buffer.clone().unbind() }, Ok(())),
            Err(failed) => {
                let (error, writer) = *failed;
                buffer.get().give_back(writer);
                (Place::Idle { counters: Vec::new() }, Err(error.raise()))
            }
        };
        *self.place() = place;
        result
    }

    /// End the stream; safe to call again. In a forked child nothing is sent: the stream is the parent's.
    fn stop(&self, py: Python<'_>) {
        let mut place = self.place();
        if !matches!(*place, Place::Running { .. }) {
            return;
        }
        let taken = std::mem::replace(&mut *place, Place::Busy);
        drop(place);
        let Place::Running { mut receiver, buffer } = taken else { return };
        if let Some(writer) = py.detach(|| receiver.stop()) {
            buffer.get().give_back(writer);
        }
        *self.place() = Place::Idle { counters: receiver.counters() };
    }

    /// Make the present load the new zero, for every client of the box.
    fn bias(&self) -> PyResult<()> {
        match &*self.place() {
            Place::Running { receiver, .. } => receiver.bias().or_raise(),
            Place::Idle { .. } | Place::Busy => {
                Err(PyRuntimeError::new_err("the source does not run: start it first"))
            }
        }
    }

    /// What was counted, up to now or until the end; nothing before the start.
    fn counters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let counters = match &*self.place() {
            Place::Idle { counters } => counters.clone(),
            Place::Busy => Vec::new(),
            Place::Running { receiver, .. } => receiver.counters(),
        };
        counters.into_py_dict(py)
    }

    /// How it is, in a word, and seconds since the newest datagram.
    fn state(&self) -> (&'static str, f64) {
        match &*self.place() {
            Place::Running { receiver, .. } => (receiver.state().name(), receiver.silent_ns() as f64 * 1e-9),
            Place::Idle { .. } | Place::Busy => (State::Stopped.name(), 0.0),
        }
    }
}

impl PyRdtReceiver {
    fn place(&self) -> MutexGuard<'_, Place> {
        self.place.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
