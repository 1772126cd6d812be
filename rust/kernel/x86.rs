//! The wrappers for AVX2 and AVX-512, and the primitives that plain loops do not reach.
#![allow(unsafe_code)]

use std::arch::x86_64::{
    __m256d, __m256i, _mm256_add_epi32, _mm256_add_pd, _mm256_and_pd, _mm256_and_si256, _mm256_andnot_pd,
    _mm256_castpd128_pd256, _mm256_castpd_ps, _mm256_castpd_si256, _mm256_castsi256_pd, _mm256_cmp_pd,
    _mm256_cmpeq_epi32, _mm256_cvtpd_ps, _mm256_insertf128_pd, _mm256_loadu_pd, _mm256_max_pd,
    _mm256_min_epu32, _mm256_min_pd, _mm256_movemask_epi8, _mm256_mul_pd, _mm256_or_pd,
    _mm256_permute2f128_pd, _mm256_set1_epi32, _mm256_set1_epi64x, _mm256_set1_pd, _mm256_setzero_pd,
    _mm256_shuffle_ps, _mm256_storeu_pd, _mm256_storeu_ps, _mm256_stream_pd, _mm256_sub_pd,
    _mm256_unpackhi_pd, _mm256_unpacklo_pd, _mm_loadu_pd, _mm_prefetch, _mm_sfence, _mm_storeu_pd,
    _mm_storeu_ps, _mm_unpackhi_pd, _mm_unpacklo_pd, _CMP_LE_OQ, _CMP_LT_OQ, _MM_HINT_T0,
};

use super::count::{Cells, LaneBins};
use super::simd::{Isa, Job};
use super::transpose::{Raw, Real};
use super::x86_quad::Register;
use super::{Row, BLOCK, LANES};

/// Compiles a job for AVX2.
#[target_feature(enable = "avx2")]
pub(super) fn avx2<J: Job>(job: J) -> J::Output {
    job.run::<X86<false>>()
}

/// Compiles a job for AVX-512: F, and VL, BW and DQ, which give the primitives below, of 256 bits, twice the registers.
#[target_feature(enable = "avx2,avx512f,avx512vl,avx512bw,avx512dq")]
pub(super) fn avx512<J: Job>(job: J) -> J::Output {
    job.run::<X86<true>>()
}

/// AVX2 primitives. Only ever used inside the wrappers above, which [`SimdPath`](super::Path) calls after it has
/// asked the processor: that is the safety argument of every block here.
pub(super) struct X86<const MANY_REGISTERS: bool>;

