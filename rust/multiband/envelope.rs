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
