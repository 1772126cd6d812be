//! Distribution of the values of a band: quantiles of a histogram, and the size of the signal.

use super::bank::BandSignals;
use super::energies::{mean_square, Energies};
use super::log_bins::{bin, edges, word, N_BINS};
use super::logarithm::{self, Asinh};
use super::pack::Pack;
use crate::lanes::{Isa, Job, Path};

/// Which quantiles.
pub(super) const PROBABILITIES: [f64; 7] = [0.02, 0.10, 0.25, 0.50, 0.75, 0.90, 0.98];

/// Added to the RMS of scaled signals before its logarithm.
const FLOOR: f64 = 1e-3;

/// Numbers per axis.
pub(super) const PER_AXIS: usize = PROBABILITIES.len() + 1;

/// Values whose bins are found before any of them is counted: so many that bins go through memory, which is the fastest way
/// from vectors to addresses.
const BLOCK: usize = 512;

/// Histograms that take turns, so that a value need not wait until the one before it is counted.
const TURNS: usize = 2;

/// Numbers calculated with as one.
const LANES: usize = 8;

/// Bins of one histogram, rounded up so that a mask keeps an index within.
const ROOM: usize = N_BINS.next_power_of_two();

/// Counts of one signal.
type Counts = [[u32; ROOM]; TURNS];

/// The statistic.
#[derive(Clone, Debug)]
pub(super) struct Quantiles {
    n_signals: usize,
    edges: Vec<f64>,
}

/// What one thread needs to compute it. Between recordings all counts are zero.
#[derive(Clone, Debug)]
pub(super) struct QuantilesWork {
    counts: Box<Counts>,
    /// Values in each bin.
    all: Box<[u32; ROOM]>,
    words: Box<[i16; BLOCK]>,
    bins: Box<[u16; BLOCK]>,
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
}

impl Quantiles {
    pub(super) fn new(n_bands: usize, n_axes: usize) -> Self {
        Self { n_signals: n_bands * n_axes, edges: edges() }
    }

    pub(super) fn n_features(&self) -> usize {
        self.n_signals * PER_AXIS
    }

    #[allow(clippy::unused_self)] // as the other statistics
    pub(super) fn work(&self) -> QuantilesWork {
        QuantilesWork {
            counts: Box::new([[0; ROOM]; TURNS]),
            all: Box::new([0; ROOM]),
            words: Box::new([0; BLOCK]),
            bins: Box::new([0; BLOCK]),
        }
    }

    /// Band by band, axis by axis: inverse hyperbolic sines of quantiles, then the logarithm of the RMS. Allocates nothing.
    pub(super) fn compute(
        &self,
        path: Path,
        signals: BandSignals<'_>,
        energies: &[Energies],
        work: &mut QuantilesWork,
        out: &mut [f64],
    ) {
        path.run(Compute { design: self, signals, energies, work, out });
    }
}

