//! A few numbers side by side, calculated with as one: a plain array, and the registers of the baseline.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::simd::{F32x8, Simd};

/// Numbers that packs are made of.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    const ZERO: Self;
    const ONE: Self;
}

impl Number for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
}

impl Number for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
}

/// `L` independent numbers: plain arrays that a compiler turns into vectors. Every operation rounds each lane by itself,
/// so that all instruction sets give the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Pack<T, const L: usize>(pub(crate) [T; L]);

impl<T: Number, const L: usize> Pack<T, L> {
    pub(crate) const ZERO: Self = Self([T::ZERO; L]);
    pub(crate) const ONE: Self = Self([T::ONE; L]);

    /// The same number in all lanes.
    #[inline(always)]
    pub(crate) fn splat(x: T) -> Self {
        Self([x; L])
    }

    /// The first `L` of some numbers.
    #[inline(always)]
    pub(crate) fn load(x: &[T]) -> Self {
        let mut out = Self::ZERO;
        out.0.copy_from_slice(&x[..L]);
        out
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        let mut out = self;
        for l in 0..L {
            out.0[l] = f(self.0[l], other.0[l]);
        }
        out
    }
}

impl<T: Number> Pack<T, 8> {
    /// The sum of all lanes, halves first, as vectors do it.
    #[inline(always)]
    pub(crate) fn sum(self) -> T {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

/// Plain loops, compiled for whatever the wrapper allows.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

impl Simd for Portable {
    type F32x8 = Pack<f32, 8>;

    #[inline(always)]
    fn splat(self, x: f32) -> Pack<f32, 8> {
        Pack::splat(x)
    }

    #[inline(always)]
    fn load(self, from: &[f32]) -> Pack<f32, 8> {
        Pack::load(from)
    }
}

impl F32x8 for Pack<f32, 8> {
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn transposed(rows: [Self; 8]) -> [Self; 8] {
        let mut out = rows;
        for (column, out) in out.iter_mut().enumerate() {
            for (row, from) in rows.iter().enumerate() {
                out.0[row] = from.0[column];
            }
        }
        out
    }
}

macro_rules! operator {
    ($operator:ident, $method:ident, $sign:tt) => {
        impl<T: Number, const L: usize> $operator for Pack<T, L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.with(other, |a, b| a $sign b)
            }
        }
    };
}
operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl<T: Number, const L: usize> Neg for Pack<T, L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self, |a, _| -a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_do_not_mix() {
        let (a, b) = (Pack([1.0, -2.0, 3.0]), Pack([4.0, 5.0, -6.0]));
        assert_eq!(a + b, Pack([5.0, 3.0, -3.0]));
        assert_eq!(a - b, Pack([-3.0, -7.0, 9.0]));
        assert_eq!(a * b, Pack([4.0, -10.0, -18.0]));
        assert_eq!(b / a, Pack([4.0, -2.5, -2.0]));
        assert_eq!(-a, Pack([-1.0, 2.0, -3.0]));
    }

    #[test]
    fn a_sum_takes_every_lane() {
        assert_eq!(Pack([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0]).sum(), 255.0);
    }
}
