//! Distribution of the values of a band: quantiles of a histogram, and the size of the signal.
//!
//! Bins have nearly equal ratio and are found in the bits of a number: the exponent and the first four bits of the mantissa
//! of a float32 say in which sixteenth of which octave it lies, so no logarithm and no search is needed. Histograms are
//! counted as signals grow.

use std::ops::Range;

use super::envelope::mean_square;
use super::logarithm::{each, log, Asinh};
use super::{BandSignals, Split, Statistic};
use crate::kernel::{Pack, Simd};

/// Which quantiles.
pub(super) const PROBABILITIES: [f64; 7] = [0.02, 0.10, 0.25, 0.50, 0.75, 0.90, 0.98];

/// Added to the RMS of scaled signals before its logarithm.
const FLOOR: f64 = 1e-3;

/// Numbers per axis.
pub(super) const PER_AXIS: usize = PROBABILITIES.len() + 1;

/// Numbers calculated with as one.
const LANES: usize = 8;

/// Samples of an octave that are worth counting before the others are there.
const LEAST: usize = 64;

/// Samples whose bins are found before any of them is counted.
const BLOCK: usize = 2048;

/// Bins of one histogram, rounded up so that a mask keeps an index within.
const ROOM: usize = N_BINS.next_power_of_two();

/// Groups of bins that are added up as one.
const GROUPS: usize = ROOM / LANES;

/// Signals that take turns, so that a value need not wait until the one before it is counted.
const TURNS: usize = 2;

/// Bins of each octave: equal steps, as the first four bits of a mantissa make them.
const PER_OCTAVE: i16 = 16;

/// The octaves: from two to this power, to two to that power.
const LOWEST: i16 = -6;
const HIGHEST: i16 = 8;

/// The bin around zero, which is also the number of bins on either side.
const MIDDLE: i16 = (HIGHEST - LOWEST) * PER_OCTAVE;

/// All bins.
const N_BINS: usize = 2 * MIDDLE as usize + 1;

/// The bits taken out of a number: sign, exponent and the first seven of the mantissa.
const BITS: u32 = 16;

/// Those of them that are more of the mantissa than bins are fine.
const FINER: u32 = 3;

/// Those of numbers just below the first octave, and of numbers in the last bin.
const BELOW: i16 = (127 + LOWEST) * PER_OCTAVE - 1;
const LAST: i16 = (127 + HIGHEST) * PER_OCTAVE - 1;

/// The statistic.
#[derive(Clone, Debug)]
pub(super) struct Quantiles {
    /// Samples of each band, the longest first.
    lengths: Vec<usize>,
    n_axes: usize,
    edges: Vec<f64>,
}

impl Quantiles {
    pub(super) fn new(lengths: Vec<usize>, n_axes: usize) -> Self {
        Self { lengths, n_axes, edges: edges() }
    }
}

impl Statistic for Quantiles {
    type Work = BandHistograms;

    fn n_features(&self) -> usize {
        self.lengths.len() * self.n_axes * PER_AXIS
    }

    fn work(&self) -> BandHistograms {
        BandHistograms::new(&self.lengths, self.n_axes)
    }

    /// Band by band, axis by axis: inverse hyperbolic sines of quantiles, then the logarithm of the RMS.
    #[inline(always)]
    fn compute(&self, _simd: impl Simd, split: Split<'_>, histograms: &mut BandHistograms, out: &mut [f64]) {
        let Split { signals, energies, .. } = split;
        let n_axes = self.n_axes;
        let of_bands = out.chunks_exact_mut(n_axes * PER_AXIS).zip(energies.chunks_exact(n_axes));
        for (band, (out, energies)) in of_bands.enumerate() {
            let n = signals.len(band);
            let ranks = Ranks::new(n);
            let of_axes = out.as_chunks_mut::<PER_AXIS>().0.iter_mut().zip(energies);
            for (histogram, (out, energies)) in histograms.finish(signals, band).iter().zip(of_axes) {
                let [quantiles @ .., rms] = out;
                ranks.find(histogram, &self.edges, quantiles);
                *rms = mean_square(energies, n).sqrt() + FLOOR;
            }
            histograms.undo(signals, band);
        }
        // The inverse sines of all, then the logarithms of sizes in their places, a few signals at a time.
        for rows in out.chunks_mut(LANES * PER_AXIS) {
            let mut sizes = Pack::<f64, LANES>::ONE;
            for (size, row) in sizes.0.iter_mut().zip(rows.chunks_exact(PER_AXIS)) {
                *size = row[PER_AXIS - 1];
            }
            let sizes = log(sizes);
            each::<Asinh, LANES>(rows);
            for (size, row) in sizes.0.iter().zip(rows.chunks_exact_mut(PER_AXIS)) {
                row[PER_AXIS - 1] = *size;
            }
        }
    }
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
        let (counts, start) = histogram.counts();
        // Values before each group of bins, and, behind the last group, more than there are.
        let mut before = [u32::MAX; GROUPS + 1];
        before[0] = 0;
        let mut sum = 0;
        for (before, group) in before[1..].iter_mut().zip(counts) {
            sum += group.iter().sum::<u32>();
            *before = sum;
        }
        // The group in which each rank lies, by halves, all ranks side by side.
        let mut groups = [0; PROBABILITIES.len()];
        let mut step = GROUPS / 2;
        while step > 0 {
            for l in 0..groups.len() {
                groups[l] += if before[groups[l] + step] < self.whole[l] { step } else { 0 };
            }
            step /= 2;
        }
        // The bins, then their quotients as vectors.
        let (mut befores, mut within) = ([0.0; LANES], [1.0; LANES]);
        let (mut left, mut right) = ([0.0; LANES], [0.0; LANES]);
        for (l, group) in groups.into_iter().enumerate() {
            let (mut sum, mut before, mut behind) = (before[group], before[group], 0);
            for count in counts[group] {
                sum += count;
                if sum < self.whole[l] {
                    (before, behind) = (sum, behind + 1);
                }
            }
            let bin = start + group * LANES + behind;
            (befores[l], within[l]) = (f64::from(before), f64::from(counts[group][behind]));
            (left[l], right[l]) = (edges[bin], edges[bin + 1]);
        }
        for l in 0..LANES {
            left[l] += (self.exact[l] - befores[l]) / within[l] * (right[l] - left[l]);
        }
        out.copy_from_slice(&left[..groups.len()]);
    }
}

