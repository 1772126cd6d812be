//! Energy of each signal in a few stretches of time: what the envelope, the size of a signal and its scale are made of.

use std::ops::Range;

use super::band_signals::BandSignals;
use crate::kernel::{Pack, Quad};

/// Stretches of time, as equal as whole samples allow.
pub(super) const STRETCHES: usize = 4;

/// Partial sums per energy.
const LANES: usize = 8;

/// Signals at a time: one alone would wait for its own additions.
const SIGNALS: usize = 3;

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
pub(super) fn measure<V: Quad>(signals: BandSignals<'_>, out: &mut [Energies]) {
    let n_axes = signals.n_axes();
    for (band, out) in out.chunks_exact_mut(n_axes).enumerate() {
        for (group, out) in out.chunks_mut(SIGNALS).enumerate() {
            // Where there are fewer axes, the last is measured more than once.
            let mut axes = [&[][..]; SIGNALS];
            for (i, axis) in axes.iter_mut().enumerate() {
                *axis = signals.axis(band, (group * SIGNALS + i).min(n_axes - 1));
            }
            for i in 0..STRETCHES {
                let range = stretch(i, signals.len(band));
                let [a, b, c] = axes;
                let sums = sums_of_squares::<V>([&a[range.clone()], &b[range.clone()], &c[range]]);
                for (energies, sum) in out.iter_mut().zip(sums) {
                    energies[i] = sum;
                }
            }
        }
    }
}

/// Each of eight partial sums.
#[inline(always)]
fn sums_of_squares<V: Quad>([a, b, c]: [&[f64]; SIGNALS]) -> [f64; SIGNALS] {
    let zero = V::splat(0.0);
    let mut sums = [[zero; 2]; SIGNALS];
    let [(a, rest_a), (b, rest_b), (c, rest_c)] = [a.as_chunks(), b.as_chunks(), c.as_chunks::<LANES>()];
    for ((a, b), c) in a.iter().zip(b).zip(c) {
        for (sums, eight) in sums.iter_mut().zip([a, b, c]) {
            let (x, y) = (V::load(eight), V::load(&eight[LANES / 2..]));
            sums[0] = sums[0] + x * x;
            sums[1] = sums[1] + y * y;
        }
    }
    let mut out = [0.0; SIGNALS];
    for ((out, sums), rest) in out.iter_mut().zip(sums).zip([rest_a, rest_b, rest_c]) {
        let mut lanes = Pack::<LANES>::ZERO;
        sums[0].store(&mut lanes.0);
        sums[1].store(&mut lanes.0[LANES / 2..]);
        for (sum, z) in lanes.0.iter_mut().zip(rest) {
            *sum += z * z;
        }
        *out = lanes.sum();
    }
    out
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
        measure::<Pack<4>>(signals.view(), &mut energies);
        assert_eq!(energies, [[1.0, 4.0, 9.0, 17.0], [0.0, 0.0, 0.0, 9.0]]);
        assert_eq!(mean_square(&energies[0], 5), 6.2);
    }

    #[test]
    fn every_sample_counts_once() {
        let signals = Signals::new(&[1000, 61, 9], 2);
        let mut energies = [[f64::NAN; STRETCHES]; 6];
        measure::<Pack<4>>(signals.view(), &mut energies);
        for (index, energies) in energies.iter().enumerate() {
            let all: f64 = signals.view().numbered(index).iter().map(|z| z * z).sum();
            assert!((energies.iter().sum::<f64>() - all).abs() < 1e-13 * all);
        }
    }
}
