//! Four numbers in one vector register.
#![allow(unsafe_code)]

use std::arch::x86_64::{
    __m256d, _mm256_add_pd, _mm256_blendv_pd, _mm256_cmp_pd, _mm256_div_pd, _mm256_loadu_pd, _mm256_mul_pd,
    _mm256_permute2f128_pd, _mm256_permute4x64_pd, _mm256_set1_pd, _mm256_sqrt_pd, _mm256_storeu_pd,
    _mm256_sub_pd, _mm256_unpackhi_pd, _mm256_unpacklo_pd, _mm256_xor_pd, _CMP_GT_OQ,
};
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::quad::Quad;

/// An AVX register. Only ever used by [`X86`](super::x86::X86), and so inside its wrappers, where AVX2 is known to be
/// there: that is the safety argument of every block here.
#[derive(Clone, Copy)]
pub(crate) struct Register(__m256d);

impl Quad for Register {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_set1_pd(x) })
    }

    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        // SAFETY: see `Register`; the slice holds four numbers.
        Self(unsafe { _mm256_loadu_pd(from[..4].as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        // SAFETY: as in `load`; the borrow is exclusive.
        unsafe { _mm256_storeu_pd(to[..4].as_mut_ptr(), self.0) };
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_sqrt_pd(self.0) })
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_cmp_pd::<_CMP_GT_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn or(self, other: Self, answer: Self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_blendv_pd(other.0, self.0, answer.0) })
    }

    #[inline(always)]
    fn reversed(self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_permute4x64_pd::<0b00_01_10_11>(self.0) })
    }

    #[inline(always)]
    fn transposed(rows: [Self; 4]) -> [Self; 4] {
        let [Self(a), Self(b), Self(c), Self(d)] = rows;
        // SAFETY: see `Register`.
        unsafe {
            let (even, odd) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
            let (even_after, odd_after) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
            [
                Self(_mm256_permute2f128_pd::<0x20>(even, even_after)),
                Self(_mm256_permute2f128_pd::<0x20>(odd, odd_after)),
                Self(_mm256_permute2f128_pd::<0x31>(even, even_after)),
                Self(_mm256_permute2f128_pd::<0x31>(odd, odd_after)),
            ]
        }
    }
}

impl Add for Register {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_add_pd(self.0, other.0) })
    }
}

impl Sub for Register {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_sub_pd(self.0, other.0) })
    }
}

impl Mul for Register {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_mul_pd(self.0, other.0) })
    }
}

impl Div for Register {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_div_pd(self.0, other.0) })
    }
}

impl Neg for Register {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe { _mm256_xor_pd(self.0, _mm256_set1_pd(-0.0)) })
    }
}
