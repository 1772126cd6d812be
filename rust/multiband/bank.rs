//! From a recording to the signals of its bands.

use super::bands::{halved, halvings, n_octaves, Filters};
use super::octave::{run, Coefficients, Memory, Rows, BACK, ROWS};
use super::quad::{first, spread, Quad, QUAD};
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

/// The signals of all bands of one recording, divided by their scales: band 0 is the recording without its mean, then
/// octave after octave downward, each at a rate of its own.
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

    /// Samples of a band.
    #[inline(always)]
    pub(super) fn len(&self, band: usize) -> usize {
        self.places[band].len
    }

    /// Axes of each band.
    #[inline(always)]
    pub(super) fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// Signals in the order of bands, then of axes.
    #[inline(always)]
    pub(super) fn numbered(&self, index: usize) -> &'a [f64] {
        self.axis(index / self.n_axes, index % self.n_axes)
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
    /// What each band is multiplied by, four axes at a time, band-major.
    gains: Vec<Quad>,
    n_axes: usize,
    n_samples: usize,
    octaves: usize,
}

/// Memory for one recording and its bands.
#[derive(Clone, Debug)]
pub(super) struct BankWork {
    values: Vec<f64>,
    places: Vec<Place>,
    /// Four axes of the levels of the pyramid below the first, one after the other, each after [`BACK`] rows at rest.
    levels: Vec<Quad>,
    first_level: Box<FirstLevel>,
}

/// One block of the first level.
#[derive(Clone, Debug)]
struct FirstLevel {
    input: [Quad; BACK + ROWS],
    /// The input without its mean.
    centred: [Quad; ROWS],
    rows: Rows,
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
    /// For bands that are divided by `scales`, band-major.
    pub(super) fn new(n_samples: usize, n_axes: usize, scales: &[f64]) -> Result<Self> {
        // All bands together hold less than five times the samples of the recording, and some room to align them.
        let room = n_samples
            .checked_add(2 * LINE)
            .and_then(|n| n.checked_mul(n_axes)?.checked_mul(8 * size_of::<f64>()));
        if room.is_none_or(|room| isize::try_from(room).is_err()) {
            return Err(Error::TooLarge { n_samples, n_axes });
        }
        let filters = Filters::new()?;
        let mut gains = Vec::new();
        for (band, scales) in scales.chunks(n_axes).enumerate() {
            let gain = match band {
                0 => 1.0,
                1 => filters.top.gain,
                // Every halving has doubled the signal.
                _ => filters.octave.gain * (-f64::from(halvings(band - 1))).exp2(),
            };
            gains.extend(scales.chunks(QUAD).map(|scales| {
                let mut quad = Quad::ZERO;
                quad.0.iter_mut().zip(scales).for_each(|(lane, scale)| *lane = gain / scale);
                quad
            }));
        }
        let coefficients = Box::new(Coefficients::new(&filters));
        Ok(Self { coefficients, gains, n_axes, n_samples, octaves: n_octaves(n_samples) })
    }

    pub(super) fn work(&self) -> BankWork {
        let places = self.places(self.n_samples);
        let n_values = places.last().map_or(0, |last| last.start + self.n_axes * last.stride);
        // What the last level leaves is not used, but written.
        let n_rows = (1..self.octaves.max(2)).map(|halvings| self.room(halvings)).sum();
        BankWork {
            values: vec![0.0; n_values + LINE],
            places,
            levels: vec![Quad::ZERO; n_rows],
            first_level: Box::new(FirstLevel {
                input: [Quad::ZERO; BACK + ROWS],
                centred: [Quad::ZERO; ROWS],
                rows: Rows::new(),
            }),
        }
    }

    /// Rows that a level takes up: those at rest before it, then its own in pairs.
    fn room(&self, halvings: usize) -> usize {
        let halvings = u32::try_from(halvings).unwrap_or(u32::MAX);
        BACK + halved(self.n_samples, halvings).next_multiple_of(2)
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
        let BankWork { values, places, levels, first_level } = work;
        let start = aligned(values);
        let mut target = Target::<N> { values: &mut values[start..], places, axis, bank: self };
        self.first_level::<I, N>(recording, first::<N>(&means[axis..]), levels, first_level, &mut target);
        let rows = &mut first_level.rows;
        let mut rest = &mut **levels;
        for octave in 2..self.octaves {
            let n_rows = target.places[1 + octave].len;
            let (level, next) = rest.split_at_mut(self.room(octave - 1));
            let mut memory = Memory::REST;
            for start in (0..n_rows).step_by(ROWS) {
                let n = (n_rows - start).min(ROWS);
                let input = &level[start..][..BACK + n.next_multiple_of(2)];
                run::<false>(&self.coefficients, &mut memory, input, rows, &mut next[BACK + start / 2..]);
                target.write::<I>(1 + octave, start, n, &rows.octave);
            }
            rest = next;
        }
    }

    /// Band 0 and the octaves that are sampled at the full rate; what lies below them goes to `level`.
    #[inline(always)]
    fn first_level<I: Isa, const N: usize>(
        &self,
        recording: &[f64],
        mean: Quad,
        level: &mut [Quad],
        work: &mut FirstLevel,
        target: &mut Target<'_, N>,
    ) {
        let FirstLevel { input, centred, rows } = work;
        let mut memory = Memory::REST;
        input[..BACK].fill(Quad::ZERO);
        let at_start = first::<N>(&recording[target.axis..]);
        for (block, samples) in recording.chunks(ROWS * self.n_axes).enumerate() {
            let (start, n) = (block * ROWS, samples.len() / self.n_axes);
            for (sample, (input, centred)) in
                samples.chunks_exact(self.n_axes).zip(input[BACK..].iter_mut().zip(&mut *centred))
            {
                *input = first::<N>(&sample[target.axis..]) - at_start;
                *centred = *input - mean;
            }
            target.write::<I>(0, start, n, centred);
            if self.octaves == 0 {
                continue;
            }
            let rows_in = &input[..BACK + n.next_multiple_of(2)];
            run::<true>(&self.coefficients, &mut memory, rows_in, rows, &mut level[BACK + start / 2..]);
            target.write::<I>(1, start, n, &rows.top);
            target.write::<I>(2, start, n, &rows.octave);
            input.copy_within(ROWS.., 0);
        }
    }
}

/// `N` axes of all bands, from `axis` on.
struct Target<'a, const N: usize> {
    values: &'a mut [f64],
    places: &'a [Place],
    axis: usize,
    bank: &'a Bank,
}

impl<const N: usize> Target<'_, N> {
    /// Writes `n` samples of a band from sample `t` on. A band that the recording is too short for is left out.
    #[inline(always)]
    fn write<I: Isa>(&mut self, band: usize, t: usize, n: usize, quads: &[Quad; ROWS]) {
        if let Some(place) = self.places.get(band) {
            let gain = self.bank.gains[band * self.bank.n_axes.div_ceil(QUAD) + self.axis / QUAD];
            let values = &mut self.values[place.start + self.axis * place.stride + t..];
            spread::<I, N>(&quads[..n.next_multiple_of(QUAD)], gain, place.stride, values);
        }
    }
}
