//! What a model is made of, before anybody has looked at it.

use super::extraction::Features;
use super::fault::Fault;
use super::loss::{Decoding, Loss};
use super::notes::Notes;
use crate::memory::collected;
use crate::Error;

/// The largest number of classes.
pub const MAX_CLASSES: usize = 1024;

/// The largest number of samples per axis: half an hour at 500 Hz. A small file must not ask for a large window.
pub const MAX_WINDOW: usize = 1 << 20;

/// The largest number of axes.
pub const MAX_AXES: usize = 256;

/// The largest number of bins of all histograms together: their edges take 8 MB.
pub const MAX_BINS_IN_ALL: usize = 1 << 20;

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
    Bytes(&'a [[u8; 8]]),
}

impl<'a> Tensor<'a> {
    /// Numbers of a shape; whether both fit is checked with the model.
    #[must_use]
    pub fn new(shape: Vec<usize>, values: &'a [f64]) -> Self {
        Self { shape, values: Values::Numbers(values) }
    }

    pub(super) fn from_bytes(shape: Vec<usize>, bytes: &'a [u8]) -> Self {
        Self { shape, values: Values::Bytes(bytes.as_chunks().0) }
    }

    /// The shape.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The number of values, whatever the shape says.
    pub(super) fn len(&self) -> usize {
        match self.values {
            Values::Numbers(numbers) => numbers.len(),
            Values::Bytes(bytes) => bytes.len(),
        }
    }

    /// A value by its place; NaN where there is none.
    #[inline]
    pub(super) fn at(&self, index: usize) -> f64 {
        match self.values {
            Values::Numbers(numbers) => numbers.get(index).copied(),
            Values::Bytes(bytes) => bytes.get(index).map(|bytes| f64::from_le_bytes(*bytes)),
        }
        .unwrap_or(f64::NAN)
    }

    pub(super) fn to_vec(&self) -> Result<Vec<f64>, Error> {
        collected((0..self.len()).map(|index| self.at(index)))
    }

    /// Refuses a tensor of another shape.
    pub(super) fn check_shape(
        &self,
        name: &'static str,
        shape: &[usize],
        wanted: impl FnOnce() -> String,
    ) -> Result<(), Fault> {
        let len = shape.iter().try_fold(1_usize, |len, size| len.checked_mul(*size));
        if self.shape == shape && len == Some(self.len()) {
            return Ok(());
        }
        Err(Fault::Shape { name, wanted: wanted(), got: self.shape.clone() })
    }

    /// Refuses NaN and infinity.
    pub(super) fn check_finite(&self, name: &'static str) -> Result<(), Fault> {
        (0..self.len()).try_for_each(|index| self.finite(name, index).map(drop))
    }

    /// Refuses NaN, infinity, zero and negative numbers.
    pub(super) fn check_positive(&self, name: &'static str) -> Result<(), Fault> {
        self.check_finite(name)?;
        match (0..self.len()).map(|index| self.at(index)).find(|value| *value <= 0.0) {
            None => Ok(()),
            Some(got) => Err(Fault::Entry { key: name, wanted: "positive".to_owned(), got: got.to_string() }),
        }
    }

    /// A value by its place, unless it is NaN or infinite.
    #[inline]
    pub(super) fn finite(&self, name: &'static str, index: usize) -> Result<f64, Fault> {
        let value = self.at(index);
        if value.is_finite() {
            return Ok(value);
        }
        let mut left = index;
        let mut place: Vec<_> = self
            .shape
            .iter()
            .rev()
            .map(|size| {
                let part = left % (*size).max(1);
                left /= (*size).max(1);
                part
            })
            .collect();
        place.reverse();
        Err(Fault::NonFinite { name, place, value })
    }
}

/// The parts of a [`Model`](super::Model): L learners, D features, K classes.
#[derive(Clone, Debug)]
pub struct ModelParts<'a> {
    /// What is extracted from a recording.
    pub features: Features<'a>,
    /// Samples of a recording.
    pub n_samples: usize,
    /// Axes of a sample.
    pub n_axes: usize,
    /// Weights (L, D), features in the order of [`Extractor::extract`](crate::Extractor::extract) or
    /// [`MultiBand::extract_into`](crate::multiband::MultiBand::extract_into).
    pub coef: Tensor<'a>,
    /// Intercepts (L,).
    pub intercept: Tensor<'a>,
    /// Codes (K, L): -1, 0, +1.
    pub coding_matrix: Tensor<'a>,
    /// Labels of the classes.
    pub classes: Vec<String>,
    /// The binary loss.
    pub loss: Loss,
    /// By what the summed loss is divided.
    pub decoding: Decoding,
    /// Mean of the training recordings, axis by axis (`n_axes * n_samples`,): what a sample not yet seen is taken for.
    pub raw_mean: Option<Tensor<'a>>,
    /// Their smallest values, in the same order.
    pub raw_low: Option<Tensor<'a>>,
    /// Their largest values.
    pub raw_high: Option<Tensor<'a>>,
    /// Samples seen and margin needed (M, 2) for an early answer.
    pub early: Option<Tensor<'a>>,
    /// Slope and offset of the sigmoid of each learner (L, 2).
    pub sigmoid: Option<Tensor<'a>>,
    /// Sum of the weights of the training rows behind each learner (L,), for the coupling of probabilities.
    pub posterior_weights: Option<Tensor<'a>>,
    /// What describes the model; of all this only the rules are part of an answer.
    pub notes: Notes,
}
