//! The writing end of a buffer, which Python has unless a sensor of the core does.

use std::sync::{MutexGuard, PoisonError};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use super::clock::DeviceClock;
use super::PyWrenchBuffer;
use granular_id::buffer::{BufferSpec, Writer};

pub(super) struct Input {
    /// Nothing while a sensor has it.
    writer: Option<Writer>,
    clock: DeviceClock,
}

impl Input {
    pub(super) fn new(writer: Writer, spec: &BufferSpec) -> Self {
        Self { writer: Some(writer), clock: DeviceClock::new(spec) }
    }

    pub(super) fn writing(&mut self) -> PyResult<(&mut Writer, &mut DeviceClock)> {
        let writer = self.writer.as_mut().ok_or_else(sensor_writes)?;
        Ok((writer, &mut self.clock))
    }
}

impl PyWrenchBuffer {
    /// The writer, for a sensor that pushes from a thread of its own; pushing from Python is refused until
    /// [`give_back`](Self::give_back). An error when another sensor has it.
    pub(crate) fn take_writer(&self) -> PyResult<Writer> {
        self.input().writer.take().ok_or_else(sensor_writes)
    }

    /// Takes the writer back from a sensor that has stopped; rows that wait are written.
    pub(crate) fn give_back(&self, mut writer: Writer) {
        writer.flush();
        self.input().writer = Some(writer);
    }

    /// Locked for moments only and never without the GIL, so that no fork finds it locked. Nothing that runs under this lock
    /// panics half-way.
    pub(super) fn input(&self) -> MutexGuard<'_, Input> {
        self.input.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn sensor_writes() -> PyErr {
    PyRuntimeError::new_err("a sensor is writing to this buffer: stop it before you push rows")
}
