//! From a recording to the signals of its bands.

use super::bands::{halved, halvings, n_octaves, Filters};
use super::octave::{halve, run, Coefficients, Line, Memory, Rows, BACK, ROWS};
use super::quad::{spread, Quad, QUAD};
use crate::error::{Error, Result};
use crate::lanes::Isa;

/// Signals begin at whole cache lines: this many float64.
const LINE: usize = 8;

/// Where the signal of one band lies: `n_axes` stretches of `len` samples, axis after axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Index of the first sample of the first axis.
    pub(super) start: usize,
    /// From the first sample of one axis to that of the next.
    pub(super) stride: usize,
    /// Samples of each axis.
    pub(super) len: usize,
}

/// The signals of all bands of one recording: band 0 is the recording without its mean, then octave after octave
/// downward, each at a rate of its own.
#[derive(Clone, Copy, Debug)]
pub(super) struct BandSignals<'a> {
    values: &'a [f64],
    places: &'a [Place],
    n_axes: usize,
}

impl<'a> BandSignals<'a> {
    /// Signals of `n_axes` axes, those of band `b` at `places[b]` of `values`.
    pub(super) fn new(values: &'a [f64], places: &'a [Place], n_axes: usize) -> Self {
        Self { values, places, n_axes }
    }

    /// Bands, band 0 included.
    #[inline(always)]
    pub(super) fn n_bands(&self) -> usize {
        self.places.len()
    }

    /// Axes of the recording.
    #[inline(always)]
    pub(super) fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// Samples of a band.
    #[inline(always)]
    pub(super) fn len(&self, band: usize) -> usize {
        self.places[band].len
    }

    /// One axis of a band, in time order.
    #[inline(always)]
    pub(super) fn axis(&self, band: usize, axis: usize) -> &'a [f64] {
        let Place { start, stride, len } = self.places[band];
        &self.values[start + axis * stride..][..len]
    }
}

/// Splits recordings of one shape into bands.
#[derive(Clone, Debug)]
pub(super) struct Bank {
    // Boxed, as are the rows below: their lanes want more alignment than every owner gives, Python's objects for one.
    coefficients: Box<Coefficients>,
    n_axes: usize,
    n_samples: usize,
    octaves: usize,
}

/// Memory for one recording and its bands.
#[derive(Clone, Debug)]
pub(super) struct BankWork {
    values: Vec<f64>,
    places: Vec<Place>,
    /// The current level of the pyramid below the first, four axes of it.
    level: Vec<Quad>,
    rows: Box<Rows>,
}

impl BankWork {
    /// The bands that [`Bank::split`] has left here.
    pub(super) fn signals(&self, n_axes: usize) -> BandSignals<'_> {
        BandSignals::new(&self.values[aligned(&self.values)..], &self.places, n_axes)
    }
}

/// Values before the first whole cache line.
fn aligned(values: &[f64]) -> usize {
    // Speed only: a pointer that cannot be aligned stays as it is.
    values.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE)
}

impl Bank {
    pub(super) fn new(n_samples: usize, n_axes: usize) -> Result<Self> {
        let coefficients = Box::new(Coefficients::new(&Filters::new()?));
        let bank = Self { coefficients, n_axes, n_samples, octaves: n_octaves(n_samples) };
        // All bands together hold less than five times the samples of the recording, and some room to align them.
        let room = n_samples
            .checked_add(2 * LINE)
            .and_then(|n| n.checked_mul(n_axes)?.checked_mul(8 * size_of::<f64>()));
        room.filter(|room| isize::try_from(*room).is_ok())
            .map(|_| bank)
            .ok_or(Error::TooLarge { n_samples, n_axes })
    }

    pub(super) fn work(&self) -> BankWork {
        let places = self.places(self.n_samples);
        let n_values = places.last().map_or(0, |last| last.start + self.n_axes * last.stride);
        BankWork {
            values: vec![0.0; n_values + LINE],
            places,
            level: vec![Quad::ZERO; self.n_samples.div_ceil(2)],
            rows: Box::new(Rows::new()),
        }
    }

    /// Where the bands of the first `n_seen` samples lie.
    fn places(&self, n_seen: usize) -> Vec<Place> {
        let mut start = 0;
        let rates = std::iter::once(0).chain((0..self.octaves).map(halvings));
        rates
            .map(|halvings| {
                let stride = halved(self.n_samples, halvings).next_multiple_of(LINE);
                let place = Place { start, stride, len: halved(n_seen, halvings) };
                start += self.n_axes * stride;
                place
            })
            .collect()
    }

