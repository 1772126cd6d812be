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
    pub(super) gain: Quad,
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

/// What one half of a filter has given last.
#[derive(Clone, Copy, Debug)]
struct Half {
    latest: Quad,
    before: Quad,
}

impl Half {
    const REST: Self = Self { latest: Quad::ZERO, before: Quad::ZERO };
}

/// What a level remembers from one block to the next, apart from rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory {
    /// First halves of the filters; what the second ones have given is found in the rows.
    top: Half,
    octave: Half,
    halving: Half,
}

impl Memory {
    /// As if the first sample had lasted for ever: signals are counted from it, so that it is zero.
    pub(super) const REST: Self = Self { top: Half::REST, octave: Half::REST, halving: Half::REST };
}

/// Room for `BACK` earlier rows, then a block.
pub(super) type Line = [Quad; BACK + ROWS];

/// One block of a level; outputs without the gain of their filter.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) input: Line,
    /// The low-pass, without its zeros.
    pub(super) smooth: Line,
    pub(super) top: Line,
    pub(super) octave: Line,
    /// The input of the first level without its mean.
    pub(super) centred: [Quad; ROWS],
}

impl Rows {
    pub(super) fn new() -> Self {
        let silence = [Quad::ZERO; BACK + ROWS];
        Self { input: silence, smooth: silence, top: silence, octave: silence, centred: [Quad::ZERO; ROWS] }
    }

    /// Forgets what came before.
    #[inline(always)]
    pub(super) fn rest(&mut self) {
        for line in [&mut self.input, &mut self.smooth, &mut self.top, &mut self.octave] {
            line[..BACK].fill(Quad::ZERO);
        }
    }

    /// Keeps the last rows in front of the next block.
    #[inline(always)]
    pub(super) fn turn(&mut self) {
        for line in [&mut self.input, &mut self.smooth, &mut self.top, &mut self.octave] {
            line.copy_within(ROWS.., 0);
        }
    }
}

/// Half a filter without its zeros. What is known early comes first: only one product and one difference wait for the
/// sample before.
#[inline(always)]
fn resonate([a1, a2]: &[Quad; 2], latest: Quad, before: Quad, x: Quad) -> Quad {
    x.minus(a2.times(before)).minus(a1.times(latest))
}

/// One row through a filter: `x` through the first half, then the second, whose last two outputs are given.
///
/// For a band-pass `x` is what the input has gained over two rows; the gain of the first half goes to the second.
#[inline(always)]
fn filter<const BAND: bool>(filter: &Wide, half: &mut Half, x: Quad, latest: Quad, before: Quad) -> Quad {
    let y = resonate(&filter.pairs[0], half.latest, half.before, x);
    let x = if BAND { y.minus(half.before) } else { y };
    *half = Half { latest: y, before: half.latest };
    resonate(&filter.pairs[1], latest, before, x)
}

/// `n_rows` rows through all filters of a level; `TOP` on the first one, which has two octaves.
#[inline(always)]
pub(super) fn run<const TOP: bool>(c: &Coefficients, memory: &mut Memory, rows: &mut Rows, n_rows: usize) {
    let Memory { mut top, mut octave, mut halving } = *memory;
    // The latest rows stay in registers. Earlier ones are read back, for which there is time; registers are few.
    let (mut top_row, mut octave_row) = (rows.top[BACK - 1], rows.octave[BACK - 1]);
    let mut smooth_row = rows.smooth[BACK - 1];
    for t in BACK..BACK + n_rows.min(ROWS) {
        let x = rows.input[t];
        let rise = x.minus(rows.input[t - 2]);
        if TOP {
            top_row = filter::<true>(&c.top, &mut top, rise, top_row, rows.top[t - 2]);
            rows.top[t] = top_row;
        }
        octave_row = filter::<true>(&c.octave, &mut octave, rise, octave_row, rows.octave[t - 2]);
        rows.octave[t] = octave_row;
        smooth_row = filter::<false>(&c.halving, &mut halving, x, smooth_row, rows.smooth[t - 2]);
        rows.smooth[t] = smooth_row;
    }
    *memory = Memory { top, octave, halving };
}

/// Every second row after the low-pass, from row 0 of the block on.
#[inline(always)]
pub(super) fn halve(c: &Coefficients, smooth: &Line, out: &mut [Quad]) {
    let (gain, four, six) = (c.halving.gain, Quad::all(4.0), Quad::all(6.0));
    for (rows, out) in smooth.windows(BACK + 1).step_by(2).zip(out) {
        let outer = rows[0].plus(rows[4]);
        let inner = rows[1].plus(rows[3]).times(four);
        *out = outer.plus(inner).plus(rows[2].times(six)).times(gain);
    }
}
