//! The wrench buffer and its writing end, and rows as Python gives them.

mod reader;

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{
    get_array_module, PyArrayDescrMethods, PyArrayDyn, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::arguments::{
    contiguous_real, named, optional, readable, shown, whole, word, wrong_shape, GranularIdError, OrRaise,
};
use granular_id::bindings::{filled, reserved, short_number};
use granular_id::buffer::{self, wrench_buffer, BufferSpec, DeviceClock, Fill, Pushed, Reader, Writer};
use granular_id::wrench::KNOWN_FLAGS;

pub(super) use reader::{PyBlock, PyWindow, PyWrenchReader, WindowError};

/// The newest seconds of a sensor, of six axes or of others: one writer, any number of readers, the oldest rows overwritten.
///
/// Parameters
/// ----------
/// seconds : float, default 10
///     Time that the rows reach back; ``capacity`` is seconds times rate, rounded up. The default holds three recordings of
///     the paper's length.
/// rate_hz : float, default 500
///     Nominal rate of the rows: gaps are counted in its periods.
/// tick_hz : float, default 1e9
///     Ticks per second of the device's clock; times are stored as whole ticks. Nanoseconds suit most; a sensor that counts
///     its own samples has the rate of those.
/// reorder_depth : int, default 0
///     Rows that wait for a late one at most. With 0 nothing ever waits, and a row that comes after a later one is dropped
///     and counted.
/// n_axes : int, default 6
///     Values of a row, from 1 to 64. Six are a wrench.
///
/// Raises
/// ------
/// TypeError, ValueError
///     If an argument has the wrong type or is out of range; the message names it.
///
/// Notes
/// -----
/// All memory is taken at once; pushing never waits for a reader. Device time is the axis: rows leave in strictly
/// increasing time within an epoch. A time more than a second before the newest, or the eighth late row in a row, begins a
/// new epoch: the device has started again. No block and no window spans two epochs.
///
/// Any thread may push (one at a time goes in), unless a sensor owns the buffer.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from granular_id import WrenchBuffer
/// >>> buffer = WrenchBuffer(seconds=2.0, rate_hz=500.0)
/// >>> buffer.push_block(np.zeros((10, 6)), np.arange(10) / 500)
/// 10
/// >>> buffer.push([0.1, 0.0, -5.2, 0.0, 0.0, 0.0])
/// True
/// >>> buffer.window(4).wrench[:, 2].tolist()
/// [0.0, 0.0, 0.0, -5.2]
/// >>> buffer.latest().time_s
/// array([0.02])
#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pyclass(frozen, name = "WrenchBuffer", module = "granular_id.live")]
pub(crate) struct PyWrenchBuffer {
    reader: Reader,
    input: Mutex<Input>,
}

/// The writing end, which Python has unless a sensor of the core does.
struct Input {
    /// Nothing while a sensor has it.
    writer: Option<Writer>,
    clock: DeviceClock,
}

impl Input {
    fn writing(&mut self) -> PyResult<(&mut Writer, &mut DeviceClock)> {
        let writer = self.writer.as_mut().ok_or_else(sensor_writes)?;
        Ok((writer, &mut self.clock))
    }
}

#[allow(clippy::doc_markdown)] // numpydoc, read by Python
#[pymethods]
impl PyWrenchBuffer {
    #[new]
    #[pyo3(signature = (seconds=10.0, *, rate_hz=500.0, tick_hz=1e9, reorder_depth=0, n_axes=6))]
    fn new(
        #[pyo3(from_py_with = named::seconds)] seconds: f64,
        #[pyo3(from_py_with = named::rate_hz)] rate_hz: f64,
        #[pyo3(from_py_with = named::tick_hz)] tick_hz: f64,
        #[pyo3(from_py_with = named::reorder_depth)] reorder_depth: usize,
        #[pyo3(from_py_with = named::n_axes)] n_axes: usize,
    ) -> PyResult<Self> {
        let spec = BufferSpec::default()
            .with_seconds(seconds)
            .with_rate_hz(rate_hz)
            .with_tick_hz(tick_hz)
            .with_reorder_depth(reorder_depth)
            .with_n_axes(n_axes);
        let (writer, reader) = wrench_buffer(spec).or_raise()?;
        let input = Input { writer: Some(writer), clock: DeviceClock::new(&spec) };
        Ok(Self { reader, input: Mutex::new(input) })
    }

    /// Take in one row.
    ///
    /// Parameters
    /// ----------
    /// wrench : array_like of shape (n_axes,)
    ///     Of six axes: forces in N, then torques in N m.
    /// t : float, optional
    ///     Device time in seconds, not negative. One period after the last row by default; 0 for the first of an epoch.
    /// flags : int, default 0
    ///     Bits of `granular_id.SampleFlag`.
    /// host_ns : int, optional
    ///     Arrival by ``host_ns()``; now by default.
    ///
    /// Returns
    /// -------
    /// bool
    ///     True if the row was taken (written, or held for a late one before it); False if it was dropped, and counted in
    ///     ``stats()``: as a duplicate, late, or with a value that is NaN or infinite.
    ///
    /// Raises
    /// ------
    /// TypeError, ValueError
    ///     If an argument has the wrong type, shape or range.
    /// RuntimeError
    ///     If a sensor is writing.
    #[pyo3(signature = (wrench, t=None, *, flags=0, host_ns=None))]
    fn push(
        &self,
        wrench: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = optional::t)] t: Option<f64>,
        #[pyo3(from_py_with = flags_of_one)] flags: u8,
        #[pyo3(from_py_with = optional::host_ns)] host_ns: Option<u64>,
    ) -> PyResult<bool> {
        // Everything from Python is read before the lock is taken: it may run code that pushes too.
        let array = contiguous_real(wrench, "wrench")?;
        let host_ns = host_ns.unwrap_or_else(buffer::host_ns);
        let ticks = t.map(|t| number_of_ticks(t, self.tick_hz(), None)).transpose()?;
        let array = one_wrench(&array, self.n_axes())?;
        let wrench = array.as_slice()?;
        let mut input = self.input();
        let (writer, clock) = input.writing()?;
        let ticks = clock.ticks(ticks, writer);
        Ok(matches!(
            writer.push(&buffer::Row { ticks, host_ns, wrench, flags }),
            Pushed::Written | Pushed::Held
        ))
    }

    /// Take in several rows.
    ///
    /// Parameters
    /// ----------
    /// wrench : array_like of shape (n, n_axes)
    ///     Of six axes: forces in N, then torques in N m, row by row. Any layout and width; C-ordered float64 is read in place.
    /// t : array_like of shape (n,), optional
    ///     Device times in seconds, not negative. One period apart after the last row by default.
    /// flags : int or array_like of shape (n,), optional
    ///     Bits of `granular_id.SampleFlag`, for all rows or for each.
    /// host_ns : int or array_like of shape (n,), optional
    ///     Arrival by ``host_ns()``, of all rows or of each; now by default.
    ///
    /// Returns
    /// -------
    /// int
    ///     Rows written by this call; rows that waited for a late one count when they are written.
    ///
    /// Raises
    /// ------
    /// TypeError, ValueError
    ///     If an argument has the wrong type, shape or range; no row has been taken then.
    /// RuntimeError
    ///     If a sensor is writing.
    #[pyo3(signature = (wrench, t=None, *, flags=None, host_ns=None))]
    fn push_block(
        &self,
        wrench: &Bound<'_, PyAny>,
        t: Option<&Bound<'_, PyAny>>,
        flags: Option<&Bound<'_, PyAny>>,
        host_ns: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<u64> {
        let rows = Rows::new(wrench, t, flags, host_ns, self.reader.spec())?;
        let mut input = self.input();
        let (writer, clock) = input.writing()?;
        let before = self.reader.stats().written;
        for row in rows.given()? {
            let ticks = clock.ticks(row.ticks, writer);
            writer.push(&buffer::Row { ticks, host_ns: row.host_ns, wrench: row.wrench, flags: row.flags });
        }
        Ok(self.reader.stats().written - before)
    }

    /// Begin a new epoch, unless the present one has no rows: device time may start anywhere.
    fn new_epoch(&self) -> PyResult<()> {
        self.input().writing()?.0.new_epoch();
        Ok(())
    }

    /// Write all rows that wait for a late one: none will come any more.
    fn flush(&self) -> PyResult<()> {
        self.input().writing()?.0.flush();
        Ok(())
    }

    /// The newest row as a block of one, or None before the first.
    fn latest(&self, py: Python<'_>) -> PyResult<Option<PyBlock>> {
        self.reader.clone().latest().map(|row| PyBlock::one(py, &row, self.tick_hz())).transpose()
    }

    /// The last instants up to the newest row, as a copy.
    ///
    /// Parameters
    /// ----------
    /// n : int
    ///     Instants, one period apart, with or without a row; at most ``capacity``.
    /// fill : {"none", "nan", "linear"}, default "none"
    ///     What stands for an instant without a row: nothing (the window has fewer rows than instants), NaN, or a straight
    ///     line between its neighbours with the flag GAP_FILLED.
    /// max_gap : int, default 0
    ///     Longest gap, in instants, that the window may touch. None by default: nothing is invented unasked.
    /// allow_saturated : bool, default False
    ///     Whether rows at the end of the sensor's range are taken.
    ///
    /// Returns
    /// -------
    /// Window
    ///     Arrays of their own, which rows to come do not change.
    ///
    /// Raises
    /// ------
    /// WindowError
    ///     A ValueError with the reason why there is no such window: too few rows, a longer gap, a new epoch, saturation.
    /// TypeError, ValueError
    ///     If an argument has the wrong type or is out of range.
    #[pyo3(signature = (n, *, fill="none", max_gap=0, allow_saturated=false))]
    fn window(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = named::n)] n: usize,
        fill: &str,
        #[pyo3(from_py_with = named::max_gap)] max_gap: u32,
        allow_saturated: bool,
    ) -> PyResult<PyWindow> {
        let spec = buffer::WindowSpec::whole(n)
            .with_fill(word(fill, "fill", &Fill::NAMED)?)
            .with_max_gap(max_gap)
            .with_allow_saturated(allow_saturated);
        let window = py.detach(|| self.reader.window(&spec)).or_raise()?;
        PyWindow::new(py, window, self.reader.spec())
    }

    /// A reader with a place of its own.
    ///
    /// Parameters
    /// ----------
    /// from_oldest : bool, default False
    ///     Whether it begins with the rows already there, oldest first; else with the next one.
    ///
    /// Returns
    /// -------
    /// WrenchReader
    #[pyo3(signature = (from_oldest=false))]
    fn reader(&self, from_oldest: bool) -> PyWrenchReader {
        PyWrenchReader::new(if from_oldest { self.reader.from_oldest() } else { self.reader.from_now() })
    }

    /// Seconds since the newest row would have arrived without any delay; NaN before the first row.
    ///
    /// Device time is mapped to host time by the lower envelope of (host - device), so a delay on the way shows even while
    /// rows keep coming. Parameter ``now_ns``: a moment by ``host_ns()``, the present one by default.
    #[pyo3(signature = (now_ns=None))]
    fn lag_s(&self, #[pyo3(from_py_with = optional::now_ns)] now_ns: Option<u64>) -> f64 {
        let now_ns = now_ns.unwrap_or_else(buffer::host_ns);
        self.reader.lag_ns(now_ns).map_or(f64::NAN, |lag_ns| lag_ns / 1e9)
    }

    /// Device time in seconds at a moment by ``host_ns()``, in the newest epoch; NaN before the first row.
    fn device_time_s(&self, #[pyo3(from_py_with = named::host_ns)] host_ns: u64) -> f64 {
        self.reader.ticks_at(host_ns).map_or(f64::NAN, |ticks| ticks / self.reader.spec().tick_hz)
    }

    /// What happened to the rows so far: counts by name.
    ///
    /// ``written``; ``held`` (waiting now); dropped ones: ``duplicates`` (device time was there already), ``late``,
    /// ``non_finite``; ``reordered`` (came late, put in order); ``gaps`` and ``missing``
    /// (instants in them); ``epochs`` (new beginnings after the first); ``saturated`` and ``bad_status`` (written with that
    /// flag).
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.reader.stats().named().into_py_dict(py)
    }

    /// Nominal rate of the rows.
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.reader.spec().rate_hz
    }

    /// Time that the rows reach back.
    #[getter]
    fn seconds(&self) -> f64 {
        self.reader.spec().seconds
    }

    /// Rows the buffer holds.
    #[getter]
    fn capacity(&self) -> usize {
        self.reader.capacity()
    }

    /// Ticks per second of the device's clock.
    #[getter]
    fn tick_hz(&self) -> f64 {
        self.reader.spec().tick_hz
    }

    /// Rows that wait for a late one at most.
    #[getter]
    fn reorder_depth(&self) -> usize {
        self.reader.spec().reorder_depth
    }

    /// Values of a row.
    #[getter]
    fn n_axes(&self) -> usize {
        self.reader.spec().n_axes
    }

    fn __repr__(&self) -> String {
        let BufferSpec { rate_hz, seconds, tick_hz, reorder_depth, n_axes, .. } = self.reader.spec();
        let rates = format!("rate_hz={rate_hz:?}, tick_hz={tick_hz:?}");
        format!("WrenchBuffer({seconds:?}, {rates}, reorder_depth={reorder_depth}, n_axes={n_axes})")
    }
}

