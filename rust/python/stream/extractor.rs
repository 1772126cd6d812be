//! Streaming extraction: unpack, call, map the error.

use std::sync::MutexGuard;

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::super::scalars::count;
use super::super::spec::PyFeatureSpec;
use super::turns::Turns;
use super::{push_rows, written};
use crate::convert::OrRaise;
use granular_id::stream::{StreamingExtractor, Windows, MAX_WINDOW};

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
/// >>> from granular_id._core import StreamingExtractor
/// >>> recording = np.random.default_rng(0).normal(size=(1600, 6))
/// >>> stream = StreamingExtractor(gid.FeatureSpec())
/// >>> for block in np.array_split(recording, 160):
/// ...     taken = stream.push(block)
/// >>> stream.is_complete, np.array_equal(stream.features(), gid.extract_features(recording))
/// (True, True)
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "StreamingExtractor", module = "granular_id._core")]
pub(crate) struct PyStreamingExtractor {
    spec: Py<PyFeatureSpec>,
    windows: Windows,
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
        let mut windows = Windows::default();
        if let Some(n_samples) = n_samples {
            windows.n_samples = count(n_samples, "n_samples", MAX_WINDOW)?;
        }
        if let Some(n_axes) = n_axes {
            windows.n_axes = count(n_axes, "n_axes", MAX_WINDOW)?;
        }
        windows.hop = hop.map(|hop| count(hop, "hop", usize::MAX)).transpose()?;
        let stream = Turns::new(StreamingExtractor::new(&spec.get().extractor, windows).or_raise()?);
        Ok(Self { spec: spec.clone().unbind(), windows, stream })
    }

    /// Take rows `(k, n_axes)`, or one row `(n_axes,)`, in N and N m, until the window is complete; returns how many.
    ///
    /// Rows beyond the end of the window are not taken: pass them again after `next` or `reset`. NaN, infinity and
    /// values too large to filter raise a `ValueError`; no row was taken then.
    fn push(&self, wrench: &Bound<'_, PyAny>) -> PyResult<usize> {
        push_rows(wrench, self.windows.n_axes, &self.stream, StreamingExtractor::push)
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
        self.locked(py)?.advance().or_raise()
    }

    /// Back to the state before the first row.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.locked(py)?.reset();
        Ok(())
    }

    #[getter]
    fn spec(&self, py: Python<'_>) -> Py<PyFeatureSpec> {
        self.spec.clone_ref(py)
    }

    #[getter]
    fn n_samples(&self) -> usize {
        self.windows.n_samples
    }

    #[getter]
    fn n_axes(&self) -> usize {
        self.windows.n_axes
    }

    #[getter]
    fn hop(&self) -> Option<usize> {
        self.windows.hop
    }

    #[getter]
    fn n_features(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.locked(py)?.n_features())
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

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Windows { n_samples, n_axes, hop } = self.windows;
        let hop = hop.map_or("None".to_owned(), |hop| hop.to_string());
        let spec = self.spec.bind(py).repr()?;
        Ok(format!("StreamingExtractor({spec}, n_samples={n_samples}, n_axes={n_axes}, hop={hop})"))
    }
}

impl PyStreamingExtractor {
    fn locked<'py>(&'py self, py: Python<'py>) -> PyResult<MutexGuard<'py, StreamingExtractor>> {
        self.stream.locked(py)
    }
}
