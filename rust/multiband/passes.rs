//! Stockham's algorithm for Fourier transforms of lengths with the factors 2, 3 and 5: pass after pass from one buffer to
//! the other, which needs no reordering (Van Loan, "Computational frameworks for the fast Fourier transform", 1992).

use std::f64::consts::PI;

use super::butterfly::{Butterfly, Cell, Complex, Eight, Five, Four, Three, Two};
use crate::kernel::Quad;

/// One pass: `blocks` transforms of `radix` values for each of `stride` places.
#[derive(Clone, Debug)]
struct Pass {
    radix: usize,
    blocks: usize,
    stride: usize,
    /// `radix - 1` factors per block.
    factors: Vec<[f64; 2]>,
}

/// All passes of a transform of some length.
#[derive(Clone, Debug)]
pub(super) struct Passes(Vec<Pass>);

/// `exp(-2 pi i numerator / denominator)` for a fraction below one.
pub(super) fn root(numerator: usize, denominator: usize) -> [f64; 2] {
    // Within half a turn: the smaller the angle, the smaller its error.
    let (numerator, sign) =
        if 2 * numerator > denominator { (denominator - numerator, 1.0) } else { (numerator, -1.0) };
    let angle = 2.0 * PI * (numerator as f64 / denominator as f64);
    [libm::cos(angle), sign * libm::sin(angle)]
}

/// The factors of a length, the one that is most work without a factor of its own last; none for other lengths.
pub(super) fn radices(n: usize) -> Option<Vec<usize>> {
    let (mut rest, mut radices) = (n, Vec::new());
    for radix in [8, 4, 2, 3, 5] {
        while rest > 1 && rest.is_multiple_of(radix) {
            radices.push(radix);
            rest /= radix;
        }
    }
    (rest == 1).then_some(radices)
}

impl Passes {
    /// For a length that has [`radices`].
    pub(super) fn new(n: usize) -> Self {
        let (mut rest, mut stride) = (n, 1);
        let pass = |radix: usize| {
            let blocks = rest / radix;
            let factors = (0..blocks).flat_map(|p| (1..radix).map(move |k| (p, k)));
            let pass =
                Pass { radix, blocks, stride, factors: factors.map(|(p, k)| root(p * k, rest)).collect() };
            (rest, stride) = (blocks, stride * radix);
            pass
        };
        Self(radices(n).unwrap_or_default().into_iter().map(pass).collect())
    }

    /// Transforms the values of `x`, which are lost; returns the buffer that holds the result.
    #[inline(always)]
    pub(super) fn process<'a, V: Quad>(&self, x: &'a mut [Cell], y: &'a mut [Cell]) -> &'a mut [Cell] {
        let (mut from, mut to) = (x, y);
        for pass in &self.0 {
            match pass.radix {
                8 => pass.run::<Eight, V, 8>(from, to),
                4 => pass.run::<Four, V, 4>(from, to),
                2 => pass.run::<Two, V, 2>(from, to),
                3 => pass.run::<Three, V, 3>(from, to),
                _ => pass.run::<Five, V, 5>(from, to),
            }
            (from, to) = (to, from);
        }
        from
    }
}

impl Pass {
    #[inline(always)]
    fn run<B: Butterfly<R>, V: Quad, const R: usize>(&self, from: &[Cell], to: &mut [Cell]) {
        let stride = self.stride;
        let step = self.blocks * stride;
        // The last pass has nothing left to turn.
        if self.blocks == 1 {
            for place in 0..stride {
                let values = B::of(every::<V, R>(&from[place..], stride));
                for k in 0..R {
                    to[k * stride + place].store(values[k]);
                }
            }
            return;
        }
        let targets = to.chunks_exact_mut(R * stride).zip(self.factors.chunks_exact(R - 1));
        for (block, (target, factors)) in targets.enumerate() {
            for place in 0..stride {
                let values = B::of(every::<V, R>(&from[block * stride + place..], step));
                target[place].store(values[0]);
                for k in 1..R {
                    target[k * stride + place].store(values[k].turned(factors[k - 1]));
                }
            }
        }
    }
}

/// Values that lie `step` apart. A loop, because closures lose the vector features of the wrapper.
#[inline(always)]
fn every<V: Quad, const R: usize>(cells: &[Cell], step: usize) -> [Complex<V>; R] {
    let mut values = [cells[0].load(); R];
    for k in 1..R {
        values[k] = cells[k * step].load();
    }
    values
}
