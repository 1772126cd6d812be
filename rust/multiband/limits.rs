//! What a recording may hold: numbers, and none so large that a square leaves float64.

use super::quad::{first, Quad, QUAD};
use super::scales::Scales;

/// Larger magnitudes, in units of the smallest scale, are refused. Filters overshoot and sums of squares grow with the
/// length of a recording, which leaves room to 1e154, where squares overflow.
const LARGEST: f64 = 1e145;

/// The largest magnitude of each axis, given its scales; at most `LARGEST` itself.
pub(super) fn limits(scales: &Scales, n_axes: usize) -> Vec<f64> {
    (0..n_axes)
        .map(|axis| {
            let own = scales.bands.iter().skip(axis).step_by(n_axes).chain(scales.level.get(axis));
            LARGEST * own.fold(1.0, |least: f64, scale| least.min(*scale))
        })
        .collect()
}

/// Means of the axes of a time-major recording, counted from its first sample; false where a value is NaN, infinite or
/// beyond the limit of its axis.
#[inline(always)]
pub(super) fn means_within(recording: &[f64], limits: &[f64], means: &mut [f64]) -> bool {
    let mut within = true;
    for axis in (0..limits.len()).step_by(QUAD) {
        within &= match limits.len() - axis {
            1 => quad_within::<1>(recording, axis, limits, means),
            2 => quad_within::<2>(recording, axis, limits, means),
            3 => quad_within::<3>(recording, axis, limits, means),
            _ => quad_within::<QUAD>(recording, axis, limits, means),
        };
    }
    within
}

/// `N` axes from `axis` on.
#[inline(always)]
fn quad_within<const N: usize>(recording: &[f64], axis: usize, limits: &[f64], means: &mut [f64]) -> bool {
    let n_axes = limits.len();
    let at_start = first::<N>(&recording[axis..]);
    // Four sums side by side: one would wait for itself at every row.
    let mut sums = [Quad::ZERO; 4];
    let mut largest = [Quad::ZERO; 4];
    let fours = recording.chunks_exact(4 * n_axes);
    let rest = fours.remainder();
    for four in fours {
        for i in 0..4 {
            let x = first::<N>(&four[i * n_axes + axis..]);
            sums[i] = sums[i] + (x - at_start);
            largest[i] = x.abs().above(largest[i]).select(x.abs(), largest[i]);
        }
    }
    for (i, row) in rest.chunks_exact(n_axes).enumerate() {
        let x = first::<N>(&row[axis..]);
        sums[i] = sums[i] + (x - at_start);
        largest[i] = x.abs().above(largest[i]).select(x.abs(), largest[i]);
    }
    let n = (recording.len() / n_axes) as f64;
    let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    let mut within = true;
    for lane in 0..N {
        // NaN is never the larger one of two, but it stays in a sum.
        within &= sum.0[lane].is_finite() && largest.iter().all(|l| l.0[lane] <= limits[axis + lane]);
        means[axis + lane] = sum.0[lane] / n;
    }
    within
}
