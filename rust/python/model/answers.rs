//! Arrays through a model: recordings to scores, scores to losses.

use numpy::{PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyString, PyTuple};

use super::super::arrays::{contiguous_real, readable, tuple, writable, zeros, Hold};
use super::super::pool::threads_for;
use crate::convert::OrRaise;
use granular_id::bindings::room;
use granular_id::Model;

/// Scores (n, L) of recordings (n, `n_samples`, `n_axes`), or (1, L) of one.
pub(super) fn scores<'py>(
    model: &Model,
    wrench: &Bound<'py, PyAny>,
    threads: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let py = wrench.py();
    let threads = threads_for(threads)?;
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
    let out = zeros(py, &[n_recordings, model.n_learners()])?;
    {
        let hold = Hold::new(&[wrench.as_any()])?;
        let values = readable(&wrench, "wrench")?;
        let values = values.as_slice()?;
        let mut target = writable(&out, "wrench", &[values])?;
        let target = target.as_slice_mut()?;
        let threads = threads(n_recordings == 1);
        hold.work(py, || model.scores_into(values, n_recordings, threads, target)).or_raise()?;
    }
    Ok(out.cast_into()?)
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
    let (n_rows, n_classes) = (scores.len() / n_learners, model.classes().len());
    let out = zeros(py, &[n_rows, n_classes])?;
    {
        let hold = Hold::for_values(scores.len().saturating_mul(n_classes), &[scores.as_any()])?;
        let scores = readable(&scores, "scores")?;
        let scores = scores.as_slice()?;
        let mut losses = writable(&out, "scores", &[scores])?;
        let losses = losses.as_slice_mut()?;
        hold.work(py, || {
            let mut rows =
                scores.chunks_exact(n_learners).zip(losses.chunks_exact_mut(n_classes)).enumerate();
            rows.try_for_each(|(row, (scores, losses))| {
                model.decode(scores, losses).map_err(|error| error.later(row))
            })
        })
        .or_raise()?;
    }
    Ok(out.cast_into()?)
}

/// What the rules say of scores (n, L) or (L,): for each the labels of the candidates, and whether it is like no class.
pub(super) fn verdicts<'py>(model: &Model, scores: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
    let py = scores.py();
    let scores = contiguous_real(scores, "scores")?;
    let losses = losses(model, &scores)?;
    let verdicts = {
        let hold = Hold::for_values(scores.len(), &[scores.as_any()])?;
        let (losses, scores) = (losses.readonly(), readable(&scores, "scores")?);
        let (losses, scores) = (losses.as_slice()?, scores.as_slice()?);
        hold.work(py, || model.verdicts(losses, scores)).or_raise()?
    };
    // The list, a pair for each row, and its candidates: objects of Python with a header of some 50 bytes.
    let per_row = size_of::<usize>() + 2 * (56 + 2 * size_of::<usize>());
    room(verdicts.n_rows().saturating_mul(per_row) + size_of::<usize>() * verdicts.n_candidates())
        .or_raise()?;
    let labels: Vec<_> = model.classes().iter().map(|label| PyString::new(py, label)).collect();
    let told = PyList::empty(py);
    for (candidates, unknown) in verdicts.rows() {
        told.append((PyTuple::new(py, candidates.iter().map(|class| &labels[*class]))?, unknown))?;
    }
    Ok(told)
}
