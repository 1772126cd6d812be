//! The levels of the pyramid that four axes go through, block by block.
//!
//! A block of a level is half a block of the next one, which runs as soon as it has a whole one. What a recording leaves
//! over at its end goes through all levels in a copy of what they remember, so that more of it may still come.

use super::octave::{run, Coefficients, Memory, Rows, BACK, ROWS};
use super::quad::Quad;

/// Filters between two halvings of the rate.
#[derive(Clone, Debug)]
struct Level {
    memory: Memory,
    /// Rows that wait, behind the last [`BACK`] that have gone through.
    input: [Quad; BACK + ROWS],
    n_waiting: usize,
    /// Rows that have gone through.
    n_done: usize,
}

impl Level {
    const REST: Self =
        Self { memory: Memory::REST, input: [Quad::ZERO; BACK + ROWS], n_waiting: 0, n_done: 0 };
}

/// The levels of four axes.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    levels: Vec<Level>,
    /// Where the rows below the last octave go, and no further.
    below: [Quad; ROWS / 2],
}

/// Where bands go. No closure: those are not compiled for the instruction set of their caller unless they are inlined.
pub(super) trait Target {
    /// Takes the first `n` rows of a band, which are those from `start` on.
    fn write(&mut self, band: usize, start: usize, n: usize, rows: &[Quad; ROWS]);
}

impl Pyramid {
    /// For one octave or more.
    pub(super) fn new(octaves: usize) -> Self {
        let n_levels = octaves.saturating_sub(1).max(1);
        Self { levels: vec![Level::REST; n_levels], below: [Quad::ZERO; ROWS / 2] }
    }

    /// Back to the state before the first row.
    pub(super) fn restart(&mut self) {
        self.levels.iter_mut().for_each(|level| {
            level.memory = Memory::REST;
            level.input[..BACK].fill(Quad::ZERO);
            (level.n_waiting, level.n_done) = (0, 0);
        });
    }

    /// Rows that have gone through the first level.
    pub(super) fn n_done(&self) -> usize {
        self.levels[0].n_done
    }

    /// Where the next rows of the first level go: a block, or what is left of a recording.
    pub(super) fn input(&mut self) -> &mut [Quad] {
        &mut self.levels[0].input[BACK..]
    }

    /// A block that stands in [`input`](Self::input) through all levels that now have one.
    #[inline(always)]
    pub(super) fn advance(&mut self, c: &Coefficients, rows: &mut Rows, target: &mut impl Target) {
        self.levels[0].n_waiting = ROWS;
        for index in 0..self.levels.len() {
            let (level, halved) = self.level(index);
            if level.n_waiting < ROWS {
                return;
            }
            through(index, c, &mut level.memory, &level.input, rows, halved);
            give(index, rows, level.n_done, ROWS, target);
            level.input.copy_within(ROWS.., 0);
            level.n_waiting = 0;
            level.n_done += ROWS;
            if let Some(next) = self.levels.get_mut(index + 1) {
                next.n_waiting += ROWS / 2;
            }
        }
    }

    /// What waits, and `n` rows that stand in [`input`](Self::input), through all levels. Nothing of it is remembered.
    #[inline(always)]
    pub(super) fn finish(&mut self, c: &Coefficients, n: usize, rows: &mut Rows, target: &mut impl Target) {
        let mut n_last = n;
        for index in 0..self.levels.len() {
            let (level, halved) = self.level(index);
            let n = level.n_waiting + n_last;
            // An odd row goes through with whatever lies behind it: nobody looks at what comes of that.
            let input = &level.input[..BACK + n.next_multiple_of(2)];
            through(index, c, &mut { level.memory }, input, rows, halved);
            give(index, rows, level.n_done, n, target);
            n_last = n.div_ceil(2);
        }
    }

    /// A level, and where rows at half of its rate go.
    #[inline(always)]
    fn level(&mut self, index: usize) -> (&mut Level, &mut [Quad]) {
        let (levels, after) = self.levels.split_at_mut(index + 1);
        let halved = match after {
            [next, ..] => &mut next.input[BACK + next.n_waiting..],
            [] => &mut self.below[..],
        };
        (&mut levels[index], halved)
    }
}

/// Rows of a level through its filters.
#[inline(always)]
fn through(
    index: usize,
    c: &Coefficients,
    memory: &mut Memory,
    input: &[Quad],
    rows: &mut Rows,
    halved: &mut [Quad],
) {
    if index == 0 {
        run::<true>(c, memory, input, rows, halved);
    } else {
        run::<false>(c, memory, input, rows, halved);
    }
}

/// The bands of a level: two of the first, one of each other.
#[inline(always)]
fn give(index: usize, rows: &Rows, start: usize, n: usize, target: &mut impl Target) {
    if index == 0 {
        target.write(1, start, n, &rows.top);
    }
    target.write(2 + index, start, n, &rows.octave);
}