impl PyWrenchBuffer {
    /// The writer, for a sensor that pushes from a thread of its own; pushing from Python is refused until
    /// [`give_back`](Self::give_back). An error when another sensor has it.
    pub(crate) fn take_writer(&self) -> PyResult<Writer> {
        self.input().writer.take().ok_or_else(sensor_writes)
    }

    /// Takes the writer back from a sensor that has stopped; rows that wait are written.
    pub(crate) fn give_back(&self, mut writer: Writer) {
        writer.flush();
        self.input().writer = Some(writer);
    }

    /// Locked for moments only and never without the GIL, so that no fork finds it locked. Nothing that runs under this lock
    /// panics half-way.
    fn input(&self) -> MutexGuard<'_, Input> {
        self.input.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn sensor_writes() -> PyErr {
    PyRuntimeError::new_err("a sensor is writing to this buffer: stop it before you push rows")
}

/// Ticks that a time may reach.
const MOST_TICKS: f64 = (1_u64 << 63) as f64;

/// One row whose time may still be missing.
struct GivenRow<'a> {
    wrench: &'a [f64],
    ticks: Option<u64>,
    flags: u8,
    host_ns: u64,
}

/// Several rows, checked, which nothing else may write to.
struct Rows<'py> {
    wrench: PyReadonlyArrayDyn<'py, f64>,
    n_axes: usize,
    ticks: Option<Vec<u64>>,
    flags: Vec<u8>,
    host_ns: Vec<u64>,
}

