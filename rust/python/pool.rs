//! What the machine has to offer, and when other threads of Python get a share of it.

use pyo3::prelude::*;

use super::scalars::count;

/// Values of an array from which on other threads of Python run meanwhile: some 40 microseconds of work. Handing the GIL
/// over takes a tenth of one, getting it back from a thread that is busy takes up to 5 ms.
pub(super) const MANY_VALUES: usize = 1 << 14;

/// How many cores this process may use, by affinity and by quota of its control group.
#[pyfunction]
pub(super) fn available_cores() -> usize {
    granular_id::bindings::cores()
}

/// Work on so many values, without the GIL where they are many.
pub(super) fn work_on<T: Send>(py: Python<'_>, n_values: usize, work: impl FnOnce() -> T + Send) -> T {
    if n_values < MANY_VALUES {
        work()
    } else {
        py.detach(work)
    }
}

/// Threads that are asked for; all cores by default, and one for a single recording.
pub(super) fn threads_for(asked: Option<&Bound<'_, PyAny>>) -> PyResult<impl Fn(bool) -> usize> {
    let asked = asked.map(|asked| count(asked, "threads", usize::MAX)).transpose()?;
    Ok(move |single| asked.unwrap_or_else(|| if single { 1 } else { granular_id::bindings::cores() }))
}
