//! The recurrences of one level of the pyramid.
//!
//! Poles are those of the designs, pair by pair. Zeros are shared out anew, which changes rounding only: each half of a
//! band-pass gets one zero at frequency 0 and one at Nyquist, `1 - z^-2`, so that a constant leaves nothing behind, not
//! even rounding; and those of the low-pass are applied where a sample is kept.

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
    pub(super) gain: f64,
}

impl Wide {
    pub(super) fn new(poles: &Poles) -> Self {
        Self { pairs: poles.pairs.map(|pair| pair.map(Quad::all)), gain: poles.gain }
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
    /// As if `first` had lasted for ever.
    pub(super) fn steady(coefficients: &Coefficients, first: Quad) -> Self {
        let silence = [[Quad::ZERO; 2]; 2];
        let mut value = first;
        let halving = coefficients.halving.pairs.map(|[a1, a2]| {
            value = Quad(std::array::from_fn(|l| value.0[l] / (1.0 + a1.0[l] + a2.0[l])));
            [value; 2]
        });
        Self { top: silence, octave: silence, halving }
    }

    /// What the low-pass gave before the first sample.
    pub(super) fn smooth(&self) -> Quad {
        self.halving[1][0]
    }
}

/// One block of a level: room for `BACK` earlier rows, then the block.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) input: [Quad; BACK + ROWS],
    /// Poles of the low-pass only.
    pub(super) smooth: [Quad; BACK + ROWS],
    pub(super) top: [Quad; ROWS],
    pub(super) octave: [Quad; ROWS],
}

impl Rows {
    pub(super) fn new() -> Self {
        let silence = [Quad::ZERO; BACK + ROWS];
        Self { input: silence, smooth: silence, top: [Quad::ZERO; ROWS], octave: [Quad::ZERO; ROWS] }
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
            rows.top[t] = band_pass(&c.top, &mut top, rise);
        }
        rows.octave[t] = band_pass(&c.octave, &mut octave, rise);
        let half = resonate(&c.halving.pairs[0], &mut halving[0], x);
        rows.smooth[BACK + t] = resonate(&c.halving.pairs[1], &mut halving[1], half);
    }
    *memory = Memory { top, octave, halving };
}

/// Every second row after the low-pass, from row 0 of the block on.
#[inline(always)]
pub(super) fn halve(gain: f64, smooth: &[Quad; BACK + ROWS], out: &mut [Quad]) {
    let (gain, four, six) = (Quad::all(gain), Quad::all(4.0), Quad::all(6.0));
    for (i, out) in out.iter_mut().enumerate() {
        let at = |back: usize| smooth[BACK + 2 * i - back];
        let outer = at(0).plus(at(4));
        let inner = at(1).plus(at(3)).times(four);
        *out = outer.plus(inner).plus(at(2).times(six)).times(gain);
    }
}
