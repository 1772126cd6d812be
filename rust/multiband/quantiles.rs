//! Distribution of the values of a band: quantiles of a histogram, and the size of the signal.

use super::band_signals::BandSignals;
use super::energies::{mean_square, Energies};
use super::log_bins::edges;
use super::logarithm::{self, Asinh};
use super::tally::{Histogram, Tally, TURNS};
use crate::kernel::{Isa, Job, Pack, SimdPath};

/// Which quantiles.
pub(super) const PROBABILITIES: [f64; 7] = [0.02, 0.10, 0.25, 0.50, 0.75, 0.90, 0.98];

/// Added to the RMS of scaled signals before its logarithm.
const FLOOR: f64 = 1e-3;

/// Numbers per axis.
pub(super) const PER_AXIS: usize = PROBABILITIES.len() + 1;

/// Numbers calculated with as one.
const LANES: usize = 8;

/// The statistic.
#[derive(Clone, Debug)]
pub(super) struct Quantiles {
    lengths: Vec<usize>,
    n_axes: usize,
    edges: Vec<f64>,
}

/// Where quantiles lie among sorted values; what lies behind the last of them is of no account.
#[derive(Clone, Copy, Debug)]
struct Ranks {
    exact: [f64; LANES],
    /// A count reaches a rank where it reaches the next whole number.
    whole: [u32; LANES],
}

impl Ranks {
    /// `p (n - 1) + 1/2` of `n` values.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // ranks are at most n, which is 32 bits wide
    #[inline(always)]
    fn new(n: usize) -> Self {
        let (mut exact, mut whole) = ([0.0; LANES], [0; LANES]);
        for ((exact, whole), p) in exact.iter_mut().zip(&mut whole).zip(PROBABILITIES) {
            *exact = p * (n as f64 - 1.0) + 0.5;
            *whole = exact.ceil() as u32;
        }
        Self { exact, whole }
    }

    /// Quantiles of counted values, linear within the bin in which a rank lies.
    #[inline(always)]
    fn find(&self, histogram: &Histogram, edges: &[f64], out: &mut [f64; PROBABILITIES.len()]) {
        let (counts, start) = histogram.counts::<LANES>();
        // For each rank the bins, in groups, and the values before the group in which it lies.
        let (mut groups, mut before) = ([0; LANES], [0; LANES]);
        let mut sum = 0;
        for group in counts {
            sum += group.iter().sum::<u32>();
            for l in 0..LANES {
                let below = sum < self.whole[l];
                groups[l] += u32::from(below);
                before[l] = if below { sum } else { before[l] };
            }
        }
        for (l, out) in out.iter_mut().enumerate() {
            let group = groups[l] as usize;
            let (mut sum, mut before, mut behind) = (before[l], before[l], 0);
            for count in counts[group] {
                sum += count;
                if sum < self.whole[l] {
                    (before, behind) = (sum, behind + 1);
                }
            }
            let within = (self.exact[l] - f64::from(before)) / f64::from(counts[group][behind]);
            let bin = start + group * LANES + behind;
            *out = edges[bin] + within * (edges[bin + 1] - edges[bin]);
        }
    }
}

impl Quantiles {
    /// For bands of some numbers of samples, the longest first.
    pub(super) fn new(lengths: Vec<usize>, n_axes: usize) -> Self {
        Self { lengths, n_axes, edges: edges() }
    }

    pub(super) fn n_features(&self) -> usize {
        self.lengths.len() * self.n_axes * PER_AXIS
    }

    pub(super) fn work(&self) -> Tally {
        Tally::new(&self.lengths, self.n_axes)
    }

    /// Band by band, axis by axis: inverse hyperbolic sines of quantiles, then the logarithm of the RMS. Allocates nothing.
    pub(super) fn compute(
        &self,
        path: SimdPath,
        signals: BandSignals<'_>,
        energies: &[Energies],
        tally: &mut Tally,
        out: &mut [f64],
    ) {
        path.run(Compute { design: self, signals, energies, tally, out });
    }
}

struct Compute<'a> {
    design: &'a Quantiles,
    signals: BandSignals<'a>,
    energies: &'a [Energies],
    tally: &'a mut Tally,
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { design, signals, energies, tally, out } = self;
        let n_axes = signals.n_axes();
        let of_bands = out.chunks_exact_mut(n_axes * PER_AXIS).zip(energies.chunks_exact(n_axes));
        for (band, (out, energies)) in of_bands.enumerate() {
            let n = signals.len(band);
            let ranks = Ranks::new(n);
            let mut of_axes = out.as_chunks_mut::<PER_AXIS>().0.iter_mut().zip(energies);
            for axis in (0..n_axes).step_by(TURNS) {
                let histograms = tally.finish(signals, band, axis).iter();
                for (histogram, (out, energies)) in histograms.zip(&mut of_axes) {
                    let [quantiles @ .., rms] = out;
                    ranks.find(histogram, &design.edges, quantiles);
                    *rms = mean_square(energies, n).sqrt() + FLOOR;
                }
                tally.undo(signals, band, axis);
            }
        }
        // The inverse sines of all, then the logarithms of sizes in their places, a few signals at a time.
        for rows in out.chunks_mut(LANES * PER_AXIS) {
            let mut sizes = Pack::<LANES>::ONE;
            for (size, row) in sizes.0.iter_mut().zip(rows.chunks_exact(PER_AXIS)) {
                *size = row[PER_AXIS - 1];
            }
            let sizes = logarithm::log(sizes);
            logarithm::each::<Asinh, LANES>(rows);
            for (size, row) in sizes.0.iter().zip(rows.chunks_exact_mut(PER_AXIS)) {
                row[PER_AXIS - 1] = *size;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::signals::{same_on_every_path, Signals};
    use super::*;

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        let design = Quantiles::new(signals.lengths(), signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        design.compute(path, signals.view(), &signals.energies(), &mut design.work(), &mut out);
        out
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn quantiles_of_one_to_a_thousand() {
        let signals = Signals::from(vec![vec![(1..=1000).map(|x| f64::from(x) / 10.0).collect()]]);
        let got = compute(SimdPath::detect().unwrap(), &signals);
        for (got, p) in got.iter().zip(PROBABILITIES) {
            // No better than a bin is wide.
            assert!((got.sinh() / (0.1 + 99.9 * p) - 1.0).abs() < 1.0 / 16.0, "{p}: {}", got.sinh());
        }
        assert!((got[7] - (333_833.5_f64.sqrt() / 10.0 + FLOOR).ln()).abs() < 1e-14);
    }

    #[test]
    fn linear_within_a_bin() {
        // All in the bin from 1 to 17/16, ranks 0.56, 0.8, ... of 4.
        let signals = Signals::from(vec![vec![vec![1.0; 4]]]);
        let got = compute(SimdPath::Baseline, &signals);
        for (got, p) in got.iter().zip(PROBABILITIES) {
            assert!((got - (1.0 + (p * 3.0 + 0.5) / 64.0).asinh()).abs() < 1e-15);
        }
    }

    #[test]
    fn silence_and_overflow() {
        let silence = compute(SimdPath::detect().unwrap(), &Signals::from(vec![vec![vec![0.0; 50]]]));
        assert!(silence[3].abs() < 1e-2 && silence[7] == libm::log(FLOOR));
        let overflow = compute(SimdPath::detect().unwrap(), &Signals::from(vec![vec![vec![1e200; 50]]]));
        assert_eq!(overflow[7], f64::INFINITY);
    }
}
