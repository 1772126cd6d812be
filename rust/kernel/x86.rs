//! The tokens of AVX2 and AVX-512, their registers, and the primitives that plain loops do not reach.
#![allow(unsafe_code)]

use std::arch::is_x86_feature_detected;
use std::arch::x86_64::{
    __m256, __m256d, __m256i, _mm256_add_epi32, _mm256_add_pd, _mm256_add_ps, _mm256_and_pd,
    _mm256_and_si256, _mm256_andnot_pd, _mm256_andnot_ps, _mm256_blendv_pd, _mm256_blendv_ps,
    _mm256_castpd128_pd256, _mm256_castpd_ps, _mm256_castpd_si256, _mm256_castps128_ps256,
    _mm256_castsi256_pd, _mm256_cmp_pd, _mm256_cmp_ps, _mm256_cmpeq_epi32, _mm256_cvtpd_ps, _mm256_div_pd,
    _mm256_div_ps, _mm256_insertf128_pd, _mm256_insertf128_ps, _mm256_loadu_pd, _mm256_loadu_ps,
    _mm256_max_pd, _mm256_max_ps, _mm256_min_epu32, _mm256_min_pd, _mm256_movemask_epi8, _mm256_movemask_ps,
    _mm256_mul_pd, _mm256_mul_ps, _mm256_or_pd, _mm256_permute2f128_pd, _mm256_permute2f128_ps,
    _mm256_permute4x64_pd, _mm256_permutevar8x32_ps, _mm256_set1_epi32, _mm256_set1_epi64x, _mm256_set1_pd,
    _mm256_set1_ps, _mm256_setr_epi32, _mm256_setzero_pd, _mm256_setzero_ps, _mm256_shuffle_ps,
    _mm256_storeu_pd, _mm256_storeu_ps, _mm256_stream_pd, _mm256_stream_ps, _mm256_sub_pd, _mm256_sub_ps,
    _mm256_unpackhi_pd, _mm256_unpackhi_ps, _mm256_unpacklo_pd, _mm256_unpacklo_ps, _mm256_xor_pd,
    _mm256_xor_ps, _mm_loadu_pd, _mm_prefetch, _mm_sfence, _mm_storeu_pd, _mm_unpackhi_pd, _mm_unpacklo_pd,
    _CMP_EQ_OQ, _CMP_GT_OQ, _CMP_LE_OQ, _CMP_LT_OQ, _MM_HINT_T0,
};
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::count::{Cells, LaneBins};
use super::simd::{Job, Register, Simd, Vectors};
use super::transpose::{Raw, Row, BLOCK, LANES};
use crate::dsp::{Real, Slice};

/// The token of AVX2 or, with `MANY_REGISTERS`, of AVX-512: F, and VL, BW and DQ, which give the primitives below, of 256 bits,
/// twice the registers. That nothing but [`detect`](Self::detect) makes one is the safety argument of every block here.
#[derive(Clone, Copy)]
pub(crate) struct X86<const MANY_REGISTERS: bool>(());

