//! What to compute: blocks, the bands that there are, and the sizes by which signals are divided.

use crate::error::{short_number, Error, Result};
use crate::memory::filled;
use crate::specs::{choices, setters};

/// Where the highest octave ends, as a share of the Nyquist frequency.
pub(super) const TOP: f64 = 0.98;

/// Cycles that the lower edge of an octave completes within a recording.
const MIN_CYCLES: f64 = 1.5;

/// Larger magnitudes, in units of the least scale of their axis, are refused. Of the longest recordings a transform is a million
/// times as large as the signal, and its square must not leave float32.
pub(super) const LARGEST: f64 = 1e12;
pub(crate) const TOO_LOUD: &str = "more than 1e12 times the scale of one of its bands";

/// Samples of a recording from which on octave 2 has half the rate. Short ones have no time to save, and lose by it.
const EARLY_SAMPLES: usize = 100;

/// Whether recordings of so many samples have octave 2 at half the rate.
pub(super) const fn halves_early(n_samples: usize) -> bool {
    n_samples >= EARLY_SAMPLES
}

/// One kind of numbers about a recording; in the order of the features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Block {
    /// How axes move together in a band, now and two samples earlier; one sample in octave 2 where it has half
    /// the rate, of recordings of 100 samples and more.
    Coupling,
    /// Quantiles and root mean square of a band.
    Quantiles,
    /// Energy of a band in four stretches of time.
    Envelope,
    /// Power over frequency, pooled.
    Spectrum,
    /// Means over sixteen stretches of time.
    Level,
}

choices! {
    Block:
    "coupling" Coupling,
    "quantiles" Quantiles,
    "envelope" Envelope,
    "spectrum" Spectrum,
    "level" Level,
}

impl Block {
    /// Samples of the shortest recording of `n_axes` axes that has the block. Of a longer one, couplings are those of the
    /// bands with so many samples; octave 2 at half the rate needs half as many and one.
    #[must_use]
    pub const fn least_samples(self, n_axes: usize) -> usize {
        match self {
            Self::Coupling => super::coupling::least_samples(n_axes, super::coupling::LAG),
            Self::Envelope => 4,
            Self::Spectrum => super::spectrum::LEAST_SAMPLES,
            Self::Quantiles | Self::Level => 1,
        }
    }
}

/// What to compute from a recording. The default is all blocks but the level, which tells sessions apart as readily as
/// materials.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct MultiBandSpec {
    /// Sampling rate in hertz. It names the bands; no feature depends on it.
    pub rate_hz: f64,
    /// Whether each block is included, in order.
    pub(super) blocks: [bool; Block::NAMED.len()],
}

impl Default for MultiBandSpec {
    fn default() -> Self {
        Self::of(500.0, |block| block != Block::Level)
    }
}

setters! { MultiBandSpec: with_rate_hz rate_hz f64, }

impl MultiBandSpec {
    /// The blocks for which `wants` is true.
    pub fn of(rate_hz: f64, wants: impl Fn(Block) -> bool) -> Self {
        Self { rate_hz, blocks: Block::NAMED.map(|(_, block)| wants(block)) }
    }

    /// True if a block is wanted.
    #[must_use]
    pub const fn wants(&self, block: Block) -> bool {
        self.blocks[block as usize]
    }

    /// True if a block is wanted that recordings of so many samples have.
    pub(super) fn has(&self, block: Block, n_samples: usize, n_axes: usize) -> bool {
        self.wants(block) && n_samples >= block.least_samples(n_axes)
    }
}

/// One band of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrequencyBand {
    /// Lower edge in hertz, 3 dB down; zero for band 0, which is the recording without its mean.
    pub low_hz: f64,
    /// Upper edge in hertz.
    pub high_hz: f64,
    /// Rate at which the band is sampled, in hertz.
    pub rate_hz: f64,
    /// Samples of the band in a whole recording.
    pub n_samples: usize,
}

