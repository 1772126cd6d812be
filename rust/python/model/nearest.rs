//! Distances to the nearest class: unpack, call, map the error.

use numpy::{PyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::super::arrays::{contiguous_real, readable, tuple, Hold};
use crate::convert::{OrRaise, Raise};
use granular_id::model::NearestMean;
use granular_id::Error;

/// Distances of recordings to the nearest of some means, one per class, after whitening.
///
/// Parameters
/// ----------
/// means : array-like, shape (K, S)
///     Mean values of each class.
/// whitener : array-like, shape (S, S)
///     Matrix whose product with values has the unit matrix as covariance within a class.
/// of_pairs : bool, default False
///     Whether recordings come as scores of one learner for each pair of S classes. The values are then minus the mean
///     losses of the classes under the hinge.
///
/// Raises
/// ------
/// TypeError, ValueError
///     Shapes that do not fit, numbers that are not finite.
///
/// Notes
/// -----
/// Source: Lee, Lee, Lee, Shin, "A simple unified framework for detecting out-of-distribution samples and adversarial
/// attacks" (NeurIPS 2018).
///
/// Examples
/// --------
/// >>> from granular_id._core import NearestMean
/// >>> nearest = NearestMean([[0.0, 0.0], [3.0, 4.0]], [[1.0, 0.0], [0.0, 2.0]])
/// >>> nearest.distances([[3.0, 3.0], [1.0, 0.0]])
/// array([2., 1.])
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "NearestMean", module = "granular_id._core")]
pub(crate) struct PyNearestMean {
    nearest: NearestMean,
}

#[pymethods]
impl PyNearestMean {
    #[new]
    #[pyo3(signature = (means, whitener, *, of_pairs=false))]
    fn new(means: &Bound<'_, PyAny>, whitener: &Bound<'_, PyAny>, of_pairs: bool) -> PyResult<Self> {
        let (means, whitener) = (contiguous_real(means, "means")?, contiguous_real(whitener, "whitener")?);
        let (shape, square) = (tuple(means.shape()), tuple(whitener.shape()));
        if !matches!((means.shape(), whitener.shape()), ([k, s], [rows, columns]) if *k > 0 && *s > 0 && [s, s] == [rows, columns])
        {
            let message = format!(
                "means (K, S) and whitener (S, S) must fit, K and S at least 1, got shapes {shape} and {square}"
            );
            return Err(PyValueError::new_err(message));
        }
        let (means, whitener) = (readable(&means, "means")?, readable(&whitener, "whitener")?);
        let (means, whitener) = (means.as_slice()?, whitener.as_slice()?);
        for (name, values) in [("means", means), ("whitener", whitener)] {
            if !values.iter().all(|value| value.is_finite()) {
                return Err(PyValueError::new_err(format!("{name} must be finite, got NaN or infinity")));
            }
        }
        let make = if of_pairs { NearestMean::of_pairs } else { NearestMean::new };
        Ok(Self { nearest: make(means, whitener).or_raise()? })
    }

    /// Distances (n,) of rows of S values, or of S (S - 1) / 2 scores of pairs, or (1,) of one row; `name` is what messages
    /// call them.
    #[pyo3(signature = (scores, name="scores"))]
    fn distances<'py>(&self, scores: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let py = scores.py();
        let scores = contiguous_real(scores, name)?;
        let width = self.nearest.width();
        if !matches!(*scores.shape(), [n] | [_, n] if n == width) {
            let got = tuple(scores.shape());
            let message = format!("{name} must have shape ({width},) or (n, {width}), got {got}");
            return Err(PyValueError::new_err(message));
        }
        let hold = Hold::for_values(scores.len().saturating_mul(width), &[scores.as_any()])?;
        let scores = readable(&scores, name)?;
        let not_finite = |error| match error {
            Error::Score { .. } => {
                PyValueError::new_err(format!("{name} must be finite, got NaN or infinity"))
            }
            error => error.raise(),
        };
        let scores = scores.as_slice()?;
        let distances = hold.work(py, || self.nearest.distances(scores)).map_err(not_finite)?;
        Ok(PyArray1::from_vec(py, distances))
    }
}
