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

    // Plain loops: closures would not always be compiled into the function that has the vector features.

    #[inline(always)]
    pub(super) fn plus(mut self, other: Self) -> Self {
        for l in 0..QUAD {
            self.0[l] += other.0[l];
        }
        self
    }

    #[inline(always)]
    pub(super) fn minus(mut self, other: Self) -> Self {
        for l in 0..QUAD {
            self.0[l] -= other.0[l];
        }
        self
    }

    #[inline(always)]
    pub(super) fn times(mut self, other: Self) -> Self {
        for l in 0..QUAD {
            self.0[l] *= other.0[l];
        }
        self
    }

    /// The larger of what is there and the magnitude of another; NaN is not larger than anything.
    #[inline(always)]
    pub(super) fn largest(mut self, other: Self) -> Self {
        for l in 0..QUAD {
            let size = other.0[l].abs();
            self.0[l] = if size > self.0[l] { size } else { self.0[l] };
        }
        self
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

/// Writes quads as samples of `n_axes` neighbouring axes, each `stride` values after the one before. There must be room
/// for whole fours of samples.
#[inline(always)]
pub(super) fn spread<I: Isa>(quads: &[Quad], n_axes: usize, stride: usize, values: &mut [f64]) {
    let mut first = 0;
    while first < quads.len() {
        let mut rows = [[0.0; QUAD]; QUAD];
        for (row, quad) in rows.iter_mut().zip(&quads[first..]) {
            *row = quad.0;
        }
        let axes = I::transpose4(&rows);
        for (axis, samples) in axes.iter().take(n_axes).enumerate() {
            values[axis * stride + first..][..QUAD].copy_from_slice(samples);
        }
        first += QUAD;
    }
}
