//! The filters of the pyramid, eight axes side by side: two octaves and the low-pass in front of a halving of the rate.

use super::spec::TOP;
use super::{narrow, LANES};
use crate::dsp::{butterworth, Band};
use crate::error::Result;
use crate::kernel::{F32x8, Pack, Simd};

/// Order of the low-pass in front of every halving of the rate. What lies at 0.755 to 0.878 of Nyquist folds onto the octave
/// that is taken next; there the low-pass is down by 55 dB or more.
const HALVING_ORDER: usize = 7;

/// Axes of a group, which go through the bank side by side.
pub(super) const GROUP: usize = LANES;

/// The axes of a group at one instant.
pub(super) type Axes8 = Pack<f32, GROUP>;

/// Rows that go through a stage at a time: an even number, whole groups.
pub(super) const ROWS: usize = 64;

/// Rows before the first that a stage looks back to.
pub(super) const BACK: usize = 4;

/// The three filters of the pyramid; the same at every stage, for frequencies are relative to its rate. Both octaves have
/// the same zeros, twice at frequency 0 and twice at Nyquist: `(1 - z^-2)^2` is taken once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filters {
    /// The upper octave of two.
    pub(super) top: Poles,
    /// The octave below, or the only one, but for the first.
    pub(super) octave: Poles,
    /// Before the rate is halved: `(A(a0) A(a2) + z^-1 A(a1)) / 2` with all-passes `A(a) = (a + z^-2) / (1 + a z^-2)`.
    halving: [f32; 3],
}

/// Two pairs of poles and the gain of a band-pass whose zeros are known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Poles {
    /// `a1` and `a2` of each pair: `1 + a1 z^-1 + a2 z^-2`.
    pairs: [[f32; 2]; 2],
    /// Factor of the numerator.
    pub(super) gain: f64,
}

impl Filters {
    pub(super) fn new() -> Result<Self> {
        let halving = all_passes()?.map(narrow);
        Ok(Self { top: Poles::new(TOP)?, octave: Poles::new(TOP / 2.0)?, halving })
    }
}

impl Poles {
    /// Those of the octave that ends at `high`, a share of the Nyquist frequency.
    fn new(high: f64) -> Result<Self> {
        let sos = butterworth(2, Band::Bandpass(high / 2.0, high), 2.0)?;
        let mut poles = Self { pairs: [[0.0; 2]; 2], gain: 1.0 };
        for (pair, section) in poles.pairs.iter_mut().zip(sos.sections()) {
            *pair = [section.a1, section.a2].map(narrow);
            poles.gain *= section.b0;
        }
        Ok(poles)
    }

    /// The pairs, each number in all lanes.
    #[inline(always)]
    fn splat<S: Simd>(&self, simd: S) -> [[S::F32x8; 2]; 2] {
        let [[a, b], [c, d]] = self.pairs;
        [[simd.splat(a), simd.splat(b)], [simd.splat(c), simd.splat(d)]]
    }
}

/// A Butterworth low-pass of odd order that ends at half the Nyquist frequency has its poles on the imaginary axis, so that
/// it is the sum of two chains of all-passes in `z^-2`, one of them a sample later (Gazsi, "Explicit formulas for lattice
/// wave digital filters", 1985). The poles take turns.
fn all_passes() -> Result<[f64; 3]> {
    let sos = butterworth(HALVING_ORDER, Band::Lowpass(0.5), 2.0)?;
    let mut squares: Vec<_> = sos.sections().iter().map(|section| section.a2).collect();
    squares.sort_by(f64::total_cmp);
    // The first is the pole at zero.
    Ok([squares[1], squares[2], squares[3]])
}

/// The last two outputs of a recurrence.
#[derive(Clone, Copy)]
struct Last<V> {
    latest: V,
    before: V,
}

impl<V: F32x8> Last<V> {
    /// Takes in `x` and gives what a pair of poles makes of it. What is known early comes first: only one product and one
    /// difference wait for the row before.
    #[inline(always)]
    fn resonate(&mut self, [a1, a2]: [V; 2], x: V) -> V {
        let y = x - a2 * self.before - a1 * self.latest;
        *self = Self { latest: y, before: self.latest };
        y
    }
}

/// What the filters of a stage remember of the rows before.
pub(super) struct Memory<V> {
    top: [Last<V>; 2],
    octave: [Last<V>; 2],
    /// What the all-passes gave last.
    halving: [V; 3],
}

impl<V: F32x8> Memory<V> {
    /// Nothing before the first row.
    #[inline(always)]
    pub(super) fn at_rest(zero: V) -> Self {
        let rest = Last { latest: zero, before: zero };
        Self { top: [rest; 2], octave: [rest; 2], halving: [zero; 3] }
    }