impl<const MANY_REGISTERS: bool> X86<MANY_REGISTERS> {
    /// The token, where the machine has the instructions.
    pub(super) fn detect() -> Option<Self> {
        let found = is_x86_feature_detected!("avx2")
            && (!MANY_REGISTERS
                || is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq"));
        found.then_some(Self(()))
    }

    /// Runs a job that is compiled for these instructions.
    pub(super) fn run<J: Job>(self, job: J) -> J::Output {
        // SAFETY: the token says that the machine has the features.
        unsafe {
            if MANY_REGISTERS {
                avx512(self, job)
            } else {
                avx2(self, job)
            }
        }
    }
}

#[target_feature(enable = "avx2")]
fn avx2<J: Job>(simd: impl Simd, job: J) -> J::Output {
    job.run(simd)
}

#[target_feature(enable = "avx2,avx512f,avx512vl,avx512bw,avx512dq")]
fn avx512<J: Job>(simd: impl Simd, job: J) -> J::Output {
    job.run(simd)
}

macro_rules! operator {
    ($operator:ident, $method:ident, $register:ident, $instruction:ident) => {
        impl $operator for $register {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: the token that made it.
                Self(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}

/// A register and what it can do: the instructions of one kind of numbers. Those that move lanes are functions below.
macro_rules! register {
    (
        $(#[$doc:meta])*
        $register:ident($vector:ty): $lanes:literal of $number:ty,
        $splat:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $xor:ident,
        $compare:ident, $blend:ident, $reversed:ident, $transposed:ident
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        pub(crate) struct $register($vector);

        impl<const MANY_REGISTERS: bool> Vectors<$number, $lanes> for X86<MANY_REGISTERS> {
            type Register = $register;

            #[inline(always)]
            fn splat(self, x: $number) -> $register {
                // SAFETY: the token.
                $register(unsafe { $splat(x) })
            }

            #[inline(always)]
            fn load(self, from: &[$number]) -> $register {
                // SAFETY: the token; the slice holds as many numbers.
                $register(unsafe { $load(from[..$lanes].as_ptr()) })
            }
        }

        impl Register<$number, $lanes> for $register {
            #[inline(always)]
            fn store(self, to: &mut [$number]) {
                // SAFETY: the token that made it; the slice holds as many numbers.
                unsafe { $store(to[..$lanes].as_mut_ptr(), self.0) };
            }

            #[inline(always)]
            fn above(self, other: Self) -> Self {
                // SAFETY: the token that made it.
                Self(unsafe { $compare::<_CMP_GT_OQ>(self.0, other.0) })
            }

            #[inline(always)]
            fn select(self, yes: Self, no: Self) -> Self {
                // SAFETY: the token that made it.
                Self(unsafe { $blend(no.0, yes.0, self.0) })
            }

            #[inline(always)]
            fn reversed(self) -> Self {
                $reversed(self)
            }

            #[inline(always)]
            fn transposed(rows: [Self; $lanes]) -> [Self; $lanes] {
                $transposed(rows)
            }
        }

        operator!(Add, add, $register, $add);
        operator!(Sub, sub, $register, $sub);
        operator!(Mul, mul, $register, $mul);
        operator!(Div, div, $register, $div);

        impl Mul<$number> for $register {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: $number) -> Self {
                // SAFETY: the token that made it.
                Self(unsafe { $mul(self.0, $splat(other)) })
            }
        }

        impl Neg for $register {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: the token that made it.
                Self(unsafe { $xor(self.0, $splat(-0.0)) })
            }
        }
    };
}

register! {
    /// Four float64 in an AVX register, made with a token.
    F64x4(__m256d): 4 of f64,
    _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd,
    _mm256_xor_pd, _mm256_cmp_pd, _mm256_blendv_pd, reversed_f64, transposed_f64
}

register! {
    /// Eight float32 in an AVX register, made with a token.
    F32x8(__m256): 8 of f32,
    _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps,
    _mm256_xor_ps, _mm256_cmp_ps, _mm256_blendv_ps, reversed_f32, transposed_f32
}

#[inline(always)]
fn reversed_f64(F64x4(x): F64x4) -> F64x4 {
    // SAFETY: the token that made it.
    F64x4(unsafe { _mm256_permute4x64_pd::<0b00_01_10_11>(x) })
}

#[inline(always)]
fn reversed_f32(F32x8(x): F32x8) -> F32x8 {
    // SAFETY: the token that made it.
    F32x8(unsafe { _mm256_permutevar8x32_ps(x, _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0)) })
}

/// Halves first: of rows that come from memory, a compiler joins them as it loads.
#[inline(always)]
fn transposed_f64([F64x4(a), F64x4(b), F64x4(c), F64x4(d)]: [F64x4; 4]) -> [F64x4; 4] {
    // SAFETY: the token that made them.
    unsafe {
        let (even, odd) = (_mm256_permute2f128_pd::<0x20>(a, c), _mm256_permute2f128_pd::<0x20>(b, d));
        let (even_after, odd_after) =
            (_mm256_permute2f128_pd::<0x31>(a, c), _mm256_permute2f128_pd::<0x31>(b, d));
        [
            F64x4(_mm256_unpacklo_pd(even, odd)),
            F64x4(_mm256_unpackhi_pd(even, odd)),
            F64x4(_mm256_unpacklo_pd(even_after, odd_after)),
            F64x4(_mm256_unpackhi_pd(even_after, odd_after)),
        ]
    }
}

/// Halves first, as above.
#[inline(always)]
fn transposed_f32(
    [F32x8(a), F32x8(b), F32x8(c), F32x8(d), F32x8(e), F32x8(f), F32x8(g), F32x8(h)]: [F32x8; 8],
) -> [F32x8; 8] {
    // SAFETY: the token that made them.
    unsafe {
        let [i, j, k, l] = four_by_four([
            _mm256_permute2f128_ps::<0x20>(a, e),
            _mm256_permute2f128_ps::<0x20>(b, f),
            _mm256_permute2f128_ps::<0x20>(c, g),
            _mm256_permute2f128_ps::<0x20>(d, h),
        ]);
        let [m, n, o, p] = four_by_four([
            _mm256_permute2f128_ps::<0x31>(a, e),
            _mm256_permute2f128_ps::<0x31>(b, f),
            _mm256_permute2f128_ps::<0x31>(c, g),
            _mm256_permute2f128_ps::<0x31>(d, h),
        ]);
        [i, j, k, l, m, n, o, p]
    }
}

/// Rows and columns exchanged in each half.
///
/// # Safety
/// AVX2.
#[inline(always)]
unsafe fn four_by_four([a, b, c, d]: [__m256; 4]) -> [F32x8; 4] {
    // SAFETY: what the caller promises.
    unsafe {
        let (even, odd) = (_mm256_unpacklo_ps(a, c), _mm256_unpacklo_ps(b, d));
        let (even_after, odd_after) = (_mm256_unpackhi_ps(a, c), _mm256_unpackhi_ps(b, d));
        [
            F32x8(_mm256_unpacklo_ps(even, odd)),
            F32x8(_mm256_unpackhi_ps(even, odd)),
            F32x8(_mm256_unpacklo_ps(even_after, odd_after)),
            F32x8(_mm256_unpackhi_ps(even_after, odd_after)),
        ]
    }
}

impl<const MANY_REGISTERS: bool> Simd for X86<MANY_REGISTERS> {
    const MANY_REGISTERS: bool = MANY_REGISTERS;

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // halves of several rows at a time
    fn cells<const W: usize>(self, bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
        // SAFETY: the token; pointers to read are the start of four elements of an array of eight, those to write
        // of an array of eight half as large.
        unsafe {
            let mut nearest = _mm256_set1_epi32(-1);
            let mut sums = [[_mm256_setzero_pd(); 2]; W];
            each_vector!(W, w, {
                for half in 0..2 {
                    let load = |row: &Row<W>| _mm256_loadu_pd(row.0[w].as_ptr().add(half * LANES / 2));
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
                    let load = |row: &Row<W>| _mm256_loadu_pd(row.0[w].as_ptr().add(half * LANES / 2));
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
        self,
        samples: &[f64; 6 * BLOCK],
        rows: &mut [Row<W>; BLOCK],
        lane: usize,
        raw: Option<Raw<'_, T>>,
    ) -> bool {
        assert!(lane + 6 <= W * LANES, "six lanes must fit");
        // SAFETY: the token. Reads: sample s < 8 has six values at 6 * s. Writes: six lanes fit in each row.
        let (early, late) = unsafe {
            (
                four_samples(samples.as_ptr(), &mut rows[..4], lane),
                four_samples(samples.as_ptr().add(24), &mut rows[4..], lane),
            )
        };
        let Some(Raw { values, n_samples, start, stream }) = raw else { return true };
        assert!(values[start..].len() >= 5 * n_samples + BLOCK, "six axes must fit");
        let axes = early.into_iter().zip(late).enumerate();
        // SAFETY: the token; the assert above leaves room for eight values of each of six axes, and a line ends where eight
        // values of each came before; streamed are aligned ones.
        match T::slice(values) {
            Slice::F64(values) => {
                let values = values[start..].as_mut_ptr();
                let stream = stream.is_some() && values.addr() % 32 == 0 && n_samples % 4 == 0;
                for (axis, (early, late)) in axes {
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
                true
            }
            Slice::F32(values) => {
                // Of all values: the half line before `start` is written too.
                let (values, half) = (values.as_mut_ptr().wrapping_add(start), 4 * BLOCK);
                // Where whole lines are blocks alike on all axes: a first half waits for the block after it, if there is one.
                let mut stream = stream.filter(|_| n_samples % (2 * BLOCK) == 0);
                let (mut waits, mut ends) = (false, false);
                if stream.is_some() {
                    waits = values.addr() % (2 * half) == 0 && start + 2 * BLOCK <= n_samples;
                    ends = values.addr() % (2 * half) == half && start >= BLOCK;
                }
                unsafe {
                    let mut largest = _mm256_setzero_ps();
                    for (axis, (early, late)) in axes {
                        let values = values.add(axis * n_samples);
                        let (early, late) = (_mm256_cvtpd_ps(early), _mm256_cvtpd_ps(late));
                        let block = _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(early), late);
                        largest = _mm256_max_ps(_mm256_andnot_ps(_mm256_set1_ps(-0.0), block), largest);
                        match &mut stream {
                            Some(first) if waits => _mm256_storeu_ps(first.0[axis].as_mut_ptr(), block),
                            Some(first) if ends => {
                                _mm256_stream_ps(values.sub(BLOCK), _mm256_loadu_ps(first.0[axis].as_ptr()));
                                _mm256_stream_ps(values, block);
                            }
                            _ => _mm256_storeu_ps(values, block),
                        }
                    }
                    let infinite = _mm256_cmp_ps::<_CMP_EQ_OQ>(largest, _mm256_set1_ps(f32::INFINITY));
                    _mm256_movemask_ps(infinite) == 0
                }
            }
        }
    }

    #[inline(always)]
    fn will_read(self, values: &[f64], index: usize) {
        // SAFETY: a prefetch reads nothing and never faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().wrapping_add(index).cast()) };
    }

    #[inline(always)]
    fn finish_writes(self) {
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
