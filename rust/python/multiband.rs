//! Multi-band features of recordings.

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyTuple};

use crate::arguments::{
    copied, named, new_arguments, optional, owned_real, tuple, word, work_into, wrong_shape, zeros,
    GranularIdError, NewArguments, OrRaise, Recordings,
};
use granular_id::bindings::{collected, filled, short_number};
use granular_id::multiband::{n_bands, Block, MultiBand, MultiBandSpec, Scales};
use granular_id::BatchShape;

/// Multi-band features of recordings of one shape, as one checked, immutable value.
///
/// `rate_hz` only names the bands. Blocks that such short recordings do not have are left out; the order of their names
/// does not matter. `scales` (n_bands, n_axes) are the typical root mean square of each band and axis, `level_scales`
/// (n_axes,) the typical magnitude of the level; ones without them. `granular_id.MultiBand` learns them.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "MultiBandExtractor", module = "granular_id._core")]
pub(super) struct PyMultiBandExtractor {
    pub(super) design: MultiBand,
}

/// Numbers of each recording of a batch, by so many threads.
type Extract = fn(&MultiBand, &[f64], BatchShape, usize, &mut [f64]) -> granular_id::Result<()>;

#[pymethods]
impl PyMultiBandExtractor {
    #[new]
    #[pyo3(
        signature = (n_samples, n_axes, *, rate_hz=500.0, blocks=None, scales=None, level_scales=None),
        text_signature = "(n_samples, n_axes, *, rate_hz=500.0, \
                          blocks=('coupling', 'quantiles', 'envelope', 'spectrum'), scales=None, level_scales=None)"
    )]
    fn new(
        #[pyo3(from_py_with = named::n_samples)] n_samples: usize,
        #[pyo3(from_py_with = named::n_axes)] n_axes: usize,
        #[pyo3(from_py_with = named::rate_hz)] rate_hz: f64,
        blocks: Option<Vec<String>>,
        scales: Option<&Bound<'_, PyAny>>,
        level_scales: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let spec = match blocks {
            None => MultiBandSpec::default().with_rate_hz(rate_hz),
            Some(blocks) => blocks_of(&blocks, rate_hz)?,
        };
        MultiBand::check_size(n_samples, n_axes).or_raise()?;
        let scales = Scales {
            bands: given_scales(scales, "scales", &[n_bands(n_samples), n_axes])?,
            level: given_scales(level_scales, "level_scales", &[n_axes])?,
        };
        Ok(Self { design: MultiBand::new(spec, n_samples, n_axes, &scales).or_raise()? })
    }

    #[getter]
    fn n_samples(&self) -> usize {
        self.design.n_samples()
    }

    #[getter]
    fn n_axes(&self) -> usize {
        self.design.n_axes()
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.design.spec().rate_hz
    }

    #[getter]
    fn n_features(&self) -> usize {
        self.design.n_features()
    }

    #[getter]
    fn n_bands(&self) -> usize {
        self.design.n_bands()
    }

    /// Names of the requested blocks.
    #[getter]
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let wanted = Block::NAMED.iter().filter(|(_, block)| self.design.spec().wants(*block));
        PyTuple::new(py, wanted.map(|(name, _)| name).collect::<Vec<_>>())
    }

    /// Features of each block that such recordings have, in order.
    #[getter]
    fn block_sizes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.design.block_sizes().into_iter().map(|(block, size)| (block.name(), size)).into_py_dict(py)
    }

    /// Names of the features, in order.
    #[getter]
    fn names(&self) -> PyResult<Vec<String>> {
        self.design.names().or_raise()
    }

    /// Lower and upper edge in hertz, rate in hertz and samples of each band.
    #[getter]
    fn bands(&self) -> Vec<(f64, f64, f64, usize)> {
        let bands = self.design.bands().iter();
        bands.map(|band| (band.low_hz, band.high_hz, band.rate_hz, band.n_samples)).collect()
    }

    /// Middle of each bin of the spectrum, in hertz.
    #[getter]
    fn frequencies_hz<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.design.frequencies_hz())
    }

    #[getter]
    fn scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let scales = copied(py, &self.design.scales().bands)?;
        Ok(scales.reshape([self.design.n_bands(), self.design.n_axes()])?.into_any())
    }

    #[getter]
    fn level_scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        copied(py, &self.design.scales().level)
    }

    /// Features `(n, D)` of recordings `(n, T, C)`, or `(D,)` of one `(T, C)`. T may be less than `n_samples`: such a recording
    /// is taken as the beginning of a whole one.
    #[pyo3(signature = (X, threads=None))]
    #[allow(non_snake_case)] // as scikit-learn calls it
    fn extract<'py>(
        &self,
        X: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = optional::threads)] threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.each(X, threads, MultiBand::extract_batch, &[self.design.n_features()])
    }

    /// Root mean square `(n, n_bands, C)` of each band and axis of recordings `(n, T, C)`, or `(n_bands, C)` of one.
    #[pyo3(signature = (X, threads=None))]
    #[allow(non_snake_case)] // as scikit-learn calls it
    fn band_rms<'py>(
        &self,
        X: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = optional::threads)] threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.each(X, threads, MultiBand::rms_batch, &[self.design.n_bands(), self.design.n_axes()])
    }

    fn __getnewargs_ex__<'py>(slf: &Bound<'py, Self>) -> NewArguments<'py> {
        new_arguments(slf, "n_samples n_axes", "rate_hz blocks scales level_scales")
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let (one, other) = (&self.design, &other.get().design);
            let shape = |design: &MultiBand| (design.n_samples(), design.n_axes());
            shape(one) == shape(other) && one.spec() == other.spec() && one.scales() == other.scales()
        })
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (n_samples, n_axes, rate_hz) = (self.n_samples(), self.n_axes(), short_number(self.rate_hz()));
        let blocks = self.blocks(py)?.repr()?;
        Ok(format!(
            "<MultiBandExtractor of {n_samples} samples of {n_axes} axes at {rate_hz} Hz, blocks={blocks}>"
        ))
    }
}

