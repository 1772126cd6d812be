//! Features and answers while samples arrive. Every call stays attached to Python, where there is a GIL with it: it ends at the
//! border of a window, so it is short, and a process that was forked finds no stream half-way. Calls of several threads take
//! their turn by a lock, under which nothing of Python's runs.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::arguments::{contiguous_real, named, optional, output, readable, writable, wrong_shape, OrRaise};
use crate::features::PyFeatureSpec;
use crate::model::PyModel;
use granular_id::bindings::{collected, ranking};
use granular_id::stream::{StreamingExtractor, StreamingIdentifier, Windows};

/// Features of a recording while its samples arrive, equal to those of the whole recording bit for bit.
///
/// Parameters
/// ----------
/// spec : FeatureSpec
///     What to extract.
/// n_samples, n_axes : int, default 1600 and 6
///     Size of a window; the defaults are a recording of the paper, 3.2 s of six axes at 500 Hz.
/// hop : int, optional
///     None: one window, from the first row on, as after a trigger. Else a window every `hop` samples, over a filter
///     that never stops: window k holds samples ``k * hop`` to ``k * hop + n_samples`` of the stream and the
///     histograms of the filtered stream there, as ``scipy.signal.sosfilt`` of the whole stream gives it.
///
/// Attributes
/// ----------
/// spec, n_samples, n_axes, hop
///     As given.
/// n_features : int
///     Length of the feature vector.
/// n_seen : int
///     Rows of the window so far.
/// is_complete : bool
///     Whether all rows of the window are there.
/// first_row : int
///     Rows of the stream before the window.
///
/// Raises
/// ------
/// TypeError, ValueError
///     From the constructor: a size that is not a positive integer, a window of more than 2^24 values, `bin_range` of
///     another number of axes.
///
/// Notes
/// -----
/// All memory is allocated by the constructor. One object may be used from several threads: calls take their turn.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> import granular_id as gid
/// >>> recording = np.random.default_rng(0).normal(size=(1600, 6))
/// >>> stream = gid.StreamingExtractor(gid.FeatureSpec())
/// >>> for block in np.array_split(recording, 160):
/// ...     taken = stream.push(block)
/// >>> stream.is_complete, np.array_equal(stream.features(), gid.extract_features(recording))
/// (True, True)
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "StreamingExtractor", module = "granular_id._core")]
pub(super) struct PyStreamingExtractor {
    #[pyo3(get)]
    spec: Py<PyFeatureSpec>,
    stream: Mutex<StreamingExtractor>,
}

#[pymethods]
impl PyStreamingExtractor {
    #[new]
    #[pyo3(signature = (spec, *, n_samples=1600, n_axes=6, hop=None))]
    fn new(
        spec: &Bound<'_, PyFeatureSpec>,
        #[pyo3(from_py_with = named::n_samples)] n_samples: usize,
        #[pyo3(from_py_with = named::n_axes)] n_axes: usize,
        #[pyo3(from_py_with = optional::hop)] hop: Option<usize>,
    ) -> PyResult<Self> {
        let windows = Windows::new(n_samples, n_axes).with_hop(hop);
        let stream = StreamingExtractor::new(&spec.get().extractor, windows).or_raise()?;
        Ok(Self { spec: spec.clone().unbind(), stream: Mutex::new(stream) })
    }

    /// Take rows `(k, n_axes)`, or one row `(n_axes,)`, in N and N m, until the window is complete; returns how many.
    ///
    /// Rows beyond the end of the window are not taken: pass them again after `next` or `reset`. NaN, infinity and
    /// values too large to filter raise a `ValueError`; no row was taken then.
    fn push(&self, wrench: &Bound<'_, PyAny>) -> PyResult<usize> {
        let array = contiguous_real(wrench, "wrench")?;
        let rows = rows(&array, self.n_axes())?;
        self.stream().push(rows.as_slice()?).or_raise()
    }

    /// Features `(n_features,)` of the window so far; raw samples that have not arrived are 0.
    ///
    /// `out`, if given, is written and returned: float64, C-contiguous.
    #[pyo3(signature = (out = None))]
    fn features<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let n_features = self.n_features();
        let out = output(py, out, &[n_features])?;
        let mut target = writable(&out, &[n_features], "", &[])?;
        self.stream().features_into(target.as_slice_mut()?).or_raise()?;
        Ok(out)
    }

    /// Go on to the next window: rows that it shares with this one stay. Needs `hop` and a complete window.
    fn next(&self) -> PyResult<()> {
        self.stream().next_window().or_raise()
    }

    /// Back to the state before the first row.
    fn reset(&self) {
        self.stream().reset();
    }

    #[getter]
    fn n_samples(&self) -> usize {
        self.stream().windows().n_samples
    }

    #[getter]
    fn n_axes(&self) -> usize {
        self.stream().windows().n_axes
    }

    #[getter]
    fn hop(&self) -> Option<usize> {
        self.stream().windows().hop
    }

    #[getter]
    fn n_features(&self) -> usize {
        self.stream().n_features()
    }

    #[getter]
    fn n_seen(&self) -> usize {
        self.stream().n_seen()
    }

    #[getter]
    fn is_complete(&self) -> bool {
        self.stream().is_complete()
    }

    #[getter]
    fn first_row(&self) -> u64 {
        self.stream().first_row()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Windows { n_samples, n_axes, hop, .. } = self.stream().windows();
        let (spec, hop) = (self.spec.bind(py).repr()?, or_none(hop));
        Ok(format!("StreamingExtractor({spec}, n_samples={n_samples}, n_axes={n_axes}, hop={hop})"))
    }
}

