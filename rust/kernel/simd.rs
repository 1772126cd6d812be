//! Which vector instructions to use, decided once at run time.

use std::sync::OnceLock;

use super::count::{Cells, LaneBins};
use super::pack::Pack;
use super::quad::Quad;
use super::transpose::{self, Real};
use super::{Row, BLOCK};
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

    /// The path used when none is asked for: the fastest available, or the one named by the environment
    /// variable `GRANULAR_ID_SIMD` (`baseline`, `avx2`, `avx512`).
    ///
    /// The environment is read once per process.
    ///
    /// # Errors
    /// [`Error::VectorUnit`]: the variable names none, or one that this machine lacks.
    pub fn detect() -> Result<Self> {
        static CHOICE: OnceLock<Result<SimdPath>> = OnceLock::new();
        let asked = || std::env::var_os("GRANULAR_ID_SIMD").unwrap_or_default();
        CHOICE.get_or_init(|| Self::named(&asked().to_string_lossy())).clone()
    }

    /// The path of a name; the fastest where there is none.
    fn named(asked: &str) -> Result<Self> {
        let available = Self::available();
        let found = if asked.is_empty() {
            available.last()
        } else {
            available.iter().find(|path| path.name() == asked)
        };
        found.copied().ok_or_else(|| Error::VectorUnit {
            asked: asked.to_owned(),
            available: available.iter().map(|path| path.name()).collect(),
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
            Self::Avx2 => std::is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                std::is_x86_feature_detected!("avx2")
                    && std::is_x86_feature_detected!("avx512f")
                    && std::is_x86_feature_detected!("avx512vl")
                    && std::is_x86_feature_detected!("avx512bw")
                    && std::is_x86_feature_detected!("avx512dq")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Runs `job` compiled for this path, or for the baseline where the machine lacks it.
    #[allow(unsafe_code)]
    pub(crate) fn run<J: Job>(self, job: J) -> J::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `is_available` has just found the features that the wrapper is compiled for.
            Self::Avx2 if self.is_available() => unsafe { super::x86::avx2(job) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx512 if self.is_available() => unsafe { super::x86::avx512(job) },
            _ => job.run::<Portable>(),
        }
    }
}

/// Work that is compiled once per path. `run` must be `#[inline(always)]`, so that it takes on the features of
/// the wrapper that calls it.
pub(crate) trait Job {
    /// What the work gives.
    type Output;
    /// Does the work with the primitives of one instruction set.
    fn run<I: Isa>(self) -> Self::Output;
}

/// The primitives that a compiler does not find in a plain loop, with plain loops as the default.
pub(crate) trait Isa {
    /// Four numbers as this instruction set holds them.
    type Quad: Quad;

    /// Whether the state of four sections and 24 lanes stays in registers.
    const MANY_REGISTERS: bool = false;

    /// Cells of one row; true when a value is too near to an edge for the quick arithmetic to decide.
    #[inline(always)]
    fn cells<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
        super::count::cells(bins, row, cells)
    }

    /// Eight samples of six axes: into lanes `lane..lane + 6` of `rows`, and axis by axis into `raw`.
    #[inline(always)]
    fn transpose6<const W: usize, T: Real>(
        samples: &[f64; 6 * BLOCK],
        rows: &mut [Row<W>; BLOCK],
        lane: usize,
        raw: Option<transpose::Raw<'_, T>>,
    ) {
        transpose::transpose6(samples, rows, lane, raw);
    }

    /// Rows and columns of four by four exchanged.
    #[inline(always)]
    fn transpose4(rows: [&[f64; 4]; 4]) -> [[f64; 4]; 4] {
        transpose::transpose4(rows)
    }

    /// Asks for the cache line at `values[index]`, to be read soon. Any index is fine.
    #[inline(always)]
    fn will_read(_values: &[f64], _index: usize) {}

    /// Makes writes past the caches visible to other threads.
    #[inline(always)]
    fn finish_writes() {}
}

/// Plain loops, compiled for whatever the wrapper allows.
pub(crate) struct Portable;

impl Isa for Portable {
    type Quad = Pack<4>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_means_nothing_here_is_refused() {
        let available = SimdPath::available();
        assert_eq!(SimdPath::named("").ok(), available.last().copied());
        for path in [SimdPath::Baseline, SimdPath::Avx2, SimdPath::Avx512] {
            assert_eq!(SimdPath::named(path.name()).ok(), available.contains(&path).then_some(path));
        }
        for asked in ["AVX2", "neon", "avx2 "] {
            let error = SimdPath::named(asked).unwrap_err().to_string();
            assert!(
                error.contains("GRANULAR_ID_SIMD") && error.contains("baseline") && error.contains(asked)
            );
        }
    }
}
