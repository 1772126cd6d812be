//! Rows as Python gives them.

use numpy::{
    get_array_module, PyArrayDescrMethods, PyArrayDyn, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::arguments::{named, shown, whole, GranularIdError, OrRaise};
use crate::arrays::{contiguous_real, readable, wrong_shape};
use granular_id::bindings::{reserved, short_number};
use granular_id::buffer::{self, BufferSpec};
use granular_id::wrench::KNOWN_FLAGS;

/// Ticks that a time may reach.
const MOST_TICKS: f64 = (1_u64 << 63) as f64;

/// One row whose time may still be missing.
pub(super) struct GivenRow<'a> {
    pub(super) wrench: &'a [f64],
    pub(super) ticks: Option<u64>,
    pub(super) flags: u8,
    pub(super) host_ns: u64,
}

/// Several rows, checked, which nothing else may write to.
pub(super) struct Rows<'py> {
    wrench: PyReadonlyArrayDyn<'py, f64>,
    n_axes: usize,
    ticks: Option<Vec<u64>>,
    flags: Each<u8>,
    host_ns: Each<u64>,
}

/// One value for all rows, or one for each.
enum Each<T> {
    All(T),
    Row(Vec<T>),
}

impl<T: Copy> Each<T> {
    fn at(&self, row: usize) -> T {
        match self {
            Self::All(value) => *value,
            Self::Row(values) => values[row],
        }
    }
}

impl<'py> Rows<'py> {
    pub(super) fn new(
        wrench: &Bound<'py, PyAny>,
        t: Option<&Bound<'py, PyAny>>,
        flags: Option<&Bound<'py, PyAny>>,
        host_ns: Option<&Bound<'py, PyAny>>,
        spec: &BufferSpec,
    ) -> PyResult<Self> {
        let wrench = contiguous_real(wrench, "wrench")?;
        let &BufferSpec { tick_hz, n_axes, .. } = spec;
        let n_rows = match *wrench.shape() {
            [n_rows, n] if n == n_axes => n_rows,
            ref shape => return Err(wrong_shape("wrench", format_args!("(n, {n_axes})"), shape)),
        };
        let ticks = t.map(|t| times(t, n_rows, tick_hz)).transpose()?;
        let flags = flags.map_or(Ok(Each::All(0)), |flags| flags_of_rows(flags, n_rows))?;
        let host_ns = match host_ns {
            Some(value) if is_one_per_row(value)? => Each::Row(host_times(value, n_rows)?),
            Some(one) => Each::All(named::host_ns(one)?),
            None => Each::All(buffer::host_ns()),
        };
        let wrench = readable(&wrench, "wrench")?;
        check_length(&wrench.shape()[..1], n_rows, "wrench")?;
        Ok(Self { wrench, n_axes, ticks, flags, host_ns })
    }

    pub(super) fn given(&self) -> PyResult<impl Iterator<Item = GivenRow<'_>> + '_> {
        let Self { wrench, n_axes, ticks, flags, host_ns } = self;
        Ok(wrench.as_slice()?.chunks_exact(*n_axes).enumerate().map(move |(row, wrench)| GivenRow {
            wrench,
            ticks: ticks.as_ref().map(|ticks| ticks[row]),
            flags: flags.at(row),
            host_ns: host_ns.at(row),
        }))
    }
}

/// The values of one row, in an array of [`contiguous_real`].
pub(super) fn one_wrench<'py>(
    array: &Bound<'py, PyArrayDyn<f64>>,
    n_axes: usize,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = readable(array, "wrench")?;
    if array.shape() == [n_axes] {
        return Ok(array);
    }
    Err(wrong_shape("wrench", format_args!("({n_axes},)"), array.shape()))
}

/// A time in seconds as ticks; `row` names it where there are several.
pub(super) fn number_of_ticks(t: f64, tick_hz: f64, row: Option<usize>) -> PyResult<u64> {
    let ticks = (t * tick_hz).round();
    if (0.0..MOST_TICKS).contains(&ticks) {
        // Whole, not negative and below 2^63.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        return Ok(ticks as u64);
    }
    let place = row.map_or_else(String::new, |row| format!(" at row {row}"));
    let most = MOST_TICKS / tick_hz;
    Err(GranularIdError::new_err(format!(
        "t must be from 0 to {most:e} seconds, got {}{place}",
        short_number(t)
    )))
}

