//! Multi-band features: unpack, call, map the error.

mod arguments;

use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use self::arguments::{blocks_of, given_scales};
use super::arrays::{self, contiguous_real, copied, readable, writable, zeros, Hold};
use super::pool::threads_for;
use super::scalars::{count, number};
use crate::convert::OrRaise;
use granular_id::bindings::brief;
use granular_id::multiband::{n_bands, MultiBand, MultiBandSpec, Scales};

/// Multi-band features of recordings of one shape, as one checked, immutable value.
///
/// Parameters
/// ----------
/// n_samples, n_axes : int
///     Shape of a whole recording.
/// rate_hz : float, default 500.0
///     Sampling rate in hertz. It names the bands; no feature depends on it.
/// blocks : sequence of str, default ("coupling", "quantiles", "envelope", "spectrum")
///     What to compute; also "level". Their order does not matter. Blocks that such short recordings do not have are left
///     out.
/// scales : array-like, shape (n_bands, n_axes), optional
///     Typical root mean square of each band and axis; ones without it.
/// level_scales : array-like, shape (n_axes,), optional
///     Typical magnitude of the level of each axis; ones without it.
///
/// Raises
/// ------
/// TypeError, ValueError
///     If a value has the wrong type or is outside its range; the message names the argument.
///
/// Notes
/// -----
/// Pickles with protocol 2 and later. `granular_id.spaces.MultiBand` learns the scales.
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "MultiBandExtractor", module = "granular_id._core")]
pub(super) struct PyMultiBandExtractor {
    pub(super) design: MultiBand,
}

/// Which numbers of a recording are wanted.
#[derive(Clone, Copy)]
enum Wanted {
    Features,
    RootMeanSquares,
}

#[pymethods]
impl PyMultiBandExtractor {
    #[new]
    #[pyo3(
        signature = (n_samples, n_axes, *, rate_hz=None, blocks=None, scales=None, level_scales=None),
        text_signature = "(n_samples, n_axes, *, rate_hz=500.0, \
                          blocks=('coupling', 'quantiles', 'envelope', 'spectrum'), scales=None, level_scales=None)"
    )]
    fn new(
        n_samples: &Bound<'_, PyAny>,
        n_axes: &Bound<'_, PyAny>,
        rate_hz: Option<&Bound<'_, PyAny>>,
        blocks: Option<&Bound<'_, PyAny>>,
        scales: Option<&Bound<'_, PyAny>>,
        level_scales: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let n_samples = count(n_samples, "n_samples", usize::MAX)?;
        let n_axes = count(n_axes, "n_axes", usize::MAX)?;
        let mut spec = MultiBandSpec::default();
        if let Some(rate_hz) = rate_hz {
            spec.rate_hz = number(rate_hz, "rate_hz")?;
        }
        if let Some(blocks) = blocks {
            spec = blocks_of(blocks, spec.rate_hz)?;
        }
        MultiBand::check_size(n_samples, n_axes).or_raise()?;
        let n_bands = n_bands(n_samples);
        let scales = Scales {
            bands: given_scales(scales, "scales", &[n_bands, n_axes])?,
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

    /// Names of the blocks that were asked for.
    #[getter]
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let spec = self.design.spec();
        let named = granular_id::multiband::Block::NAMED.into_iter();
        PyTuple::new(
            py,
            named.filter(|(_, block)| spec.wants(*block)).map(|(name, _)| name).collect::<Vec<_>>(),
        )
    }

    /// Features of each block that such recordings have, in order.
    #[getter]
    fn block_sizes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let sizes = PyDict::new(py);
        for (block, size) in self.design.block_sizes() {
            sizes.set_item(block.name(), size)?;
        }
        Ok(sizes)
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
        threads: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.each(X, threads, Wanted::Features, &[self.design.n_features()])
    }

    /// Root mean square `(n, n_bands, C)` of each band and axis of recordings `(n, T, C)`, or `(n_bands, C)` of one.
    #[pyo3(signature = (X, threads=None))]
    #[allow(non_snake_case)] // as scikit-learn calls it
    fn band_rms<'py>(
        &self,
        X: &Bound<'py, PyAny>,
        threads: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.each(X, threads, Wanted::RootMeanSquares, &[self.design.n_bands(), self.design.n_axes()])
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let keywords = PyDict::new(py);
        keywords.set_item("rate_hz", self.rate_hz())?;
        keywords.set_item("blocks", self.blocks(py)?)?;
        keywords.set_item("scales", self.scales(py)?)?;
        keywords.set_item("level_scales", self.level_scales(py)?)?;
        Ok((PyTuple::new(py, [self.n_samples(), self.n_axes()])?, keywords))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let (one, other) = (&self.design, &other.get().design);
            let shape = |design: &MultiBand| (design.n_samples(), design.n_axes());
            shape(one) == shape(other) && one.spec() == other.spec() && one.scales() == other.scales()
        })
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (n_samples, n_axes, rate_hz) = (self.n_samples(), self.n_axes(), brief(self.rate_hz()));
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
        threads: Option<&Bound<'py, PyAny>>,
        wanted: Wanted,
        row: &[usize],
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = recordings.py();
        let threads = threads_for(threads)?;
        let array = contiguous_real(recordings, "X")?;
        let (shape, single) = arrays::recordings(&array, "X")?;
        // Refused here, before the result is made, which may be large.
        self.design.check_batch(array.len(), shape).or_raise()?;
        let dims: Vec<_> = if single { row.to_vec() } else { [&[shape.n_recordings], row].concat() };
        let out = zeros(py, &dims)?;
        {
            let hold = Hold::new(&[array.as_any()])?;
            let values = readable(&array, "X")?;
            let values = values.as_slice()?;
            let mut target = writable(&out, "X", &[values])?;
            let target = target.as_slice_mut()?;
            let (design, threads) = (&self.design, threads(single));
            hold.work(py, || match wanted {
                Wanted::Features => design.extract_batch(values, shape, threads, target),
                Wanted::RootMeanSquares => design.rms_batch(values, shape, threads, target),
            })
            .or_raise()?;
        }
        Ok(out.into_any())
    }
}
