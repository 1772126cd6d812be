//! Multi-band features: what a signal does in each octave, and how its axes move together there.
//!
//! A pyramid of band-passes (`bank`) splits a recording into octaves; of each band, blocks of numbers say how its axes are
//! coupled (`coupling`), how their values are distributed (`quantiles`), and how their energy goes through the recording
//! (`envelope`, which has the level, too); one more holds the whole spectrum (`spectrum`, with its window function).
//! `tests/python/multiband_twin.py` is the same in plain numpy.
//!
//! ```
//! use granular_id::multiband::{MultiBand, MultiBandSpec, Scales};
//!
//! let (n_samples, n_axes) = (1600, 6);
//! let multi_band = MultiBand::new(MultiBandSpec::default(), n_samples, n_axes, &Scales::unit(10, n_axes)?)?;
//! let mut work = multi_band.workspace()?;
//! let mut features = vec![0.0; multi_band.n_features()];
//! multi_band.extract_into(&vec![0.0; n_samples * n_axes], &mut work, &mut features)?;
//! assert_eq!(multi_band.names()?[0], "b0_coupling_fx_fx");
//! # Ok::<(), granular_id::Error>(())
//! ```

mod bank;
mod coupling;
mod envelope;
mod extractor;
mod quantiles;
mod spec;
mod spectrum;
#[cfg(test)]
mod tests;

use crate::kernel::{Job, Simd};

pub use extractor::{MultiBand, Workspace};
pub(crate) use spec::TOO_LOUD;
pub use spec::{n_bands, Block, FrequencyBand, MultiBandSpec, Scales};

/// The float32 nearest to a number.
#[allow(clippy::cast_possible_truncation)] // the purpose
#[inline(always)]
fn narrow(x: f64) -> f32 {
    x as f32
}

/// Numbers of float32 that are calculated with as one.
const LANES: usize = 8;

/// The signals of all bands of one recording, divided by their scales: band 0 is the recording without its mean, then
/// octave after octave downward, each at a rate of its own.
#[derive(Clone, Copy, Debug)]
struct BandSignals<'a> {
    values: &'a [f32],
    regions: &'a [Region],
    n_axes: usize,
}

/// Where the signals of one band lie, axis after axis.
#[derive(Clone, Copy, Debug)]
struct Region {
    /// Index of the first sample of the first axis.
    start: usize,
    /// From the first sample of one axis to that of the next.
    stride: usize,
    /// Samples of each axis.
    len: usize,
}

impl<'a> BandSignals<'a> {
    /// Samples of a band.
    #[inline(always)]
    fn len(&self, band: usize) -> usize {
        self.regions[band].len
    }

    /// Signals in the order of bands, then of axes.
    #[inline(always)]
    fn numbered(&self, index: usize) -> &'a [f32] {
        self.axis(index / self.n_axes, index % self.n_axes)
    }

    /// One axis of a band, in time order.
    #[inline(always)]
    fn axis(&self, band: usize, axis: usize) -> &'a [f32] {
        let Region { start, stride, len } = self.regions[band];
        &self.values[start + axis * stride..][..len]
    }
}

/// A recording that has been split into bands.
#[derive(Clone, Copy, Debug)]
struct Split<'a> {
    rows: &'a [f64],
    signals: BandSignals<'a>,
    energies: &'a [envelope::Energies],
}

/// What a block is computed by.
trait Statistic {
    /// What one thread needs to compute it.
    type Work;

    fn n_features(&self) -> usize;

    fn work(&self) -> Self::Work;

    /// Allocates nothing.
    fn compute(&self, simd: impl Simd, split: Split<'_>, work: &mut Self::Work, out: &mut [f64]);
}

/// A statistic, compiled for every path.
struct Compute<'a, S: Statistic> {
    statistic: &'a S,
    split: Split<'a>,
    work: &'a mut S::Work,
    out: &'a mut [f64],
}

impl<S: Statistic> Job for Compute<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<I: Simd>(self, simd: I) {
        self.statistic.compute(simd, self.split, self.work, self.out);
    }
}
