//! Features and answers while samples arrive, for several threads, which take turns; and for a process that was forked
//! meanwhile.

use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyString, PyTuple};

use crate::arguments::{count, shown, GranularIdError, OrRaise};
use crate::arrays::{contiguous_real, readable, tuple, writable, wrong_shape, zeros, Hold};
use crate::features::PyFeatureSpec;
use crate::model::PyModel;
use granular_id::bindings::ranking;
use granular_id::stream::{StreamingExtractor, StreamingIdentifier, Windows, MAX_WINDOW};

/// Rows from which on other threads may run meanwhile: some 20 microseconds of work, more than the way back costs.
const MANY_ROWS: usize = 128;

/// Between two looks whether a stream is free.
const PAUSE: Duration = Duration::from_micros(100);

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
/// All memory is allocated by the constructor. One object may be used from several threads: calls take their turn, and
/// no other thread is held up by a large block. In a process that is forked while another thread pushes such a block, the
/// stream is not whole: its methods raise a `RuntimeError`.
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
    spec: Py<PyFeatureSpec>,
    #[pyo3(get)]
    n_samples: usize,
    #[pyo3(get)]
    n_axes: usize,
    #[pyo3(get)]
    hop: Option<usize>,
    stream: Turns<StreamingExtractor>,
}

#[pymethods]
impl PyStreamingExtractor {
    #[new]
    #[pyo3(signature = (spec, *, n_samples = None, n_axes = None, hop = None), text_signature = "(spec, *, n_samples=1600, n_axes=6, hop=None)")]
    fn new(
        spec: &Bound<'_, PyFeatureSpec>,
        n_samples: Option<&Bound<'_, PyAny>>,
        n_axes: Option<&Bound<'_, PyAny>>,
        hop: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let default = Windows::default();
        let size = |value, name| count(value, name, MAX_WINDOW);
        let n_samples = n_samples.map_or(Ok(default.n_samples), |value| size(value, "n_samples"))?;
        let n_axes = n_axes.map_or(Ok(default.n_axes), |value| size(value, "n_axes"))?;
        let hop = hop.map(|value| count(value, "hop", usize::MAX)).transpose()?;
        let windows = Windows::new(n_samples, n_axes).with_hop(hop);
        let stream = Turns::new(StreamingExtractor::new(&spec.get().extractor, windows).or_raise()?);
        Ok(Self { spec: spec.clone().unbind(), n_samples, n_axes, hop, stream })
    }

    /// Take rows `(k, n_axes)`, or one row `(n_axes,)`, in N and N m, until the window is complete; returns how many.
    ///
    /// Rows beyond the end of the window are not taken: pass them again after `next` or `reset`. NaN, infinity and
    /// values too large to filter raise a `ValueError`; no row was taken then.
    fn push(&self, wrench: &Bound<'_, PyAny>) -> PyResult<usize> {
        push_rows(wrench, self.n_axes, &self.stream, StreamingExtractor::push)
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
        let n_features = self.n_features(py)?;
        written(py, out, n_features, &self.stream, |stream, target| stream.features_into(target))
    }

    /// Go on to the next window: rows that it shares with this one stay. Needs `hop` and a complete window.
    fn next(&self, py: Python<'_>) -> PyResult<()> {
        self.stream.locked(py)?.advance().or_raise()
    }

    /// Back to the state before the first row.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.stream.locked(py)?.reset();
        Ok(())
    }

    #[getter]
    fn spec(&self, py: Python<'_>) -> Py<PyFeatureSpec> {
        self.spec.clone_ref(py)
    }

    #[getter]
    fn n_features(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.stream.locked(py)?.n_features())
    }

    #[getter]
    fn n_seen(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.stream.locked(py)?.n_seen())
    }

    #[getter]
    fn is_complete(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.stream.locked(py)?.is_complete())
    }

    #[getter]
    fn first_row(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.stream.locked(py)?.first_row())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Self { n_samples, n_axes, .. } = self;
        let (spec, hop) = (self.spec.bind(py).repr()?, or_none(self.hop));
        Ok(format!("StreamingExtractor({spec}, n_samples={n_samples}, n_axes={n_axes}, hop={hop})"))
    }
}

/// The answer of a model while samples arrive; `granular_id.StreamingIdentifier` makes decisions of it.
///
/// Scores of a complete window are those of `Model.scores`, bit for bit. Before, samples that have not arrived count as
/// `Model.raw_mean`, 0 where the model has none, and counts are scaled by ``n_samples / n_seen``; multi-band features are
/// those of the rows so far, taken as the beginning of a recording. Windows, threads and forks: as `StreamingExtractor`.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "StreamingIdentifier", module = "granular_id._core")]
pub(super) struct PyStreamingIdentifier {
    #[pyo3(get)]
    model: Py<PyModel>,
    #[pyo3(get)]
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
    /// whether the margin meets the rule for early answers; rows of the window; rows before it; labels of the candidates,
    /// the likeliest first, and whether the window is like none: of a complete window, by the rules of the model.
    fn standing<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        // Copies first: nothing of Python's is made while the stream is locked.
        let (losses, candidates, first_row, rest) = {
            let mut stream = self.stream.locked(py)?;
            let first_row = stream.first_row();
            let at = stream.standing().or_raise()?;
            let rest = (at.margin, at.is_final, at.is_sure, at.n_seen, at.unknown);
            (at.losses.to_vec(), at.candidates.to_vec(), first_row, rest)
        };
        let pairs = ranking(&losses).into_iter().map(|class| (&self.labels[class], losses[class]));
        let pairs = PyTuple::new(py, pairs.collect::<Vec<_>>())?;
        let (margin, is_final, is_sure, n_seen, unknown) = rest;
        let candidates = PyTuple::new(py, candidates.into_iter().map(|class| &self.labels[class]))?;
        (pairs, margin, is_final, is_sure, n_seen, first_row, candidates, unknown).into_pyobject(py)
    }

    /// Go on to the next window: rows that it shares with this one stay. Needs `hop` and a complete window.
    fn next(&self, py: Python<'_>) -> PyResult<()> {
        self.stream.locked(py)?.advance().or_raise()
    }

    /// Back to the state before the first row.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.stream.locked(py)?.reset();
        Ok(())
    }

    #[getter]
    fn n_seen(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.stream.locked(py)?.n_seen())
    }

    #[getter]
    fn is_complete(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.stream.locked(py)?.is_complete())
    }

    #[getter]
    fn first_row(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.stream.locked(py)?.first_row())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("StreamingIdentifier({}, hop={})", self.model.bind(py).repr()?, or_none(self.hop)))
    }
}

