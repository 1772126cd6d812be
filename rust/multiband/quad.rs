//! Four axes at a time: the lanes of the bank.

use crate::lanes::Isa;

/// Axes per quad. Eight lanes would leave a quarter of the work of six axes without use.
pub(super) const QUAD: usize = 4;

/// Four axes at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(super) struct Quad(pub(super) [f64; QUAD]);

impl Quad {
    pub(super) const ZERO: Self = Self([0.0; QUAD]);

    /// The same number for each axis.
    #[inline(always)]
    pub(super) fn all(value: f64) -> Self {
        Self([value; QUAD])
    }

    #[inline(always)]
    pub(super) fn plus(self, other: Self) -> Self {
        Self(std::array::from_fn(|l| self.0[l] + other.0[l]))
    }

    #[inline(always)]
    pub(super) fn minus(self, other: Self) -> Self {
        Self(std::array::from_fn(|l| self.0[l] - other.0[l]))
    }

    #[inline(always)]
    pub(super) fn times(self, other: Self) -> Self {
        Self(std::array::from_fn(|l| self.0[l] * other.0[l]))
    }

    /// The larger of what is there and the magnitude of another; NaN is not larger than anything.
    #[inline(always)]
    pub(super) fn largest(self, other: Self) -> Self {
        Self(std::array::from_fn(|l| {
            let size = other.0[l].abs();
            if size > self.0[l] {
                size
            } else {
                self.0[l]
            }
        }))
    }

    /// Up to four neighbouring values; the rest is zero.
    #[inline(always)]
    pub(super) fn load(values: &[f64]) -> Self {
        Self(match *values {
            [] => [0.0; QUAD],
            [a] => [a, 0.0, 0.0, 0.0],
            [a, b] => [a, b, 0.0, 0.0],
            [a, b, c] => [a, b, c, 0.0],
            [a, b, c, d, ..] => [a, b, c, d],
        })
    }
}

/// Writes quads as samples of `n_axes` neighbouring axes, each `stride` values after the one before; each quad goes
/// through `map` first. There must be room for whole fours of samples.
#[inline(always)]
pub(super) fn spread<I: Isa>(
    quads: &[Quad],
    map: impl Fn(Quad) -> Quad,
    n_axes: usize,
    stride: usize,
    values: &mut [f64],
) {
    for (first, four) in quads.chunks(QUAD).enumerate() {
        let mut rows = [[0.0; QUAD]; QUAD];
        for (row, quad) in rows.iter_mut().zip(four) {
            *row = map(*quad).0;
        }
        let axes = I::transpose4(&rows);
        for (axis, samples) in axes.iter().take(n_axes).enumerate() {
            values[axis * stride + first * QUAD..][..QUAD].copy_from_slice(samples);
        }
    }
}
