//! What Python gives, or an exception that names the argument: single values, anything array-like as a float64 array, the
//! rights to read and write arrays; errors of the core as exceptions.
//!
//! The rule of every binding: first whatever may run Python (conversion of arrays and scalars, new arrays, warnings), then
//! [`readable`] and [`writable`], slices and the work. From a borrow on nothing of Python's is made, so nothing of it runs in
//! this thread. As in numpy, an array must not be resized by another thread meanwhile.

use granular_id::bindings::{collected, cores};
use granular_id::{BatchShape, Error};
use numpy::{
    get_array_module, BorrowError, Element, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods,
    PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

create_exception!(
    granular_id,
    GranularIdError,
    PyValueError,
    "Input that granular_id refuses: a ValueError whose message names the argument or file, and what is \
     wanted.\n\nAll refusals of values are of this class or one below it, so that one ``except`` separates them from bugs."
);

/// An error of the core that Python can raise.
pub(super) trait Raise {
    fn raise(self) -> PyErr;
}

impl Raise for Error {
    fn raise(self) -> PyErr {
        let message = self.to_string();
        match self {
            Self::Memory { .. } => PyMemoryError::new_err(message),
            _ => GranularIdError::new_err(message),
        }
    }
}

/// `work().or_raise()?` in a function that answers to Python.
pub(super) trait OrRaise<T> {
    fn or_raise(self) -> PyResult<T>;
}

impl<T, E: Raise> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(Raise::raise)
    }
}

/// A value of a type, or an exception that names the argument; what the value's own code raised stays.
fn converted<T>(value: &Bound<'_, PyAny>, name: &str, wanted: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    value.extract().map_err(|error: PyErr| {
        let py = value.py();
        let message = || format!("{name} must be {wanted}, got {}", shown(value));
        if error.is_instance_of::<PyTypeError>(py) {
            PyTypeError::new_err(message())
        } else if error.is_instance_of::<PyOverflowError>(py) || error.is_instance_of::<PyValueError>(py) {
            GranularIdError::new_err(message())
        } else {
            error
        }
    })
}

/// A real number.
pub(super) fn number(value: &Bound<'_, PyAny>, name: &str) -> PyResult<f64> {
    converted(value, name, "a real number that float64 can hold")
}

/// A whole number.
pub(super) fn whole<T>(value: &Bound<'_, PyAny>, name: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'a, Error = PyErr>,
{
    converted(value, name, &format!("an integer from 0 to 2^{} - 1", 8 * size_of::<T>()))
}

fn index(value: &Bound<'_, PyAny>, name: &str) -> PyResult<isize> {
    converted(value, name, "an integer")
}

/// A number of things.
fn count(value: &Bound<'_, PyAny>, name: &str) -> PyResult<usize> {
    let wanted = "an integer of at least 1";
    match converted(value, name, wanted)? {
        0 => Err(GranularIdError::new_err(format!("{name} must be {wanted}, got 0"))),
        count => Ok(count),
    }
}

macro_rules! converters {
    (optional: $($convert:ident $type:ty: $($name:ident)*;)*) => {$($(
        pub(crate) fn $name(value: &Bound<'_, PyAny>) -> PyResult<Option<$type>> {
            (!value.is_none()).then(|| super::$convert(value, stringify!($name))).transpose()
        }
    )*)*};
    ($($convert:ident $type:ty: $($name:ident)*;)*) => {$($(
        pub(crate) fn $name(value: &Bound<'_, PyAny>) -> PyResult<$type> {
            super::$convert(value, stringify!($name))
        }
    )*)*}
}

/// Converters for `from_py_with`, each called as its argument: by itself `PyO3` raises an `OverflowError` without a name
/// for a negative count.
pub(super) mod named {
    use pyo3::prelude::*;

    converters! {
        number f64: rate_hz cutoff_hz seconds tick_hz timeout_s;
        whole u64: host_ns;
        whole u32: max_gap;
        whole usize: reorder_depth;
        index isize: axis;
        count usize: n n_axes n_bins n_samples max_file_bytes order;
    }
}

/// The same where None is a value.
pub(super) mod optional {
    use pyo3::prelude::*;

    converters! {
        optional:
        number f64: t;
        whole u64: host_ns now_ns;
        count usize: hop max_rows n_axes n_samples threads;
    }
}

/// One of some words.
pub(super) fn word<T: Copy>(value: &str, name: &str, words: &[(&str, T)]) -> PyResult<T> {
    words.iter().find(|(word, _)| value == *word).map(|(_, meaning)| *meaning).ok_or_else(|| {
        let (wanted, start) =
            (granular_id::bindings::listed(words), value.chars().take(60).collect::<String>());
        GranularIdError::new_err(format!("{name} must be {wanted}, got {start:?}"))
    })
}

/// What `__getnewargs_ex__` gives: attributes as positional arguments and as keywords, both by their names.
pub(super) fn new_arguments<'py>(
    object: &Bound<'py, PyAny>,
    positional: &str,
    keywords: &str,
) -> NewArguments<'py> {
    let py = object.py();
    let positional = positional.split_whitespace().map(|name| object.getattr(name));
    let positional = PyTuple::new(py, positional.collect::<PyResult<Vec<_>>>()?)?;
    let given = PyDict::new(py);
    for keyword in keywords.split_whitespace() {
        given.set_item(keyword, object.getattr(keyword)?)?;
    }
    Ok((positional, given))
}