impl PyMultiBandExtractor {
    fn each<'py>(
        &self,
        recordings: &Bound<'py, PyAny>,
        threads: Option<usize>,
        extract: Extract,
        row: &[usize],
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let recordings = Recordings::new(recordings, "X", threads, None)?;
        let Recordings { array, shape, threads } = &recordings;
        // Refused here, before the result is made, which may be large.
        self.design.check_batch(array.len(), *shape).or_raise()?;
        let rows = recordings.rows(row);
        let out = zeros(array.py(), &rows)?;
        work_into((&out, &rows), array, "X", |values, out| {
            extract(&self.design, values, *shape, *threads, out)
        })?;
        Ok(out)
    }
}

/// Names of blocks, in any order.
fn blocks_of(names: &[String], rate_hz: f64) -> PyResult<MultiBandSpec> {
    let mut wanted = Vec::new();
    for name in names {
        let block = word(name, "each of blocks", &Block::NAMED)?;
        if wanted.contains(&block) {
            let message = format!("blocks must name each block once, got '{}' twice", block.name());
            return Err(GranularIdError::new_err(message));
        }
        wanted.push(block);
    }
    Ok(MultiBandSpec::of(rate_hz, |block| wanted.contains(&block)))
}

/// Scales of one shape; ones where there are none.
fn given_scales(value: Option<&Bound<'_, PyAny>>, name: &str, shape: &[usize]) -> PyResult<Vec<f64>> {
    let Some(value) = value else {
        return filled(1.0, shape.iter().product()).or_raise();
    };
    let array = owned_real(value, name)?;
    if array.shape() != shape {
        return Err(wrong_shape(name, tuple(shape), array.shape()));
    }
    let array = array.try_readonly()?;
    collected(array.as_slice()?.iter().copied()).or_raise()
}