/// Counts of one signal; whole cache lines, so that vectors of them do not cross any.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Histogram {
    counts: [u32; ROOM],
    /// The first and the last bin that hold any.
    least: u16,
    most: u16,
}

impl Histogram {
    const EMPTY: Self = Self { counts: [0; ROOM], least: u16::MAX, most: 0 };

    /// Counts from the first bin that holds any, or a little before it, to the last or a little behind it, and the number of
    /// the first of them.
    #[inline(always)]
    fn counts(&self) -> (&[[u32; LANES]], usize) {
        let first = usize::from(self.least) / LANES;
        let end = (usize::from(self.most) + 1).div_ceil(LANES);
        (&self.counts.as_chunks::<LANES>().0[first..end], first * LANES)
    }

    /// Back to no counts.
    #[inline(always)]
    fn clear(&mut self) {
        if self.least <= self.most {
            self.counts[usize::from(self.least)..=usize::from(self.most)].fill(0);
        }
        (self.least, self.most) = (u16::MAX, 0);
    }

    /// Finds the bins of some values, which are to be counted. Bits first, all of them: they are half as wide as the values.
    #[inline(always)]
    fn reach(&mut self, values: &[f32], words: &mut [i16], bins: &mut [u16]) {
        for (word_of_z, z) in words.iter_mut().zip(values) {
            *word_of_z = word(*z);
        }
        let (mut least, mut most) = (self.least, self.most);
        for (bin_of_z, word) in bins.iter_mut().zip(&*words) {
            *bin_of_z = bin(*word);
            (least, most) = (least.min(*bin_of_z), most.max(*bin_of_z));
        }
        (self.least, self.most) = (least, most);
    }

    /// One more in a bin, or one less.
    #[inline(always)]
    fn count<const MORE: bool>(&mut self, bin: u16) {
        let count = &mut self.counts[usize::from(bin) % ROOM];
        *count = if MORE { *count + 1 } else { *count - 1 };
    }
}

/// Room for bits that choose bins, and for bins of signals that take turns.
type Words = [i16; BLOCK];
type Bins = [[u16; BLOCK]; TURNS];

/// Histograms of one recording.
#[derive(Clone, Debug)]
pub(super) struct BandHistograms {
    n_axes: usize,
    /// Those of the octaves that are long enough to be counted while they grow, axis by axis.
    growing: Vec<Histogram>,
    /// How many samples of each of these octaves are in them.
    n_counted: Vec<usize>,
    /// Those of the axes of other bands; empty in between.
    passing: Vec<Histogram>,
    // Bins go through memory, which is the fastest way from vectors to addresses.
    words: Box<Words>,
    bins: Box<Bins>,
}

impl BandHistograms {
    /// For bands of some numbers of samples, the longest first.
    fn new(lengths: &[usize], n_axes: usize) -> Self {
        let n_growing = lengths.iter().skip(1).filter(|n| **n >= LEAST).count();
        Self {
            n_axes,
            growing: vec![Histogram::EMPTY; n_growing * n_axes],
            n_counted: vec![0; n_growing],
            passing: vec![Histogram::EMPTY; n_axes],
            words: Box::new([0; BLOCK]),
            bins: Box::new([[0; BLOCK]; TURNS]),
        }
    }

