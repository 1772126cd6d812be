//! What the machine has to offer.

use pyo3::prelude::*;

/// How many cores this process may use, by affinity and by quota of its control group.
#[pyfunction]
pub(super) fn available_cores() -> usize {
    crate::pool::cores()
}
