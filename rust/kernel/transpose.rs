//! Rows of lanes: from samples (all axes of one instant together) to them, and to raw features (all instants of one axis
//! together).

use crate::dsp::{Real, Slice};

/// Channels per vector.
pub(crate) const LANES: usize = 8;

/// Vectors per row. Three vectors are 24 lanes, four 6-axis recordings: enough independent work to hide the
/// latency of the filter's recurrence.
pub(crate) const MAX_WIDTH: usize = 3;

/// Rows per block: eight float64 are one cache line of an output that is written axis by axis.
pub(crate) const BLOCK: usize = 8;

/// One instant of `W * LANES` channels, in `W` vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Row<const W: usize>(pub(crate) [[f64; LANES]; W]);

impl<const W: usize> Row<W> {
    pub(crate) const ZERO: Self = Self([[0.0; LANES]; W]);

    /// The lanes side by side.
    #[inline(always)]
    pub(crate) fn flat(&self) -> &[f64] {
        self.0.as_flattened()
    }

    /// The lanes side by side, to be written.
    #[inline(always)]
    pub(crate) fn flat_mut(&mut self) -> &mut [f64] {
        self.0.as_flattened_mut()
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
    /// For writes past the caches, where asked and where the machine can.
    pub(crate) stream: Option<&'a mut HalfLines>,
}

/// Half a cache line of float32 for each of six axes. The other half is in the next block; both are written past the caches
/// together, because a line that is written there in two parts is slow.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct HalfLines(pub(super) [[f32; BLOCK]; 6]);

impl HalfLines {
    pub(crate) const EMPTY: Self = Self([[0.0; BLOCK]; 6]);
}

/// Whether numbers just written are what they were before they were narrowed, as far as float32 reaches. Those not narrowed are.
#[inline(always)]
pub(crate) fn fits<T: Real>(values: &mut [T]) -> bool {
    match T::slice(values) {
        Slice::F64(_) => true,
        // without a branch, which the compiler turns into a few vector instructions
        Slice::F32(values) => values.iter().fold(true, |all, value| all & value.is_finite()),
    }
}

/// Plain-loop twin of the vector code in `x86.rs`.
#[inline(always)]
pub(super) fn transpose6<const W: usize, T: Real>(
    samples: &[f64; 6 * BLOCK],
    rows: &mut [Row<W>; BLOCK],
    lane: usize,
    raw: Option<Raw<'_, T>>,
) -> bool {
    let mut fit = true;
    for (row, sample) in rows.iter_mut().zip(samples.chunks_exact(6)) {
        row.flat_mut()[lane..lane + 6].copy_from_slice(sample);
    }
    if let Some(Raw { values, n_samples, start, .. }) = raw {
        for axis in 0..6 {
            let target = &mut values[axis * n_samples + start..][..BLOCK];
            for (value, sample) in target.iter_mut().zip(samples.chunks_exact(6)) {
                *value = T::of(sample[axis]);
            }
            fit &= fits(target);
        }
    }
    fit
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
        row.flat_mut()[lanes.clone()].copy_from_slice(&sample[axis..axis + n]);
    }
}

/// One lane of some rows, in time order. True when the target's type reaches far enough.
#[inline(always)]
pub(crate) fn unpack<const W: usize, T: Real>(rows: &[Row<W>], lane: usize, target: &mut [T]) -> bool {
    for (value, row) in target.iter_mut().zip(rows) {
        *value = T::of(row.flat()[lane]);
    }
    fits(target)
}
