//! Rows of lanes: from samples (all axes of one instant together) to them, and to raw features (all instants of one axis
//! together).

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m256d, _mm256_castpd128_pd256, _mm256_insertf128_pd, _mm256_loadu_pd, _mm256_permute2f128_pd,
    _mm256_storeu_pd, _mm256_stream_pd, _mm256_unpackhi_pd, _mm256_unpacklo_pd, _mm_loadu_pd, _mm_prefetch,
    _mm_sfence, _mm_storeu_pd, _mm_unpackhi_pd, _mm_unpacklo_pd, _MM_HINT_T0,
};

#[cfg(target_arch = "x86_64")]
use super::simd::Avx2;
use super::simd::Simd;

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
pub(crate) struct Raw<'a> {
    /// Raw features of one recording, axis-major.
    pub(crate) values: &'a mut [f64],
    /// Samples per axis.
    pub(crate) n_samples: usize,
    /// The first sample of this block.
    pub(crate) start: usize,
    /// Write past the caches, where the machine can.
    pub(crate) stream: bool,
}

/// Eight samples of six axes: into lanes `lane..lane + 6` of `rows`, and axis by axis into `raw`.
#[inline(always)]
pub(crate) fn transpose6<const W: usize>(
    simd: impl Simd,
    samples: &[f64; 6 * BLOCK],
    rows: &mut [Row<W>; BLOCK],
    lane: usize,
    raw: Option<Raw<'_>>,
) {
    #[cfg(target_arch = "x86_64")]
    if let Some(proof) = simd.avx2() {
        return transpose6_by_avx2(proof, samples, rows, lane, raw);
    }
    let _ = simd;
    for (row, sample) in rows.iter_mut().zip(samples.chunks_exact(6)) {
        row.flat_mut()[lane..lane + 6].copy_from_slice(sample);
    }
    if let Some(Raw { values, n_samples, start, .. }) = raw {
        for axis in 0..6 {
            let target = &mut values[axis * n_samples + start..][..BLOCK];
            for (value, sample) in target.iter_mut().zip(samples.chunks_exact(6)) {
                *value = sample[axis];
            }
        }
    }
}

/// The same: a compiler makes slower code of loops that write in two orders.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
#[inline(always)]
fn transpose6_by_avx2<const W: usize>(
    _: Avx2,
    samples: &[f64; 6 * BLOCK],
    rows: &mut [Row<W>; BLOCK],
    lane: usize,
    raw: Option<Raw<'_>>,
) {
    assert!(lane + 6 <= W * LANES, "six lanes must fit");
    // SAFETY: the proof of AVX2. Reads: sample s < 8 has six values at 6 * s. Writes: six lanes fit in each row.
    let (early, late) = unsafe {
        (
            four_samples(samples.as_ptr(), &mut rows[..4], lane),
            four_samples(samples.as_ptr().add(24), &mut rows[4..], lane),
        )
    };
    let Some(Raw { values, n_samples, start, stream }) = raw else { return };
    let values = &mut values[start..];
    assert!(values.len() >= 5 * n_samples + BLOCK, "six axes must fit");
    let values = values.as_mut_ptr();
    let stream = stream && values.addr() % 32 == 0 && n_samples % 4 == 0;
    for (axis, (early, late)) in early.into_iter().zip(late).enumerate() {
        // SAFETY: the proof of AVX2; the assert leaves room for eight values of each of six axes; streamed are aligned ones.
        unsafe {
            let values = values.add(axis * n_samples);
            if stream {
                _mm256_stream_pd(values, early);
                _mm256_stream_pd(values.add(4), late);
            } else {
                _mm256_storeu_pd(values, early);
                _mm256_storeu_pd(values.add(4), late);
            }
        }
    }
}

/// Four samples of six axes into lanes `lane..lane + 6` of four rows; returns the samples axis by axis.
///
/// # Safety
/// AVX2; 24 values at `samples`; four rows of at least `lane + 6` lanes.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn four_samples<const W: usize>(
    samples: *const f64,
    rows: &mut [Row<W>],
    lane: usize,
) -> [__m256d; 6] {
    // SAFETY: what the caller promises.
    unsafe {
        let (h0, t0) = (_mm256_loadu_pd(samples), _mm_loadu_pd(samples.add(4)));
        let (h1, t1) = (_mm256_loadu_pd(samples.add(6)), _mm_loadu_pd(samples.add(10)));
        let (h2, t2) = (_mm256_loadu_pd(samples.add(12)), _mm_loadu_pd(samples.add(16)));
        let (h3, t3) = (_mm256_loadu_pd(samples.add(18)), _mm_loadu_pd(samples.add(22)));
        for (row, (head, tail)) in rows.iter_mut().zip([(h0, t0), (h1, t1), (h2, t2), (h3, t3)]) {
            let row = row.flat_mut().as_mut_ptr().add(lane);
            _mm256_storeu_pd(row, head);
            _mm_storeu_pd(row.add(4), tail);
        }
        let (a, b) = (_mm256_unpacklo_pd(h0, h1), _mm256_unpackhi_pd(h0, h1));
        let (c, d) = (_mm256_unpacklo_pd(h2, h3), _mm256_unpackhi_pd(h2, h3));
        let (e, f) = (_mm_unpacklo_pd(t0, t1), _mm_unpackhi_pd(t0, t1));
        let (g, h) = (_mm_unpacklo_pd(t2, t3), _mm_unpackhi_pd(t2, t3));
        [
            _mm256_permute2f128_pd::<0x20>(a, c),
            _mm256_permute2f128_pd::<0x20>(b, d),
            _mm256_permute2f128_pd::<0x31>(a, c),
            _mm256_permute2f128_pd::<0x31>(b, d),
            _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(e), g),
            _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(f), h),
        ]
    }
}

/// Asks for the cache line at `values[index]`, to be read soon. Any index is fine.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn prefetch(simd: impl Simd, values: &[f64], index: usize) {
    #[cfg(target_arch = "x86_64")]
    if simd.avx2().is_some() {
        // SAFETY: a prefetch reads nothing and never faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().wrapping_add(index).cast()) };
    }
    let _ = (simd, values, index);
}

/// Makes writes past the caches visible to other threads.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn finish_writes(simd: impl Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.avx2().is_some() {
        // SAFETY: every x86-64 processor has this instruction, and it takes no operands.
        unsafe { _mm_sfence() };
    }
    let _ = simd;
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
pub(crate) fn unpack<const W: usize>(rows: &[Row<W>], lane: usize, target: &mut [f64]) {
    for (value, row) in target.iter_mut().zip(rows) {
        *value = row.flat()[lane];
    }
}
