//! Arrays through a model: recordings to scores, scores to losses.

use numpy::{PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};

use super::super::arrays::{briefly_readable, contiguous_real, readable, tuple, writable, zeros};
use super::super::pool::{threads_for, work_on};
use crate::memory::collected;
use crate::Model;

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
        let values = readable(&wrench, "wrench")?;
        let values = values.as_slice()?;
        let mut target = writable(&out, "wrench", &[values])?;
        let target = target.as_slice_mut()?;
        let threads = threads(n_recordings == 1);
        py.detach(|| model.scores_into(values, n_recordings, threads, target))?;
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
        let scores = readable(&scores, "scores")?;
        let scores = scores.as_slice()?;
        let mut losses = writable(&out, "scores", &[scores])?;
        let losses = losses.as_slice_mut()?;
        work_on(py, scores.len().saturating_mul(n_classes), || {
            let mut rows =
                scores.chunks_exact(n_learners).zip(losses.chunks_exact_mut(n_classes)).enumerate();
            rows.try_for_each(|(row, (scores, losses))| {
                model.decode(scores, losses).map_err(|error| error.later(row))
            })
        })?;
    }
    Ok(out.cast_into()?)
}

/// What the rules say of scores (n, L) or (L,): for each the labels of the candidates, and whether it is like no class.
pub(super) fn verdicts<'py>(model: &Model, scores: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
    let py = scores.py();
    let scores = contiguous_real(scores, "scores")?;
    let losses = losses(model, &scores)?;
    let mut verdict = model.rules().verdict();
    let verdicts = {
        let (losses, scores) = (losses.readonly(), briefly_readable(&scores, "scores")?);
        let rows = losses.as_slice()?.chunks_exact(model.classes().len());
        let rows = rows.zip(scores.as_slice()?.chunks_exact(model.n_learners()));
        collected(rows.map(|(losses, scores)| {
            model.judge(losses, scores, &mut verdict);
            (verdict.candidates().to_vec(), verdict.unknown())
        }))?
    };
    let told = verdicts.into_iter().map(|(candidates, unknown)| {
        Ok((PyTuple::new(py, candidates.iter().map(|class| &model.classes()[*class]))?, unknown))
    });
    PyList::new(py, told.collect::<PyResult<Vec<_>>>()?)
}
