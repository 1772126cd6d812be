//! Energy of each signal in a few stretches of time: what the envelope, the size of a signal and its scale are made of.

use std::ops::Range;

use super::bank::BandSignals;
use super::pack::Pack;

/// Stretches of time, as equal as whole samples allow.
pub(super) const STRETCHES: usize = 4;

/// Partial sums per energy.
const LANES: usize = 8;

/// Sums of the squares of one signal.
pub(super) type Energies = [f64; STRETCHES];

/// Samples of stretch `i` of `n` samples; there may be none.
#[inline(always)]
pub(super) fn stretch(i: usize, n: usize) -> Range<usize> {
    i * n / STRETCHES..(i + 1) * n / STRETCHES
}

/// The mean square of a signal of `n` samples.
#[inline(always)]
pub(super) fn mean_square(energies: &Energies, n: usize) -> f64 {
    energies.iter().sum::<f64>() / n as f64
}

/// Energies of all signals, band by band, axis by axis.
#[inline(always)]
pub(super) fn measure(signals: BandSignals<'_>, out: &mut [Energies]) {
    for (index, energies) in out.iter_mut().enumerate() {
        let signal = signals.numbered(index);
        for (i, energy) in energies.iter_mut().enumerate() {
            *energy = sum_of_squares(&signal[stretch(i, signal.len())]);
        }
    }
}

#[inline(always)]
fn sum_of_squares(signal: &[f64]) -> f64 {
    let mut sums = Pack::<LANES>::ZERO;
    let (chunks, rest) = signal.as_chunks::<LANES>();
    for z in chunks {
        sums = sums + Pack(*z) * Pack(*z);
    }
    for (sum, z) in sums.0.iter_mut().zip(rest) {
        *sum += z * z;
    }
    sums.sum()
}

#[cfg(test)]
mod tests {
    use super::super::signals::Signals;
    use super::*;

    #[test]
    fn stretches_are_as_equal_as_samples_allow() {
        // 1, 1, 1 and 2 samples; 0, 0, 0 and 1.
        let signals = Signals::from(vec![vec![vec![1.0, 2.0, 3.0, 4.0, 1.0]], vec![vec![3.0]]]);
        let mut energies = [[f64::NAN; STRETCHES]; 2];
        measure(signals.view(), &mut energies);
        assert_eq!(energies, [[1.0, 4.0, 9.0, 17.0], [0.0, 0.0, 0.0, 9.0]]);
        assert_eq!(mean_square(&energies[0], 5), 6.2);
    }

    #[test]
    fn every_sample_counts_once() {
        let signals = Signals::new(&[1000, 61, 9], 2);
        let mut energies = [[f64::NAN; STRETCHES]; 6];
        measure(signals.view(), &mut energies);
        for (index, energies) in energies.iter().enumerate() {
            let all: f64 = signals.view().numbered(index).iter().map(|z| z * z).sum();
            assert!((energies.iter().sum::<f64>() - all).abs() < 1e-13 * all);
        }
    }
}
