//! Trained models and their files.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use numpy::{
    Element, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOSError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict, PyList, PyString, PyTuple};

use crate::arguments::{
    contiguous_real, copied, named, new_arguments, optional, readable, shown, word, work, work_into,
    wrong_shape, zeros, GranularIdError, NewArguments, OrRaise, Raise, Recordings,
};
use crate::features::PyFeatureSpec;
use crate::multiband::PyMultiBandExtractor;
use granular_id::bindings::collected;
use granular_id::model::{
    Extraction, Features, Loss, Metadata, ModelError, ModelFileError as FileError, ModelParts, NoveltyParts,
    Tensor,
};
use granular_id::multiband::Block;
use granular_id::{Error, Model};

create_exception!(
    granular_id._core,
    ModelFileError,
    GranularIdError,
    "A file that holds no model; the message names what is wrong with it."
);

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
///     Or "root".
/// n_samples : int, default 1600
///     Samples of a recording; the default is the paper's, or what a `MultiBandExtractor` was made for.
/// n_axes : int, default 6
///     Axes of a sample; likewise.
/// metadata : mapping of str to str, optional
///     What describes the model: "axes" and "units" (JSON lists), "training_sha256", "library_version", "lead_s" (seconds,
///     or empty), "trained" (a JSON object). Of all this only the rules under "confidence" in "trained" are part of an
///     answer.
/// raw_mean : array_like, shape (n_axes * n_samples,), optional
///     Mean of the training recordings, axis by axis: what samples not yet seen are taken for in provisional answers.
/// early : array_like, shape (M, 2), optional
///     Samples seen and margin needed for an early answer.
/// novelty : tuple of three array_like, optional
///     What the novelty of a recording is computed with, rounded to float32: centre and factor of each feature (2, D),
///     directions of scaled features (R, D), means of the classes (K, D). There exactly if the metadata has a rule that
///     refuses unknown materials.
///
/// Notes
/// -----
/// Scores are added in one order (see :doc:`/reference/model_file`), so that batches, streams and other readers of the file
/// agree bit for bit.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "Model", module = "granular_id._core")]
pub(super) struct PyModel {
    pub(super) model: Arc<Model>,
}

