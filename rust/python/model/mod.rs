//! Trained models and their files: unpack, call, map the error.

mod answers;
mod errors;
mod nearest;
mod parts;

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyTuple};

use super::arrays::{contiguous_real, copied, readable, Hold};
use super::multiband::PyMultiBandExtractor;
use super::number_table::bytes;
use super::scalars::{count, flag, word};
use super::spec::PyFeatureSpec;
use crate::convert::OrRaise;
pub(super) use errors::ModelFileError;
use errors::{bad_file, bad_part, no_model};
use granular_id::bindings::collected;
use granular_id::model::{
    Decoding, Extraction, Loss, ModelParts, Tensor, MAX_AXES, MAX_FILE_BYTES, MAX_WINDOW,
};
use granular_id::Model;
pub(super) use nearest::PyNearestMean;
use parts::{labels, notes, tensor, Spec};

/// Samples of the paper's recordings.
const PAPER_SAMPLES: usize = 1600;

/// A trained linear identifier as one checked, immutable value, shared between threads.
///
/// Parameters
/// ----------
/// spec : FeatureSpec or MultiBandExtractor
///     What is extracted from a recording: samples and counts, or multi-band features with their scales.
/// coef : array_like, shape (L, D)
///     Weights of L linear learners for D features, in the order of `granular_id.extract_features` or of
///     `MultiBandExtractor.names`.
/// intercept : array_like, shape (L,)
///     Intercepts.
/// coding_matrix : array_like, shape (K, L)
///     Codes -1, 0 and +1 of K classes.
/// classes : sequence of str
///     K different labels.
/// loss : str, default "hinge"
///     Also "hamming", "root", "linear", "exponential", "logit", "binodeviance".
/// decoding : str, default "loss_weighted"
///     Or "loss_based".
/// n_samples : int, default 1600
///     Samples of a recording; the default is the paper's, or what a `MultiBandExtractor` was made for.
/// n_axes : int, default 6
///     Axes of a sample; likewise.
/// metadata : mapping of str to str, optional
///     What describes the model: "axes" and "units" (JSON lists), "coding", "posterior", "training_sha256",
///     "library_version", "lead_s" (seconds, or empty), "trained" (a JSON object). Of all this only the rules under
///     "confidence" in "trained" are part of an answer.
/// raw_mean, raw_low, raw_high : array_like, shape (n_axes * n_samples,), optional
///     Of the training recordings, axis by axis, for provisional answers.
/// early : array_like, shape (M, 2), optional
///     Samples seen and margin needed for an early answer.
/// sigmoid : array_like, shape (L, 2), optional
///     Slope and offset of each learner's sigmoid; needs a "posterior" in the metadata.
/// posterior_weights : array_like, shape (L,), optional
///     Weight of the training rows behind each learner, for coupling by "kullback_leibler".
/// lacks_digest : bool, default False
///     Whether the parts come from a file without a digest.
///
/// Raises
/// ------
/// TypeError, ValueError
///     If parts do not fit together; the message names the part.
///
/// Notes
/// -----
/// Scores are added in one order (`docs/live/model-file.md`), so that batches, streams and other readers of the file agree
/// bit for bit.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> import granular_id as gid
/// >>> from granular_id._core import Model
/// >>> spec = gid.FeatureSpec(hfmh=False)
/// >>> model = Model(spec, [[0.0, 2.0, 0.0]], [-1.0], [[1], [-1]], ["rice", "salt"], n_samples=3, n_axes=1)
/// >>> scores = model.scores(np.array([[[0.1], [0.9], [0.2]]]))
/// >>> model.classes[model.losses(scores).argmin()]
/// 'rice'
/// >>> Model.from_bytes(model.to_bytes()).classes
/// ('rice', 'salt')
#[allow(clippy::doc_markdown, clippy::doc_link_with_quotes)] // numpydoc, read by Python
#[pyclass(frozen, name = "Model", module = "granular_id._core")]
pub(super) struct PyModel {
    pub(super) model: Arc<Model>,
}

