//! A few numbers side by side, calculated with as one.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// `L` independent numbers: plain arrays that a compiler turns into vectors. Every operation rounds each lane by itself,
/// so that all instruction sets give the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Pack<const L: usize>(pub(crate) [f64; L]);

/// One answer per lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mask<const L: usize>(pub(crate) [bool; L]);

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
    pub(super) fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
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

    #[inline(always)]
    pub(crate) fn above(self, other: Self) -> Mask<L> {
        let mut out = Mask([false; L]);
        for l in 0..L {
            out.0[l] = self.0[l] > other.0[l];
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

impl<const L: usize> Mask<L> {
    #[inline(always)]
    pub(crate) fn any(self) -> bool {
        self.0.iter().fold(false, |any, lane| any | lane)
    }

    /// `yes` where the answer is yes, `no` elsewhere.
    #[inline(always)]
    pub(crate) fn select(self, yes: Pack<L>, no: Pack<L>) -> Pack<L> {
        let mut out = no;
        for l in 0..L {
            out.0[l] = if self.0[l] { yes.0[l] } else { no.0[l] };
        }
        out
    }
}

impl<const L: usize> Add for Pack<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl<const L: usize> Sub for Pack<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl<const L: usize> Mul for Pack<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl<const L: usize> Div for Pack<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
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
