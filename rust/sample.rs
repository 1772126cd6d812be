//! Features as float64, or as float32 to halve their memory.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::extract::not_finite;
use crate::features::{BatchShape, Extractor};
use crate::pool;

/// A number that features can be stored as.
pub trait Sample: Copy + Send {
    /// Extracts a batch into numbers of this type; see [`Extractor::extract_as`].
    fn extract(
        extractor: &Extractor,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [Self],
    ) -> Result<()>;
}

impl Extractor {
    /// [`extract_into`](Self::extract_into) for float64 or float32 features.
    pub fn extract_as<T: Sample>(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [T],
    ) -> Result<()> {
        T::extract(self, wrench, shape, threads, out)
    }
}

impl Sample for f64 {
    fn extract(
        extractor: &Extractor,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [Self],
    ) -> Result<()> {
        extractor.extract_into(wrench, shape, threads, out)
    }
}

impl Sample for f32 {
    /// Histograms in float64, rounded once; samples rounded on their way, so that no wide copy of them is made.
    fn extract(
        extractor: &Extractor,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [Self],
    ) -> Result<()> {
        let n_features = extractor.check(wrench, shape)?;
        let expected = shape.n_recordings.saturating_mul(n_features);
        if out.len() != expected {
            return Err(Error::Length { what: "out", expected, got: out.len() });
        }
        let raw_len = if extractor.spec().raw { shape.recording_len() } else { 0 };
        let hfmh_len = n_features - raw_len;
        let mut hfmh = vec![0.0; shape.n_recordings * hfmh_len];
        if extractor.spec().hfmh {
            extractor.without_raw().extract_into(wrench, shape, threads, &mut hfmh)?;
        } else if threads == 0 {
            return Err(Error::Threads { threads });
        }
        let one = |(recording, row): (usize, &mut [f32])| {
            let samples = &wrench[recording * shape.recording_len()..][..raw_len];
            let (raw, counts) = row.split_at_mut(raw_len);
            for (axis, raw) in raw.chunks_exact_mut(shape.n_samples).enumerate() {
                narrow(recording, samples.iter().skip(axis).step_by(shape.n_axes), raw)?;
            }
            narrow(recording, &hfmh[recording * hfmh_len..][..hfmh_len], counts)
        };
        if threads == 1 {
            out.chunks_exact_mut(n_features).enumerate().try_for_each(one)
        } else {
            pool::install(threads, || out.par_chunks_exact_mut(n_features).enumerate().try_for_each(one))
        }
        .map_err(|error| {
            if wrench.iter().all(|value| value.is_finite()) {
                error
            } else {
                not_finite(wrench, shape)
            }
        })
    }
}

/// Rounds numbers to float32; refuses those that it cannot hold.
fn narrow<'a>(recording: usize, wide: impl IntoIterator<Item = &'a f64>, narrow: &mut [f32]) -> Result<()> {
    for (narrow, wide) in narrow.iter_mut().zip(wide) {
        #[allow(clippy::cast_possible_truncation)] // what was asked for
        let rounded = *wide as f32;
        if !rounded.is_finite() {
            return Err(Error::Narrow { recording, value: *wide });
        }
        *narrow = rounded;
    }
    Ok(())
}
