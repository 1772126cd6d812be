//! Filter design and filtering: unpack, call, map the error.

use numpy::{PyArray, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arguments::{named, owned_real, tuple, work, wrong_shape, GranularIdError, OrRaise};
use granular_id::{AlongAxis, Band, Result, Sos};

/// A float64 array of any rank.
type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Butterworth design; a single edge for low-pass and high-pass, two for the others.
#[pyfunction]
pub(super) fn butter<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = named::order)] order: usize,
    band: &str,
    low_hz: f64,
    high_hz: f64,
    rate_hz: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let band = match band {
        "lowpass" => Band::Lowpass(low_hz),
        "highpass" => Band::Highpass(low_hz),
        "bandpass" => Band::Bandpass(low_hz, high_hz),
        "bandstop" => Band::Bandstop(low_hz, high_hz),
        other => {
            return Err(GranularIdError::new_err(format!("band must be the name of a band, got {other:?}")))
        }
    };
    let sos = granular_id::butterworth(order, band, rate_hz).or_raise()?;
    let rows: Vec<f64> = sos.sections().iter().flat_map(granular_id::dsp::Section::row).collect();
    PyArray::from_vec(py, rows).reshape([sos.sections().len(), 6])
}

/// Filters along an axis; with `zi`, returns the final states too.
#[pyfunction]
#[pyo3(signature = (sos, x, axis, zi))]
pub(super) fn sosfilt<'py>(
    py: Python<'py>,
    sos: &Bound<'py, PyAny>,
    x: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = named::axis)] axis: isize,
    zi: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Array<'py>, Option<Array<'py>>)> {
    let sos = sections(sos)?;
    let (y, axis, along) = signal(x, axis)?;
    let Some(zi) = zi else {
        filter(py, &y, |y| granular_id::sosfilt(&sos, y, along))?;
        return Ok((y, None));
    };
    let zf = owned_real(zi, "zi")?;
    let mut wanted = y.shape().to_vec();
    wanted[axis] = 2;
    wanted.insert(0, sos.sections().len());
    if zf.shape() != wanted {
        let (of, n) = (tuple(y.shape()), sos.sections().len());
        let wanted = format!("{} for x of shape {of} along axis {axis} with {n} sections", tuple(&wanted));
        return Err(wrong_shape("Invalid zi shape: zi", wanted, zf.shape()));
    }
    let mut borrowed = zf.try_readwrite()?;
    let z = borrowed.as_slice_mut()?;
    filter(py, &y, |y| granular_id::sosfilt_from(&sos, y, along, z))?;
    drop(borrowed);
    Ok((y, Some(zf)))
}

/// Steady state of a constant input of one, per section.
#[pyfunction]
pub(super) fn sosfilt_zi<'py>(sos: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let py = sos.py();
    let states = sections(sos)?.steady_state().or_raise()?;
    let n = states.len();
    PyArray::from_vec(py, states.into_flattened()).reshape([n, 2])
}

/// Rows of coefficients, checked; a single section may come as one row.
fn sections(value: &Bound<'_, PyAny>) -> PyResult<Sos> {
    let array = owned_real(value, "sos")?;
    if !matches!(array.shape(), [6] | [_, 6]) {
        return Err(wrong_shape("sos", "(n_sections, 6)", array.shape()));
    }
    let array = array.try_readonly()?;
    Sos::new(array.as_slice()?.as_chunks().0).or_raise()
}

/// A copy of the signal to filter in place, its axis, and the view from there.
fn signal<'py>(x: &Bound<'py, PyAny>, axis: isize) -> PyResult<(Array<'py>, usize, AlongAxis)> {
    let x = owned_real(x, "x")?;
    if x.ndim() == 0 {
        return Err(GranularIdError::new_err("x must be at least 1-D, got a single number"));
    }
    let (ndim, shape) = (x.ndim(), tuple(x.shape()));
    let index = if axis < 0 { ndim.checked_add_signed(axis) } else { Some(axis.unsigned_abs()) };
    let along = index.and_then(|index| Some((index, AlongAxis::new(x.shape(), index)?)));
    let outside = || format!("axis must be in [-{ndim}, {ndim}) for x of shape {shape}, got {axis}");
    let (index, along) = along.ok_or_else(|| GranularIdError::new_err(outside()))?;
    Ok((x, index, along))
}

/// Runs a filter on an array of our own, without the GIL when that pays.
fn filter(py: Python<'_>, y: &Array<'_>, run: impl FnOnce(&mut [f64]) -> Result<()> + Send) -> PyResult<()> {
    let mut borrowed = y.try_readwrite()?;
    let y = borrowed.as_slice_mut()?;
    work(py, y.len(), || run(y)).or_raise()
}
