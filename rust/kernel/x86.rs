//! The tokens of AVX2 and AVX-512, and their registers of eight float32.
#![allow(unsafe_code)]

use std::arch::is_x86_feature_detected;
use std::arch::x86_64::{
    __m256, _mm256_add_ps, _mm256_loadu_ps, _mm256_mul_ps, _mm256_permute2f128_ps, _mm256_set1_ps,
    _mm256_storeu_ps, _mm256_sub_ps, _mm256_unpackhi_ps, _mm256_unpacklo_ps,
};
use std::ops::{Add, Mul, Sub};

use super::simd::{Avx2, F32x8, Job, Simd};

/// The token of AVX2 or, with `MANY_REGISTERS`, of AVX-512: F, and VL, BW and DQ, which give vectors of 256 bits twice the
/// registers. That nothing but [`detect`](Self::detect) makes one is the safety argument of every block here.
#[derive(Clone, Copy)]
pub(crate) struct X86<const MANY_REGISTERS: bool>(Avx2);

impl<const MANY_REGISTERS: bool> X86<MANY_REGISTERS> {
    /// The token, where the machine has the instructions.
    pub(super) fn detect() -> Option<Self> {
        let found = !MANY_REGISTERS
            || is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq");
        Avx2::detect().filter(|_| found).map(Self)
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

/// Eight float32 in an AVX register, made with a token.
#[derive(Clone, Copy)]
pub(crate) struct Register(__m256);

impl<const MANY_REGISTERS: bool> Simd for X86<MANY_REGISTERS> {
    const MANY_REGISTERS: bool = MANY_REGISTERS;
    type F32x8 = Register;

    #[inline(always)]
    fn splat(self, x: f32) -> Register {
        // SAFETY: the token.
        Register(unsafe { _mm256_set1_ps(x) })
    }

    #[inline(always)]
    fn load(self, from: &[f32]) -> Register {
        // SAFETY: the token; the slice holds as many numbers.
        Register(unsafe { _mm256_loadu_ps(from[..8].as_ptr()) })
    }

    #[inline(always)]
    fn avx2(self) -> Option<Avx2> {
        Some(self.0)
    }
}

macro_rules! operator {
    ($operator:ident, $method:ident, $instruction:ident) => {
        impl $operator for Register {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: the token that made it.
                Self(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}
operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);

impl F32x8 for Register {
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        // SAFETY: the token that made it; the slice holds as many numbers.
        unsafe { _mm256_storeu_ps(to[..8].as_mut_ptr(), self.0) };
    }

    /// Halves first: of rows that come from memory, a compiler joins them as it loads.
    #[inline(always)]
    fn transposed(
        [Self(a), Self(b), Self(c), Self(d), Self(e), Self(f), Self(g), Self(h)]: [Self; 8],
    ) -> [Self; 8] {
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
}

/// Rows and columns exchanged in each half.
///
/// # Safety
/// AVX2.
#[inline(always)]
unsafe fn four_by_four([a, b, c, d]: [__m256; 4]) -> [Register; 4] {
    // SAFETY: what the caller promises.
    unsafe {
        let (even, odd) = (_mm256_unpacklo_ps(a, c), _mm256_unpacklo_ps(b, d));
        let (even_after, odd_after) = (_mm256_unpackhi_ps(a, c), _mm256_unpackhi_ps(b, d));
        [
            Register(_mm256_unpacklo_ps(even, odd)),
            Register(_mm256_unpackhi_ps(even, odd)),
            Register(_mm256_unpacklo_ps(even_after, odd_after)),
            Register(_mm256_unpackhi_ps(even_after, odd_after)),
        ]
    }
}
