//! Arrays through a model: recordings to scores, scores to losses.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::super::arrays::{contiguous_real, readable, tuple};
use super::super::scalars::count;
use crate::Model;

/// Scores (n, L) of recordings (n, `n_samples`, `n_axes`), or (1, L) of one.
pub(super) fn scores<'py>(
    model: &Model,
    wrench: &Bound<'py, PyAny>,
    threads: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let py = wrench.py();
    let wrench = contiguous_real(wrench, "wrench")?;
    let wanted = [model.n_samples(), model.n_axes()];
    let n_recordings = match *wrench.shape() {
        [n_samples, n_axes] if [n_samples, n_axes] == wanted => 1,
        [n, n_samples, n_axes] if [n_samples, n_axes] == wanted => n,
        _ => {
            let (inner, got) = (tuple(&wanted), tuple(wrench.shape()));
            return Err(PyValueError::new_err(format!(
                    "wrench must have shape {inner}, or one more dimension in front of it, as the model was trained on, got {got}"
                )));
        }
    };
    let threads = match threads {
        Some(threads) => count(threads, "threads", usize::MAX)?,
        None if n_recordings == 1 => 1,
        None => crate::pool::cores(),
    };
    let values = readable(&wrench, "wrench")?;
    let values = values.as_slice()?;
    let scores = py.detach(|| model.scores(values, n_recordings, threads))?;
    PyArray1::from_vec(py, scores).reshape([n_recordings, model.n_learners()])
}

/// Mean losses (n, K) of scores (n, L) or (L,).
pub(super) fn losses<'py>(model: &Model, scores: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let py = scores.py();
    let scores = contiguous_real(scores, "scores")?;
    let n_learners = model.n_learners();
    if !matches!(*scores.shape(), [l] | [_, l] if l == n_learners) {
        let got = tuple(scores.shape());
        return Err(PyValueError::new_err(format!(
            "scores must have shape (n, {n_learners}) or ({n_learners},), one per learner, got {got}"
        )));
    }
    let scores = readable(&scores, "scores")?;
    let scores = scores.as_slice()?;
    let n_classes = model.classes().len();
    let mut losses = vec![0.0; scores.len() / n_learners * n_classes];
    let rows = scores.chunks_exact(n_learners).zip(losses.chunks_exact_mut(n_classes));
    for (row, (scores, losses)) in rows.enumerate() {
        model.decode(scores, losses).map_err(|error| error.later(row))?;
    }
    PyArray1::from_vec(py, losses).reshape([scores.len() / n_learners, n_classes])
}