    /// Ready for the first sample of a recording.
    pub(super) fn restart(&mut self) {
        self.growing.iter_mut().for_each(Histogram::clear);
        self.n_counted.fill(0);
    }

    /// Counts what there is of the octaves, and of none much more at a time than a block has.
    #[inline(always)]
    pub(super) fn advance(&mut self, signals: BandSignals<'_>) {
        let Self { n_axes, growing, n_counted, words, bins, .. } = self;
        let octaves = growing.chunks_mut(*n_axes).zip(n_counted);
        for (band, (histograms, n_counted)) in (1..).zip(octaves) {
            if signals.len(band) < *n_counted + LEAST {
                continue;
            }
            let range = *n_counted..signals.len(band).min(*n_counted + 2 * LEAST);
            *n_counted = range.end;
            count::<true>(signals, band, range, histograms, words, bins);
        }
    }

    /// Histograms of all axes of a band, of all samples that are there. To be [undone](Self::undo) afterwards.
    ///
    /// All axes before any quantile: what reads counts waits until the last of them have left the processor's queue.
    #[inline(always)]
    fn finish(&mut self, signals: BandSignals<'_>, band: usize) -> &[Histogram] {
        let (histograms, n_before, words, bins) = self.of(band);
        count::<true>(signals, band, n_before..signals.len(band), histograms, words, bins);
        histograms
    }

    /// Takes off again what [`finish`](Self::finish) has counted: more samples may come.
    #[inline(always)]
    fn undo(&mut self, signals: BandSignals<'_>, band: usize) {
        let (histograms, n_before, words, bins) = self.of(band);
        if n_before == 0 {
            histograms.iter_mut().for_each(Histogram::clear);
        } else {
            count::<false>(signals, band, n_before..signals.len(band), histograms, words, bins);
        }
    }

    /// Where the axes of a band are counted, and how many of their samples are there.
    #[inline(always)]
    fn of(&mut self, band: usize) -> (&mut [Histogram], usize, &mut Words, &mut Bins) {
        let Self { n_axes, growing, n_counted, passing, words, bins } = self;
        let octave = band.wrapping_sub(1);
        let n_before = n_counted.get(octave).copied().unwrap_or(0);
        let histograms = if n_before == 0 { passing } else { &mut growing[octave * *n_axes..][..*n_axes] };
        (histograms, n_before, words, bins)
    }
}

/// Counts some samples of all axes of a band, or takes them off.
#[inline(always)]
fn count<const MORE: bool>(
    signals: BandSignals<'_>,
    band: usize,
    samples: Range<usize>,
    histograms: &mut [Histogram],
    words: &mut Words,
    bins: &mut Bins,
) {
    for (pair, histograms) in histograms.chunks_mut(TURNS).enumerate() {
        for start in samples.clone().step_by(BLOCK) {
            let n = BLOCK.min(samples.end - start);
            for ((axis, histogram), bins) in (pair * TURNS..).zip(&mut *histograms).zip(&mut *bins) {
                let values = &signals.axis(band, axis)[start..][..n];
                histogram.reach(values, &mut words[..n], &mut bins[..n]);
            }
            let [even, odd] = bins.each_ref().map(|bins| &bins[..n]);
            match &mut *histograms {
                [a, b] => {
                    let (eights_a, rest_a) = even.as_chunks::<LANES>();
                    let (eights_b, rest_b) = odd.as_chunks::<LANES>();
                    for (eight_a, eight_b) in eights_a.iter().zip(eights_b) {
                        for l in 0..LANES {
                            a.count::<MORE>(eight_a[l]);
                            b.count::<MORE>(eight_b[l]);
                        }
                    }
                    for (bin_a, bin_b) in rest_a.iter().zip(rest_b) {
                        a.count::<MORE>(*bin_a);
                        b.count::<MORE>(*bin_b);
                    }
                }
                alone => {
                    for histogram in alone {
                        for bin in even {
                            histogram.count::<MORE>(*bin);
                        }
                    }
                }
            }
        }
    }
}

/// The bits that choose the bin of a number.
#[allow(clippy::cast_possible_truncation)] // those that are left
#[inline(always)]
fn word(z: f32) -> i16 {
    ((z.to_bits() >> (u32::BITS - BITS)) as u16).cast_signed()
}

/// The bin of a number with these bits; those beyond the outermost bins count there.
#[inline(always)]
fn bin(word: i16) -> u16 {
    let outward = ((word & i16::MAX) >> FINER).clamp(BELOW, LAST) - BELOW;
    let sign = word >> (BITS - 1);
    (MIDDLE + ((outward ^ sign) - sign)).cast_unsigned()
}