#[pymethods]
impl PyModel {
    #[new]
    #[pyo3(
        signature = (spec, coef, intercept, coding_matrix, classes, *, loss=None, decoding=None, n_samples=None, n_axes=None,
                     metadata=None, raw_mean=None, raw_low=None, raw_high=None, early=None, sigmoid=None,
                     posterior_weights=None, lacks_digest=None),
        text_signature = "(spec, coef, intercept, coding_matrix, classes, *, loss='hinge', decoding='loss_weighted', \
                          n_samples=1600, n_axes=6, metadata=None, raw_mean=None, raw_low=None, raw_high=None, early=None, \
                          sigmoid=None, posterior_weights=None, lacks_digest=False)"
    )]
    #[allow(clippy::too_many_arguments)] // the parts of a model
    fn new<'py>(
        spec: &Bound<'py, PyAny>,
        coef: &Bound<'py, PyAny>,
        intercept: &Bound<'py, PyAny>,
        coding_matrix: &Bound<'py, PyAny>,
        classes: &Bound<'py, PyAny>,
        loss: Option<&Bound<'py, PyAny>>,
        decoding: Option<&Bound<'py, PyAny>>,
        n_samples: Option<&Bound<'py, PyAny>>,
        n_axes: Option<&Bound<'py, PyAny>>,
        metadata: Option<&Bound<'py, PyAny>>,
        raw_mean: Option<&Bound<'py, PyAny>>,
        raw_low: Option<&Bound<'py, PyAny>>,
        raw_high: Option<&Bound<'py, PyAny>>,
        early: Option<&Bound<'py, PyAny>>,
        sigmoid: Option<&Bound<'py, PyAny>>,
        posterior_weights: Option<&Bound<'py, PyAny>>,
        lacks_digest: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let py = coef.py();
        let lacks_digest = lacks_digest.map_or(Ok(false), |value| flag(value, "lacks_digest"))?;
        let spec = Spec::of(spec)?;
        let (own_samples, own_axes) =
            spec.shape().unwrap_or((PAPER_SAMPLES, granular_id::wrench::AXES.len()));
        let n_axes = n_axes.map_or(Ok(own_axes), |value| count(value, "n_axes", MAX_AXES))?;
        let n_samples = n_samples.map_or(Ok(own_samples), |value| count(value, "n_samples", MAX_WINDOW))?;
        spec.check_shape(n_samples, n_axes)?;
        let arrays = [
            ("coef", Some(coef)),
            ("intercept", Some(intercept)),
            ("coding_matrix", Some(coding_matrix)),
            ("raw_mean", raw_mean),
            ("raw_low", raw_low),
            ("raw_high", raw_high),
            ("early", early),
            ("sigmoid", sigmoid),
            ("posterior_weights", posterior_weights),
        ];
        let classes = labels(classes)?;
        let loss = loss.map_or(Ok(Loss::default()), |value| word(value, "loss", &Loss::NAMED))?;
        let decoding =
            decoding.map_or(Ok(Decoding::default()), |value| word(value, "decoding", &Decoding::NAMED))?;
        let notes = notes(n_axes, metadata)?;
        let convert = |(name, value): (&'static str, Option<&Bound<'py, PyAny>>)| {
            value.map(|value| Ok::<_, PyErr>((name, contiguous_real(value, name)?))).transpose()
        };
        let arrays = arrays.into_iter().map(convert).collect::<PyResult<Vec<_>>>()?;
        let given = || arrays.iter().flatten().map(|(_, array)| array);
        let hold = Hold::for_values(
            given().map(PyUntypedArrayMethods::len).sum(),
            &given().map(Bound::as_any).collect::<Vec<_>>(),
        )?;
        // Nothing of Python's runs from here on.
        let borrowed =
            arrays.iter().map(|array| array.as_ref().map(|(name, array)| readable(array, name)).transpose());
        let borrowed = borrowed.collect::<PyResult<Vec<_>>>()?;
        let tensors = borrowed.iter().map(|array| array.as_ref().map(tensor).transpose());
        let mut tensors = tensors.collect::<PyResult<Vec<_>>>()?.into_iter();
        let mut next = || tensors.next().flatten();
        let nothing = || Tensor::new(Vec::new(), &[]);
        let parts = ModelParts {
            features: spec.features(),
            n_samples,
            n_axes,
            coef: next().unwrap_or_else(nothing),
            intercept: next().unwrap_or_else(nothing),
            coding_matrix: next().unwrap_or_else(nothing),
            classes,
            loss,
            decoding,
            raw_mean: next(),
            raw_low: next(),
            raw_high: next(),
            early: next(),
            sigmoid: next(),
            posterior_weights: next(),
            notes,
        };
        let model = hold.work(py, || Model::new(parts)).map_err(bad_part)?;
        Ok(Self { model: Arc::new(if lacks_digest { model.without_digest() } else { model }) })
    }

    /// The model in the bytes of a file.
    #[staticmethod]
    #[pyo3(signature = (data, *, max_file_bytes=None), text_signature = "(data, *, max_file_bytes=16777216)")]
    fn from_bytes(py: Python<'_>, data: &[u8], max_file_bytes: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let most = most_bytes(max_file_bytes)?;
        let model = py.detach(|| Model::from_bytes(data, most)).map_err(no_model)?;
        Ok(Self { model: Arc::new(model) })
    }

    /// The model in a file.
    #[staticmethod]
    #[pyo3(signature = (path, *, max_file_bytes=None), text_signature = "(path, *, max_file_bytes=16777216)")]
    fn read(py: Python<'_>, path: PathBuf, max_file_bytes: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let most = most_bytes(max_file_bytes)?;
        let model = py.detach(|| Model::read_within(path, most)).map_err(|fault| bad_file(py, fault))?;
        Ok(Self { model: Arc::new(model) })
    }

    /// The bytes of a file with this model, always the same ones.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        bytes(py, &py.detach(|| self.model.to_bytes()).or_raise()?)
    }

    /// Scores (n, L) of the learners for recordings (n, `n_samples`, `n_axes`), or (1, L) for one recording.
    #[pyo3(signature = (wrench, threads=None))]
    fn scores<'py>(
        &self,
        wrench: &Bound<'py, PyAny>,
        threads: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        answers::scores(&self.model, wrench, threads)
    }

    /// Mean losses (n, K) of the classes from scores (n, L) or (L,): the smallest wins, the first of equal ones.
    fn losses<'py>(&self, scores: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        answers::losses(&self.model, scores)
    }

    /// What the rules of the model say of whole recordings, from scores (n, L) or (L,): for each the labels of the
    /// candidates, the likeliest first, and whether it is like no class; an empty tuple and None without rules.
    fn verdicts<'py>(&self, scores: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
        answers::verdicts(&self.model, scores)
    }

    /// Whether it was read from a file without a digest: had its numbers been damaged, nobody would know.
    #[getter]
    fn lacks_digest(&self) -> bool {
        self.model.lacks_digest()
    }

    #[getter]
    fn spec<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(match self.model.extraction() {
            Extraction::Additive { extractor, .. } => {
                Bound::new(py, PyFeatureSpec { extractor: extractor.clone() })?.into_any()
            }
            Extraction::MultiBand(multiband) => {
                Bound::new(py, PyMultiBandExtractor { design: multiband.clone() })?.into_any()
            }
        })
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.model.rate_hz()
    }

    #[getter]
    fn coef<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let shape = [self.model.n_learners(), self.model.n_features()];
        let at = |index| self.model.coef(index / shape[1], index % shape[1]);
        PyArray1::from_vec(py, collected((0..shape[0] * shape[1]).map(at)).or_raise()?).reshape(shape)
    }

    #[getter]
    fn intercept<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        copied(py, self.model.intercepts())
    }

    #[getter]
    fn coding_matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i8>>> {
        let shape = [self.model.classes().len(), self.model.n_learners()];
        let at = |index| self.model.code(index / shape[1], index % shape[1]);
        PyArray1::from_vec(py, collected((0..shape[0] * shape[1]).map(at)).or_raise()?).reshape(shape)
    }

    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.model.classes())
    }

    #[getter]
    fn loss(&self) -> &'static str {
        self.model.loss().name()
    }

    #[getter]
    fn decoding(&self) -> &'static str {
        self.model.decoding().name()
    }

    #[getter]
    fn n_samples(&self) -> usize {
        self.model.n_samples()
    }

    #[getter]
    fn n_axes(&self) -> usize {
        self.model.n_axes()
    }

    #[getter]
    fn n_features(&self) -> usize {
        self.model.n_features()
    }

    #[getter]
    fn n_learners(&self) -> usize {
        self.model.n_learners()
    }

    #[getter]
    fn n_classes(&self) -> usize {
        self.model.classes().len()
    }

    /// What describes the model, as the constructor takes it; of all this only the rules are part of an answer.
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let metadata = PyDict::new(py);
        for (key, text) in self.model.notes().entries() {
            metadata.set_item(key, text)?;
        }
        Ok(metadata)
    }

    #[getter]
    fn raw_mean<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.model.raw_mean().map(|values| copied(py, values)).transpose()
    }

    #[getter]
    fn raw_low<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.model.raw_range().map(|range| range.0).map(|values| copied(py, values)).transpose()
    }

    #[getter]
    fn raw_high<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.model.raw_range().map(|range| range.1).map(|values| copied(py, values)).transpose()
    }

    #[getter]
    fn early<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        pairs(py, self.model.early())
    }

    #[getter]
    fn sigmoid<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        pairs(py, self.model.sigmoid())
    }

    #[getter]
    fn posterior_weights<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.model.posterior_weights().map(|values| copied(py, values)).transpose()
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().model == self.model)
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let parts =
            (self.spec(py)?, self.coef(py)?, self.intercept(py)?, self.coding_matrix(py)?, self.classes(py)?);
        let keywords = PyDict::new(py);
        keywords.set_item("loss", self.loss())?;
        keywords.set_item("decoding", self.decoding())?;
        keywords.set_item("n_samples", self.n_samples())?;
        keywords.set_item("n_axes", self.n_axes())?;
        keywords.set_item("metadata", self.metadata(py)?)?;
        keywords.set_item("raw_mean", self.raw_mean(py)?)?;
        keywords.set_item("raw_low", self.raw_low(py)?)?;
        keywords.set_item("raw_high", self.raw_high(py)?)?;
        keywords.set_item("early", self.early(py)?)?;
        keywords.set_item("sigmoid", self.sigmoid(py)?)?;
        keywords.set_item("posterior_weights", self.posterior_weights(py)?)?;
        keywords.set_item("lacks_digest", self.lacks_digest())?;
        Ok((parts.into_pyobject(py)?, keywords))
    }

    fn __repr__(&self) -> String {
        let Self { model } = self;
        format!(
            "<Model: {} classes, {} learners, {} x {} samples>",
            model.classes().len(),
            model.n_learners(),
            model.n_samples(),
            model.n_axes()
        )
    }
}

fn most_bytes(max_file_bytes: Option<&Bound<'_, PyAny>>) -> PyResult<usize> {
    max_file_bytes.map_or(Ok(MAX_FILE_BYTES), |value| count(value, "max_file_bytes", usize::MAX))
}

fn pairs<'py>(py: Python<'py>, pairs: Option<&[[f64; 2]]>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
    pairs.map(|pairs| copied(py, pairs.as_flattened())?.reshape([pairs.len(), 2])).transpose()
}
