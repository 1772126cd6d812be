//! The filter itself: every section of a cascade over rows of lanes.

use super::{flat_mut, Row, Vector, LANES};
use crate::sos::{Section, Sos};

/// Sections that run over a row together, written out in `group`.
const GROUP: usize = 4;

/// What one section remembers of a row: `z0` and `z1` of every lane.
type Memory<const W: usize> = [Row<W>; 2];

/// Multiplications by one that a group of sections can leave out without changing a bit.
#[derive(Clone, Copy, Debug)]
enum Shape {
    /// Any numerators.
    General,
    /// `b0 == b2 == 1` in all but the first section: how `butter` puts the gain.
    MonicTail,
    /// `b0 == b2 == 1` in all sections.
    Monic,
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
        let memory = vec![[[Vector::ZERO; W]; 2]; sections.len()];
        Self { sections, memory }
    }

    /// Sets what section `section` remembers of lane `lane`.
    pub(crate) fn set(&mut self, section: usize, lane: usize, z: [f64; 2]) {
        let [z0, z1] = &mut self.memory[section];
        flat_mut(z0)[lane] = z[0];
        flat_mut(z1)[lane] = z[1];
    }

    /// Back to rest.
    pub(crate) fn rest(&mut self) {
        self.memory.fill([[Vector::ZERO; W]; 2]);
    }

    /// True while no lane holds NaN or infinity. Once such a value enters a cascade it never leaves it: with
    /// finite coefficients `b2*x - a2*y` of a value that is not finite is not finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.memory.iter().flatten().flatten().all(|vector| vector.0.iter().all(|z| z.is_finite()))
    }

    /// Filters rows in place, in time order. `before` is called with the index of each row as the first
    /// sections come to it: the place for work that overlaps with arithmetic, such as prefetching.
    #[inline(always)]
    pub(crate) fn filter(&mut self, rows: &mut [Row<W>], before: impl Fn(usize)) {
        let groups = self.sections.chunks(GROUP).zip(self.memory.chunks_mut(GROUP));
        for (g, (sections, memory)) in groups.enumerate() {
            let before = |row| {
                if g == 0 {
                    before(row);
                }
            };
            match sections.len() {
                1 => shaped::<W, 1>(sections, memory, rows, before),
                2 => shaped::<W, 2>(sections, memory, rows, before),
                3 => shaped::<W, 3>(sections, memory, rows, before),
                _ => shaped::<W, GROUP>(sections, memory, rows, before),
            }
        }
    }
}

#[inline(always)]
fn shaped<const W: usize, const N: usize>(
    sections: &[Section],
    memory: &mut [Memory<W>],
    rows: &mut [Row<W>],
    before: impl Fn(usize),
) {
    let (Ok(sections), Ok(memory)) = (sections.try_into(), memory.try_into()) else { return };
    match shape(sections) {
        Shape::General => group::<W, N, false, false>(sections, memory, rows, before),
        Shape::MonicTail => group::<W, N, false, true>(sections, memory, rows, before),
        Shape::Monic => group::<W, N, true, true>(sections, memory, rows, before),
    }
}

#[allow(clippy::float_cmp)] // multiplying by exactly one is what can be left out
#[inline(always)]
fn shape<const N: usize>(sections: &[Section; N]) -> Shape {
    let monic = |s: &Section| s.b0 == 1.0 && s.b2 == 1.0;
    match (monic(&sections[0]), sections[1..].iter().all(monic)) {
        (true, true) => Shape::Monic,
        (false, true) => Shape::MonicTail,
        _ => Shape::General,
    }
}

#[inline(always)]
fn group<const W: usize, const N: usize, const HEAD: bool, const TAIL: bool>(
    sections: &[Section; N],
    memory: &mut [Memory<W>; N],
    rows: &mut [Row<W>],
    before: impl Fn(usize),
) {
    for (i, row) in rows.iter_mut().enumerate() {
        before(i);
        // Written out for the reason of `each_vector`: rolled up, the row would pass through memory.
        let mut x = through::<W, HEAD>(&sections[0], &mut memory[0], *row);
        if N > 1 {
            x = through::<W, TAIL>(&sections[1], &mut memory[1], x);
        }
        if N > 2 {
            x = through::<W, TAIL>(&sections[2], &mut memory[2], x);
        }
        if N > 3 {
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
    each_vector!(W, w, {
        x[w] = step::<MONIC>(section, &mut z0[w], &mut z1[w], x[w]);
    });
    x
}

/// One sample through one section, transposed direct form II, in the order of operations that every path and
/// [`SosState`](crate::SosState) share. A separate loop per result keeps each one a plain vector operation.
#[inline(always)]
fn step<const MONIC: bool>(s: &Section, z0: &mut Vector, z1: &mut Vector, x: Vector) -> Vector {
    let mut y = Vector::ZERO;
    for l in 0..LANES {
        y.0[l] = if MONIC { x.0[l] + z0.0[l] } else { s.b0 * x.0[l] + z0.0[l] };
    }
    for l in 0..LANES {
        z0.0[l] = s.b1 * x.0[l] - s.a1 * y.0[l] + z1.0[l];
    }
    for l in 0..LANES {
        z1.0[l] = if MONIC { x.0[l] - s.a2 * y.0[l] } else { s.b2 * x.0[l] - s.a2 * y.0[l] };
    }
    y
}