/// Arguments with which an object can be made again.
pub(super) type NewArguments<'py> = PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)>;

/// How Python shows a value and its type; only the type where the value is long or cannot be shown.
pub(super) fn shown(value: &Bound<'_, PyAny>) -> String {
    let kind = value.get_type().name().map_or_else(|_| "object".to_owned(), |name| name.to_string());
    let text = value.repr();
    match text.as_ref().map(|text| text.to_str()) {
        Ok(Ok(text)) if text.chars().take(61).count() <= 60 => format!("{text} ({kind})"),
        _ => kind,
    }
}

/// Values of an array from which on other threads of Python run meanwhile: some 40 microseconds of work. Handing the GIL
/// over takes a tenth of one, getting it back from a thread that is busy takes up to 5 ms.
const MANY_VALUES: usize = 1 << 14;

/// A C-ordered, aligned float64 copy of real numbers that nothing else refers to: safe to change without the GIL.
pub(super) fn owned_real<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let py = value.py();
    let keywords = PyDict::new(py);
    keywords.set_item("dtype", numpy::dtype::<f64>(py))?;
    keywords.set_item("order", "C")?;
    let array = real(value, name)?;
    Ok(get_array_module(py)?.call_method("array", (array,), Some(&keywords))?.cast_into()?)
}

/// Real numbers as a C-ordered, aligned float64 array: the caller's own where it is one, else a copy.
pub(super) fn contiguous_real<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    // Without a call into numpy where nothing is converted: a stream is pushed row by row.
    if let Some(array) = value.cast_exact::<PyUntypedArray>().ok().and_then(|array| array.cast().ok()) {
        if is_aligned(array) && array.is_c_contiguous() {
            return Ok(array.clone());
        }
    }
    let array = real(value, name)?;
    let float64 = numpy::dtype::<f64>(value.py());
    let numpy = value.py().import("numpy")?;
    Ok(numpy.call_method1("require", (array, float64, ["C", "A"]))?.cast_into()?)
}

fn is_aligned<T: Element>(array: &Bound<'_, PyArrayDyn<T>>) -> bool {
    array.data().addr().is_multiple_of(align_of::<T>())
}

/// A new array of zeros; a `MemoryError` where there is no room for it.
pub(super) fn zeros<'py>(py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    Ok(get_array_module(py)?.call_method1("zeros", (PyTuple::new(py, shape)?,))?.cast_into()?)
}