fn or_none(hop: Option<usize>) -> String {
    hop.map_or("None".to_owned(), |hop| hop.to_string())
}

/// Rows of `n_axes` values into a stream, without the GIL when they are many.
fn push_rows<T: Send>(
    wrench: &Bound<'_, PyAny>,
    n_axes: usize,
    stream: &Turns<T>,
    push: fn(&mut T, &[f64]) -> granular_id::Result<usize>,
) -> PyResult<usize> {
    let py = wrench.py();
    let array = contiguous_real(wrench, "wrench")?;
    if !matches!(array.shape(), [columns] | [_, columns] if *columns == n_axes) {
        let shape = tuple(array.shape());
        let message = format!("wrench must have shape (k, {n_axes}) or ({n_axes},), got shape {shape}");
        return Err(GranularIdError::new_err(message));
    }
    if array.len() >= MANY_ROWS * n_axes {
        let hold = Hold::new(&[array.as_any()])?;
        if hold.detaches() {
            let rows = readable(&array, "wrench")?;
            let values = rows.as_slice()?;
            return stream.work(py, |stream| push(stream, values))?.or_raise();
        }
    }
    // First the stream, which others may run for; then the rows, in which nobody may meddle.
    let mut stream = stream.locked(py)?;
    let taken = push(&mut stream, readable(&array, "wrench")?.as_slice()?);
    taken.or_raise()
}

/// A float64 vector of `len` values, the caller's `out` or a new one, after `write` has written it.
fn written<'py, T: Send>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    len: usize,
    stream: &Turns<T>,
    write: impl FnOnce(&mut T, &mut [f64]) -> granular_id::Result<()> + Send,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let out = match out {
        None => zeros(py, &[len])?,
        Some(out) => out.cast::<PyArrayDyn<f64>>().cloned().map_err(|_| {
            let got = shown(out);
            PyTypeError::new_err(format!("out must be a float64 array in native byte order, got {got}"))
        })?,
    };
    let borrowed = || {
        if out.shape() != [len] {
            return Err(wrong_shape("out", tuple(&[len]), out.shape()));
        }
        writable(&out, "", &[])
    };
    let hold = Hold::for_values(len, &[out.as_any()])?;
    if hold.detaches() {
        let mut target = borrowed()?;
        let target = target.as_slice_mut()?;
        stream.work(py, |stream| write(stream, target))?.or_raise()?;
    } else {
        // As above: first the stream, then the array.
        let mut stream = stream.locked(py)?;
        write(&mut stream, borrowed()?.as_slice_mut()?).or_raise()?;
    }
    Ok(out)
}

/// A stream that is locked under the GIL only, and kept without it for long work alone. So a fork finds it whole, or locked by
/// a process that is not its own: then whoever asks for it gets an error, because nobody will ever unlock it.
struct Turns<T> {
    stream: Mutex<T>,
    /// The process that did long work last.
    process: AtomicU32,
    /// Threads that wait for it.
    n_waiting: AtomicUsize,
}

impl<T: Send> Turns<T> {
    fn new(stream: T) -> Self {
        Self { stream: Mutex::new(stream), process: AtomicU32::new(0), n_waiting: AtomicUsize::new(0) }
    }

    /// The stream, for work that is short and calls nothing of Python's.
    fn locked(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, T>> {
        if let Some(stream) = self.free() {
            return Ok(stream);
        }
        if self.process.load(Relaxed) != std::process::id() {
            return Err(PyRuntimeError::new_err(
                "the stream was taking rows in another thread when this process was forked, and is not whole here: make a new one",
            ));
        }
        self.n_waiting.fetch_add(1, Relaxed);
        let stream = loop {
            py.detach(|| std::thread::sleep(PAUSE));
            if let Some(stream) = self.free() {
                break stream;
            }
        };
        self.n_waiting.fetch_sub(1, Relaxed);
        Ok(stream)
    }

    /// Work that is long and calls nothing of Python's, without the GIL.
    fn work<R: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut T) -> R + Send) -> PyResult<R> {
        // Who waits would otherwise find the stream locked whenever there is the GIL for a look.
        if self.n_waiting.load(Relaxed) > 0 {
            py.detach(|| std::thread::sleep(2 * PAUSE));
        }
        let mut stream = self.locked(py)?;
        if self.process.swap(std::process::id(), Relaxed) != std::process::id() {
            // Nobody who waited in another process waits in this one.
            self.n_waiting.store(0, Relaxed);
        }
        let stream = &mut *stream;
        Ok(py.detach(|| work(stream)))
    }

    fn free(&self) -> Option<MutexGuard<'_, T>> {
        match self.stream.try_lock() {
            Ok(stream) => Some(stream),
            // Nothing in a stream panics; if it did, no push is left half done that `reset` does not undo.
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}
