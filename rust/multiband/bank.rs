//! From a recording to the signals of its bands, as it arrives or all at once.

use std::marker::PhantomData;

use super::band_signals::{BandSignals, Place};
use super::bands::{halved, halvings, n_octaves, Filters};
use super::octave::{Coefficients, Rows, ROWS};
use super::pyramid::{Pyramid, Target};
use super::quad::{first, spread, Quad, QUAD};
use crate::error::{Error, Result};
use crate::kernel::Isa;

/// Signals begin at whole cache lines: this many float64.
const LINE: usize = 8;

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
    /// One for four axes; none where there are no octaves.
    pyramids: Vec<Pyramid>,
    /// What comes out of a level, or of the means.
    rows: Box<Rows>,
}

impl BankWork {
    /// What there is of the bands.
    pub(super) fn signals(&self, n_axes: usize) -> BandSignals<'_> {
        BandSignals::new(&self.values[aligned(&self.values)..], &self.places, n_axes)
    }

    /// Rows of the recording that have become octaves for good.
    pub(super) fn n_done(&self) -> usize {
        self.pyramids.first().map_or(0, Pyramid::n_done)
    }

    /// Ready for the first row of a recording.
    pub(super) fn restart(&mut self) {
        self.pyramids.iter_mut().for_each(Pyramid::restart);
    }
}

/// Values before the first whole cache line.
fn aligned(values: &[f64]) -> usize {
    // Speed only: a pointer that cannot be aligned stays as it is.
    values.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE)
}