    /// Splits the first samples of a recording, time-major; `means` are those of its axes, counted from the first sample.
    #[inline(always)]
    pub(super) fn split<I: Isa>(&self, recording: &[f64], means: &[f64], work: &mut BankWork) {
        let n_seen = recording.len() / self.n_axes;
        let rates = std::iter::once(0).chain((0..self.octaves).map(halvings));
        for (place, halvings) in work.places.iter_mut().zip(rates) {
            place.len = halved(n_seen, halvings);
        }
        for axis in (0..self.n_axes).step_by(QUAD) {
            match self.n_axes - axis {
                1 => self.quad::<I, 1>(recording, axis, means, work),
                2 => self.quad::<I, 2>(recording, axis, means, work),
                3 => self.quad::<I, 3>(recording, axis, means, work),
                _ => self.quad::<I, QUAD>(recording, axis, means, work),
            }
        }
    }

    /// `N` axes from `axis` on.
    #[inline(always)]
    fn quad<I: Isa, const N: usize>(
        &self,
        recording: &[f64],
        axis: usize,
        means: &[f64],
        work: &mut BankWork,
    ) {
        let BankWork { values, places, level, rows } = work;
        let first = aligned(values);
        let mut target = Target::<N> { values: &mut values[first..], places, axis };
        let c = &self.coefficients;
        self.first_level::<I, N>(recording, Quad::load::<N>(&means[axis..]), level, rows, &mut target);
        for octave in 2..self.octaves {
            let n_rows = target.places[1 + octave].len;
            let level = &mut level[..n_rows];
            let mut memory = Memory::REST;
            rows.rest();
            for start in (0..n_rows).step_by(ROWS) {
                let n = (n_rows - start).min(ROWS);
                rows.input[BACK..][..n].copy_from_slice(&level[start..][..n]);
                run::<false>(c, &mut memory, rows, n);
                target.write::<I>(1 + octave, start, n, &rows.octave, c.octave.gain);
                halve(c, &rows.smooth, &mut level[start / 2..][..n.div_ceil(2)]);
                rows.turn();
            }
        }
    }

    /// Band 0 and the octaves that are sampled at the full rate; what lies below them goes to `level`.
    #[inline(always)]
    fn first_level<I: Isa, const N: usize>(
        &self,
        recording: &[f64],
        mean: Quad,
        level: &mut [Quad],
        rows: &mut Rows,
        target: &mut Target<'_, N>,
    ) {
        let c = &self.coefficients;
        let mut memory = Memory::REST;
        rows.rest();
        let first = Quad::load::<N>(&recording[target.axis..]);
        for (block, samples) in recording.chunks(ROWS * self.n_axes).enumerate() {
            let (start, n) = (block * ROWS, samples.len() / self.n_axes);
            for (sample, (input, centred)) in
                samples.chunks_exact(self.n_axes).zip(rows.input[BACK..].iter_mut().zip(&mut rows.centred))
            {
                *input = Quad::load::<N>(&sample[target.axis..]).minus(first);
                *centred = input.minus(mean);
            }
            target.spread::<I>(0, start, n, &rows.centred, Quad::all(1.0));
            if self.octaves == 0 {
                continue;
            }
            run::<true>(c, &mut memory, rows, n);
            target.write::<I>(1, start, n, &rows.top, c.top.gain);
            target.write::<I>(2, start, n, &rows.octave, c.octave.gain);
            halve(c, &rows.smooth, &mut level[start / 2..][..n.div_ceil(2)]);
            rows.turn();
        }
    }
}

/// `N` axes of all bands, from `axis` on.
struct Target<'a, const N: usize> {
    values: &'a mut [f64],
    places: &'a [Place],
    axis: usize,
}

impl<const N: usize> Target<'_, N> {
    /// Writes `n` samples of a band from sample `t` on.
    #[inline(always)]
    fn write<I: Isa>(&mut self, band: usize, t: usize, n: usize, line: &Line, gain: Quad) {
        self.spread::<I>(band, t, n, &line[BACK..], gain);
    }

    /// The same from quads without earlier ones in front. A band that the recording is too short for is left out.
    #[inline(always)]
    fn spread<I: Isa>(&mut self, band: usize, t: usize, n: usize, quads: &[Quad], gain: Quad) {
        if let Some(place) = self.places.get(band) {
            let values = &mut self.values[place.start + self.axis * place.stride + t..];
            spread::<I, N>(quads, gain, n, place.stride, values);
        }
    }
}