/// Some numbers as a new array; a `MemoryError` where there is no room for it.
pub(super) fn copied<'py, T: Element + Copy>(
    py: Python<'py>,
    values: &[T],
) -> PyResult<Bound<'py, PyArray1<T>>> {
    Ok(PyArray1::from_vec(py, collected(values.iter().copied()).or_raise()?))
}

/// Work on so many values: short work keeps the GIL.
pub(super) fn work<T: Send>(py: Python<'_>, n_values: usize, work: impl FnOnce() -> T + Send) -> T {
    if n_values < MANY_VALUES {
        work()
    } else {
        py.detach(work)
    }
}

/// Work from an array of [`contiguous_real`] into `out`, which must have one shape.
pub(super) fn work_into(
    (out, wanted): (&Bound<'_, PyArrayDyn<f64>>, &[usize]),
    array: &Bound<'_, PyArrayDyn<f64>>,
    name: &str,
    run: impl FnOnce(&[f64], &mut [f64]) -> granular_id::Result<()> + Send,
) -> PyResult<()> {
    let values = readable(array, name)?;
    let values = values.as_slice()?;
    let mut target = writable(out, wanted, name, values)?;
    let target = target.as_slice_mut()?;
    work(out.py(), values.len().max(target.len()), || run(values, target)).or_raise()
}

/// The right to read an array of [`contiguous_real`], unless another call is writing to it.
pub(super) fn readable<'py>(
    array: &Bound<'py, PyArrayDyn<f64>>,
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let wrong =
        |what| GranularIdError::new_err(format!("{name} must not be {what} by another call meanwhile"));
    let borrowed = array.try_readonly().map_err(|_| wrong("written"))?;
    if is_still(array) && array.is_c_contiguous() {
        return Ok(borrowed);
    }
    Err(wrong("changed"))
}

/// True if an array has the type that it had: what ran since may have given it another one.
fn is_still(array: &Bound<'_, PyArrayDyn<f64>>) -> bool {
    array.as_untyped().cast::<PyArrayDyn<f64>>().is_ok()
}

/// The right to write to `out`, if it has the shape `wanted` and shares no memory with `input`, which is called `name`.
pub(super) fn writable<'py>(
    out: &Bound<'py, PyArrayDyn<f64>>,
    wanted: &[usize],
    name: &str,
    input: &[f64],
) -> PyResult<PyReadwriteArrayDyn<'py, f64>> {
    if out.shape() != wanted {
        return Err(wrong_shape("out", tuple(wanted), out.shape()));
    }
    let refused = |problem| Err(GranularIdError::new_err(format!("out must {problem}")));
    // Views of the same memory by way of different objects: one borrow does not exclude the other.
    let (start, read) = (out.data().addr(), input.as_ptr_range());
    if start < read.end.addr() && read.start.addr() < start + out.len() * size_of::<f64>() {
        return refused(format!("not overlap {name}"));
    }
    if !is_still(out) {
        return refused("not be changed by another call meanwhile".to_owned());
    }
    if !out.is_c_contiguous() {
        return refused("be C-contiguous, got a strided array".to_owned());
    }
    if !is_aligned(out) {
        return refused("be aligned, got an array at an odd address".to_owned());
    }
    match out.try_readwrite() {
        Ok(borrowed) => Ok(borrowed),
        Err(BorrowError::NotWriteable) => refused("be writable, got a read-only array".to_owned()),
        Err(_) => refused("not be in use by another call".to_owned()),
    }
}

/// An array to write to, called `out`; a new one where there is none.
pub(super) fn output<'py>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let Some(out) = out else { return zeros(py, shape) };
    if is_masked(out)? {
        return Err(PyTypeError::new_err("out must be a plain array, got a masked one"));
    }
    out.cast::<PyArrayDyn<f64>>().cloned().map_err(|_| {
        let got = out
            .cast::<PyUntypedArray>()
            .map_or_else(|_| out.get_type().to_string(), |out| out.dtype().to_string());
        PyTypeError::new_err(format!("out must be a float64 array in native byte order, got {got}"))
    })
}

