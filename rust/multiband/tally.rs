//! Histograms of the signals of all bands, counted as they grow.

use std::ops::Range;

use super::band_signals::BandSignals;
use super::log_bins::{bin, word, N_BINS};

/// Samples of an octave that are worth counting before the others are there.
const LEAST: usize = 64;

/// Samples whose bins are found before any of them is counted.
const BLOCK: usize = 512;

/// Bins of one histogram, rounded up so that a mask keeps an index within.
const ROOM: usize = N_BINS.next_power_of_two();

/// Signals that take turns, so that a value need not wait until the one before it is counted.
pub(super) const TURNS: usize = 2;

/// Numbers worked with as one.
const LANES: usize = 8;

/// Counts of one signal; whole cache lines, so that vectors of them do not cross any.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Histogram {
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
    pub(super) fn counts<const L: usize>(&self) -> (&[[u32; L]], usize) {
        let first = usize::from(self.least) / L;
        let end = (usize::from(self.most) + 1).div_ceil(L);
        (&self.counts.as_chunks::<L>().0[first..end], first * L)
    }

    /// Back to no counts.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        if self.least <= self.most {
            self.counts[usize::from(self.least)..=usize::from(self.most)].fill(0);
        }
        (self.least, self.most) = (u16::MAX, 0);
    }

    #[inline(always)]
    fn reach(&mut self, bins: &[u16]) {
        for bin in bins {
            self.least = self.least.min(*bin);
            self.most = self.most.max(*bin);
        }
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
pub(super) struct Tally {
    n_axes: usize,
    /// Those of the octaves that are long enough to be counted while they grow, axis by axis.
    growing: Vec<Histogram>,
    /// How many samples of each of these octaves are in them.
    n_counted: Vec<usize>,
    /// Those of other signals whose turn it is; empty in between.
    passing: Box<[Histogram; TURNS]>,
    // Bins go through memory, which is the fastest way from vectors to addresses.
    words: Box<Words>,
    bins: Box<Bins>,
}

impl Tally {
    /// For bands of some numbers of samples, the longest first.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        let n_growing = lengths.iter().skip(1).filter(|n| **n >= LEAST).count();
        Self {
            n_axes,
            growing: vec![Histogram::EMPTY; n_growing * n_axes],
            n_counted: vec![0; n_growing],
            passing: Box::new([Histogram::EMPTY; TURNS]),
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
            for (pair, histograms) in histograms.chunks_mut(TURNS).enumerate() {
                count::<true>(signals, band, pair * TURNS, range.clone(), histograms, words, bins);
            }
            *n_counted = range.end;
        }
    }

    /// Histograms of two axes of a band, from `axis` on, or of the last one; of all samples that are there. To be
    /// [undone](Self::undo) afterwards.
    #[inline(always)]
    pub(super) fn finish(&mut self, signals: BandSignals<'_>, band: usize, axis: usize) -> &[Histogram] {
        let (histograms, n_before, words, bins) = self.turn(band, axis);
        count::<true>(signals, band, axis, n_before..signals.len(band), histograms, words, bins);
        histograms
    }

    /// Takes off again what [`finish`](Self::finish) has counted: more samples may come.
    #[inline(always)]
    pub(super) fn undo(&mut self, signals: BandSignals<'_>, band: usize, axis: usize) {
        let (histograms, n_before, words, bins) = self.turn(band, axis);
        if n_before == 0 {
            histograms.iter_mut().for_each(Histogram::clear);
        } else {
            count::<false>(signals, band, axis, n_before..signals.len(band), histograms, words, bins);
        }
    }

    /// Where two axes of a band are counted, or the last one, and how many of their samples are there.
    #[inline(always)]
    fn turn(&mut self, band: usize, axis: usize) -> (&mut [Histogram], usize, &mut Words, &mut Bins) {
        let Self { n_axes, growing, n_counted, passing, words, bins } = self;
        let octave = band.wrapping_sub(1);
        let n_before = n_counted.get(octave).copied().unwrap_or(0);
        let histograms =
            if n_before == 0 { &mut passing[..] } else { &mut growing[octave * *n_axes + axis..] };
        (&mut histograms[..TURNS.min(*n_axes - axis)], n_before, words, bins)
    }
}

/// Counts some samples of one or two axes of a band, from `axis` on, or takes them off.
#[inline(always)]
fn count<const MORE: bool>(
    signals: BandSignals<'_>,
    band: usize,
    axis: usize,
    samples: Range<usize>,
    histograms: &mut [Histogram],
    words: &mut Words,
    bins: &mut Bins,
) {
    for start in samples.clone().step_by(BLOCK) {
        let n = BLOCK.min(samples.end - start);
        for ((axis, histogram), bins) in (axis..).zip(&mut *histograms).zip(&mut *bins) {
            let values = &signals.axis(band, axis)[start..][..n];
            let (words, bins) = (&mut words[..n], &mut bins[..n]);
            for (word_of_z, z) in words.iter_mut().zip(values) {
                *word_of_z = word(*z);
            }
            for (bin_of_z, word) in bins.iter_mut().zip(&*words) {
                *bin_of_z = bin(*word);
            }
            histogram.reach(bins);
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

#[cfg(test)]
mod tests {
    use super::super::signals::Signals;
    use super::*;

    fn counts(tally: &mut Tally, signals: &Signals) -> Vec<Vec<u32>> {
        let mut all = Vec::new();
        for band in 0..signals.lengths().len() {
            for axis in (0..signals.n_axes()).step_by(TURNS) {
                let histograms = tally.finish(signals.view(), band, axis);
                all.extend(histograms.iter().map(|histogram| histogram.counts.to_vec()));
                tally.undo(signals.view(), band, axis);
            }
        }
        all
    }

    #[test]
    fn counts_grow_a_little_at_a_time_to_those_of_all_samples() {
        let signals = Signals::new(&[1000, 1000, 500, 63], 3);
        let mut fresh = Tally::new(&signals.lengths(), 3);
        let expected = counts(&mut fresh, &signals);
        for (index, counts) in expected.iter().enumerate() {
            assert_eq!(counts.iter().sum::<u32>() as usize, signals.view().numbered(index).len());
        }
        let mut tally = fresh.clone();
        for n_counted in [[128, 128], [256, 256], [384, 384], [512, 500], [640, 500]] {
            tally.advance(signals.view());
            assert_eq!(tally.n_counted, n_counted);
            assert!(counts(&mut tally, &signals) == expected && counts(&mut tally, &signals) == expected);
        }
        tally.restart();
        assert!(tally.growing.iter().chain(&*tally.passing).all(|histogram| histogram.counts == [0; ROOM]));
        assert!(counts(&mut tally, &signals) == expected);
    }
}
