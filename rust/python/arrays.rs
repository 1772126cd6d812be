//! Anything array-like as a float64 array of our own, or an exception that names the argument; arrays that stay as they are.
//!
//! The rule of every binding: first whatever may run Python (conversion of arrays and scalars, new arrays, warnings), then one
//! [`Hold`] of all arrays, which may run the garbage collector, then [`readable`] and [`writable`], slices and the work. From
//! a borrow on nothing of Python's is made, so nothing of it runs; without a hold the GIL is kept.

use numpy::{
    get_array_module, BorrowError, Element, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods,
    PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyMemoryView, PyTuple, PyWeakrefReference};

use crate::arguments::{threads, GranularIdError, OrRaise};
use granular_id::bindings::{collected, reserved};
use granular_id::BatchShape;

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
    if let Some(array) = ready(value) {
        return Ok(array);
    }
    let array = real(value, name)?;
    let float64 = numpy::dtype::<f64>(value.py());
    let numpy = value.py().import("numpy")?;
    Ok(numpy.call_method1("require", (array, float64, ["C", "A"]))?.cast_into()?)
}

/// An array that needs no conversion, found without a call into numpy: a stream is pushed row by row.
fn ready<'py>(value: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArrayDyn<f64>>> {
    let array = value.cast_exact::<PyUntypedArray>().ok()?.cast::<PyArrayDyn<f64>>().ok()?;
    (is_aligned(array) && array.is_c_contiguous()).then(|| array.clone())
}

fn is_aligned<T: Element>(array: &Bound<'_, PyArrayDyn<T>>) -> bool {
    array.data().addr().is_multiple_of(align_of::<T>())
}

/// A new array of zeros; a `MemoryError` where there is no room for it.
pub(super) fn zeros<'py>(py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let arguments = (PyTuple::new(py, shape)?, numpy::dtype::<f64>(py));
    Ok(get_array_module(py)?.call_method1("zeros", arguments)?.cast_into()?)
}

/// Some numbers as a new array; a `MemoryError` where there is no room for it.
pub(super) fn copied<'py, T: Element + Copy>(
    py: Python<'py>,
    values: &[T],
) -> PyResult<Bound<'py, PyArray1<T>>> {
    Ok(PyArray1::from_vec(py, collected(values.iter().copied()).or_raise()?))
}

/// Arrays that numpy does not resize while other threads run: it refuses where a weak reference points to the owner of the
/// memory. Under an exported buffer it would not, where `refcheck` is false. Nothing guards against `__setstate__` and
/// `data`, which give an array other memory.
pub(super) struct Hold<'py> {
    /// Nothing where the GIL is kept instead.
    owners: Option<Vec<Bound<'py, PyWeakrefReference>>>,
}