/// Recordings `(n_recordings, n_samples, n_axes)`, or a single one without the first dimension, and threads for them.
pub(super) struct Recordings<'py> {
    pub(super) array: Bound<'py, PyArrayDyn<f64>>,
    pub(super) shape: BatchShape,
    pub(super) threads: usize,
}

impl<'py> Recordings<'py> {
    /// Of any number of samples and axes, or of those that a model was trained on. All cores by default, and one thread for
    /// a single recording.
    pub(super) fn new(
        value: &Bound<'py, PyAny>,
        name: &str,
        threads: Option<usize>,
        trained_on: Option<[usize; 2]>,
    ) -> PyResult<Self> {
        let array = contiguous_real(value, name)?;
        let shape = match *array.shape() {
            [n_samples, n_axes] => Some(BatchShape { n_recordings: 1, n_samples, n_axes }),
            [n_recordings, n_samples, n_axes] => Some(BatchShape { n_recordings, n_samples, n_axes }),
            _ => None,
        };
        let fits = |shape: &BatchShape| trained_on.is_none_or(|of| of == [shape.n_samples, shape.n_axes]);
        if let Some(shape) = shape.filter(fits) {
            let threads = threads.unwrap_or_else(|| if array.ndim() == 2 { 1 } else { cores() });
            return Ok(Self { array, shape, threads });
        }
        let wanted = trained_on.map_or_else(
            || "(n_samples, n_axes) or (n_recordings, n_samples, n_axes)".to_owned(),
            |of| tuple(&of) + ", or one more dimension in front of it, as the model was trained on",
        );
        Err(wrong_shape(name, wanted, array.shape()))
    }

    /// Shape of results of which each recording has a row.
    pub(super) fn rows(&self, row: &[usize]) -> Vec<usize> {
        if self.array.ndim() == 2 {
            row.to_vec()
        } else {
            [&[self.shape.n_recordings], row].concat()
        }
    }
}

/// True for numpy's masked arrays, whose gaps a plain array would show as numbers.
fn is_masked(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    value.is_instance(&value.py().import("numpy.ma")?.getattr("MaskedArray")?)
}

/// An array of real numbers of any layout and width.
fn real<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let array = if value.is_exact_instance_of::<PyUntypedArray>() {
        value.clone()
    } else {
        if is_masked(value)? {
            let message =
                format!("{name} must be a plain array, got a masked one: fill or drop its gaps first");
            return Err(PyTypeError::new_err(message));
        }
        as_array(value, name)?
    };
    let dtype = array.cast::<PyUntypedArray>()?.dtype();
    if !matches!(dtype.kind(), b'f' | b'i' | b'u' | b'b') {
        return Err(PyTypeError::new_err(format!("{name} must hold real numbers, got dtype {dtype}")));
    }
    Ok(array)
}

/// `numpy.asarray`, with the name of the argument in its messages.
fn as_array<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let py = value.py();
    get_array_module(py)?.call_method1("asarray", (value,)).map_err(|error| {
        let message = format!("{name} must be an array of real numbers, got {}: {error}", value.get_type());
        let named = if error.is_instance_of::<PyTypeError>(py) {
            PyTypeError::new_err(message)
        } else if error.is_instance_of::<PyValueError>(py) {
            GranularIdError::new_err(message)
        } else {
            return error;
        };
        named.set_cause(py, Some(error));
        named
    })
}

/// An array of another shape than is wanted.
pub(super) fn wrong_shape(name: &str, wanted: impl std::fmt::Display, got: &[usize]) -> PyErr {
    GranularIdError::new_err(format!("{name} must have shape {wanted}, got {}", tuple(got)))
}

/// A shape as Python writes it.
pub(super) fn tuple(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}
