//! The recurrences of one level of the pyramid.
//!
//! Poles are those of the designs, pair by pair. Both octaves of a level have the same zeros, twice at frequency 0 and twice
//! at Nyquist: `(1 - z^-2)^2` is taken once. Signals are counted from the first sample: a start as if it had lasted for ever
//! is then a start from rest, and a constant leaves nothing behind, not even rounding.

use super::bands::{Filters, Poles};
use super::quad::Quad;

/// Rows that go through a level together: an even number, whole quads.
pub(super) const ROWS: usize = 64;

/// Rows before the first that a level looks back to.
pub(super) const BACK: usize = 4;

/// The poles of a band-pass, side by side for the lanes.
#[derive(Clone, Copy, Debug)]
struct Wide([[Quad; 2]; 2]);

impl Wide {
    fn new(poles: &Poles) -> Self {
        Self(poles.pairs.map(|pair| pair.map(Quad::splat)))
    }
}

/// The filters of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coefficients {
    top: Wide,
    octave: Wide,
    halving: [Quad; 3],
}

impl Coefficients {
    pub(super) fn new(filters: &Filters) -> Self {
        let [top, octave] = [filters.top, filters.octave].map(|poles| Wide::new(&poles));
        Self { top, octave, halving: filters.halving.map(Quad::splat) }
    }
}

/// The last two outputs of a recurrence.
#[derive(Clone, Copy, Debug)]
struct Last {
    latest: Quad,
    before: Quad,
}

impl Last {
    const REST: Self = Self { latest: Quad::ZERO, before: Quad::ZERO };

    /// Takes in `x` and gives what a pair of poles makes of it. What is known early comes first: only one product and one
    /// difference wait for the row before.
    #[inline(always)]
    fn resonate(&mut self, [a1, a2]: &[Quad; 2], x: Quad) -> Quad {
        let y = x - *a2 * self.before - *a1 * self.latest;
        *self = Self { latest: y, before: self.latest };
        y
    }
}

/// What a level remembers from one block to the next, apart from its input.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory {
    /// By how much the input rose over two rows.
    rise: Last,
    top: [Last; 2],
    octave: [Last; 2],
    /// What the all-passes gave last.
    halving: [Quad; 3],
}

impl Memory {
    /// As if the first sample had lasted for ever: signals are counted from it, so that it is zero.
    pub(super) const REST: Self =
        Self { rise: Last::REST, top: [Last::REST; 2], octave: [Last::REST; 2], halving: [Quad::ZERO; 3] };

    /// What the zeros that both octaves share make of a row and the one two rows earlier.
    #[inline(always)]
    fn numerator(&mut self, x: Quad, earlier: Quad) -> Quad {
        let rise = x - earlier;
        let out = rise - self.rise.before;
        self.rise = Last { latest: rise, before: self.rise.latest };
        out
    }

    /// A row of half the rate, of the last four; twice as large as the input.
    #[inline(always)]
    fn halve(&mut self, [a0, a1, a2]: &[Quad; 3], [x3, x2, x1, x0]: [Quad; 4]) -> Quad {
        let [before0, before1, before2] = self.halving;
        let y0 = *a0 * x0 + x2 - *a0 * before0;
        let y1 = *a1 * x1 + x3 - *a1 * before1;
        let y2 = *a2 * y0 + before0 - *a2 * before2;
        self.halving = [y0, y1, y2];
        y2 + y1
    }
}

/// Outputs of one block of a level, without the gain of their filters.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) top: [Quad; ROWS],
    pub(super) octave: [Quad; ROWS],
}

impl Rows {
    pub(super) const fn new() -> Self {
        Self { top: [Quad::ZERO; ROWS], octave: [Quad::ZERO; ROWS] }
    }
}

/// At most [`ROWS`] rows of a level, `input` with the [`BACK`] before them, through its filters: `TOP` on the first one,
/// which has two octaves. `halved` are the rows of the next level.
#[inline(always)]
pub(super) fn run<const TOP: bool>(
    c: &Coefficients,
    memory: &mut Memory,
    input: &[Quad],
    rows: &mut Rows,
    halved: &mut [Quad],
) {
    let mut m = *memory;
    let pairs = input.windows(BACK + 2).step_by(2).zip(&mut *halved);
    let outputs = rows.top.as_chunks_mut::<2>().0.iter_mut().zip(rows.octave.as_chunks_mut::<2>().0);
    for ((x, halved), (top, octave)) in pairs.zip(outputs) {
        for i in 0..2 {
            let w = m.numerator(x[BACK + i], x[BACK + i - 2]);
            if TOP {
                let y = m.top[0].resonate(&c.top.0[0], w);
                top[i] = m.top[1].resonate(&c.top.0[1], y);
            }
            let y = m.octave[0].resonate(&c.octave.0[0], w);
            octave[i] = m.octave[1].resonate(&c.octave.0[1], y);
        }
        *halved = m.halve(&c.halving, [x[BACK - 3], x[BACK - 2], x[BACK - 1], x[BACK]]);
    }
    *memory = m;
}
