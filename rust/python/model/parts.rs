//! Parts of a model as Python gives them.

use std::collections::BTreeMap;

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;

use super::super::multiband::PyMultiBandExtractor;
use super::super::scalars::shown;
use super::super::spec::PyFeatureSpec;
use super::errors::bad_part;
use granular_id::model::{Features, Notes, Tensor};

/// What is extracted, of either kind.
pub(super) enum Spec<'a, 'py> {
    Additive(&'a Bound<'py, PyFeatureSpec>),
    MultiBand(&'a Bound<'py, PyMultiBandExtractor>),
}

impl<'a, 'py> Spec<'a, 'py> {
    pub(super) fn of(value: &'a Bound<'py, PyAny>) -> PyResult<Self> {
        if let Ok(spec) = value.cast() {
            return Ok(Self::Additive(spec));
        }
        let wrong = |_| {
            let got = shown(value);
            PyTypeError::new_err(format!("spec must be a FeatureSpec or a MultiBandExtractor, got {got}"))
        };
        Ok(Self::MultiBand(value.cast().map_err(wrong)?))
    }

    /// Samples and axes of a recording, where it knows them.
    pub(super) fn shape(&self) -> Option<(usize, usize)> {
        match self {
            Self::Additive(_) => None,
            Self::MultiBand(spec) => Some((spec.get().design.n_samples(), spec.get().design.n_axes())),
        }
    }

    /// Refuses recordings of another shape.
    pub(super) fn check_shape(&self, n_samples: usize, n_axes: usize) -> PyResult<()> {
        match self.shape() {
            Some((own_samples, own_axes)) if (own_samples, own_axes) != (n_samples, n_axes) => {
                Err(PyValueError::new_err(format!(
                    "spec is for {own_samples} samples of {own_axes} axes, got n_samples = {n_samples}, n_axes = {n_axes}"
                )))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn features(&self) -> Features<'_> {
        match self {
            Self::Additive(spec) => spec.get().extractor.spec().clone().into(),
            Self::MultiBand(spec) => {
                let design = &spec.get().design;
                let (scales, n_axes) = (design.scales(), design.n_axes());
                let levels = || Tensor::new(vec![n_axes], &scales.level);
                Features::MultiBand {
                    spec: *design.spec(),
                    band_scales: Tensor::new(vec![design.n_bands(), n_axes], &scales.bands),
                    level_scales: design.spec().level.then(levels),
                }
            }
        }
    }
}

/// The numbers of an array that is borrowed.
pub(super) fn tensor<'a>(array: &'a PyReadonlyArrayDyn<'_, f64>) -> PyResult<Tensor<'a>> {
    Ok(Tensor::new(array.shape().to_vec(), array.as_slice()?))
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
