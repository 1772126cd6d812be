//! Which vector instructions to use, decided once at run time.

use std::sync::OnceLock;

use super::simd::{Job, Portable};
#[cfg(target_arch = "x86_64")]
use super::x86::X86;
use crate::error::{Error, Result};

/// A compiled variant of the kernels. All give the same bits; they differ in speed only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SimdPath {
    /// What every machine of the target has: SSE2 on `x86_64`, NEON on `aarch64`.
    Baseline,
    /// AVX2: two vectors of four float64 for eight lanes.
    Avx2,
    /// AVX-512 with F, VL, BW and DQ: one vector of eight float64, and more registers.
    Avx512,
}

impl SimdPath {
    /// The paths that this machine can run, slowest first.
    ///
    /// ```
    /// assert_eq!(granular_id::SimdPath::available()[0], granular_id::SimdPath::Baseline);
    /// ```
    #[must_use]
    pub fn available() -> Vec<Self> {
        [Self::Baseline, Self::Avx2, Self::Avx512].into_iter().filter(|path| path.is_available()).collect()
    }

    /// The path that is used: the fastest available, or the one named by the environment
    /// variable `GRANULAR_ID_SIMD` (`baseline`, `avx2`, `avx512`).
    ///
    /// The environment is read once per process.
    ///
    /// # Errors
    /// [`Error::Argument`]: the variable names none, or one that this machine lacks.
    pub fn detect() -> Result<Self> {
        static CHOICE: OnceLock<Result<SimdPath>> = OnceLock::new();
        let requested = || std::env::var_os("GRANULAR_ID_SIMD").unwrap_or_default();
        CHOICE.get_or_init(|| Self::named(&requested().to_string_lossy())).clone()
    }

    /// The path of a name; the fastest where there is none.
    fn named(name: &str) -> Result<Self> {
        let available = Self::available();
        let found = if name.is_empty() {
            available.last()
        } else {
            available.iter().find(|path| path.name() == name)
        };
        found.copied().ok_or_else(|| {
            let names: Vec<_> = available.iter().map(|path| path.name()).collect();
            let wanted =
                format_args!("be one of the vector units of this machine ({}), or not set", names.join(", "));
            Error::argument("GRANULAR_ID_SIMD", wanted, format_args!("{name:?}"))
        })
    }

    /// The name that `GRANULAR_ID_SIMD` knows.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    fn is_available(self) -> bool {
        match self {
            Self::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => X86::<false>::detect().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => X86::<true>::detect().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Runs `job` compiled for this path, or for the baseline where the machine lacks it.
    pub(crate) fn run<J: Job>(self, job: J) -> J::Output {
        #[cfg(target_arch = "x86_64")]
        match self {
            Self::Baseline => {}
            Self::Avx2 => {
                if let Some(simd) = X86::<false>::detect() {
                    return simd.run(job);
                }
            }
            Self::Avx512 => {
                if let Some(simd) = X86::<true>::detect() {
                    return simd.run(job);
                }
            }
        }
        job.run(Portable)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::simd::{F32x8, Simd};
    use super::*;

    /// Calculates with vectors as with plain numbers.
    struct Compare([f32; 16]);

    impl Job for Compare {
        type Output = ();

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) {
            let numbers = self.0;
            for shift in 0..16 {
                let mut others = numbers;
                others.rotate_left(shift);
                for (a, b) in numbers.chunks_exact(8).zip(others.chunks_exact(8)) {
                    let (x, y) = (simd.load(a), simd.load(b));
                    same(x + y, |l| a[l] + b[l]);
                    same(x - y, |l| a[l] - b[l]);
                    same(x * y, |l| a[l] * b[l]);
                    same(simd.splat(a[1]), |_| a[1]);
                }
            }
            let mut rows = [simd.splat(0.0); 8];
            for (row, values) in rows.iter_mut().enumerate() {
                *values =
                    simd.load(&std::array::from_fn::<f32, 8, _>(|column| numbers[(row + 3 * column) % 16]));
            }
            for (column, row) in F32x8::transposed(rows).into_iter().enumerate() {
                same(row, |l| numbers[(l + 3 * column) % 16]);
            }
        }
    }

    /// The same bits, but of NaN, which no language promises; nothing behind the eighth number is written.
    fn same(got: impl F32x8, expected: impl Fn(usize) -> f32) {
        let mut values = [7.0_f32; 16];
        got.store(&mut values);
        for (l, value) in values.into_iter().enumerate() {
            let expected = if l < 8 { expected(l) } else { 7.0 };
            assert!(
                value.to_bits() == expected.to_bits() || value.is_nan() && expected.is_nan(),
                "lane {l}: {value}"
            );
        }
    }

    proptest! {
        #[test]
        fn any_numbers_have_the_bits_of_plain_arithmetic(numbers in prop::array::uniform16(prop::num::f32::ANY)) {
            for path in SimdPath::available() {
                path.run(Compare(numbers));
            }
        }
    }

    #[test]
    fn a_name_that_means_nothing_here_is_refused() {
        let available = SimdPath::available();
        assert_eq!(SimdPath::named("").ok(), available.last().copied());
        for path in [SimdPath::Baseline, SimdPath::Avx2, SimdPath::Avx512] {
            assert_eq!(SimdPath::named(path.name()).ok(), available.contains(&path).then_some(path));
        }
        for name in ["AVX2", "neon", "avx2 "] {
            let error = SimdPath::named(name).unwrap_err().to_string();
            assert!(error.contains("GRANULAR_ID_SIMD") && error.contains("baseline") && error.contains(name));
        }
    }
}
