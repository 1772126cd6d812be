//! Four axes at a time: the lanes of the bank.

use crate::kernel::{Isa, Pack};

/// Axes per quad. Eight lanes would leave a quarter of the work of six axes without use.
pub(super) const QUAD: usize = 4;

/// Four axes at one instant.
pub(super) type Quad = Pack<QUAD>;

/// The first `N` of some values; the rest is zero.
#[inline(always)]
pub(super) fn first<const N: usize>(values: &[f64]) -> Quad {
    let mut quad = Quad::ZERO;
    quad.0[..N].copy_from_slice(&values[..N]);
    quad
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
            axis[t] = (Pack(lane) * Quad::splat(gain)).0;
        }
    }
}
