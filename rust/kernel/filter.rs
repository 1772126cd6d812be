//! The filter itself: every section of a cascade over rows of lanes.

use super::simd::Simd;
use super::transpose::{Row, LANES};
use crate::dsp::{biquad_step, Section, Sos};

/// Sections that run over a row together, written out in `group`.
const GROUP: usize = 4;

/// What one section remembers of a row: `z0` and `z1` of every lane.
type Memory<const W: usize> = [Row<W>; 2];

/// Work that overlaps with the arithmetic of the first sections, in as many parts for each row as there are sections in their
/// group. A trait, because a closure would lose the features of the wrapper.
pub(crate) trait Overlap {
    /// One part of what there is to do while row `row` is filtered.
    fn work<const PART: usize, const PARTS: usize>(&mut self, row: usize);
}

/// Nothing to do.
impl Overlap for () {
    #[inline(always)]
    fn work<const PART: usize, const PARTS: usize>(&mut self, _row: usize) {}
}

/// A cascade at work on `W * LANES` channels: coefficients and memory of one stretch of filtering.
#[derive(Clone, Debug)]
pub(crate) struct Cascade<const W: usize> {
    sections: Vec<Section>,
    memory: Vec<Memory<W>>,
}

impl<const W: usize> Cascade<W> {
    /// A cascade at rest.
    pub(crate) fn new(sos: &Sos) -> Self {
        let sections = sos.sections().to_vec();
        let memory = vec![[Row::ZERO; 2]; sections.len()];
        Self { sections, memory }
    }

    /// Sets what section `section` remembers of lane `lane`.
    pub(crate) fn set(&mut self, section: usize, lane: usize, z: [f64; 2]) {
        let [z0, z1] = &mut self.memory[section];
        z0.flat_mut()[lane] = z[0];
        z1.flat_mut()[lane] = z[1];
    }

    /// Back to rest.
    pub(crate) fn rest(&mut self) {
        self.memory.fill([Row::ZERO; 2]);
    }

    /// True while no lane holds NaN or infinity. Once such a value enters a cascade it never leaves it: with
    /// finite coefficients `b2*x - a2*y` of a value that is not finite is not finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.memory.iter().flatten().all(|row| row.flat().iter().all(|z| z.is_finite()))
    }

    /// Filters rows in place, in time order.
    #[inline(always)]
    pub(crate) fn filter<S: Simd>(&mut self, _simd: S, rows: &mut [Row<W>], overlap: &mut impl Overlap) {
        let mut groups = self.sections.chunks(GROUP).zip(self.memory.chunks_mut(GROUP));
        if let Some((sections, memory)) = groups.next() {
            some::<S, W, true>(sections, memory, rows, overlap);
        }
        for (sections, memory) in groups {
            some::<S, W, false>(sections, memory, rows, &mut ());
        }
    }
}

#[inline(always)]
fn some<S: Simd, const W: usize, const FIRST: bool>(
    sections: &[Section],
    memory: &mut [Memory<W>],
    rows: &mut [Row<W>],
    overlap: &mut impl Overlap,
) {
    match sections.len() {
        1 => shaped::<S, W, 1, FIRST>(sections, memory, rows, overlap),
        2 => shaped::<S, W, 2, FIRST>(sections, memory, rows, overlap),
        3 => shaped::<S, W, 3, FIRST>(sections, memory, rows, overlap),
        _ => shaped::<S, W, GROUP, FIRST>(sections, memory, rows, overlap),
    }
}

#[inline(always)]
fn shaped<S: Simd, const W: usize, const N: usize, const FIRST: bool>(
    sections: &[Section],
    memory: &mut [Memory<W>],
    rows: &mut [Row<W>],
    overlap: &mut impl Overlap,
) {
    let (Ok(sections), Ok(memory)) =
        (<&[Section; N]>::try_from(sections), <&mut [Memory<W>; N]>::try_from(memory))
    else {
        return;
    };
    if S::MANY_REGISTERS {
        // A copy, which no write to a row or a count can change, stays in registers. Sixteen registers are too few: section by
        // section, two sections or half of the lanes at a time, all with state in registers, took 1.3 to 1.6 times as long.
        let mut copy = *memory;
        rows_through::<W, N, FIRST>(sections, &mut copy, rows, overlap);
        *memory = copy;
    } else {
        rows_through::<W, N, FIRST>(sections, memory, rows, overlap);
    }
}

/// Where `b0 == b2 == 1` in all sections but the first of a filter, as `butter` puts the gain, those multiplications are left
/// out: no bit changes.
#[allow(clippy::float_cmp)] // multiplying by exactly one is what can be left out
#[inline(always)]
fn rows_through<const W: usize, const N: usize, const FIRST: bool>(
    sections: &[Section; N],
    memory: &mut [Memory<W>; N],
    rows: &mut [Row<W>],
    overlap: &mut impl Overlap,
) {
    let monic = sections[usize::from(FIRST)..].iter().all(|s| s.b0 == 1.0 && s.b2 == 1.0);
    match (monic, FIRST) {
        (false, _) => group::<W, N, false, false>(sections, memory, rows, overlap),
        (true, true) => group::<W, N, false, true>(sections, memory, rows, overlap),
        (true, false) => group::<W, N, true, true>(sections, memory, rows, overlap),
    }
}

#[inline(always)]
fn group<const W: usize, const N: usize, const HEAD: bool, const TAIL: bool>(
    sections: &[Section; N],
    memory: &mut [Memory<W>; N],
    rows: &mut [Row<W>],
    overlap: &mut impl Overlap,
) {
    for (i, row) in rows.iter_mut().enumerate() {
        // Written out for the reason of `each_vector`: rolled up, the row would pass through memory.
        overlap.work::<0, N>(i);
        let mut x = through::<W, HEAD>(&sections[0], &mut memory[0], *row);
        if N > 1 {
            overlap.work::<1, N>(i);
            x = through::<W, TAIL>(&sections[1], &mut memory[1], x);
        }
        if N > 2 {
            overlap.work::<2, N>(i);
            x = through::<W, TAIL>(&sections[2], &mut memory[2], x);
        }
        if N > 3 {
            overlap.work::<3, N>(i);
            x = through::<W, TAIL>(&sections[3], &mut memory[3], x);
        }
        *row = x;
    }
}

/// One row through one section.
#[inline(always)]
fn through<const W: usize, const MONIC: bool>(
    section: &Section,
    [z0, z1]: &mut Memory<W>,
    mut x: Row<W>,
) -> Row<W> {
    let coefficients = section.splat();
    each_vector!(W, w, {
        x.0[w] = biquad_step::<LANES, MONIC>(&coefficients, &mut z0.0[w], &mut z1.0[w], &x.0[w]);
    });
    x
}
