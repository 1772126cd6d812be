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

#[cfg(test)]
mod tests {
    use super::super::signals::Signals;
    use super::*;

    fn compute(path: Path, signals: &Signals, scales: &[f64]) -> Vec<f64> {
        let design = Envelope::new(signals.lengths().len(), signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        design.compute(path, signals.view(), scales, &mut out);
        out
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        let (signals, scales) = (Signals::new(&[1000, 1000, 500, 61, 9, 1], 7), [1.7; 42]);
        let all =
            Path::available().into_iter().map(|path| compute(path, &signals, &scales)).collect::<Vec<_>>();
        assert!(all[0].iter().all(|x| x.is_finite()));
        assert!(all.windows(2).all(|pair| pair[0] == pair[1]));
    }

    #[test]
    fn stretches_are_as_equal_as_samples_allow() {
        // 1, 1, 1 and 2 samples.
        let signals = Signals::from(vec![vec![vec![2.0, 4.0, 6.0, 8.0, 0.0]]]);
        let expected = [1.0, 4.0, 9.0, 8.0].map(|energy| libm::log(energy + FLOOR));
        assert_eq!(compute(Path::Baseline, &signals, &[2.0]), expected);
    }

    #[test]
    fn a_stretch_without_samples_has_no_energy() {
        let signals = Signals::from(vec![vec![vec![3.0]]]);
        let floor = libm::log(FLOOR);
        assert_eq!(compute(Path::Baseline, &signals, &[1.0]), [floor, floor, floor, libm::log(9.0 + FLOOR)]);
    }
}