impl<'py> Hold<'py> {
    /// For work without the GIL; with it, where the owner of some memory is not known.
    pub(super) fn new(arrays: &[&Bound<'py, PyAny>]) -> PyResult<Self> {
        let mut held = reserved(arrays.len()).or_raise()?;
        for array in arrays {
            match owner(array)? {
                Owner::Array(owner) => held.push(PyWeakrefReference::new(&owner)?),
                Owner::Fixed => {}
                Owner::Unknown => return Ok(Self { owners: None }),
            }
        }
        Ok(Self { owners: Some(held) })
    }

    /// For work on so many values: short work keeps the GIL, with which nobody can change an array meanwhile.
    pub(super) fn for_values(n_values: usize, arrays: &[&Bound<'py, PyAny>]) -> PyResult<Self> {
        if n_values < MANY_VALUES {
            Ok(Self { owners: None })
        } else {
            Self::new(arrays)
        }
    }

    /// Whether other threads run during the work.
    pub(super) fn detaches(&self) -> bool {
        self.owners.is_some()
    }

    /// Work on the arrays.
    pub(super) fn work<T: Send>(&self, py: Python<'py>, work: impl FnOnce() -> T + Send) -> T {
        if self.detaches() {
            py.detach(work)
        } else {
            work()
        }
    }
}

/// Work on an array of [`contiguous_real`], which is held for as many values.
pub(super) fn work_on<R: Send>(
    array: &Bound<'_, PyArrayDyn<f64>>,
    name: &str,
    n_values: usize,
    work: impl FnOnce(&[f64]) -> R + Send,
) -> PyResult<R> {
    let hold = Hold::for_values(n_values, &[array.as_any()])?;
    let values = readable(array, name)?;
    let values = values.as_slice()?;
    Ok(hold.work(array.py(), || work(values)))
}

/// Work from such an array into `out`, which must have one shape.
pub(super) fn work_into<T: Element>(
    (out, wanted): (&Bound<'_, PyArrayDyn<T>>, &[usize]),
    array: &Bound<'_, PyArrayDyn<f64>>,
    name: &str,
    n_values: usize,
    work: impl FnOnce(&[f64], &mut [T]) -> granular_id::Result<()> + Send,
) -> PyResult<()> {
    let hold = Hold::for_values(n_values, &[array.as_any(), out.as_any()])?;
    let values = readable(array, name)?;
    let values = values.as_slice()?;
    if out.shape() != wanted {
        return Err(wrong_shape("out", tuple(wanted), out.shape()));
    }
    let mut target = writable(out, name, &[values])?;
    let target = target.as_slice_mut()?;
    hold.work(out.py(), || work(values, target)).or_raise()
}

/// Where the memory of an array comes from.
enum Owner<'py> {
    /// From an array, which could be resized.
    Array(Bound<'py, PyAny>),
    /// From bytes or a mapped file.
    Fixed,
    /// From an object that may have it from anywhere.
    Unknown,
}

/// Owners behind owners: more of them than anybody makes who means well.
const MAX_OWNERS: usize = 64;

/// The last object behind an array; by numpy's own attribute, whatever a subclass makes of it.
fn owner<'py>(array: &Bound<'py, PyAny>) -> PyResult<Owner<'py>> {
    let py = array.py();
    let base_of = py.get_type::<PyUntypedArray>().getattr("base")?;
    let mut owner = array.clone();
    for _ in 0..MAX_OWNERS {
        let next = if owner.is_instance_of::<PyUntypedArray>() {
            let base = base_of.call_method1("__get__", (&owner,))?;
            if base.is_none() {
                return Ok(Owner::Array(owner));
            }
            base
        } else if owner.is_instance_of::<PyMemoryView>() {
            owner.getattr("obj")?
        } else if owner.is_instance_of::<PyBytes>()
            || owner.is_instance(&py.import("mmap")?.getattr("mmap")?)?
        {
            return Ok(Owner::Fixed);
        } else if owner.get_type().name()? == "DummyArray" {
            // What `as_strided` and `sliding_window_view` put between.
            owner.getattr("base")?
        } else {
            break;
        };
        owner = next;
    }
    Ok(Owner::Unknown)
}

/// The right to read an array of [`contiguous_real`], unless another call is writing to it.
pub(super) fn readable<'py>(
    array: &Bound<'py, PyArrayDyn<f64>>,
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let wrong =
        |what| GranularIdError::new_err(format!("{name} must not be {what} by another call meanwhile"));
    let borrowed = array.try_readonly().map_err(|_| wrong("written"))?;
    if !(is_still(array) && is_aligned(array) && array.is_c_contiguous()) {
        return Err(wrong("changed"));
    }
    Ok(borrowed)
}

/// Whether an array has the type that it had: what ran since may have given it another one.
fn is_still<T: Element>(array: &Bound<'_, PyArrayDyn<T>>) -> bool {
    array.as_untyped().cast::<PyArrayDyn<T>>().is_ok()
}

/// The right to write to `out`, if that cannot harm anyone.
pub(super) fn writable<'py, T: Element>(
    out: &Bound<'py, PyArrayDyn<T>>,
    name: &str,
    inputs: &[&[f64]],
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let borrowed = out.try_readwrite().map_err(|error| {
        GranularIdError::new_err(match error {
            BorrowError::NotWriteable => "out must be writable, got a read-only array",
            _ => "out must not be in use by another call",
        })
    });
    if !is_still(out) {
        return Err(GranularIdError::new_err("out must not be changed by another call meanwhile"));
    }
    if !out.is_c_contiguous() {
        return Err(GranularIdError::new_err("out must be C-contiguous, got a strided array"));
    }
    if !is_aligned(out) {
        return Err(GranularIdError::new_err("out must be aligned, got an array at an odd address"));
    }
    // Views of the same memory by way of different objects: the borrow above knows nothing of each other's.
    let start = out.data().addr();
    let end = start + out.len() * size_of::<T>();
    for read in inputs.iter().map(|input| input.as_ptr_range()) {
        if start < read.end.addr() && read.start.addr() < end {
            return Err(GranularIdError::new_err(format!("out must not overlap {name}")));
        }
    }
    borrowed
}