struct Compute<'a> {
    design: &'a Quantiles,
    signals: BandSignals<'a>,
    energies: &'a [Energies],
    work: &'a mut QuantilesWork,
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { design, signals, energies, work, out } = self;
        let (mut n, mut ranks) = (0, Ranks::new(0));
        for (index, (out, energies)) in out.chunks_exact_mut(PER_AXIS).zip(energies).enumerate() {
            let signal = signals.numbered(index);
            if signal.len() != n {
                (n, ranks) = (signal.len(), Ranks::new(signal.len()));
            }
            let range = work.count(signal);
            let Some((rms, quantiles)) = out.split_last_mut() else { return };
            work.quantiles(&ranks, range, &design.edges, quantiles);
            *rms = mean_square(energies, signal.len()).sqrt() + FLOOR;
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

impl QuantilesWork {
    /// Counts the values of a signal; returns the first and the last bin that hold any.
    #[inline(always)]
    fn count(&mut self, signal: &[f64]) -> (usize, usize) {
        let Self { counts, words, bins, .. } = self;
        let (mut least, mut most) = (u16::MAX, 0);
        for block in signal.chunks(BLOCK) {
            let (words, bins) = (&mut words[..block.len()], &mut bins[..block.len()]);
            for (word_of_z, z) in words.iter_mut().zip(block) {
                *word_of_z = word(*z);
            }
            for (bin_of_z, word) in bins.iter_mut().zip(&*words) {
                *bin_of_z = bin(*word);
            }
            for bin in &*bins {
                least = least.min(*bin);
                most = most.max(*bin);
            }
            let [even, odd] = &mut **counts;
            let (eights, rest) = bins.as_chunks::<LANES>();
            for eight in eights {
                for l in (0..LANES).step_by(TURNS) {
                    even[usize::from(eight[l]) % ROOM] += 1;
                    odd[usize::from(eight[l + 1]) % ROOM] += 1;
                }
            }
            for bin in rest {
                even[usize::from(*bin) % ROOM] += 1;
            }
        }
        (least.into(), most.into())
    }

    /// Quantiles of counted values, linear within the bin in which a rank lies; the counts are zero afterwards.
    #[inline(always)]
    fn quantiles(&mut self, ranks: &Ranks, (first, last): (usize, usize), edges: &[f64], out: &mut [f64]) {
        let (start, end) = (first - first % LANES, (last + 1).next_multiple_of(LANES));
        let [even, odd] = &mut *self.counts;
        let both = even[start..end]
            .as_chunks_mut::<LANES>()
            .0
            .iter_mut()
            .zip(odd[start..end].as_chunks_mut::<LANES>().0);
        let all = self.all[start..end].as_chunks_mut::<LANES>().0;
        // For each rank the bins, in groups, and the values before the group in which it lies.
        let (mut groups, mut before) = ([0; LANES], [0; LANES]);
        let mut sum = 0;
        for ((a, b), all) in both.zip(all.iter_mut()) {
            let (evens, odds) = (std::mem::take(a), std::mem::take(b));
            let mut counts = [0; LANES];
            for l in 0..LANES {
                counts[l] = evens[l] + odds[l];
            }
            *all = counts;
            sum += counts.iter().sum::<u32>();
            for l in 0..LANES {
                let below = sum < ranks.whole[l];
                groups[l] += u32::from(below);
                before[l] = if below { sum } else { before[l] };
            }
        }
        for (l, out) in out.iter_mut().enumerate() {
            let group = groups[l] as usize;
            let (mut sum, mut before, mut behind) = (before[l], before[l], 0);
            for count in all[group] {
                sum += count;
                if sum < ranks.whole[l] {
                    (before, behind) = (sum, behind + 1);
                }
            }
            let within = (ranks.exact[l] - f64::from(before)) / f64::from(all[group][behind]);
            let bin = start + group * LANES + behind;
            *out = edges[bin] + within * (edges[bin + 1] - edges[bin]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::signals::{same_on_every_path, Signals};
    use super::*;

    fn compute(path: Path, signals: &Signals) -> Vec<f64> {
        let design = Quantiles::new(signals.lengths().len(), signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        let mut work = design.work();
        design.compute(path, signals.view(), &signals.energies(), &mut work, &mut out);
        assert!(work.counts.iter().flatten().all(|count| *count == 0), "counts are left over");
        out
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn quantiles_of_one_to_a_thousand() {
        let signals = Signals::from(vec![vec![(1..=1000).map(|x| f64::from(x) / 10.0).collect()]]);
        let got = compute(Path::detect(), &signals);
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
        let got = compute(Path::Baseline, &signals);
        for (got, p) in got.iter().zip(PROBABILITIES) {
            assert!((got - (1.0 + (p * 3.0 + 0.5) / 64.0).asinh()).abs() < 1e-15);
        }
    }

    #[test]
    fn silence_and_overflow() {
        let silence = compute(Path::detect(), &Signals::from(vec![vec![vec![0.0; 50]]]));
        assert!(silence[3].abs() < 1e-2 && silence[7] == libm::log(FLOOR));
        let overflow = compute(Path::detect(), &Signals::from(vec![vec![vec![1e200; 50]]]));
        assert_eq!(overflow[7], f64::INFINITY);
    }
}