/// Octaves downward from `TOP` of which the lower edge completes `MIN_CYCLES`.
pub(super) fn n_octaves(n_samples: usize) -> usize {
    let mut edge = TOP / 2.0;
    let mut octaves = 0;
    while edge * n_samples as f64 / 2.0 >= MIN_CYCLES {
        octaves += 1;
        edge /= 2.0;
    }
    octaves
}

/// Bands of a recording of so many samples: band 0 and the octaves that fit.
///
/// ```
/// use granular_id::multiband::n_bands;
///
/// assert_eq!((n_bands(1600), n_bands(1)), (10, 1));
/// ```
#[must_use]
pub fn n_bands(n_samples: usize) -> usize {
    1 + n_octaves(n_samples)
}

/// How often the rate is halved before octave `octave`, counted from 0 at the top.
pub(super) fn halvings(octave: usize, early: bool) -> u32 {
    if early && octave == 1 {
        return 1;
    }
    u32::try_from(octave.saturating_sub(1)).unwrap_or(u32::MAX)
}

/// Samples that are left of `n_samples` after halvings that each keep the first of two.
pub(super) fn halved(n_samples: usize, halvings: u32) -> usize {
    (0..halvings).fold(n_samples, |n, _| n.div_ceil(2))
}

/// The bands of a recording.
pub(super) fn bands(n_samples: usize, rate_hz: f64) -> Vec<FrequencyBand> {
    let early = halves_early(n_samples);
    let nyquist = rate_hz / 2.0;
    let whole = FrequencyBand { low_hz: 0.0, high_hz: nyquist, rate_hz, n_samples };
    let mut bands = vec![whole];
    let mut high_hz = TOP * nyquist;
    for octave in 0..n_octaves(n_samples) {
        let halvings = halvings(octave, early);
        bands.push(FrequencyBand {
            low_hz: high_hz / 2.0,
            high_hz,
            rate_hz: rate_hz / libm::exp2(halvings.into()),
            n_samples: halved(n_samples, halvings),
        });
        high_hz /= 2.0;
    }
    bands
}

/// Typical size of each band and of the level, learned from training recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Typical root mean square of each band and axis, band-major: `bands[band * n_axes + axis]`.
    pub bands: Vec<f64>,
    /// Typical magnitude of the mean over a stretch of time, axis by axis.
    pub level: Vec<f64>,
}

impl Scales {
    /// One everywhere.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn unit(n_bands: usize, n_axes: usize) -> Result<Self> {
        Ok(Self { bands: filled(1.0, n_bands.saturating_mul(n_axes))?, level: filled(1.0, n_axes)? })
    }

    /// Refuses a wrong number of scales, and scales that are not positive.
    pub(super) fn check(&self, n_samples: usize, n_axes: usize) -> Result<()> {
        let bands = n_bands(n_samples).saturating_mul(n_axes);
        for (what, expected, scales) in
            [("scales", bands, &self.bands), ("level_scales", n_axes, &self.level)]
        {
            if scales.len() != expected {
                return Err(Error::Length { what, expected, got: scales.len() });
            }
            // Half of the exponents of float64: a quotient by such a scale, and its square, stay within its range.
            if let Some(index) = scales.iter().position(|scale| !(*scale >= 1e-150 && *scale <= 1e150)) {
                let (value, band, axis) = (short_number(scales[index]), index / n_axes, index % n_axes);
                let got = format_args!("{value} for band {band}, axis {axis}");
                return Err(Error::argument(what, "be from 1e-150 to 1e150", got));
            }
        }
        Ok(())
    }
}

/// The least scale of each axis.
pub(super) fn least_scales(bands: &[f64], n_axes: usize) -> impl Iterator<Item = f64> + '_ {
    (0..n_axes).map(move |axis| bands[axis..].iter().step_by(n_axes).copied().fold(f64::INFINITY, f64::min))
}
