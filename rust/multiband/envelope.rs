//! Energy of a band over time.

use super::bank::BandSignals;
use super::logarithm::{self, Log};
use super::pack::Pack;
use crate::lanes::{Isa, Job, Path};

/// Stretches of time, as equal as whole samples allow.
pub(super) const STRETCHES: usize = 4;

/// Added to scaled energies before the logarithm.
pub(super) const FLOOR: f64 = 1e-6;

/// Partial sums per energy.
const LANES: usize = 8;

/// The statistic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Envelope {
    n_axes: usize,
    n_bands: usize,
}

impl Envelope {
    pub(super) fn new(n_bands: usize, n_axes: usize) -> Self {
        Self { n_axes, n_bands }
    }

    pub(super) fn n_features(&self) -> usize {
        self.n_bands * self.n_axes * STRETCHES
    }

    /// Band by band, axis by axis, the logarithms of the mean squares of scaled stretches; a stretch without samples has no
    /// energy. Allocates nothing.
    pub(super) fn compute(&self, path: Path, signals: BandSignals<'_>, scales: &[f64], out: &mut [f64]) {
        path.run(Compute { n_axes: self.n_axes, signals, scales, out });
    }
}

struct Compute<'a> {
    n_axes: usize,
    signals: BandSignals<'a>,
    scales: &'a [f64],
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { n_axes, signals, scales, out } = self;
        for (index, out) in out.chunks_exact_mut(STRETCHES).enumerate() {
            let signal = signals.axis(index / n_axes, index % n_axes);
            let n = signal.len();
            let inverse = 1.0 / scales[index];
            for (i, energy) in out.iter_mut().enumerate() {
                let stretch = &signal[i * n / STRETCHES..(i + 1) * n / STRETCHES];
                *energy = sum_of_squares(stretch, inverse) / stretch.len().max(1) as f64 + FLOOR;
            }
        }
        logarithm::each::<Log, LANES>(out);
    }
}

/// The sum of `(factor * y)^2`.
#[inline(always)]
fn sum_of_squares(signal: &[f64], factor: f64) -> f64 {
    let mut sums = Pack::<LANES>::ZERO;
    let chunks = signal.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        let z = Pack::load(chunk) * Pack::splat(factor);
        sums = sums + z * z;
    }
    for (sum, y) in sums.0.iter_mut().zip(rest) {
        let z = factor * y;
        *sum += z * z;
    }
    sums.sum()
}