impl<'py> Rows<'py> {
    fn new(
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
        let flags = flags_of_rows(flags, n_rows)?;
        let host_ns = match host_ns {
            Some(value) if is_one_per_row(value)? => host_times(value, n_rows)?,
            Some(one) => filled(named::host_ns(one)?, n_rows).or_raise()?,
            None => filled(buffer::host_ns(), n_rows).or_raise()?,
        };
        let wrench = readable(&wrench, "wrench")?;
        check_length(&wrench.shape()[..1], n_rows, "wrench")?;
        Ok(Self { wrench, n_axes, ticks, flags, host_ns })
    }

    fn given(&self) -> PyResult<impl Iterator<Item = GivenRow<'_>> + '_> {
        let Self { wrench, n_axes, ticks, flags, host_ns } = self;
        Ok(wrench.as_slice()?.chunks_exact(*n_axes).enumerate().map(move |(row, wrench)| GivenRow {
            wrench,
            ticks: ticks.as_ref().map(|ticks| ticks[row]),
            flags: flags[row],
            host_ns: host_ns[row],
        }))
    }
}

/// The values of one row, in an array of [`contiguous_real`].
fn one_wrench<'py>(
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
fn number_of_ticks(t: f64, tick_hz: f64, row: Option<usize>) -> PyResult<u64> {
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
fn flags_of_one(value: &Bound<'_, PyAny>) -> PyResult<u8> {
    let flags = whole(value, "flags")?;
    if flags & !KNOWN_FLAGS != 0 {
        return Err(GranularIdError::new_err(format!(
            "flags must be made of the bits of SampleFlag, from 0 to {KNOWN_FLAGS}, got {}",
            shown(value)
        )));
    }
    Ok(flags)
}

fn flags_of_rows(value: Option<&Bound<'_, PyAny>>, n_rows: usize) -> PyResult<Vec<u8>> {
    let value = match value {
        None => return filled(0, n_rows).or_raise(),
        Some(one) if !is_one_per_row(one)? => return filled(flags_of_one(one)?, n_rows).or_raise(),
        Some(value) => value,
    };
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
    checked(n_rows, array.as_slice()?.iter().enumerate().map(known))
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
