//! From samples (all axes of one instant together) to lanes, and to raw features (all instants of one axis
//! together).

use super::{flat, flat_mut, Row, BLOCK};

/// What features are written as.
///
/// # Safety
/// `NARROW` tells f32 from f64; there are no others.
#[allow(unsafe_code)]
pub(crate) unsafe trait Real: Copy + Send {
    const NARROW: bool;
    /// The number nearest to another, or infinity.
    fn of(value: f64) -> Self;
}

#[allow(unsafe_code)]
// SAFETY: as it is told.
unsafe impl Real for f64 {
    const NARROW: bool = false;
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
}

#[allow(unsafe_code)]
// SAFETY: as it is told.
unsafe impl Real for f32 {
    const NARROW: bool = true;
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation)] // what was asked for
    fn of(value: f64) -> Self {
        value as f32
    }
}

/// Where the raw features of one recording go: `values[axis * n_samples + sample]`.
pub(crate) struct Raw<'a, T> {
    /// Raw features of one recording, axis-major.
    pub(crate) values: &'a mut [T],
    /// Samples per axis.
    pub(crate) n_samples: usize,
    /// The first sample of this block.
    pub(crate) start: usize,
    /// Write past the caches where the machine can.
    pub(crate) stream: bool,
}

/// Plain-loop twin of the vector code in `x86.rs`.
#[inline(always)]
pub(super) fn transpose6<const W: usize, T: Real>(
    samples: &[f64; 6 * BLOCK],
    rows: &mut [Row<W>; BLOCK],
    lane: usize,
    raw: Option<Raw<'_, T>>,
) {
    for (row, sample) in rows.iter_mut().zip(samples.chunks_exact(6)) {
        flat_mut(row)[lane..lane + 6].copy_from_slice(sample);
    }
    if let Some(Raw { values, n_samples, start, .. }) = raw {
        for axis in 0..6 {
            let target = &mut values[axis * n_samples + start..][..BLOCK];
            for (value, sample) in target.iter_mut().zip(samples.chunks_exact(6)) {
                *value = T::of(sample[axis]);
            }
        }
    }
}

/// Plain-loop twin of the vector code in `x86.rs`.
#[inline(always)]
pub(super) fn transpose4(rows: [&[f64; 4]; 4]) -> [[f64; 4]; 4] {
    std::array::from_fn(|column| std::array::from_fn(|row| rows[row][column]))
}

/// Samples of any number of axes into consecutive lanes, starting with axis `axis`.
#[inline(always)]
pub(crate) fn pack<const W: usize>(
    samples: &[f64],
    n_axes: usize,
    axis: usize,
    rows: &mut [Row<W>],
    lanes: std::ops::Range<usize>,
) {
    for (row, sample) in rows.iter_mut().zip(samples.chunks_exact(n_axes)) {
        let n = lanes.len();
        flat_mut(row)[lanes.clone()].copy_from_slice(&sample[axis..axis + n]);
    }
}

/// One lane of some rows, in time order.
#[inline(always)]
pub(crate) fn unpack<const W: usize, T: Real>(rows: &[Row<W>], lane: usize, target: &mut [T]) {
    for (value, row) in target.iter_mut().zip(rows) {
        *value = T::of(flat(row)[lane]);
    }
}