#[pymethods]
impl PyModel {
    #[new]
    #[pyo3(
        signature = (spec, coef, intercept, coding_matrix, classes, *, loss="hinge", n_samples=None, n_axes=None,
                     metadata=None, raw_mean=None, early=None, novelty=None),
        text_signature = "(spec, coef, intercept, coding_matrix, classes, *, loss='hinge', n_samples=1600, n_axes=6, \
                          metadata=None, raw_mean=None, early=None, novelty=None)"
    )]
    #[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)] // the parts of a model, as PyO3 gives them
    fn new<'py>(
        spec: &Bound<'py, PyAny>,
        coef: &Bound<'py, PyAny>,
        intercept: &Bound<'py, PyAny>,
        coding_matrix: &Bound<'py, PyAny>,
        classes: Vec<String>,
        loss: &str,
        #[pyo3(from_py_with = optional::n_samples)] n_samples: Option<usize>,
        #[pyo3(from_py_with = optional::n_axes)] n_axes: Option<usize>,
        metadata: Option<BTreeMap<String, String>>,
        raw_mean: Option<&Bound<'py, PyAny>>,
        early: Option<&Bound<'py, PyAny>>,
        novelty: Option<[Bound<'py, PyAny>; 3]>,
    ) -> PyResult<Self> {
        let (features, own) = features(spec)?;
        let (own_samples, own_axes) = own.unwrap_or((PAPER_SAMPLES, granular_id::wrench::AXES.len()));
        let (n_samples, n_axes) = (n_samples.unwrap_or(own_samples), n_axes.unwrap_or(own_axes));
        if own.is_some_and(|own| own != (n_samples, n_axes)) {
            return Err(GranularIdError::new_err(format!(
                "spec is for {own_samples} samples of {own_axes} axes, got n_samples = {n_samples}, n_axes = {n_axes}"
            )));
        }
        let loss = word(loss, "loss", &Loss::NAMED)?;
        let metadata = Metadata::of_axes(n_axes).with(metadata.unwrap_or_default()).map_err(bad_part)?;
        // All arrays are made before the first of them is borrowed.
        let array = |value, name| Ok::<_, PyErr>((contiguous_real(value, name)?, name));
        let optional = |value: Option<_>, name| value.map(|value| array(value, name)).transpose();
        let (coef, intercept) = (array(coef, "coef")?, array(intercept, "intercept")?);
        let codes = array(coding_matrix, "coding_matrix")?;
        let (raw_mean, early) = (optional(raw_mean, "raw_mean")?, optional(early, "early")?);
        let novelty = match &novelty {
            None => None,
            Some([scaling, directions, means]) => Some([
                array(scaling, "unknown_scaling")?,
                array(directions, "unknown_directions")?,
                array(means, "unknown_means")?,
            ]),
        };
        let (coef, intercept, codes) = (borrow(&coef)?, borrow(&intercept)?, borrow(&codes)?);
        let raw_mean = raw_mean.as_ref().map(borrow).transpose()?;
        let early = early.as_ref().map(borrow).transpose()?;
        let novelty = match &novelty {
            None => None,
            Some([scaling, directions, means]) => {
                Some([borrow(scaling)?, borrow(directions)?, borrow(means)?])
            }
        };
        let mut parts = ModelParts::new(
            features,
            n_samples,
            n_axes,
            tensor(&coef)?,
            tensor(&intercept)?,
            tensor(&codes)?,
            classes,
        );
        (parts.loss, parts.metadata) = (loss, metadata);
        parts.raw_mean = raw_mean.as_ref().map(tensor).transpose()?;
        parts.early = early.as_ref().map(tensor).transpose()?;
        if let Some([scaling, directions, means]) = &novelty {
            let (scaling, directions, means) = (tensor(scaling)?, tensor(directions)?, tensor(means)?);
            parts.novelty = Some(NoveltyParts { scaling, directions, means });
        }
        let n_values = coef.len();
        let model = work(spec.py(), n_values, || Model::new(parts)).map_err(bad_part)?;
        Ok(Self { model: Arc::new(model) })
    }

    /// The model in the bytes of a file.
    #[staticmethod]
    #[pyo3(signature = (data, *, max_file_bytes=33_554_432))]
    fn from_bytes(
        py: Python<'_>,
        data: &[u8],
        #[pyo3(from_py_with = named::max_file_bytes)] max_file_bytes: usize,
    ) -> PyResult<Self> {
        let model = py.detach(|| Model::from_bytes(data, max_file_bytes)).map_err(no_model)?;
        Ok(Self { model: Arc::new(model) })
    }

    /// The model in a file.
    #[staticmethod]
    #[pyo3(signature = (path, *, max_file_bytes=33_554_432))]
    fn read(
        py: Python<'_>,
        path: PathBuf,
        #[pyo3(from_py_with = named::max_file_bytes)] max_file_bytes: usize,
    ) -> PyResult<Self> {
        let model = py.detach(|| Model::read_within(path, max_file_bytes));
        Ok(Self { model: Arc::new(model.map_err(|error| bad_file(py, error))?) })
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
        #[pyo3(from_py_with = optional::threads)] threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let model = &self.model;
        let trained_on = [model.n_samples(), model.n_axes()];
        let Recordings { array, shape, threads } =
            Recordings::new(wrench, "wrench", threads, Some(trained_on))?;
        let n_recordings = shape.n_recordings;
        let wanted = [n_recordings, model.n_learners()];
        let out = zeros(array.py(), &wanted)?;
        work_into((&out, &wanted), &array, "wrench", |values, out| {
            model.scores_into(values, n_recordings, threads, out)
        })?;
        Ok(out)
    }

    /// Mean losses (n, K) of the classes from scores (n, L) or (L,): the smallest wins, the first of equal ones.
    fn losses<'py>(&self, scores: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n_classes = self.n_classes();
        let losses = self.of_scores(scores, Model::losses)?.or_raise()?;
        let shape = [losses.len() / n_classes, n_classes];
        PyArray1::from_vec(scores.py(), losses).reshape(shape)
    }

    /// Scores (n, L) as of `scores`, and the novelty (n,) of each recording: large for what is like no class. None in its
    /// place where unknown materials are not refused.
    #[pyo3(signature = (wrench, threads=None))]
    fn scores_and_novelty<'py>(
        &self,
        wrench: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = optional::threads)] threads: Option<usize>,
    ) -> PyResult<ScoresAndNovelty<'py>> {
        let (py, model) = (wrench.py(), &self.model);
        let trained_on = [model.n_samples(), model.n_axes()];
        let Recordings { array, shape, threads } =
            Recordings::new(wrench, "wrench", threads, Some(trained_on))?;
        let borrowed = readable(&array, "wrench")?;
        let values = borrowed.as_slice()?;
        let found = py.detach(|| model.scores_and_novelty(values, shape.n_recordings, threads));
        let (scores, novelty) = found.or_raise()?;
        let scores = PyArray1::from_vec(py, scores).reshape([shape.n_recordings, model.n_learners()])?;
        Ok((scores, novelty.map(|novelty| PyArray1::from_vec(py, novelty))))
    }

    /// What the rules of the model find about whole recordings, from what `scores_and_novelty` gives: for each the labels of
    /// the candidates, the likeliest first, and whether it is like no class; an empty tuple and None without rules.
    #[pyo3(signature = (scores, novelty=None))]
    fn apply_rules<'py>(
        &self,
        scores: &Bound<'py, PyAny>,
        novelty: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyList>> {
        let py = scores.py();
        let novelty = novelty.map(|novelty| contiguous_real(novelty, "novelty")).transpose()?;
        let novelty = match &novelty {
            Some(novelty) => readable(novelty, "novelty")?.as_slice()?.to_vec(),
            None => Vec::new(),
        };
        let found =
            self.of_scores(scores, |model, scores| model.rule_outcomes(scores, &novelty))?.or_raise()?;
        let labels: Vec<_> = self.model.classes().iter().map(|label| PyString::new(py, label)).collect();
        let named = PyList::empty(py);
        for (candidates, unknown) in found {
            named.append((PyTuple::new(py, candidates.iter().map(|class| &labels[*class]))?, unknown))?;
        }
        Ok(named)
    }

    #[getter]
    fn spec<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(match self.model.extraction() {
            Extraction::Paper { extractor, .. } => {
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
        matrix(py, [self.n_learners(), self.n_features()], |row, column| self.model.coef(row, column))
    }

    #[getter]
    fn intercept<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        copied(py, self.model.intercepts())
    }

    #[getter]
    fn coding_matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i8>>> {
        matrix(py, [self.n_classes(), self.n_learners()], |row, column| self.model.code(row, column))
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
        self.model.metadata().entries().into_py_dict(py)
    }

    #[getter]
    fn raw_mean<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.model.raw_mean().map(|mean| copied(py, mean)).transpose()
    }

    #[getter]
    fn early<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let rows = self.model.early();
        rows.map(|rows| copied(py, rows.as_flattened())?.reshape([rows.len(), 2])).transpose()
    }

    /// What the novelty is computed with, as the constructor takes it.
    #[getter]
    fn novelty<'py>(&self, py: Python<'py>) -> PyResult<Option<[Bound<'py, PyArray2<f32>>; 3]>> {
        let Some(tensors) = self.model.novelty() else { return Ok(None) };
        let array = |(n_rows, values)| PyArray1::from_vec(py, values).reshape([n_rows, self.n_features()]);
        let [scaling, directions, means] = tensors.map(array);
        Ok(Some([scaling?, directions?, means?]))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().model == self.model)
    }

    fn __getnewargs_ex__<'py>(slf: &Bound<'py, Self>) -> NewArguments<'py> {
        let keywords = "loss n_samples n_axes metadata raw_mean early novelty";
        new_arguments(slf, "spec coef intercept coding_matrix classes", keywords)
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

