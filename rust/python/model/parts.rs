//! Parts of a model as Python gives them.

use std::collections::BTreeMap;

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyString;

use super::super::arrays::{contiguous_real, readable};
use super::super::scalars::shown;
use super::errors::bad_part;
use crate::model::{Notes, Tensor};

/// An array that nobody writes meanwhile, and its name.
pub(super) struct Borrowed<'py>(PyReadonlyArrayDyn<'py, f64>);

impl<'py> Borrowed<'py> {
    pub(super) fn new(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        Ok(Self(readable(&contiguous_real(value, name)?, name)?))
    }

    pub(super) fn tensor(&self) -> PyResult<Tensor<'_>> {
        Ok(Tensor::new(self.0.shape().to_vec(), self.0.as_slice()?))
    }
}

pub(super) fn labels(classes: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    let wrong = || PyTypeError::new_err(format!("classes must be a sequence of str, got {}", shown(classes)));
    if classes.is_instance_of::<PyString>() {
        return Err(wrong());
    }
    let labels = classes.try_iter().map_err(|_| wrong())?;
    labels.map(|label| label?.extract::<String>().map_err(|_| wrong())).collect()
}

/// The notes of a mapping, the others as they are without one.
pub(super) fn notes(n_axes: usize, metadata: Option<&Bound<'_, PyAny>>) -> PyResult<Notes> {
    let Some(metadata) = metadata else { return Ok(Notes::of_axes(n_axes)) };
    let texts: BTreeMap<String, String> = metadata.extract().map_err(|_| {
        PyTypeError::new_err(format!("metadata must be a dict of str to str, got {}", shown(metadata)))
    })?;
    Notes::of_axes(n_axes).with(texts).map_err(bad_part)
}