/// How often the rate is halved before each of the bands.
fn rates(octaves: usize) -> impl Iterator<Item = u32> {
    std::iter::once(0).chain((0..octaves).map(halvings))
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
                _ => filters.octave.gain * libm::exp2(-f64::from(halvings(band - 1))),
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
        let mut start = 0;
        let place = |halvings| {
            let stride = halved(self.n_samples, halvings).next_multiple_of(LINE);
            let place = Place { start, stride, len: 0 };
            start += self.n_axes * stride;
            place
        };
        let places: Vec<_> = rates(self.octaves).map(place).collect();
        BankWork {
            values: vec![0.0; start + LINE],
            places,
            pyramids: match self.octaves {
                0 => Vec::new(),
                octaves => vec![Pyramid::new(octaves); self.n_axes.div_ceil(QUAD)],
            },
            rows: Box::new(Rows::new()),
        }
    }

    /// Splits the next block of a recording of which `recording` is the beginning, time-major, into octaves; false where it
    /// is not there yet.
    #[inline(always)]
    pub(super) fn advance<I: Isa>(&self, recording: &[f64], work: &mut BankWork) -> bool {
        let n_after = work.n_done() + ROWS;
        if self.octaves == 0 || recording.len() / self.n_axes < n_after {
            return false;
        }
        for axis in (0..self.n_axes).step_by(QUAD) {
            match self.n_axes - axis {
                1 => self.advance_quad::<I, 1>(recording, axis, work),
                2 => self.advance_quad::<I, 2>(recording, axis, work),
                3 => self.advance_quad::<I, 3>(recording, axis, work),
                _ => self.advance_quad::<I, QUAD>(recording, axis, work),
            }
        }
        for (place, halvings) in work.places.iter_mut().zip(rates(self.octaves)).skip(1) {
            place.len = (n_after >> halvings) / ROWS * ROWS;
        }
        true
    }

    /// Splits what [`advance`](Self::advance) has left of a recording, of which more may come, and gives band 0; `means` are
    /// those of its axes, counted from the first sample.
    #[inline(always)]
    pub(super) fn finish<I: Isa>(&self, recording: &[f64], means: &[f64], work: &mut BankWork) {
        for axis in (0..self.n_axes).step_by(QUAD) {
            match self.n_axes - axis {
                1 => self.finish_quad::<I, 1>(recording, axis, means, work),
                2 => self.finish_quad::<I, 2>(recording, axis, means, work),
                3 => self.finish_quad::<I, 3>(recording, axis, means, work),
                _ => self.finish_quad::<I, QUAD>(recording, axis, means, work),
            }
        }
        let n_seen = recording.len() / self.n_axes;
        for (place, halvings) in work.places.iter_mut().zip(rates(self.octaves)) {
            place.len = halved(n_seen, halvings);
        }
    }

    /// `N` axes from `axis` on, one block.
    #[inline(always)]
    fn advance_quad<I: Isa, const N: usize>(&self, recording: &[f64], axis: usize, work: &mut BankWork) {
        let (mut target, pyramid, rows) = self.axes::<I, N>(axis, work);
        let Some(pyramid) = pyramid else { return };
        let at_start = first::<N>(&recording[axis..]);
        let block = recording[pyramid.n_done() * self.n_axes..].chunks_exact(self.n_axes);
        for (row, input) in block.zip(pyramid.input()) {
            *input = first::<N>(&row[axis..]) - at_start;
        }
        pyramid.advance(&self.coefficients, rows, &mut target);
    }

    /// `N` axes from `axis` on, to the end.
    #[inline(always)]
    fn finish_quad<I: Isa, const N: usize>(
        &self,
        recording: &[f64],
        axis: usize,
        means: &[f64],
        work: &mut BankWork,
    ) {
        let (mut target, mut pyramid, rows) = self.axes::<I, N>(axis, work);
        let n_done = pyramid.as_ref().map_or(0, |pyramid| pyramid.n_done());
        let (at_start, mean) = (first::<N>(&recording[axis..]), first::<N>(&means[axis..]));
        for (block, samples) in recording.chunks(ROWS * self.n_axes).enumerate() {
            let (start, n) = (block * ROWS, samples.len() / self.n_axes);
            for (row, centred) in samples.chunks_exact(self.n_axes).zip(&mut rows.top) {
                *centred = first::<N>(&row[axis..]) - at_start - mean;
            }
            target.write(0, start, n, &rows.top);
            let Some(pyramid) = pyramid.as_deref_mut().filter(|_| start >= n_done) else { continue };
            for (row, input) in samples.chunks_exact(self.n_axes).zip(pyramid.input()) {
                *input = first::<N>(&row[axis..]) - at_start;
            }
            if n == ROWS {
                pyramid.advance(&self.coefficients, rows, &mut target);
            }
        }
        if let Some(pyramid) = pyramid {
            let n_rest = recording.len() / self.n_axes % ROWS;
            pyramid.finish(&self.coefficients, n_rest, rows, &mut target);
        }
    }

    /// What `N` axes from `axis` on work in.
    #[inline(always)]
    fn axes<'a, I, const N: usize>(
        &'a self,
        axis: usize,
        work: &'a mut BankWork,
    ) -> (Axes<'a, I, N>, Option<&'a mut Pyramid>, &'a mut Rows) {
        let BankWork { values, places, pyramids, rows } = work;
        let from = aligned(values);
        let values = &mut values[from..];
        let target = Axes { values, places, axis, bank: self, isa: PhantomData };
        (target, pyramids.get_mut(axis / QUAD), rows)
    }
}

/// `N` axes of all bands, from `axis` on.
struct Axes<'a, I, const N: usize> {
    values: &'a mut [f64],
    places: &'a [Place],
    axis: usize,
    bank: &'a Bank,
    isa: PhantomData<I>,
}

impl<I: Isa, const N: usize> Target for Axes<'_, I, N> {
    /// A band that the recording is too short for is left out.
    #[inline(always)]
    fn write(&mut self, band: usize, start: usize, n: usize, rows: &[Quad; ROWS]) {
        if let Some(place) = self.places.get(band) {
            let gain = self.bank.gains[band * self.bank.n_axes.div_ceil(QUAD) + self.axis / QUAD];
            let values = &mut self.values[place.start + self.axis * place.stride + start..];
            spread::<I, N>(&rows[..n.next_multiple_of(QUAD)], gain, place.stride, values);
        }
    }
}
