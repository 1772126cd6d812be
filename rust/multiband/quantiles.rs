//! Distribution of the values of a band: quantiles of a histogram, and the size of the signal.

use super::bank::BandSignals;
use super::log_bins::{bin, edges, near_edge, N_BINS};
use super::logarithm::{self, Asinh};
use super::pack::Pack;
use crate::lanes::{Isa, Job, Path};

/// Which quantiles.
pub(super) const PROBABILITIES: [f64; 7] = [0.02, 0.10, 0.25, 0.50, 0.75, 0.90, 0.98];

/// Added to the RMS of scaled signals before its logarithm.
const FLOOR: f64 = 1e-3;

/// Numbers per axis.
pub(super) const PER_AXIS: usize = PROBABILITIES.len() + 1;

/// Values whose bins are found before any of them is counted.
const BLOCK: usize = 32;

/// Histograms that take turns, so that a value need not wait until the one before it is counted.
const TURNS: usize = 4;

/// Numbers calculated with as one.
const LANES: usize = 4;

/// Bins of one histogram, rounded up to whole vectors.
const ROOM: usize = N_BINS.next_multiple_of(64);

/// The statistic.
#[derive(Clone, Debug)]
pub(super) struct Quantiles {
    n_axes: usize,
    n_bands: usize,
    edges: Vec<f64>,
}

/// What one thread needs to compute it. Between recordings all counts are zero.
#[derive(Clone, Debug)]
pub(super) struct QuantilesWork {
    counts: Box<[[u32; ROOM]; TURNS]>,
    /// Values in a bin and in all bins before it.
    until: Box<[u32; ROOM]>,
}

impl Quantiles {
    pub(super) fn new(n_bands: usize, n_axes: usize) -> Self {
        Self { n_axes, n_bands, edges: edges() }
    }

    pub(super) fn n_features(&self) -> usize {
        self.n_bands * self.n_axes * PER_AXIS
    }

    #[allow(clippy::unused_self)] // as the other statistics
    pub(super) fn work(&self) -> QuantilesWork {
        QuantilesWork { counts: Box::new([[0; ROOM]; TURNS]), until: Box::new([0; ROOM]) }
    }

    /// Band by band, axis by axis: inverse hyperbolic sines of quantiles, then the logarithm of the RMS. Allocates nothing.
    pub(super) fn compute(
        &self,
        path: Path,
        signals: BandSignals<'_>,
        scales: &[f64],
        work: &mut QuantilesWork,
        out: &mut [f64],
    ) {
        path.run(Compute { design: self, signals, scales, work, out });
    }
}

struct Compute<'a> {
    design: &'a Quantiles,
    signals: BandSignals<'a>,
    scales: &'a [f64],
    work: &'a mut QuantilesWork,
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { design, signals, scales, work, out } = self;
        let n_axes = design.n_axes;
        for (index, out) in out.chunks_exact_mut(PER_AXIS).enumerate() {
            let signal = signals.axis(index / n_axes, index % n_axes);
            let (mean_square, range) = count(signal, scales[index], &mut work.counts);
            let Some((rms, quantiles)) = out.split_last_mut() else { return };
            work.quantiles(signal.len(), range, &design.edges, quantiles);
            *rms = mean_square.sqrt() + FLOOR;
        }
        // One vector is quantiles of which the inverse sine, but for the last number, is a logarithm.
        for out in out.chunks_exact_mut(PER_AXIS) {
            let rms = out[PER_AXIS - 1];
            logarithm::each::<Asinh, LANES>(out);
            out[PER_AXIS - 1] = rms;
        }
        let mut sizes = out.iter_mut().skip(PER_AXIS - 1).step_by(PER_AXIS);
        while let Some(first) = sizes.next() {
            let mut targets = [Some(first), sizes.next(), sizes.next(), sizes.next()];
            let mut values = Pack::<LANES>::ONE;
            for (value, target) in values.0.iter_mut().zip(&targets) {
                *value = target.as_deref().copied().unwrap_or(1.0);
            }
            let logs = logarithm::log(values);
            for (target, log) in targets.iter_mut().zip(logs.0) {
                if let Some(target) = target {
                    **target = log;
                }
            }
        }
    }
}

/// Counts the values of a signal divided by `scale`; returns their mean square, and the first and last bin that may hold
/// any.
#[inline(always)]
fn count(signal: &[f64], scale: f64, counts: &mut [[u32; ROOM]; TURNS]) -> (f64, (usize, usize)) {
    let inverse = 1.0 / scale;
    let mut squares = Pack::<LANES>::ZERO;
    let (mut least, mut most) =
        (Pack::<LANES>::splat(f64::INFINITY), Pack::<LANES>::splat(f64::NEG_INFINITY));
    let mut bins = [0_usize; BLOCK];
    let mut blocks = signal.chunks_exact(BLOCK);
    for block in &mut blocks {
        for (y, bins) in block.chunks_exact(LANES).zip(bins.chunks_exact_mut(LANES)) {
            let y = Pack::<LANES>::load(y);
            let mut z = y * Pack::splat(inverse);
            let mut near = false;
            for l in 0..LANES {
                near |= near_edge(z.0[l]);
            }
            if near {
                z = y / Pack::splat(scale);
            }
            squares = squares + z * z;
            least = least.above(z).select(z, least);
            most = z.above(most).select(z, most);
            for (bin_of_z, z) in bins.iter_mut().zip(z.0) {
                *bin_of_z = bin(z);
            }
        }
        for bins in bins.chunks_exact(TURNS) {
            for (bin, counts) in bins.iter().zip(counts.iter_mut()) {
                counts[*bin % ROOM.next_power_of_two()] += 1;
            }
        }
    }
    for (t, y) in blocks.remainder().iter().enumerate() {
        let z = y / scale;
        squares.0[t % LANES] += z * z;
        least.0[0] = least.0[0].min(z);
        most.0[0] = most.0[0].max(z);
        counts[t % TURNS][bin(z)] += 1;
    }
    let sum = squares.sum();
    let least = least.0.into_iter().fold(f64::INFINITY, f64::min);
    let most = most.0.into_iter().fold(f64::NEG_INFINITY, f64::max);
    // NaN has no place among the others.
    let range = if sum.is_finite() { (bin(least), bin(most)) } else { (0, N_BINS - 1) };
    (sum / signal.len() as f64, range)
}

