//! Distances to the nearest class.

use numpy::{PyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arguments::{OrRaise, Raise};
use crate::arrays::{contiguous_real, readable, tuple, work_on, wrong_shape};
use granular_id::model::NearestMean;
use granular_id::Error;

/// Distances of recordings to the nearest of some means, one per class, after whitening.
///
/// `means` (K, S) are those of each class; the product of values with `whitener` (S, S) has the unit matrix as covariance
/// within a class. With `of_pairs`, recordings come as scores of one learner for each pair of S classes: the values are
/// then minus the mean losses of the classes under the hinge.
///
/// Source: Lee, Lee, Lee, Shin, "A simple unified framework for detecting out-of-distribution samples and adversarial
/// attacks" (NeurIPS 2018).
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "NearestMean", module = "granular_id._core")]
pub(super) struct PyNearestMean {
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
            return Err(wrong_shape(name, format_args!("({width},) or (n, {width})"), scores.shape()));
        }
        let not_finite = |error| match error {
            Error::Score { .. } => {
                PyValueError::new_err(format!("{name} must be finite, got NaN or infinity"))
            }
            error => error.raise(),
        };
        let n_values = scores.len().saturating_mul(width);
        let distances = work_on(&scores, name, n_values, |scores| self.nearest.distances(scores))?;
        Ok(PyArray1::from_vec(py, distances.map_err(not_finite)?))
    }
}