impl<const MANY_REGISTERS: bool> Isa for X86<MANY_REGISTERS> {
    type Quad = Register;
    const MANY_REGISTERS: bool = MANY_REGISTERS;

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // halves of several rows at a time
    fn cells<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
        // SAFETY: AVX2 is there (see `X86`); pointers to read are the start of four elements of an array of eight, those to write
        // of an array of eight half as large.
        unsafe {
            let mut nearest = _mm256_set1_epi32(-1);
            let mut sums = [[_mm256_setzero_pd(); 2]; W];
            each_vector!(W, w, {
                for half in 0..2 {
                    let load = |row: &Row<W>| _mm256_loadu_pd(row[w].0.as_ptr().add(half * LANES / 2));
                    let sum = _mm256_add_pd(_mm256_mul_pd(load(row), load(&bins.scale)), load(&bins.offset));
                    // The second operand is the answer for NaN, as in the plain loop.
                    let sum = _mm256_min_pd(_mm256_max_pd(sum, load(&bins.bottom)), load(&bins.top));
                    sums[w][half] = sum;
                    // High words are far above any limit, so one minimum over all words is the least fraction.
                    nearest = _mm256_min_epu32(nearest, _mm256_castpd_si256(sum));
                }
                store_high_words(sums[w], &mut cells.0[w]);
            });
            if !is_near(nearest, bins.limit) {
                return false;
            }
            // A silent axis is 0, and so most often next to the edge at 0.
            let mut nearest = _mm256_set1_epi32(-1);
            each_vector!(W, w, {
                for half in 0..2 {
                    let load = |row: &Row<W>| _mm256_loadu_pd(row[w].0.as_ptr().add(half * LANES / 2));
                    let sum = sums[w][half];
                    let distance =
                        _mm256_andnot_pd(_mm256_set1_pd(-0.0), _mm256_sub_pd(sum, load(&bins.zero_cell)));
                    let is_zero = _mm256_cmp_pd::<_CMP_LE_OQ>(distance, _mm256_set1_pd(bins.reach));
                    let is_below = _mm256_cmp_pd::<_CMP_LT_OQ>(load(row), load(&bins.zero_edge));
                    nearest = _mm256_min_epu32(nearest, _mm256_castpd_si256(_mm256_or_pd(sum, is_zero)));
                    // All ones are -1.
                    let one_less = _mm256_castpd_si256(_mm256_and_pd(is_zero, is_below));
                    let bits = _mm256_add_epi32(_mm256_castpd_si256(sum), one_less);
                    sums[w][half] = _mm256_castsi256_pd(bits);
                }
                store_high_words(sums[w], &mut cells.0[w]);
            });
            is_near(nearest, bins.limit)
        }
    }

    #[inline(always)]
    fn transpose6<const W: usize, T: Real>(
        samples: &[f64; 6 * BLOCK],
        rows: &mut [Row<W>; BLOCK],
        lane: usize,
        raw: Option<Raw<'_, T>>,
    ) {
        assert!(lane + 6 <= W * LANES, "six lanes must fit");
        let target = raw.map(|raw| {
            let values = &mut raw.values[raw.start..];
            assert!(values.len() >= 5 * raw.n_samples + BLOCK, "six axes must fit");
            (values.as_mut_ptr(), raw.n_samples, raw.stream)
        });
        // SAFETY: AVX2 is there (see `X86`). Reads: sample s < 8 has six values at 6 * s. Writes: the asserts above leave
        // room for six lanes in each row and for eight values of each of six axes, f32 where they are narrow and f64 where not;
        // `stream` checks the alignment.
        unsafe {
            let early = four_samples(samples.as_ptr(), &mut rows[..4], lane);
            let late = four_samples(samples.as_ptr().add(24), &mut rows[4..], lane);
            let Some((values, n_samples, stream)) = target else { return };
            let stream = stream && !T::NARROW && values.addr() % 32 == 0 && n_samples % 4 == 0;
            for (axis, (early, late)) in early.into_iter().zip(late).enumerate() {
                let values = values.add(axis * n_samples);
                if T::NARROW {
                    let values = values.cast::<f32>();
                    _mm_storeu_ps(values, _mm256_cvtpd_ps(early));
                    _mm_storeu_ps(values.add(4), _mm256_cvtpd_ps(late));
                    continue;
                }
                let values = values.cast::<f64>();
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

    #[inline(always)]
    fn transpose4(rows: [&[f64; 4]; 4]) -> [[f64; 4]; 4] {
        let mut columns = [[0.0; 4]; 4];
        let halves = rows.map(|row| row.as_chunks::<2>().0);
        // SAFETY: AVX2 is there (see `X86`); every pointer is the start of an array, of two or of four.
        unsafe {
            // Halves are joined as they are loaded, so that only half of the exchanges are left to do.
            let join = |a: &[f64; 2], b: &[f64; 2]| {
                let (a, b) = (_mm_loadu_pd(a.as_ptr()), _mm_loadu_pd(b.as_ptr()));
                _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(a), b)
            };
            for half in 0..2 {
                let even = join(&halves[0][half], &halves[2][half]);
                let odd = join(&halves[1][half], &halves[3][half]);
                _mm256_storeu_pd(columns[2 * half].as_mut_ptr(), _mm256_unpacklo_pd(even, odd));
                _mm256_storeu_pd(columns[2 * half + 1].as_mut_ptr(), _mm256_unpackhi_pd(even, odd));
            }
        }
        columns
    }

    #[inline(always)]
    fn will_read(values: &[f64], index: usize) {
        // SAFETY: a prefetch reads nothing and never faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().wrapping_add(index).cast()) };
    }

    #[inline(always)]
    fn finish_writes() {
        // SAFETY: every x86-64 processor has this instruction, and it takes no operands.
        unsafe { _mm_sfence() };
    }
}

/// The high words of eight numbers, in another order.
///
/// # Safety
/// AVX2.
#[inline(always)]
unsafe fn store_high_words([low, high]: [__m256d; 2], words: &mut [u32; LANES]) {
    // SAFETY: what the caller promises; there is room for eight words.
    unsafe {
        let high = _mm256_shuffle_ps::<0b11_01_11_01>(_mm256_castpd_ps(low), _mm256_castpd_ps(high));
        _mm256_storeu_ps(words.as_mut_ptr().cast(), high);
    }
}

/// Whether one of the low words is at most `limit`.
///
/// # Safety
/// AVX2.
#[inline(always)]
unsafe fn is_near(words: __m256i, limit: u32) -> bool {
    // SAFETY: what the caller promises.
    unsafe {
        let near = _mm256_cmpeq_epi32(_mm256_min_epu32(words, _mm256_set1_epi32(limit.cast_signed())), words);
        // The mask drops the high words.
        _mm256_movemask_epi8(_mm256_and_si256(near, _mm256_set1_epi64x(0xffff_ffff))) != 0
    }
}

/// Four samples of six axes into lanes `lane..lane + 6` of four rows; returns the samples axis by axis.
///
/// # Safety
/// AVX2; 24 values at `samples`; four rows of at least `lane + 6` lanes.
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
            let row = row.as_mut_ptr().cast::<f64>().add(lane);
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