impl QuantilesWork {
    /// Quantiles of `n` counted values, linear within the bin in which the rank `p (n - 1) + 1/2` lies; the counts are zero
    /// afterwards.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // ranks are at most n, which is 32 bits wide
    #[inline(always)]
    fn quantiles(&mut self, n: usize, (first, last): (usize, usize), edges: &[f64], out: &mut [f64]) {
        let ranks = PROBABILITIES.map(|p| p * (n as f64 - 1.0) + 0.5);
        let start = first - first % 8;
        let end = (last + 1).next_multiple_of(8);
        let [a, b, c, d] = &mut *self.counts;
        let (a, b, c, d) = (&mut a[start..end], &mut b[start..end], &mut c[start..end], &mut d[start..end]);
        let until = &mut self.until[start..end];
        let all = a
            .chunks_exact_mut(8)
            .zip(b.chunks_exact_mut(8))
            .zip(c.chunks_exact_mut(8))
            .zip(d.chunks_exact_mut(8));
        for ((((a, b), c), d), until) in all.zip(until.chunks_exact_mut(8)) {
            for i in 0..8 {
                until[i] = (a[i] + b[i]) + (c[i] + d[i]);
            }
            for counts in [a, b, c, d] {
                counts.fill(0);
            }
        }
        let mut sum = 0;
        for count in &mut *until {
            sum += *count;
            *count = sum;
        }
        for (out, rank) in out.iter_mut().zip(ranks) {
            // A count reaches a rank where it reaches the next whole number.
            let behind = until.partition_point(|count| f64::from(*count) < rank);
            let before = if behind == 0 { 0 } else { until[behind - 1] };
            let within = (rank - f64::from(before)) / f64::from(until[behind] - before);
            let bin = start + behind;
            *out = edges[bin] + within * (edges[bin + 1] - edges[bin]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::signals::Signals;
    use super::*;

    fn compute(path: Path, signals: &Signals, scales: &[f64]) -> Vec<f64> {
        let design = Quantiles::new(signals.lengths().len(), signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        let mut work = design.work();
        design.compute(path, signals.view(), scales, &mut work, &mut out);
        assert!(work.counts.iter().flatten().all(|count| *count == 0), "counts are left over");
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
    fn quantiles_of_one_to_a_thousand() {
        let signals = Signals::from(vec![vec![(1..=1000).map(|x| f64::from(x) / 10.0).collect()]]);
        let got = compute(Path::detect(), &signals, &[1.0]);
        for (got, p) in got.iter().zip(PROBABILITIES) {
            // No better than a bin is wide.
            assert!((got.sinh() / (0.1 + 99.9 * p) - 1.0).abs() < 1.0 / 16.0, "{p}: {}", got.sinh());
        }
        assert!((got[7] - (333_833.5_f64.sqrt() / 10.0 + FLOOR).ln()).abs() < 1e-14);
    }

    #[test]
    fn linear_within_a_bin() {
        // All in the bin from 1 to 17/16, ranks 0.56, 0.8, ... of 4.
        let signals = Signals::from(vec![vec![vec![2.0; 4]]]);
        let got = compute(Path::Baseline, &signals, &[2.0]);
        for (got, p) in got.iter().zip(PROBABILITIES) {
            assert!((got - (1.0 + (p * 3.0 + 0.5) / 64.0).asinh()).abs() < 1e-15);
        }
    }

    #[test]
    fn a_quotient_on_an_edge_is_in_the_outer_bin() {
        // 3 times the reciprocal of 3 is 1, that of 49 times 49 is less.
        for scale in [3.0, 49.0, 1e-310, 1e300] {
            let signals = Signals::from(vec![vec![vec![scale; 100]]]);
            let got = compute(Path::detect(), &signals, &[scale]);
            assert!(got[0].sinh() >= 1.0 - 1e-15, "{scale}: {}", got[0].sinh());
        }
    }

    #[test]
    fn silence_and_overflow() {
        let silence = compute(Path::detect(), &Signals::from(vec![vec![vec![0.0; 50]]]), &[1.0]);
        assert!(silence[3].abs() < 1e-2 && silence[7] == libm::log(FLOOR));
        let overflow = compute(Path::detect(), &Signals::from(vec![vec![vec![1e200; 50]]]), &[1.0]);
        assert_eq!(overflow[7], f64::INFINITY);
    }
}