type ScoresAndNovelty<'py> = (Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray1<f64>>>);

impl PyModel {
    /// Work on scores (n, L) or (L,).
    fn of_scores<R: Send>(
        &self,
        scores: &Bound<'_, PyAny>,
        run: impl FnOnce(&Model, &[f64]) -> R + Send,
    ) -> PyResult<R> {
        let (model, n_learners) = (&self.model, self.n_learners());
        let scores = contiguous_real(scores, "scores")?;
        if !matches!(*scores.shape(), [l] | [_, l] if l == n_learners) {
            let wanted = format_args!("(n, {n_learners}) or ({n_learners},), one per learner");
            return Err(wrong_shape("scores", wanted, scores.shape()));
        }
        let n_values = scores.len().saturating_mul(self.n_classes());
        let borrowed = readable(&scores, "scores")?;
        let values = borrowed.as_slice()?;
        Ok(work(scores.py(), n_values, || run(model, values)))
    }
}

/// Bytes of Python; a `MemoryError` where there is no room for them.
fn bytes<'py>(py: Python<'py>, from: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
    PyBytes::new_with(py, from.len(), |bytes| {
        bytes.copy_from_slice(from);
        Ok(())
    })
}

type Named<'py> = (Bound<'py, PyArrayDyn<f64>>, &'static str);

