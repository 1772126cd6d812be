//! Rows of lanes: from samples (all axes of one instant together) to them, and to raw features (all instants of one axis
//! together).

use crate::dsp::Real;

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
        row.flat_mut()[lane..lane + 6].copy_from_slice(sample);
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

/// One lane of some rows, in time order.
#[inline(always)]
pub(crate) fn unpack<const W: usize, T: Real>(rows: &[Row<W>], lane: usize, target: &mut [T]) {
    for (value, row) in target.iter_mut().zip(rows) {
        *value = T::of(row.flat()[lane]);
    }
}
