//! Which octaves there are, and at what rate each is sampled.

use crate::dsp::{butterworth, Band};
use crate::error::Result;

/// Where the highest octave ends, as a share of the Nyquist frequency.
const TOP: f64 = 0.98;

/// Cycles that the lower edge of an octave completes within a recording.
const MIN_CYCLES: f64 = 1.5;

/// Order of the low-pass in front of every halving of the rate. What lies at 0.755 to 0.878 of Nyquist folds onto the octave
/// that is taken next; there the low-pass is down by 55 dB or more.
const HALVING_ORDER: usize = 7;

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
pub(super) fn halvings(octave: usize) -> u32 {
    u32::try_from(octave.saturating_sub(1)).unwrap_or(u32::MAX)
}

/// Samples that are left of `n_samples` after halvings that each keep the first of two.
pub(super) fn halved(n_samples: usize, halvings: u32) -> usize {
    (0..halvings).fold(n_samples, |n, _| n.div_ceil(2))
}

/// The bands of a recording.
pub(super) fn bands(n_samples: usize, rate_hz: f64) -> Vec<FrequencyBand> {
    let nyquist = rate_hz / 2.0;
    let whole = FrequencyBand { low_hz: 0.0, high_hz: nyquist, rate_hz, n_samples };
    let mut bands = vec![whole];
    let mut high_hz = TOP * nyquist;
    for octave in 0..n_octaves(n_samples) {
        let halvings = halvings(octave);
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

/// Two pairs of poles and the gain of a filter whose zeros are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Poles {
    /// `a1` and `a2` of each pair: `1 + a1 z^-1 + a2 z^-2`.
    pub(super) pairs: [[f64; 2]; 2],
    /// Factor of the numerator.
    pub(super) gain: f64,
}

/// The three filters of the pyramid; the same at every level, for frequencies are relative to its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Filters {
    /// The highest octave; zeros at 0 and Nyquist, twice each.
    pub(super) top: Poles,
    /// The octave below; zeros likewise.
    pub(super) octave: Poles,
    /// Before the rate is halved: `(A(a0) A(a2) + z^-1 A(a1)) / 2` with all-passes `A(a) = (a + z^-2) / (1 + a z^-2)`.
    pub(super) halving: [f64; 3],
}

impl Filters {
    pub(super) fn new() -> Result<Self> {
        let band_pass = |high: f64| poles(2, Band::Bandpass(high / 2.0, high));
        Ok(Self { top: band_pass(TOP)?, octave: band_pass(TOP / 2.0)?, halving: all_passes()? })
    }
}

/// A Butterworth low-pass of odd order that ends at half the Nyquist frequency has its poles on the imaginary axis, so that
/// it is the sum of two chains of all-passes in `z^-2`, one of them a sample later (Gazsi, "Explicit formulas for lattice
/// wave digital filters", 1985). The poles take turns.
fn all_passes() -> Result<[f64; 3]> {
    let sos = butterworth(HALVING_ORDER, Band::Lowpass(0.5), 2.0)?;
    let mut squares: Vec<_> = sos.sections().iter().map(|section| section.a2).collect();
    squares.sort_by(f64::total_cmp);
    // The first is the pole at zero.
    Ok([squares[1], squares[2], squares[3]])
}

/// A design with edges as shares of the Nyquist frequency.
fn poles(order: usize, band: Band) -> Result<Poles> {
    let sos = butterworth(order, band, 2.0)?;
    let mut poles = Poles { pairs: [[0.0; 2]; 2], gain: 1.0 };
    for (pair, section) in poles.pairs.iter_mut().zip(sos.sections()) {
        *pair = [section.a1, section.a2];
        poles.gain *= section.b0;
    }
    Ok(poles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numerators_are_those_of_the_designs() {
        let filters = Filters::new().unwrap();
        let designs = [
            (2, Band::Bandpass(TOP / 2.0, TOP), filters.top, [1.0, 0.0, -2.0, 0.0, 1.0]),
            (2, Band::Bandpass(TOP / 4.0, TOP / 2.0), filters.octave, [1.0, 0.0, -2.0, 0.0, 1.0]),
        ];
        for (order, band, poles, zeros) in designs {
            let sos = butterworth(order, band, 2.0).unwrap();
            assert_eq!(sos.sections().len(), 2);
            let [p, q] = [sos.sections()[0], sos.sections()[1]].map(|s| [s.b0, s.b1, s.b2]);
            for (power, zero) in zeros.iter().enumerate() {
                let product: f64 =
                    (0..3).filter(|i| (*i..i + 3).contains(&power)).map(|i| p[i] * q[power - i]).sum();
                assert!((product - poles.gain * zero).abs() < 1e-12 * poles.gain, "{band:?} {power}");
            }
        }
    }

    #[test]
    fn all_passes_are_the_low_pass() {
        let sos = butterworth(HALVING_ORDER, Band::Lowpass(0.5), 2.0).unwrap();
        let mut impulse = [0.0; 40];
        impulse[0] = 1.0;
        let mut expected = impulse;
        for s in sos.sections() {
            let (mut z0, mut z1) = (0.0, 0.0);
            for x in &mut expected {
                let y = s.b0 * *x + z0;
                (z0, z1) = (s.b1 * *x - s.a1 * y + z1, s.b2 * *x - s.a2 * y);
                *x = y;
            }
        }
        let all_pass = |a: f64, x: [f64; 40]| {
            let mut y = [0.0; 40];
            for t in 0..40 {
                let before = |values: &[f64; 40]| if t < 2 { 0.0 } else { values[t - 2] };
                y[t] = a * x[t] + before(&x) - a * before(&y);
            }
            y
        };
        let [a0, a1, a2] = all_passes().unwrap();
        let (first, second) = (all_pass(a2, all_pass(a0, impulse)), all_pass(a1, impulse));
        for t in 1..40 {
            assert!((expected[t] - 0.5 * (first[t] + second[t - 1])).abs() < 1e-15, "{t}");
        }
    }

    #[test]
    fn octaves_of_short_and_long_recordings() {
        let expected = [(1, 0), (6, 0), (7, 1), (12, 1), (13, 2), (85, 4), (1600, 9), (100_000, 14)];
        for (n_samples, octaves) in expected {
            assert_eq!(n_octaves(n_samples), octaves, "{n_samples}");
        }
        let bands = bands(1600, 500.0);
        assert_eq!(bands.len(), 10);
        assert_eq!((bands[1].low_hz, bands[1].high_hz, bands[2].rate_hz), (122.5, 245.0, 500.0));
        assert_eq!((bands[9].n_samples, bands[9].rate_hz), (13, 500.0 / 128.0));
    }
}
