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
/// Quads come in whole fours, for which there must be room.
#[inline(always)]
pub(super) fn spread<I: Isa, const N: usize>(quads: &[Quad], gain: Quad, stride: usize, values: &mut [f64]) {
    let fours = quads.as_chunks::<QUAD>().0;
    let mut axes = values.chunks_mut(stride);
    let mut axes: [&mut [[f64; QUAD]]; N] = std::array::from_fn(|_| {
        axes.next().map_or(&mut [][..], |axis| &mut axis.as_chunks_mut().0[..fours.len()])
    });
    for (t, [a, b, c, d]) in fours.iter().enumerate() {
        let lanes = I::transpose4([&a.0, &b.0, &c.0, &d.0]);
        for (axis, (lane, gain)) in axes.iter_mut().zip(lanes.into_iter().zip(gain.0)) {
            axis[t] = Quad(lane).times(Quad::all(gain)).0;
        }
    }
}
