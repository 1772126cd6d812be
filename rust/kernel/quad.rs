//! Four numbers calculated with as one.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::pack::Pack;

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

impl Quad for Pack<4> {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self::splat(x)
    }

    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        Self::load(from)
    }

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
