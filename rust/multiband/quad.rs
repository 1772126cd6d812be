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

    /// The first `N` of some values; the rest is zero.
    #[inline(always)]
    pub(super) fn load<const N: usize>(values: &[f64]) -> Self {
        let mut quad = Self::ZERO;
        quad.0[..N].copy_from_slice(&values[..N]);
        quad
    }
}

/// Writes the first `N` lanes of quads, times `gain`, as samples of `N` axes, each `stride` values after the one before.
/// There must be room for whole fours of samples, in `quads` as well.
#[inline(always)]
pub(super) fn spread<I: Isa, const N: usize>(
    quads: &[Quad],
    gain: Quad,
    n_samples: usize,
    stride: usize,
    values: &mut [f64],
) {
    for (first, four) in (0..n_samples).step_by(QUAD).zip(quads.chunks_exact(QUAD)) {
        let (a, b) = (four[0].times(gain).0, four[1].times(gain).0);
        let (c, d) = (four[2].times(gain).0, four[3].times(gain).0);
        let axes = I::transpose4(&[a, b, c, d]);
        for axis in 0..N {
            values[axis * stride + first..][..QUAD].copy_from_slice(&axes[axis]);
        }
    }
}
