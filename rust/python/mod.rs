//! The extension module `granular_id._core`: registration only.

use pyo3::prelude::*;

mod arrays;
mod convert;
mod signal;

#[pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::signal::{butter, sosfilt, sosfilt_zi, sosfiltfilt};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
