//! Streaming identification: unpack, call, map the error.

use std::sync::MutexGuard;

use numpy::{PyArray1, PyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::{PyString, PyTuple};

use super::super::model::PyModel;
use super::super::scalars::count;
use super::turns::Turns;
use super::{push_rows, written};
use crate::convert::OrRaise;
use granular_id::bindings::ranking;
use granular_id::stream::StreamingIdentifier;

/// The answer of a model while samples arrive; `granular_id.identifier.StreamingIdentifier` makes decisions of it.
///
/// Parameters
/// ----------
/// model : Model
///     What to identify with.
/// hop : int, optional
///     None: one window, from the first row on. Else a window every `hop` samples; see `StreamingExtractor`.
///
/// Attributes
/// ----------
/// model, hop
///     As given.
/// n_seen, is_complete, first_row
///     As of `StreamingExtractor`.
/// is_settled : bool
///     Whether the answer can no longer change.
///
/// Raises
/// ------
/// TypeError, ValueError
///     From the constructor: a hop that is not a positive integer, windows of more than 2^24 values.
///
/// Notes
/// -----
/// Scores of a complete window are those of `Model.scores`, bit for bit. Before, samples that have not arrived count as
/// `Model.raw_mean`, 0 where the model has none, and counts are scaled by ``n_samples / n_seen``; multi-band features are
/// those of the rows so far, taken as the beginning of a recording.
///
/// All memory is allocated by the constructor. One object may be used from several threads, and in a forked process, as
/// `StreamingExtractor`.
///
/// Examples
/// --------
/// >>> import granular_id as gid
/// >>> from granular_id._core import Model, StreamingIdentifier
/// >>> spec = gid.FeatureSpec(hfmh=False)
/// >>> model = Model(spec, [[0.0, 2.0, 0.0]], [-1.0], [[1], [-1]], ["rice", "salt"], n_samples=3, n_axes=1)
/// >>> stream = StreamingIdentifier(model)
/// >>> stream.push([[0.1], [0.9]])
/// 2
/// >>> stream.scores(), stream.is_complete
/// (array([0.8]), False)
#[allow(clippy::doc_markdown, clippy::doc_link_with_quotes)] // numpydoc, read by Python
#[pyclass(frozen, name = "StreamingIdentifier", module = "granular_id._core")]
pub(crate) struct PyStreamingIdentifier {
    model: Py<PyModel>,
    hop: Option<usize>,
    n_axes: usize,
    labels: Vec<Py<PyString>>,
    stream: Turns<StreamingIdentifier>,
}

#[pymethods]
impl PyStreamingIdentifier {
    #[new]
    #[pyo3(signature = (model, *, hop = None))]
    fn new(model: &Bound<'_, PyModel>, hop: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let hop = hop.map(|hop| count(hop, "hop", usize::MAX)).transpose()?;
        let py = model.py();
        let shared = &model.get().model;
        let stream = py.detach(|| StreamingIdentifier::new(shared.clone(), hop)).or_raise()?;
        let labels = shared.classes().iter().map(|label| PyString::new(py, label).unbind()).collect();
        let n_axes = shared.n_axes();
        Ok(Self { model: model.clone().unbind(), hop, n_axes, labels, stream: Turns::new(stream) })
    }

    /// Take rows `(k, n_axes)`, or one row `(n_axes,)`, in N and N m, until the window is complete; returns how many.
    ///
    /// As `StreamingExtractor.push`.
    fn push(&self, wrench: &Bound<'_, PyAny>) -> PyResult<usize> {
        push_rows(wrench, self.n_axes, &self.stream, StreamingIdentifier::push)
    }

    /// Scores `(L,)` of the learners; written to `out` and returned, where it is given.
    #[pyo3(signature = (out = None))]
    fn scores<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let n_learners = self.model.get().model.n_learners();
        written(py, out, n_learners, &self.stream, |stream, out| {
            out.copy_from_slice(stream.scores()?);
            Ok(())
        })
    }

    /// Mean losses `(K,)` of the classes: the smallest wins, the first of equal ones. Written to `out`, where it is given.
    #[pyo3(signature = (out = None))]
    fn losses<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let n_classes = self.labels.len();
        written(py, out, n_classes, &self.stream, |stream, out| {
            out.copy_from_slice(stream.losses()?);
            Ok(())
        })
    }

    /// Everything about the answer at one moment.
    ///
    /// A tuple of: the ranking, pairs of label and mean loss, best first; the margin; whether the window is complete;
    /// whether the answer is settled; whether the margin meets the rule for early answers; rows of the window; rows
    /// before it; scores `(L,)`; labels of the candidates, the likeliest first, and whether the window is like none: of a
    /// complete window, by the rules of the model.
    fn standing<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        // Copies first: nothing of Python's is made while the stream is locked.
        let (scores, losses, candidates, first_row, rest) = {
            let mut stream = self.locked(py)?;
            let first_row = stream.first_row();
            let at = stream.standing().or_raise()?;
            let rest = (at.margin, at.is_final, at.is_settled, at.is_sure, at.n_seen, at.unknown);
            (at.scores.to_vec(), at.losses.to_vec(), at.candidates.to_vec(), first_row, rest)
        };
        let pairs = ranking(&losses).into_iter().map(|class| (&self.labels[class], losses[class]));
        let pairs = PyTuple::new(py, pairs.collect::<Vec<_>>())?;
        let (margin, is_final, is_settled, is_sure, n_seen, unknown) = rest;
        let candidates = PyTuple::new(py, candidates.into_iter().map(|class| &self.labels[class]))?;
        let scores = PyArray1::from_vec(py, scores);
        (pairs, margin, is_final, is_settled, is_sure, n_seen, first_row, scores, candidates, unknown)
            .into_pyobject(py)
    }

    /// Go on to the next window: rows that it shares with this one stay. Needs `hop` and a complete window.
    fn next(&self, py: Python<'_>) -> PyResult<()> {
        self.locked(py)?.advance().or_raise()
    }

    /// Back to the state before the first row.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.locked(py)?.reset();
        Ok(())
    }

    #[getter]
    fn model(&self, py: Python<'_>) -> Py<PyModel> {
        self.model.clone_ref(py)
    }

    #[getter]
    fn hop(&self) -> Option<usize> {
        self.hop
    }

    #[getter]
    fn n_seen(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.locked(py)?.n_seen())
    }

    #[getter]
    fn is_complete(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.locked(py)?.is_complete())
    }

    #[getter]
    fn first_row(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.locked(py)?.first_row())
    }

    #[getter]
    fn is_settled(&self, py: Python<'_>) -> PyResult<bool> {
        self.locked(py)?.is_settled().or_raise()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let hop = self.hop.map_or("None".to_owned(), |hop| hop.to_string());
        Ok(format!("StreamingIdentifier({}, hop={hop})", self.model.bind(py).repr()?))
    }
}

impl PyStreamingIdentifier {
    fn locked<'py>(&'py self, py: Python<'py>) -> PyResult<MutexGuard<'py, StreamingIdentifier>> {
        self.stream.locked(py)
    }
}
