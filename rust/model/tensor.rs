//! Numbers of a model before they are checked: those of a caller, or as they lie in a file.

use std::fmt::Display;

use super::ModelError;
use crate::error::Error;
use crate::memory::collected;

/// Numbers with a shape, the last index fastest. Borrowed: models are large, and what is checked is copied once.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor<'a> {
    shape: Vec<usize>,
    values: Values<'a>,
}

#[derive(Clone, Debug, PartialEq)]
enum Values<'a> {
    Numbers(&'a [f64]),
    /// Little-endian float64 at any address.
    Doubles(&'a [[u8; 8]]),
    /// Little-endian float32 at any address.
    Singles(&'a [[u8; 4]]),
}

impl<'a> Tensor<'a> {
    /// Numbers of a shape; whether both fit is checked with the model.
    #[must_use]
    pub fn new(shape: Vec<usize>, values: &'a [f64]) -> Self {
        Self { shape, values: Values::Numbers(values) }
    }

    pub(super) fn of_doubles(shape: Vec<usize>, bytes: &'a [u8]) -> Self {
        Self { shape, values: Values::Doubles(bytes.as_chunks().0) }
    }

    pub(super) fn of_singles(shape: Vec<usize>, bytes: &'a [u8]) -> Self {
        Self { shape, values: Values::Singles(bytes.as_chunks().0) }
    }

    /// The shape.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The number of values, which need not fit the shape.
    pub(super) fn len(&self) -> usize {
        match self.values {
            Values::Numbers(numbers) => numbers.len(),
            Values::Doubles(bytes) => bytes.len(),
            Values::Singles(bytes) => bytes.len(),
        }
    }

    /// A value by its place; NaN where there is none.
    #[inline]
    pub(super) fn at(&self, index: usize) -> f64 {
        match self.values {
            Values::Numbers(numbers) => numbers.get(index).copied(),
            Values::Doubles(bytes) => bytes.get(index).map(|bytes| f64::from_le_bytes(*bytes)),
            Values::Singles(bytes) => bytes.get(index).map(|bytes| f32::from_le_bytes(*bytes).into()),
        }
        .unwrap_or(f64::NAN)
    }

    /// A value by its place, unless it is NaN or infinite.
    #[inline]
    pub(super) fn finite(&self, name: &str, index: usize) -> Result<f64, ModelError> {
        let value = self.at(index);
        if value.is_finite() {
            return Ok(value);
        }
        let (mut left, mut place) = (index, self.shape.clone());
        for size in place.iter_mut().rev() {
            let n = (*size).max(1);
            (*size, left) = (left % n, left / n);
        }
        Err(ModelError::must_be(format!("{name}{place:?}"), "finite", value))
    }

    pub(super) fn to_vec(&self) -> Result<Vec<f64>, Error> {
        collected((0..self.len()).map(|index| self.at(index)))
    }

    pub(super) fn to_pairs(&self) -> Result<Vec<[f64; 2]>, Error> {
        collected((0..self.len() / 2).map(|row| [self.at(2 * row), self.at(2 * row + 1)]))
    }

    pub(super) fn check_shape(
        &self,
        name: &str,
        shape: &[usize],
        wanted: impl Display,
    ) -> Result<(), ModelError> {
        let len = shape.iter().try_fold(1_usize, |len, size| len.checked_mul(*size));
        if self.shape == shape && len == Some(self.len()) {
            return Ok(());
        }
        Err(ModelError::part(name, format!("must have shape {wanted}, got {:?}", self.shape)))
    }

    pub(super) fn check_finite(&self, name: &str) -> Result<(), ModelError> {
        (0..self.len()).try_for_each(|index| self.finite(name, index).map(drop))
    }

    pub(super) fn check_positive(&self, name: &str) -> Result<(), ModelError> {
        self.check_finite(name)?;
        match (0..self.len()).map(|index| self.at(index)).find(|value| *value <= 0.0) {
            None => Ok(()),
            Some(got) => Err(ModelError::must_be(name, "positive", got)),
        }
    }
}
