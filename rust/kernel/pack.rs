//! A few numbers side by side, calculated with as one: a plain array, and the registers of the baseline.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::simd::{Portable, Register, Vectors};

/// `L` independent numbers: plain arrays that a compiler turns into vectors. Every operation rounds each lane by itself,
/// so that all instruction sets give the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Pack<const L: usize>(pub(crate) [f64; L]);

impl<const L: usize> Pack<L> {
    pub(crate) const ZERO: Self = Self([0.0; L]);
    pub(crate) const ONE: Self = Self([1.0; L]);

    /// The same number in all lanes.
    #[inline(always)]
    pub(crate) fn splat(x: f64) -> Self {
        Self([x; L])
    }

    /// The first `L` of some numbers.
    #[inline(always)]
    pub(crate) fn load(x: &[f64]) -> Self {
        let mut out = Self::ZERO;
        out.0.copy_from_slice(&x[..L]);
        out
    }

    #[inline(always)]
    fn each(self, f: impl Fn(f64) -> f64) -> Self {
        let mut out = self;
        for l in 0..L {
            out.0[l] = f(self.0[l]);
        }
        out
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut out = self;
        for l in 0..L {
            out.0[l] = f(self.0[l], other.0[l]);
        }
        out
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        self.each(f64::sqrt)
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        self.each(f64::abs)
    }

    /// The size of these numbers with the signs of others.
    #[inline(always)]
    pub(crate) fn with_sign_of(self, other: Self) -> Self {
        self.with(other, f64::copysign)
    }

    /// An answer for each lane, all bits set or none: is this above another?
    #[inline(always)]
    pub(crate) fn above(self, other: Self) -> Self {
        self.with(other, |a, b| f64::from_bits(if a > b { u64::MAX } else { 0 }))
    }

    /// Whether one of the answers is yes.
    #[inline(always)]
    pub(crate) fn any(self) -> bool {
        self.0.iter().fold(0, |any, answer| any | answer.to_bits()) != 0
    }

    /// `yes` where the answer is yes, `no` where it is no.
    #[inline(always)]
    pub(crate) fn select(self, yes: Self, no: Self) -> Self {
        let mut out = no;
        for l in 0..L {
            out.0[l] = if self.0[l].to_bits() != 0 { yes.0[l] } else { no.0[l] };
        }
        out
    }

    /// The sum of all lanes, halves first, as vectors do it. For four or eight lanes.
    #[inline(always)]
    pub(crate) fn sum(self) -> f64 {
        const { assert!(L == 4 || L == 8) };
        let mut x = self.0;
        if L == 8 {
            for l in 0..4 {
                x[l] += x[L / 2 + l];
            }
        }
        (x[0] + x[2]) + (x[1] + x[3])
    }
}

impl Vectors<f64, 4> for Portable {
    type Register = Pack<4>;

    #[inline(always)]
    fn splat(self, x: f64) -> Pack<4> {
        Pack::splat(x)
    }

    #[inline(always)]
    fn load(self, from: &[f64]) -> Pack<4> {
        Pack::load(from)
    }
}

impl Register<f64, 4> for Pack<4> {
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[..4].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        self.above(other)
    }

    #[inline(always)]
    fn select(self, yes: Self, no: Self) -> Self {
        self.select(yes, no)
    }

    #[inline(always)]
    fn reversed(self) -> Self {
        let [a, b, c, d] = self.0;
        Self([d, c, b, a])
    }

    #[inline(always)]
    fn transposed(rows: [Self; 4]) -> [Self; 4] {
        std::array::from_fn(|column| Self(rows.map(|row| row.0[column])))
    }
}

macro_rules! operator {
    ($operator:ident, $method:ident, $sign:tt) => {
        impl<const L: usize> $operator for Pack<L> {
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

impl<const L: usize> Mul<f64> for Pack<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: f64) -> Self {
        self.each(|a| a * other)
    }
}

impl<const L: usize> Neg for Pack<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(|a| -a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_do_not_mix() {
        let (a, b) = (Pack([1.0, -2.0, 3.0]), Pack([4.0, 5.0, -6.0]));
        assert_eq!((a + b).0, [5.0, 3.0, -3.0]);
        assert_eq!((a - b).0, [-3.0, -7.0, 9.0]);
        assert_eq!((a * b).0, [4.0, -10.0, -18.0]);
        assert_eq!((b / a).0, [4.0, -2.5, -2.0]);
        assert_eq!((-a).with_sign_of(b).0, [1.0, 2.0, -3.0]);
        assert_eq!(a.above(b).select(a, b).0, [4.0, 5.0, 3.0]);
        assert!(a.above(b).any() && !a.above(a).any());
        assert_eq!(Pack([4.0, 9.0]).sqrt().0, [2.0, 3.0]);
    }

    #[test]
    fn sums_take_every_lane() {
        assert_eq!(Pack([1.0, 2.0, 4.0, 8.0]).sum(), 15.0);
        assert_eq!(Pack([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0]).sum(), 255.0);
    }
}
