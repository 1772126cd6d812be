//! Size over time: the energy of each band in a few stretches, and coarse means of the recording itself.

use std::ops::Range;

use super::{BandSignals, Split, Statistic, LANES};
use crate::kernel::{Pack, Simd};

/// Stretches of time, as equal as whole samples allow.
pub(super) const STRETCHES: usize = 4;

/// Added to scaled energies before the logarithm.
const FLOOR: f64 = 1e-6;

/// Stretches of time of which [`Level`] takes the means, of equal length or one less.
const LEVEL_STRETCHES: usize = 16;

/// Logarithms of the energies of bands over time.
#[derive(Clone, Debug)]
pub(super) struct Envelope {
    /// Bands times axes.
    pub(super) n_signals: usize,
}

impl Statistic for Envelope {
    type Work = ();

    fn n_features(&self) -> usize {
        self.n_signals * STRETCHES
    }

    fn work(&self) {}

    /// Band by band, axis by axis, the logarithms of the mean squares of stretches; one without samples has no energy.
    #[inline(always)]
    fn compute(&self, _simd: impl Simd, split: Split<'_>, (): &mut (), out: &mut [f64]) {
        for (index, (out, energies)) in out.chunks_exact_mut(STRETCHES).zip(split.energies).enumerate() {
            let n = split.signals.numbered(index).len();
            for (i, (out, energy)) in out.iter_mut().zip(energies).enumerate() {
                *out = libm::log(energy / stretch(i, n).len().max(1) as f64 + FLOOR);
            }
        }
    }
}

/// The level of a recording: arcsinh of the mean of each stretch, in units of the scale.
#[derive(Clone, Debug)]
pub(super) struct Level {
    scales: Vec<f64>,
    /// Features of each axis.
    pub(super) stretches: usize,
}

impl Level {
    pub(super) fn new(scales: Vec<f64>, n_samples: usize) -> Self {
        Self { scales, stretches: LEVEL_STRETCHES.min(n_samples) }
    }
}

impl Statistic for Level {
    type Work = ();

    fn n_features(&self) -> usize {
        self.scales.len() * self.stretches
    }

    fn work(&self) {}

    /// Axis by axis. A stretch without samples, in a recording that has only begun, is at zero.
    #[inline(always)]
    fn compute(&self, _simd: impl Simd, split: Split<'_>, (): &mut (), out: &mut [f64]) {
        let n_axes = self.scales.len();
        let n_seen = split.rows.len() / n_axes;
        out.fill(0.0);
        for stretch in 0..self.stretches {
            let [from, to] = [stretch, stretch + 1].map(|i| i * n_seen / self.stretches);
            let samples = &split.rows[from * n_axes..to * n_axes];
            for row in samples.chunks_exact(n_axes) {
                for (axis, x) in row.iter().enumerate() {
                    out[axis * self.stretches + stretch] += x;
                }
            }
        }
        for (axis, out) in out.chunks_exact_mut(self.stretches).enumerate() {
            for (stretch, cell) in out.iter_mut().enumerate() {
                let [from, to] = [stretch, stretch + 1].map(|i| i * n_seen / self.stretches);
                *cell = libm::asinh(*cell / (to - from).max(1) as f64 / self.scales[axis]);
            }
        }
    }
}

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

/// Energies of all signals, band by band, axis by axis. The stretches of a signal side by side hide the latency of addition.
#[inline(always)]
pub(super) fn measure(signals: BandSignals<'_>, out: &mut [Energies]) {
    for (index, energies) in out.iter_mut().enumerate() {
        let signal = signals.numbered(index);
        let mut parts = [&[][..]; STRETCHES];
        for (i, part) in parts.iter_mut().enumerate() {
            *part = &signal[stretch(i, signal.len())];
        }
        let whole = signal.len() / STRETCHES / LANES * LANES;
        let mut sums = [Pack::<f32, LANES>::ZERO; STRETCHES];
        for t in (0..whole).step_by(LANES) {
            for (sum, part) in sums.iter_mut().zip(parts) {
                let x = Pack::load(&part[t..]);
                *sum = *sum + x * x;
            }
        }
        for ((energy, sum), part) in energies.iter_mut().zip(sums).zip(parts) {
            *energy = f64::from(part[whole..].iter().fold(sum.sum(), |sum, x| sum + x * x));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{same_on_every_path, Signals};
    use super::*;
    use crate::kernel::SimdPath;

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
            let all: f64 = signals.view().numbered(index).iter().map(|z| f64::from(*z).powi(2)).sum();
            assert!((energies.iter().sum::<f64>() - all).abs() < 1e-6 * all);
        }
    }

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        signals.compute(&Envelope { n_signals: signals.lengths().len() * signals.n_axes }, path)
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn logarithms_of_mean_squares() {
        let signals = Signals::from(vec![vec![vec![1.0, 2.0, 3.0, 4.0, 0.0]]]);
        let expected = [1.0, 4.0, 9.0, 8.0].map(|energy| libm::log(energy + FLOOR));
        assert_eq!(compute(SimdPath::Baseline, &signals), expected);
    }

    #[test]
    fn a_stretch_without_samples_has_no_energy() {
        let signals = Signals::from(vec![vec![vec![3.0]]]);
        let floor = libm::log(FLOOR);
        assert_eq!(compute(SimdPath::Baseline, &signals), [floor, floor, floor, libm::log(9.0 + FLOOR)]);
    }
}