/// Recordings `(n_recordings, n_samples, n_axes)`, or a single one without the first dimension, and threads for them.
pub(super) struct Recordings<'py> {
    pub(super) array: Bound<'py, PyArrayDyn<f64>>,
    pub(super) shape: BatchShape,
    pub(super) threads: usize,
}

impl<'py> Recordings<'py> {
    /// Of any number of samples and axes, or of those that a model was trained on.
    pub(super) fn new(
        value: &Bound<'py, PyAny>,
        name: &str,
        n_threads: Option<&Bound<'py, PyAny>>,
        trained_on: Option<[usize; 2]>,
    ) -> PyResult<Self> {
        let threads = threads(n_threads)?;
        let array = contiguous_real(value, name)?;
        let shape = match *array.shape() {
            [n_samples, n_axes] => Some(BatchShape { n_recordings: 1, n_samples, n_axes }),
            [n_recordings, n_samples, n_axes] => Some(BatchShape { n_recordings, n_samples, n_axes }),
            _ => None,
        };
        let fits = |shape: &BatchShape| trained_on.is_none_or(|of| of == [shape.n_samples, shape.n_axes]);
        if let Some(shape) = shape.filter(fits) {
            let threads = threads(array.ndim() == 2);
            return Ok(Self { array, shape, threads });
        }
        let wanted = trained_on.map_or_else(
            || "(n_samples, n_axes) or (n_recordings, n_samples, n_axes), got shape".to_owned(),
            |of| tuple(&of) + ", or one more dimension in front of it, as the model was trained on, got",
        );
        Err(GranularIdError::new_err(format!("{name} must have shape {wanted} {}", tuple(array.shape()))))
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
pub(super) fn is_masked(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    value.is_instance(&value.py().import("numpy.ma")?.getattr("MaskedArray")?)
}

/// An array of real numbers of any layout and width.
fn real<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let py = value.py();
    let numpy = get_array_module(py)?;
    let array = if value.is_exact_instance_of::<PyUntypedArray>() {
        value.clone()
    } else {
        if is_masked(value)? {
            let message =
                format!("{name} must be a plain array, got a masked one: fill or drop its gaps first");
            return Err(PyTypeError::new_err(message));
        }
        as_array(&numpy, value, name)?
    };
    let untyped = array.cast::<PyUntypedArray>()?;
    let dtype = untyped.dtype();
    if !matches!(dtype.kind(), b'f' | b'i' | b'u' | b'b') {
        return Err(PyTypeError::new_err(format!("{name} must hold real numbers, got dtype {dtype}")));
    }
    Ok(array)
}

/// `numpy.asarray`, with the name of the argument in its messages.
fn as_array<'py>(
    numpy: &Bound<'py, PyModule>,
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyAny>> {
    numpy.call_method1("asarray", (value,)).map_err(|error| {
        let py = value.py();
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

/// The axis as an index from the front; numpy's `AxisError`, a `ValueError` and an `IndexError`, when there is none.
pub(super) fn axis_index(axis: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<usize> {
    let py = axis.py();
    let ndim = shape.len();
    match axis.extract::<isize>() {
        Ok(index) if index >= 0 && index.unsigned_abs() < ndim => Ok(index.unsigned_abs()),
        Ok(index) if index < 0 && index.unsigned_abs() <= ndim => Ok(ndim - index.unsigned_abs()),
        Err(error) if error.is_instance_of::<PyTypeError>(py) => {
            Err(PyTypeError::new_err(format!("axis must be an integer, got {}", axis.get_type())))
        }
        Err(error) if !error.is_instance_of::<PyOverflowError>(py) => Err(error),
        _ => {
            let message = format!(
                "axis must be in [{}, {ndim}) for x of shape {}, got {axis}",
                -signed(ndim),
                tuple(shape)
            );
            let module = py.import("numpy.exceptions").or_else(|_| py.import("numpy"))?;
            Err(PyErr::from_value(module.getattr("AxisError")?.call1((message,))?))
        }
    }
}

fn signed(ndim: usize) -> i64 {
    i64::try_from(ndim).unwrap_or(i64::MAX)
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
