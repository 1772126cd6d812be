//! The extension module `granular_id._core`: registration only.

mod arguments;
mod features;
mod live;
mod model;
mod multiband;
mod rdt;
mod signal;
mod stream;

use pyo3::prelude::*;

// Classes are frozen; what changes in them is behind a lock.
#[pymodule(gil_used = false)]
mod _core {
    use pyo3::prelude::*;
    use pyo3::types::{IntoPyDict, PyTuple};

    use super::arguments::OrRaise;

    #[pymodule_export]
    use super::arguments::GranularIdError;
    #[pymodule_export]
    use super::features::{extract_features, histogram, PyFeatureSpec};
    #[pymodule_export]
    use super::live::{PyBlock, PyWindow, PyWrenchBuffer, PyWrenchReader, WindowError};
    #[pymodule_export]
    use super::model::{ModelFileError, PyModel};
    #[pymodule_export]
    use super::multiband::PyMultiBandExtractor;
    #[pymodule_export]
    use super::rdt::PyRdtReceiver;
    #[pymodule_export]
    use super::signal::{butter, sosfilt, sosfilt_zi};
    #[pymodule_export]
    use super::stream::{PyStreamingExtractor, PyStreamingIdentifier};

    /// How many cores this process may use, by affinity and by quota of its control group.
    #[pyfunction]
    fn available_cores() -> usize {
        granular_id::bindings::cores()
    }

    /// Monotonic nanoseconds since an origin of this process: the clock of `Block.host_ns`.
    #[pyfunction]
    fn host_ns() -> u64 {
        granular_id::buffer::host_ns()
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("MAX_MODEL_FILE_BYTES", granular_id::model::MAX_FILE_BYTES)?;
        module.add("MAX_MULTIBAND_VALUES", granular_id::model::MAX_MULTIBAND_VALUES)?;
        module.add("MAX_NAME_BYTES", granular_id::model::MAX_NAME_BYTES)?;
        module.add("RDT_PORT", granular_id::rdt::PORT)?;
        let limits = (granular_id::rdt::COUNTS_PER_NEWTON, granular_id::rdt::COUNTS_PER_NEWTON_METRE);
        module.add("RDT_SCALE_LIMITS", limits)?;
        module.add("SIMD", granular_id::SimdPath::detect().or_raise()?.name())?;
        // Found out here: a process that is forked while another thread is finding out would wait for it for ever.
        granular_id::bindings::cores();
        let _ = granular_id::buffer::host_ns();
        module.add("AXES", PyTuple::new(module.py(), granular_id::wrench::AXES)?)?;
        module.add("SAMPLE_FLAGS", granular_id::wrench::SAMPLE_FLAGS.into_py_dict(module.py())?)?;
        module.add("UNITS", PyTuple::new(module.py(), granular_id::wrench::UNITS)?)
    }
}
