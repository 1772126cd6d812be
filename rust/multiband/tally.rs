//! Histograms of the signals of all bands, counted as they grow.

use super::band_signals::BandSignals;
use super::log_bins::{bin, word, N_BINS};

/// Samples of a band that are counted together: they are in the cache still.
const CHUNK: usize = 256;

/// Samples whose bins are found before any of them is counted.
const BLOCK: usize = 512;

/// Bins of one histogram, rounded up so that a mask keeps an index within.
const ROOM: usize = N_BINS.next_power_of_two();

/// Signals that take turns, so that a value need not wait until the one before it is counted.
pub(super) const TURNS: usize = 2;

/// Numbers worked with as one.
const LANES: usize = 8;

/// Counts of one signal.
#[derive(Clone, Debug)]
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

    /// The counts of another one; this one is empty.
    #[inline(always)]
    fn copy(&mut self, other: &Self) {
        (self.least, self.most) = (other.least, other.most);
        if self.least <= self.most {
            let range = usize::from(self.least)..=usize::from(self.most);
            self.counts[range.clone()].copy_from_slice(&other.counts[range]);
        }
    }

    #[inline(always)]
    fn reach(&mut self, bins: &[u16]) {
        for bin in bins {
            self.least = self.least.min(*bin);
            self.most = self.most.max(*bin);
        }
    }

    #[inline(always)]
    fn add(&mut self, bin: u16) {
        self.counts[usize::from(bin) % ROOM] += 1;
    }
}

/// Histograms of one recording.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    n_axes: usize,
    /// Those of the octaves that are long enough to be counted while they grow, axis by axis.
    growing: Vec<Histogram>,
    /// How many samples of each of these octaves are in them.
    n_counted: Vec<usize>,
    /// Those of the signals whose turn it is, of all their samples.
    whole: Box<[Histogram; TURNS]>,
    // Bins go through memory, which is the fastest way from vectors to addresses.
    words: Box<[i16; BLOCK]>,
    bins: Box<[[u16; BLOCK]; TURNS]>,
}

impl Tally {
    /// For bands of some numbers of samples, the longest first.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        let n_growing = lengths.iter().skip(1).filter(|n| **n >= CHUNK).count();
        Self {
            n_axes,
            growing: vec![Histogram::EMPTY; n_growing * n_axes],
            n_counted: vec![0; n_growing],
            whole: Box::new([Histogram::EMPTY; TURNS]),
            words: Box::new([0; BLOCK]),
            bins: Box::new([[0; BLOCK]; TURNS]),
        }
    }

    /// Ready for the first sample of a recording.
    pub(super) fn restart(&mut self) {
        self.growing.iter_mut().for_each(Histogram::clear);
        self.n_counted.fill(0);
    }

    /// Counts what there is of the octaves.
    #[inline(always)]
    pub(super) fn advance(&mut self, signals: BandSignals<'_>) {
        let Self { n_axes, growing, n_counted, words, bins, .. } = self;
        let octaves = growing.chunks_mut(*n_axes).zip(n_counted);
        for (band, (histograms, n_counted)) in (1..).zip(octaves) {
            let len = signals.len(band);
            if len < *n_counted + CHUNK {
                continue;
            }
            for (pair, histograms) in histograms.chunks_mut(TURNS).enumerate() {
                count(signals, band, pair * TURNS, *n_counted, histograms, words, bins);
            }
            *n_counted = len;
        }
    }

    /// Histograms of two axes of a band, from `axis` on, or of the last one; of all samples that are there. They must be
    /// [cleared](Histogram::clear) afterwards.
    #[inline(always)]
    pub(super) fn finish(&mut self, signals: BandSignals<'_>, band: usize, axis: usize) -> &mut [Histogram] {
        let Self { n_axes, growing, n_counted, whole, words, bins } = self;
        let whole = &mut whole[..TURNS.min(*n_axes - axis)];
        let mut n_before = 0;
        if let Some(n) = band.checked_sub(1).and_then(|octave| n_counted.get(octave)) {
            n_before = *n;
            for (whole, so_far) in whole.iter_mut().zip(&growing[(band - 1) * *n_axes + axis..]) {
                whole.copy(so_far);
            }
        }
        count(signals, band, axis, n_before, whole, words, bins);
        whole
    }
}

/// Counts the samples of one or two axes of a band, from `axis` on, behind the first `n_before`.
#[inline(always)]
fn count(
    signals: BandSignals<'_>,
    band: usize,
    axis: usize,
    n_before: usize,
    histograms: &mut [Histogram],
    words: &mut [i16; BLOCK],
    bins: &mut [[u16; BLOCK]; TURNS],
) {
    for start in (n_before..signals.len(band)).step_by(BLOCK) {
        let n = BLOCK.min(signals.len(band) - start);
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
                        a.add(eight_a[l]);
                        b.add(eight_b[l]);
                    }
                }
                for (bin_a, bin_b) in rest_a.iter().zip(rest_b) {
                    a.add(*bin_a);
                    b.add(*bin_b);
                }
            }
            alone => {
                for histogram in alone {
                    for bin in even {
                        histogram.add(*bin);
                    }
                }
            }
        }
    }
}