fn times(t: &Bound<'_, PyAny>, n_rows: usize, tick_hz: f64) -> PyResult<Vec<u64>> {
    let array = contiguous_real(t, "t")?;
    check_length(array.shape(), n_rows, "t")?;
    let array = readable(&array, "t")?;
    let ticks = array.as_slice()?.iter().enumerate();
    checked(n_rows, ticks.map(|(row, t)| number_of_ticks(*t, tick_hz, Some(row))))
}

/// Values of all rows, or the first error.
fn checked<T>(n_rows: usize, values: impl Iterator<Item = PyResult<T>>) -> PyResult<Vec<T>> {
    let mut all = reserved(n_rows).or_raise()?;
    for value in values {
        all.push(value?);
    }
    Ok(all)
}

/// Arrivals of many rows: integers stay exact, as float64 would not keep them.
fn host_times(value: &Bound<'_, PyAny>, n_rows: usize) -> PyResult<Vec<u64>> {
    let py = value.py();
    let array = get_array_module(py)?.call_method1("asarray", (value,))?;
    let untyped = array.cast::<PyUntypedArray>()?;
    if !matches!(untyped.dtype().kind(), b'i' | b'u') && !untyped.shape().contains(&0) {
        let dtype = untyped.dtype();
        return Err(PyTypeError::new_err(format!("host_ns must hold integers, got dtype {dtype}")));
    }
    check_length(untyped.shape(), n_rows, "host_ns")?;
    let is_signed = untyped.dtype().kind() == b'i';
    // Unsigned ones beyond the range wrap around, and back again.
    let times: PyReadonlyArray1<'_, i64> = array.call_method1("astype", ("int64",))?.extract()?;
    let unsigned = |(row, time): (usize, &i64)| {
        if is_signed && *time < 0 {
            let message = format!("host_ns must not be negative, got {time} at row {row}");
            return Err(GranularIdError::new_err(message));
        }
        Ok(time.cast_unsigned())
    };
    checked(n_rows, times.as_array().iter().enumerate().map(unsigned))
}

/// The flags of one row.
pub(super) fn flags_of_one(value: &Bound<'_, PyAny>) -> PyResult<u8> {
    let flags = whole(value, "flags")?;
    if flags & !KNOWN_FLAGS != 0 {
        return Err(GranularIdError::new_err(format!(
            "flags must be made of the bits of SampleFlag, from 0 to {KNOWN_FLAGS}, got {}",
            shown(value)
        )));
    }
    Ok(flags)
}

fn flags_of_rows(value: &Bound<'_, PyAny>, n_rows: usize) -> PyResult<Each<u8>> {
    if !is_one_per_row(value)? {
        return Ok(Each::All(flags_of_one(value)?));
    }
    let array = contiguous_real(value, "flags")?;
    check_length(array.shape(), n_rows, "flags")?;
    let array = readable(&array, "flags")?;
    let known = |(row, flag): (usize, &f64)| {
        // Known flags are few whole numbers: every one is found, and nothing else is.
        #[allow(clippy::float_cmp)]
        let found = (0..=KNOWN_FLAGS).find(|known| f64::from(*known) == *flag);
        found.ok_or_else(|| {
            GranularIdError::new_err(format!(
                "flags must be made of the bits of SampleFlag, from 0 to {KNOWN_FLAGS}, got {flag} at row {row}"
            ))
        })
    };
    Ok(Each::Row(checked(n_rows, array.as_slice()?.iter().enumerate().map(known))?))
}

/// True for a sequence or array; false for a single value, also in an array without dimensions.
fn is_one_per_row(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    match value.cast::<PyUntypedArray>() {
        Ok(array) => Ok(array.ndim() > 0),
        Err(_) => value.hasattr("__len__"),
    }
}

fn check_length(shape: &[usize], n_rows: usize, name: &str) -> PyResult<()> {
    if shape == [n_rows] {
        return Ok(());
    }
    Err(wrong_shape(name, format_args!("({n_rows},), one per row of wrench"), shape))
}
