//! A few numbers side by side, calculated with as one: a plain array, and the registers of the baseline.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::simd::{Portable, Register, Vectors};
use crate::dsp::Real;

/// `L` independent numbers: plain arrays that a compiler turns into vectors. Every operation rounds each lane by itself,
/// so that all instruction sets give the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Pack<T, const L: usize>(pub(crate) [T; L]);

impl<T: Real, const L: usize> Pack<T, L> {
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
    fn each(self, f: impl Fn(T) -> T) -> Self {
        let mut out = self;
        for l in 0..L {
            out.0[l] = f(self.0[l]);
        }
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

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        self.each(T::sqrt)
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        self.each(T::abs)
    }

    /// The size of these numbers with the signs of others.
    #[inline(always)]
    pub(crate) fn with_sign_of(self, other: Self) -> Self {
        self.with(other, T::copysign)
    }

    /// The sum of all lanes, halves first, as vectors do it. For four or eight lanes.
    #[inline(always)]
    pub(crate) fn sum(self) -> T {
        const { assert!(L == 4 || L == 8) };
        let mut x = self.0;
        if L == 8 {
            for l in 0..4 {
                x[l] = x[l] + x[L / 2 + l];
            }
        }
        (x[0] + x[2]) + (x[1] + x[3])
    }
}

impl<T: Real, const L: usize> Vectors<T, L> for Portable {
    type Register = Pack<T, L>;

    #[inline(always)]
    fn splat(self, x: T) -> Pack<T, L> {
        Pack::splat(x)
    }

    #[inline(always)]
    fn load(self, from: &[T]) -> Pack<T, L> {
        Pack::load(from)
    }
}

impl<T: Real, const L: usize> Register<T, L> for Pack<T, L> {
    #[inline(always)]
    fn store(self, to: &mut [T]) {
        to[..L].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { T::YES } else { T::ZERO })
    }

    #[inline(always)]
    fn select(self, yes: Self, no: Self) -> Self {
        let mut out = no;
        for l in 0..L {
            out.0[l] = if self.0[l].bits() != 0 { yes.0[l] } else { no.0[l] };
        }
        out
    }

    #[inline(always)]
    fn reversed(self) -> Self {
        let mut out = self;
        for l in 0..L {
            out.0[l] = self.0[L - 1 - l];
        }
        out
    }

    #[inline(always)]
    fn transposed(rows: [Self; L]) -> [Self; L] {
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
        impl<T: Real, const L: usize> $operator for Pack<T, L> {
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

impl<T: Real, const L: usize> Mul<T> for Pack<T, L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: T) -> Self {
        self.each(|a| a * other)
    }
}

impl<T: Real, const L: usize> Neg for Pack<T, L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(|a| -a)
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Debug;

    use super::*;

    fn of<T: Real, const L: usize>(numbers: [f64; L]) -> Pack<T, L> {
        Pack(numbers.map(T::of))
    }

    fn lanes_do_not_mix<T: Real + Debug>() {
        let (a, b) = (of::<T, 3>([1.0, -2.0, 3.0]), of([4.0, 5.0, -6.0]));
        assert_eq!(a + b, of([5.0, 3.0, -3.0]));
        assert_eq!(a - b, of([-3.0, -7.0, 9.0]));
        assert_eq!(a * b, of([4.0, -10.0, -18.0]));
        assert_eq!(a * T::of(0.5), of([0.5, -1.0, 1.5]));
        assert_eq!(b / a, of([4.0, -2.5, -2.0]));
        assert_eq!(a.abs(), of([1.0, 2.0, 3.0]));
        assert_eq!((-a).with_sign_of(b), of([1.0, 2.0, -3.0]));
        assert_eq!(a.above(b).select(a, b), of([4.0, 5.0, 3.0]));
        assert_eq!(of::<T, 2>([4.0, 9.0]).sqrt(), of([2.0, 3.0]));
    }

    fn sums_take_every_lane<T: Real + Debug>() {
        assert_eq!(of::<T, 4>([1.0, 2.0, 4.0, 8.0]).sum(), T::of(15.0));
        assert_eq!(of::<T, 8>([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0]).sum(), T::of(255.0));
    }

    #[test]
    fn float64() {
        lanes_do_not_mix::<f64>();
        sums_take_every_lane::<f64>();
    }

    #[test]
    fn float32() {
        lanes_do_not_mix::<f32>();
        sums_take_every_lane::<f32>();
    }
}