fn borrow<'py>((array, name): &Named<'py>) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    readable(array, name)
}

fn tensor<'a>(array: &'a PyReadonlyArrayDyn<'_, f64>) -> PyResult<Tensor<'a>> {
    Ok(Tensor::new(array.shape().to_vec(), array.as_slice()?))
}

fn matrix<T: Element>(
    py: Python<'_>,
    shape: [usize; 2],
    at: impl Fn(usize, usize) -> T,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let values = (0..shape[0] * shape[1]).map(|index| at(index / shape[1], index % shape[1]));
    PyArray1::from_vec(py, collected(values).or_raise()?).reshape(shape)
}

/// The features of a specification; with samples and axes of a recording, where it fixes them.
fn features<'a>(spec: &'a Bound<'_, PyAny>) -> PyResult<(Features<'a>, Option<(usize, usize)>)> {
    if let Ok(spec) = spec.cast::<PyFeatureSpec>() {
        return Ok((spec.get().extractor.spec().clone().into(), None));
    }
    let Ok(multiband) = spec.cast::<PyMultiBandExtractor>() else {
        let got = shown(spec);
        let message = format!("spec must be a FeatureSpec or a MultiBandExtractor, got {got}");
        return Err(PyTypeError::new_err(message));
    };
    let design = &multiband.get().design;
    let (scales, n_axes) = (design.scales(), design.n_axes());
    let levels = || Tensor::new(vec![n_axes], &scales.level);
    let features = Features::MultiBand {
        spec: *design.spec(),
        band_scales: Tensor::new(vec![design.n_bands(), n_axes], &scales.bands),
        level_scales: design.spec().wants(Block::Level).then(levels),
    };
    Ok((features, Some((design.n_samples(), n_axes))))
}

/// Parts come from the caller, not from a file.
fn bad_part(error: ModelError) -> PyErr {
    match error {
        ModelError::Spec(error) => error.raise(),
        error => GranularIdError::new_err(error.to_string()),
    }
}

/// Bytes that are no model.
fn no_model(error: ModelError) -> PyErr {
    match error {
        ModelError::Spec(error @ Error::Memory { .. }) => error.raise(),
        error => ModelFileError::new_err(error.to_string()),
    }
}

/// A file that is no model or cannot be read.
fn bad_file(py: Python<'_>, error: FileError) -> PyErr {
    match error {
        FileError::Unreadable { ref source, .. } if source.kind() == io::ErrorKind::OutOfMemory => {
            PyMemoryError::new_err(error.to_string())
        }
        FileError::Unreadable { path, source } => {
            unreadable(py, path.into(), &source).unwrap_or_else(|error| error)
        }
        FileError::NoModel { source: ModelError::Spec(error @ Error::Memory { .. }), .. } => error.raise(),
        error => ModelFileError::new_err(error.to_string()),
    }
}

/// The exception that Python's own `open` would raise.
fn unreadable(py: Python<'_>, path: OsString, error: &io::Error) -> PyResult<PyErr> {
    let Some(code) = error.raw_os_error() else { return Ok(PyOSError::new_err((error.to_string(), path))) };
    let text: String = py.import("os")?.call_method1("strerror", (code,))?.extract()?;
    Ok(PyOSError::new_err((code, text, path)))
}