/// The answer of a model while samples arrive; `granular_id.StreamingIdentifier` makes decisions of it.
///
/// Scores of a complete window are those of `Model.scores`, bit for bit. Before, samples that have not arrived count as
/// `Model.raw_mean`, 0 where the model has none, and counts are scaled by ``n_samples / n_seen``; multi-band features are
/// those of the rows so far, taken as the beginning of a recording. Windows and threads: as `StreamingExtractor`.
#[pyclass(frozen, name = "StreamingIdentifier", module = "granular_id._core")]
pub(super) struct PyStreamingIdentifier {
    #[pyo3(get)]
    model: Py<PyModel>,
    #[pyo3(get)]
    hop: Option<usize>,
    stream: Mutex<StreamingIdentifier>,
}

#[pymethods]
impl PyStreamingIdentifier {
    #[new]
    #[pyo3(signature = (model, *, hop=None))]
    fn new(
        model: &Bound<'_, PyModel>,
        #[pyo3(from_py_with = optional::hop)] hop: Option<usize>,
    ) -> PyResult<Self> {
        let shared = &model.get().model;
        let stream = model.py().detach(|| StreamingIdentifier::new(shared.clone(), hop)).or_raise()?;
        Ok(Self { model: model.clone().unbind(), hop, stream: Mutex::new(stream) })
    }

    /// Take rows `(k, n_axes)`, or one row `(n_axes,)`, in N and N m, until the window is complete; returns how many.
    ///
    /// As `StreamingExtractor.push`.
    fn push(&self, wrench: &Bound<'_, PyAny>) -> PyResult<usize> {
        let array = contiguous_real(wrench, "wrench")?;
        let rows = rows(&array, self.model.get().model.n_axes())?;
        self.stream().push(rows.as_slice()?).or_raise()
    }

    /// Scores `(L,)` of the learners.
    fn scores<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let scores = collected(self.stream().scores().or_raise()?.iter().copied()).or_raise()?;
        Ok(PyArray1::from_vec(py, scores))
    }

    /// Mean losses `(K,)` of the classes: the smallest wins, the first of equal ones.
    fn losses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let losses = collected(self.stream().losses().or_raise()?.iter().copied()).or_raise()?;
        Ok(PyArray1::from_vec(py, losses))
    }

    /// Everything about the answer at one moment.
    ///
    /// A tuple of: the ranking, pairs of label and mean loss, best first; the margin; whether the window is complete;
    /// whether the margin meets the rule for early answers; rows of the window; rows before it; labels of the candidates,
    /// the likeliest first, and whether the window is like none: of a complete window, by the rules of the model.
    fn standing<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let model = &self.model.get().model;
        let (losses, candidates, first_row, rest) = {
            let mut stream = self.stream();
            let first_row = stream.first_row();
            let at = stream.standing().or_raise()?;
            let rest = (at.margin, at.is_final, at.is_sure, at.n_seen, at.unknown);
            (at.losses.to_vec(), at.candidates.to_vec(), first_row, rest)
        };
        let pairs = ranking(&losses).into_iter().map(|class| (&model.classes()[class], losses[class]));
        let pairs = PyTuple::new(py, pairs.collect::<Vec<_>>())?;
        let (margin, is_final, is_sure, n_seen, unknown) = rest;
        let candidates = PyTuple::new(py, candidates.iter().map(|class| &model.classes()[*class]))?;
        (pairs, margin, is_final, is_sure, n_seen, first_row, candidates, unknown).into_pyobject(py)
    }

    /// Go on to the next window: rows that it shares with this one stay. Needs `hop` and a complete window.
    fn next(&self) -> PyResult<()> {
        self.stream().next_window().or_raise()
    }

    /// Back to the state before the first row.
    fn reset(&self) {
        self.stream().reset();
    }

    #[getter]
    fn n_seen(&self) -> usize {
        self.stream().n_seen()
    }

    #[getter]
    fn is_complete(&self) -> bool {
        self.stream().is_complete()
    }

    #[getter]
    fn first_row(&self) -> u64 {
        self.stream().first_row()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("StreamingIdentifier({}, hop={})", self.model.bind(py).repr()?, or_none(self.hop)))
    }
}

fn or_none(hop: Option<usize>) -> String {
    hop.map_or("None".to_owned(), |hop| hop.to_string())
}

/// Rows of `n_axes` values, or one, in an array of [`contiguous_real`].
fn rows<'py>(array: &Bound<'py, PyArrayDyn<f64>>, n_axes: usize) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    if matches!(array.shape(), [columns] | [_, columns] if *columns == n_axes) {
        return readable(array, "wrench");
    }
    Err(wrong_shape("wrench", format_args!("(k, {n_axes}) or ({n_axes},)"), array.shape()))
}

impl PyStreamingExtractor {
    fn stream(&self) -> MutexGuard<'_, StreamingExtractor> {
        self.stream.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PyStreamingIdentifier {
    fn stream(&self) -> MutexGuard<'_, StreamingIdentifier> {
        self.stream.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
