//! Four numbers calculated with as one.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Four numbers as the machine holds them. A compiler makes vectors of plain arrays as long as little else goes on; of a
/// whole Fourier transform it makes halves and single numbers. Every operation rounds each lane by itself, so that all
/// instruction sets give the same bits.
pub(crate) trait Quad:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The same number in all lanes.
    fn splat(x: f64) -> Self;
    /// The first four of some numbers.
    fn load(from: &[f64]) -> Self;
    /// Replaces the first four of some numbers.
    fn store(self, to: &mut [f64]);
    fn sqrt(self) -> Self;
    /// An answer for each lane, for [`or`](Self::or): is this above another?
    fn above(self, other: Self) -> Self;
    /// This where the answer is yes, another where it is no.
    fn or(self, other: Self, answer: Self) -> Self;
    /// The last lane first.
    fn reversed(self) -> Self;
    /// Rows and columns of four by four exchanged.
    fn transposed(rows: [Self; 4]) -> [Self; 4];
}

/// Plain loops.
#[derive(Clone, Copy)]
pub(crate) struct Plain([f64; 4]);

impl Plain {
    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let (Self([a, b, c, d]), Self([e, g, h, i])) = (self, other);
        Self([f(a, e), f(b, g), f(c, h), f(d, i)])
    }
}

impl Quad for Plain {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        let mut out = [0.0; 4];
        out.copy_from_slice(&from[..4]);
        Self(out)
    }

    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[..4].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        self.with(other, |a, b| f64::from_bits(if a > b { u64::MAX } else { 0 }))
    }

    #[inline(always)]
    fn or(self, other: Self, answer: Self) -> Self {
        let mut out = other;
        for l in 0..4 {
            if answer.0[l].to_bits() != 0 {
                out.0[l] = self.0[l];
            }
        }
        out
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

impl Add for Plain {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Plain {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Plain {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl Div for Plain {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}

impl Neg for Plain {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
}
