//! Rules for whole recordings: unpack, call, map the error.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::super::arrays::{contiguous_real, readable, tuple};
use super::nearest::PyNearestMean;
use crate::memory::collected;
use crate::model::{Rules, Strangeness};

/// What is said of a whole recording beside its label: which classes it may be, and whether it is like none.
///
/// Parameters
/// ----------
/// limits : array-like, shape (K,), optional
///     For each class by how much its loss may exceed the least of the others to be a candidate; may be infinite. None:
///     no candidates.
/// nearest : NearestMean, optional
///     Distance of the scores of the learners to the nearest class. None: nothing is unknown.
/// of_losses : bool, default False
///     Whether the distance is that of the losses of the classes, negated, instead.
/// threshold : float, default inf
///     Recordings farther away are unknown.
///
/// Raises
/// ------
/// TypeError, ValueError
///     Arguments of other types or shapes. Whether they fit a model is looked at by `StreamingIdentifier`.
///
/// Notes
/// -----
/// `StreamingIdentifier` applies them. `granular_id.confidence` makes them, of `ConformalRule` and `UnknownRule`.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "Rules", module = "granular_id._core")]
pub(in crate::python) struct PyRules {
    pub(in crate::python) rules: Rules,
}

#[pymethods]
impl PyRules {
    #[new]
    #[pyo3(
        signature = (limits=None, nearest=None, *, of_losses=false, threshold=f64::INFINITY),
        text_signature = "(limits=None, nearest=None, *, of_losses=False, threshold=inf)"
    )]
    fn new(
        limits: Option<&Bound<'_, PyAny>>,
        nearest: Option<PyRef<'_, PyNearestMean>>,
        of_losses: bool,
        threshold: f64,
    ) -> PyResult<Self> {
        let limits = limits.map(|limits| {
            let limits = contiguous_real(limits, "limits")?;
            if limits.shape().len() != 1 {
                let message = format!("limits must have shape (K,), got {}", tuple(limits.shape()));
                return Err(PyValueError::new_err(message));
            }
            let limits = readable(&limits, "limits")?;
            Ok::<_, PyErr>(collected(limits.as_slice()?.iter().copied())?)
        });
        let strangeness =
            nearest.map(|nearest| Strangeness { nearest: nearest.nearest.clone(), of_losses, threshold });
        Ok(Self { rules: Rules { limits: limits.transpose()?, strangeness } })
    }
}
