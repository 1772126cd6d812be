//! The recurrences of one level of the pyramid.
//!
//! Poles are those of the designs, pair by pair. Zeros are shared out anew, which changes rounding only: each half of a
//! band-pass gets one zero at frequency 0 and one at Nyquist, `1 - z^-2`, and those of the low-pass are applied only where
//! a sample is kept. Signals are counted from the first sample: a start as if it had lasted for ever is then a start from
//! rest, and a constant leaves nothing behind, not even rounding.

use super::bands::{Filters, Poles};
use super::quad::Quad;

/// Rows that go through a level together.
pub(super) const ROWS: usize = 64;

/// Rows before the first of a block that its filters look back to.
pub(super) const BACK: usize = 4;

/// Coefficients side by side for the lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wide {
    pairs: [[Quad; 2]; 2],
    gain: Quad,
}

impl Wide {
    pub(super) fn new(poles: &Poles) -> Self {
        Self { pairs: poles.pairs.map(|pair| pair.map(Quad::all)), gain: Quad::all(poles.gain) }
    }
}

/// The filters of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coefficients {
    pub(super) top: Wide,
    pub(super) octave: Wide,
    pub(super) halving: Wide,
}

impl Coefficients {
    pub(super) fn new(filters: &Filters) -> Self {
        let [top, octave, halving] = [filters.top, filters.octave, filters.halving].map(|p| Wide::new(&p));
        Self { top, octave, halving }
    }
}

/// The last two outputs of each half of a filter, latest first.
pub(super) type Past = [[Quad; 2]; 2];

/// What a level remembers from one block to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory {
    top: Past,
    octave: Past,
    halving: Past,
}

impl Memory {
    /// As if the first sample had lasted for ever: signals are counted from it, so that it is zero.
    pub(super) const REST: Self = {
        let silence = [[Quad::ZERO; 2]; 2];
        Self { top: silence, octave: silence, halving: silence }
    };
}

/// One block of a level: room for `BACK` earlier rows, then the block.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) input: [Quad; BACK + ROWS],
    /// Poles of the low-pass only.
    pub(super) smooth: [Quad; BACK + ROWS],
    /// Before the filters run: the input without its mean.
    pub(super) top: [Quad; ROWS],
    pub(super) octave: [Quad; ROWS],
}

impl Rows {
    pub(super) fn new() -> Self {
        let silence = [Quad::ZERO; BACK + ROWS];
        Self { input: silence, smooth: silence, top: [Quad::ZERO; ROWS], octave: [Quad::ZERO; ROWS] }
    }

    /// Forgets what came before.
    #[inline(always)]
    pub(super) fn rest(&mut self) {
        self.input[..BACK].fill(Quad::ZERO);
        self.smooth[..BACK].fill(Quad::ZERO);
    }

    /// Keeps the last rows in front of the next block.
    #[inline(always)]
    pub(super) fn turn(&mut self) {
        self.input.copy_within(ROWS.., 0);
        self.smooth.copy_within(ROWS.., 0);
    }
}

/// One sample through half a filter without zeros.
#[inline(always)]
fn resonate([a1, a2]: &[Quad; 2], [y1, y2]: &mut [Quad; 2], x: Quad) -> Quad {
    // What is known early comes first: only one product and one difference wait for the sample before.
    let y = x.minus(a2.times(*y2)).minus(a1.times(*y1));
    (*y2, *y1) = (*y1, y);
    y
}

/// One sample through a band-pass; `rise` is what the input has gained over two samples.
#[inline(always)]
fn band_pass(filter: &Wide, past: &mut Past, rise: Quad) -> Quad {
    let [first, second] = past;
    let before = first[1];
    let rise = resonate(&filter.pairs[0], first, rise).minus(before);
    resonate(&filter.pairs[1], second, rise)
}

/// `n_rows` rows through all filters of a level; `TOP` on the first one, which has two octaves.
#[inline(always)]
pub(super) fn run<const TOP: bool>(c: &Coefficients, memory: &mut Memory, rows: &mut Rows, n_rows: usize) {
    let Memory { mut top, mut octave, mut halving } = *memory;
    for t in 0..n_rows.min(ROWS) {
        let x = rows.input[BACK + t];
        let rise = x.minus(rows.input[BACK + t - 2]);
        if TOP {
            rows.top[t] = band_pass(&c.top, &mut top, rise).times(c.top.gain);
        }
        rows.octave[t] = band_pass(&c.octave, &mut octave, rise).times(c.octave.gain);
        let half = resonate(&c.halving.pairs[0], &mut halving[0], x);
        rows.smooth[BACK + t] = resonate(&c.halving.pairs[1], &mut halving[1], half);
    }
    *memory = Memory { top, octave, halving };
}

/// Every second row after the low-pass, from row 0 of the block on.
#[inline(always)]
pub(super) fn halve(c: &Coefficients, smooth: &[Quad; BACK + ROWS], out: &mut [Quad]) {
    let (gain, four, six) = (c.halving.gain, Quad::all(4.0), Quad::all(6.0));
    for (rows, out) in smooth.windows(BACK + 1).step_by(2).zip(out) {
        let outer = rows[0].plus(rows[4]);
        let inner = rows[1].plus(rows[3]).times(four);
        *out = outer.plus(inner).plus(rows[2].times(six)).times(gain);
    }
}
