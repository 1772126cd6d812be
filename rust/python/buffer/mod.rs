//! The wrench buffer in Python.

mod block;
mod clock;
mod input;
mod reader;
mod rows;
mod window;
mod wrench_buffer;

use pyo3::prelude::*;

pub(super) use block::PyBlock;
pub(super) use reader::PyWrenchReader;
pub(super) use window::{PyWindow, WindowError};
pub(super) use wrench_buffer::PyWrenchBuffer;

/// Monotonic nanoseconds since an origin of this process: the clock of `Block.host_ns`.
#[pyfunction]
pub(super) fn host_ns() -> u64 {
    granular_id::buffer::host_ns()
}