/// The edges of all bins, ascending: bin `b` lies between edges `b` and `b + 1`.
fn edges() -> Vec<f64> {
    let outward = |k: i16| {
        let octave = f64::from(LOWEST + k / PER_OCTAVE);
        libm::exp2(octave) * (1.0 + f64::from(k % PER_OCTAVE) / f64::from(PER_OCTAVE))
    };
    let right = (0..=MIDDLE).map(outward);
    let left = (0..=MIDDLE).rev().map(|k| -outward(k));
    left.chain(right).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::{same_on_every_path, Signals};
    use super::*;
    use crate::dsp::Real;
    use crate::kernel::SimdPath;

    const MIDDLE: usize = super::MIDDLE as usize;

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        signals.compute(&Quantiles::new(signals.lengths(), signals.n_axes), path)
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn quantiles_of_one_to_a_thousand() {
        let signals = Signals::from(vec![vec![(1..=1000_u16).map(|x| f32::from(x) / 10.0).collect()]]);
        let got = compute(SimdPath::detect().unwrap(), &signals);
        for (got, p) in got.iter().zip(PROBABILITIES) {
            // No better than a bin is wide.
            assert!((got.sinh() / (0.1 + 99.9 * p) - 1.0).abs() < 1.0 / 16.0, "{p}: {}", got.sinh());
        }
        assert!((got[7] - (333_833.5_f64.sqrt() / 10.0 + FLOOR).ln()).abs() < 1e-6);
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
        let overflow = compute(SimdPath::detect().unwrap(), &Signals::from(vec![vec![vec![1e30; 50]]]));
        assert_eq!(overflow[7], f64::INFINITY);
    }

    fn counts(histograms: &mut BandHistograms, signals: &Signals) -> Vec<Vec<u32>> {
        let mut all = Vec::new();
        for band in 0..signals.lengths().len() {
            let of_axes = histograms.finish(signals.view(), band);
            all.extend(of_axes.iter().map(|histogram| histogram.counts.to_vec()));
            histograms.undo(signals.view(), band);
        }
        all
    }

    #[test]
    fn counts_grow_a_little_at_a_time_to_those_of_all_samples() {
        let signals = Signals::new(&[3000, 1000, 500, 63], 3);
        let mut fresh = BandHistograms::new(&signals.lengths(), 3);
        let expected = counts(&mut fresh, &signals);
        for (index, counts) in expected.iter().enumerate() {
            assert_eq!(counts.iter().sum::<u32>() as usize, signals.view().numbered(index).len());
        }
        let mut histograms = fresh.clone();
        for n_counted in [[128, 128], [256, 256], [384, 384], [512, 500], [640, 500]] {
            histograms.advance(signals.view());
            assert_eq!(histograms.n_counted, n_counted);
            assert!(
                counts(&mut histograms, &signals) == expected
                    && counts(&mut histograms, &signals) == expected
            );
        }
        histograms.restart();
        assert!(histograms
            .growing
            .iter()
            .chain(&*histograms.passing)
            .all(|histogram| histogram.counts == [0; ROOM]));
        assert!(counts(&mut histograms, &signals) == expected);
    }

    fn bin_of(z: f64) -> usize {
        bin(word(f32::of(z))).into()
    }

    #[test]
    fn edges_ascend_from_end_to_end() {
        let edges = edges();
        assert_eq!(edges.len(), N_BINS + 1);
        assert!(edges.is_sorted_by(|a, b| a < b));
        assert_eq!((edges[0], edges[N_BINS]), (-256.0, 256.0));
        assert_eq!(edges[MIDDLE..MIDDLE + 2], [-1.0 / 64.0, 1.0 / 64.0]);
    }

    #[test]
    fn an_edge_belongs_to_the_outer_bin() {
        let edges = edges();
        for (b, edge) in edges.iter().enumerate().take(N_BINS).skip(MIDDLE + 1) {
            assert_eq!(bin_of(*edge), b);
            assert_eq!(bin_of(f32::of(*edge).next_down().value()), b - 1);
            assert_eq!(bin_of(-edge), 2 * MIDDLE - b);
        }
    }

    #[test]
    fn the_ends() {
        for (z, expected) in [
            (0.0, MIDDLE),
            (-0.0, MIDDLE),
            (f32::from_bits(1).value(), MIDDLE),
            (-1e-3, MIDDLE),
            (255.9, N_BINS - 1),
            (256.0, N_BINS - 1),
            (f64::INFINITY, N_BINS - 1),
            (-f64::MAX, 0),
        ] {
            assert_eq!(bin_of(z), expected, "{z}");
        }
    }

    proptest! {
        #[test]
        fn a_number_lies_in_its_bin(z in -255.0..255.0_f32) {
            let (edges, z) = (edges(), z.value());
            prop_assert!(edges[bin_of(z)] <= z && z <= edges[bin_of(z) + 1]);
        }
    }
}
