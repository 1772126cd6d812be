//! Energy of a band over time.

use super::band_signals::BandSignals;
use super::energies::{stretch, Energies, STRETCHES};
use super::logarithm::{self, Log};
use crate::kernel::{Isa, Job, SimdPath};

/// Added to scaled energies before the logarithm.
const FLOOR: f64 = 1e-6;

/// Logarithms taken at a time.
const LANES: usize = 8;

/// The statistic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Envelope {
    n_signals: usize,
}

impl Envelope {
    pub(super) fn new(n_bands: usize, n_axes: usize) -> Self {
        Self { n_signals: n_bands * n_axes }
    }

    pub(super) fn n_features(self) -> usize {
        self.n_signals * STRETCHES
    }

    /// Band by band, axis by axis, the logarithms of the mean squares of stretches; one without samples has no energy.
    /// Allocates nothing.
    #[allow(clippy::unused_self)] // as the other statistics
    pub(super) fn compute(
        self,
        path: SimdPath,
        signals: BandSignals<'_>,
        energies: &[Energies],
        out: &mut [f64],
    ) {
        path.run(Compute { signals, energies, out });
    }
}

struct Compute<'a> {
    signals: BandSignals<'a>,
    energies: &'a [Energies],
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { signals, energies, out } = self;
        for (index, (out, energies)) in out.chunks_exact_mut(STRETCHES).zip(energies).enumerate() {
            let n = signals.numbered(index).len();
            for (i, (out, energy)) in out.iter_mut().zip(energies).enumerate() {
                *out = energy / stretch(i, n).len().max(1) as f64 + FLOOR;
            }
        }
        logarithm::each::<Log, LANES>(out);
    }
}

#[cfg(test)]
mod tests {
    use super::super::signals::{same_on_every_path, Signals};
    use super::*;

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        let design = Envelope::new(signals.lengths().len(), signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        design.compute(path, signals.view(), &signals.energies(), &mut out);
        out
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