    /// A row of half the rate, of the last four; twice as large as the input.
    #[inline(always)]
    fn halve(&mut self, [a0, a1, a2]: [V; 3], [x3, x2, x1, x0]: [V; 4]) -> V {
        let [before0, before1, before2] = self.halving;
        let y0 = a0 * x0 + x2 - a0 * before0;
        let y1 = a1 * x1 + x3 - a1 * before1;
        let y2 = a2 * y0 + before0 - a2 * before2;
        self.halving = [y0, y1, y2];
        y2 + y1
    }
}

/// What comes out of one block of a stage, without the gain of its filters.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) top: [Axes8; ROWS],
    pub(super) octave: [Axes8; ROWS],
}

impl Rows {
    pub(super) const ZERO: Self = Self { top: [Pack::ZERO; ROWS], octave: [Pack::ZERO; ROWS] };
}

/// Sends at most [`ROWS`] rows, `input` with the [`BACK`] before them, through the filters of a stage, one or both octaves.
/// `halved` are the rows of the next stage.
#[inline(always)]
pub(super) fn run<const UPPER: bool, const LOWER: bool, S: Simd>(
    simd: S,
    filters: &Filters,
    m: &mut Memory<S::F32x8>,
    input: &[Axes8],
    rows: &mut Rows,
    halved: &mut [Axes8],
) {
    let (top_poles, poles) = (filters.top.splat(simd), filters.octave.splat(simd));
    let [a0, a1, a2] = filters.halving;
    let halving = [simd.splat(a0), simd.splat(a1), simd.splat(a2)];
    let pairs = input.windows(BACK + 2).step_by(2).zip(halved);
    let outputs = rows.top.as_chunks_mut::<2>().0.iter_mut().zip(rows.octave.as_chunks_mut::<2>().0);
    for ((rows, halved), (top, octave)) in pairs.zip(outputs) {
        let mut x = [halving[0]; BACK + 2];
        for (x, row) in x.iter_mut().zip(rows) {
            *x = simd.load(&row.0);
        }
        for i in 0..2 {
            // What the zeros that both octaves share make of the row.
            let w = (x[BACK + i] - x[BACK + i - 2]) - (x[BACK + i - 2] - x[BACK + i - 4]);
            if UPPER {
                let y = m.top[0].resonate(top_poles[0], w);
                m.top[1].resonate(top_poles[1], y).store(&mut top[i].0);
            }
            if LOWER {
                let y = m.octave[0].resonate(poles[0], w);
                m.octave[1].resonate(poles[1], y).store(&mut octave[i].0);
            }
        }
        m.halve(halving, [x[BACK - 3], x[BACK - 2], x[BACK - 1], x[BACK]]).store(&mut halved.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numerators_are_those_of_the_designs() {
        let filters = Filters::new().unwrap();
        for (high, poles) in [(TOP, filters.top), (TOP / 2.0, filters.octave)] {
            let sos = butterworth(2, Band::Bandpass(high / 2.0, high), 2.0).unwrap();
            assert_eq!(sos.sections().len(), 2);
            let [p, q] = [sos.sections()[0], sos.sections()[1]].map(|s| [s.b0, s.b1, s.b2]);
            for (power, zero) in [1.0, 0.0, -2.0, 0.0, 1.0].iter().enumerate() {
                let product: f64 =
                    (0..3).filter(|i| (*i..i + 3).contains(&power)).map(|i| p[i] * q[power - i]).sum();
                assert!((product - poles.gain * zero).abs() < 1e-12 * poles.gain, "{high} {power}");
            }
        }
    }

    #[test]
    fn all_passes_are_the_low_pass() {
        let sos = butterworth(HALVING_ORDER, Band::Lowpass(0.5), 2.0).unwrap();
        let mut impulse = [0.0; 40];
        impulse[0] = 1.0;
        let mut expected = impulse;
        for s in sos.sections() {
            let (mut z0, mut z1) = (0.0, 0.0);
            for x in &mut expected {
                let y = s.b0 * *x + z0;
                (z0, z1) = (s.b1 * *x - s.a1 * y + z1, s.b2 * *x - s.a2 * y);
                *x = y;
            }
        }
        let all_pass = |a: f64, x: [f64; 40]| {
            let mut y = [0.0; 40];
            for t in 0..40 {
                let before = |values: &[f64; 40]| if t < 2 { 0.0 } else { values[t - 2] };
                y[t] = a * x[t] + before(&x) - a * before(&y);
            }
            y
        };
        let [a0, a1, a2] = all_passes().unwrap();
        let (first, second) = (all_pass(a2, all_pass(a0, impulse)), all_pass(a1, impulse));
        for t in 1..40 {
            assert!((expected[t] - 0.5 * (first[t] + second[t - 1])).abs() < 1e-15, "{t}");
        }
    }
}
