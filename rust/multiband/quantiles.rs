//! Distribution of the values of a band: quantiles of a histogram, and the size of the signal.
//!
//! Bins have nearly equal ratio and are found in the bits of a number: the exponent and the first four bits of the mantissa
//! of a float32 say in which sixteenth of which octave it lies, so no logarithm and no search is needed.

use std::ops::Range;

use super::envelope::mean_square;
use super::{Split, Statistic};
use crate::kernel::Simd;

/// Which quantiles.
pub(super) const PROBABILITIES: [f64; 7] = [0.02, 0.10, 0.25, 0.50, 0.75, 0.90, 0.98];

/// Added to the RMS of scaled signals before its logarithm.
const FLOOR: f64 = 1e-3;

/// Numbers per axis.
pub(super) const PER_AXIS: usize = PROBABILITIES.len() + 1;

/// Samples whose bins are found before any of them is counted.
const BLOCK: usize = 1024;

/// Bins of one histogram, rounded up so that a mask keeps an index within.
const ROOM: usize = N_BINS.next_power_of_two();

/// Bins that a search for a rank steps over at a time.
const STEP: usize = 16;

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
    /// Bands times axes.
    n_signals: usize,
    edges: Vec<f64>,
}

impl Quantiles {
    pub(super) fn new(n_signals: usize) -> Self {
        Self { n_signals, edges: edges() }
    }
}

impl Statistic for Quantiles {
    type Work = Histogram;

    fn n_features(&self) -> usize {
        self.n_signals * PER_AXIS
    }

    fn work(&self) -> Histogram {
        Histogram { words: [0; BLOCK], counts: [[0; ROOM]; 2] }
    }

    /// Band by band, axis by axis: inverse hyperbolic sines of quantiles, then the logarithm of the RMS.
    #[inline(always)]
    fn compute(&self, _simd: impl Simd, split: Split<'_>, histogram: &mut Histogram, out: &mut [f64]) {
        let signals = out.as_chunks_mut::<PER_AXIS>().0.iter_mut().zip(split.energies).enumerate();
        for (index, ([quantiles @ .., log_rms], energies)) in signals {
            let signal = split.signals.numbered(index);
            let bins = histogram.count(signal);
            histogram.quantiles(signal.len(), bins.start, &self.edges, quantiles);
            histogram.clear(bins);
            *log_rms = libm::log(mean_square(energies, signal.len()).sqrt() + FLOOR);
        }
    }
}

/// Counts of one signal.
#[derive(Clone, Debug)]
pub(super) struct Histogram {
    /// Bins of some samples. By way of memory, which is the fastest from vectors to addresses.
    words: [i16; BLOCK],
    /// Of every other sample, so that a sample need not wait until the one before it is counted; then of all, in the first.
    counts: [[u32; ROOM]; 2],
}

impl Histogram {
    /// Counts a signal; gives the bins from the first to the last that hold any.
    #[inline(always)]
    fn count(&mut self, signal: &[f32]) -> Range<usize> {
        let Self { words, counts: [even, odd] } = self;
        let (mut least, mut most) = (i16::MAX, i16::MIN);
        for values in signal.chunks(BLOCK) {
            let words = &mut words[..values.len()];
            // Bits first, all of them: they are half as wide as the values.
            for (word_of_z, z) in words.iter_mut().zip(values) {
                *word_of_z = word(*z);
            }
            for word in &mut *words {
                *word = bin(*word);
                (least, most) = (least.min(*word), most.max(*word));
            }
            let (pairs, rest) = words.as_chunks::<2>();
            for [a, b] in pairs {
                even[place(*a)] += 1;
                odd[place(*b)] += 1;
            }
            for a in rest {
                even[place(*a)] += 1;
            }
        }
        let bins = place(least)..place(most) + 1;
        for (even, odd) in even[bins.clone()].iter_mut().zip(&odd[bins.clone()]) {
            *even += *odd;
        }
        bins
    }

    /// Back to no counts.
    #[inline(always)]
    fn clear(&mut self, bins: Range<usize>) {
        for counts in &mut self.counts {
            counts[bins.clone()].fill(0);
        }
    }

    /// Inverse hyperbolic sines of the quantiles of `n` counted samples, of which none lies before bin `first`: the rank
    /// `p (n - 1) + 1/2`, linear within the bin in which it lies.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // ranks are at most n, which is 32 bits wide
    #[inline(always)]
    fn quantiles(&self, n: usize, mut first: usize, edges: &[f64], out: &mut [f64; PROBABILITIES.len()]) {
        let (counts, mut before) = (&self.counts[0], 0);
        for (out, p) in out.iter_mut().zip(PROBABILITIES) {
            let rank = p * (n as f64 - 1.0) + 0.5;
            // A count reaches a rank where it reaches the next whole number.
            let whole = rank.ceil() as u32;
            // Ranks ascend: from where the last one was found, first many bins at a time.
            while let Some(step) = counts[first..].first_chunk::<STEP>() {
                let above = before + step.iter().sum::<u32>();
                if above >= whole {
                    break;
                }
                (first, before) = (first + STEP, above);
            }
            let (mut bin, mut below) = (first, before);
            while bin + 1 < N_BINS && below + counts[bin] < whole {
                below += counts[bin];
                bin += 1;
            }
            let share = (rank - f64::from(below)) / f64::from(counts[bin]);
            *out = asinh(edges[bin] + share * (edges[bin + 1] - edges[bin]));
        }
    }
}

/// The inverse hyperbolic sine, as exact as a number near one can be: in half the time of a function that is so near zero.
#[inline(always)]
fn asinh(x: f64) -> f64 {
    libm::log(x.abs() + (x * x + 1.0).sqrt()).copysign(x)
}

/// The place of a bin among counts. The mask changes none.
fn place(bin: i16) -> usize {
    usize::from(bin.cast_unsigned()) % ROOM
}

/// The bits that choose the bin of a number.
#[inline(always)]
fn word(z: f32) -> i16 {
    ((z.to_bits() >> (u32::BITS - BITS)) as u16).cast_signed()
}

/// The bin of a number with these bits; those beyond the outermost bins count there.
#[inline(always)]
fn bin(word: i16) -> i16 {
    let outward = ((word & i16::MAX) >> FINER).clamp(BELOW, LAST) - BELOW;
    let sign = word >> (BITS - 1);
    MIDDLE + ((outward ^ sign) - sign)
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

    use super::super::narrow;
    use super::super::tests::Signals;
    use super::*;

    const MIDDLE: usize = super::MIDDLE as usize;

    #[test]
    fn every_sample_is_counted_once() {
        let mut histogram = Quantiles::new(1).work();
        for n in [3000, 1, 62, 1025] {
            let signals = Signals::new(&[n], 1);
            let signal = signals.view().numbered(0);
            let bins = histogram.count(signal);
            let mut expected = [0; ROOM];
            for z in signal {
                expected[bin_of(f64::from(*z))] += 1;
            }
            assert_eq!(histogram.counts[0], expected);
            histogram.clear(bins);
        }
    }

    fn bin_of(z: f64) -> usize {
        place(bin(word(narrow(z))))
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
            assert_eq!(bin_of(narrow(*edge).next_down().into()), b - 1);
            assert_eq!(bin_of(-edge), 2 * MIDDLE - b);
        }
    }

    proptest! {
        #[test]
        fn a_number_lies_in_its_bin(z in -255.0..255.0_f32) {
            let (edges, z) = (edges(), f64::from(z));
            prop_assert!(edges[bin_of(z)] <= z && z <= edges[bin_of(z) + 1]);
        }
    }
}
