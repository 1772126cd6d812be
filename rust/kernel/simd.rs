//! Vector instructions: which to use, decided once at run time, and what can be done with them.

use std::ops::{Add, Div, Mul, Neg, Sub};
use std::sync::OnceLock;

use super::count::{Cells, LaneBins};
use super::transpose::{Raw, Row, BLOCK};
#[cfg(target_arch = "x86_64")]
use super::x86::X86;
use crate::dsp::Real;
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

/// Work that is compiled once per path. `run` must be `#[inline(always)]`, so that it takes on the features of
/// the wrapper that calls it.
pub(crate) trait Job {
    /// What the work gives.
    type Output;
    /// Does the work with one instruction set.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// The token of an instruction set: who holds one knows that the machine has the instructions. Its methods are what a compiler
/// does not find in a plain loop, with plain loops as the default.
///
/// The crate `pulp` has such tokens too. Its vectors are as wide as the machine; here all work is four or eight lanes wide on
/// every machine, so that sums have one order, and transposes and shuffles, which it lacks, are a good part of it.
pub(crate) trait Simd: Vectors<f64, 4> {
    /// Whether the state of four sections and 24 lanes stays in registers.
    const MANY_REGISTERS: bool = false;

    /// Cells of one row; true when a value is too near to an edge for the quick arithmetic to decide.
    #[inline(always)]
    fn cells<const W: usize>(self, bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
        super::count::cells(bins, row, cells)
    }

    /// Eight samples of six axes: into lanes `lane..lane + 6` of `rows`, and axis by axis into `raw`. True when the type there
    /// reaches far enough.
    #[inline(always)]
    fn transpose6<const W: usize, T: Real>(
        self,
        samples: &[f64; 6 * BLOCK],
        rows: &mut [Row<W>; BLOCK],
        lane: usize,
        raw: Option<Raw<'_, T>>,
    ) -> bool {
        super::transpose::transpose6(samples, rows, lane, raw)
    }

    /// Asks for the cache line at `values[index]`, to be read soon. Any index is fine.
    #[inline(always)]
    fn will_read(self, _values: &[f64], _index: usize) {}

    /// Makes writes past the caches visible to other threads.
    #[inline(always)]
    fn finish_writes(self) {}
}

/// An instruction set that calculates with `L` numbers at a time. Another kind of numbers is another implementation beside it.
pub(crate) trait Vectors<T, const L: usize>: Copy {
    type Register: Register<T, L>;
    /// The same number in all lanes.
    fn splat(self, x: T) -> Self::Register;
    /// The first `L` of some numbers.
    fn load(self, from: &[T]) -> Self::Register;
}

/// `L` numbers as the machine holds them, calculated with as one. Only a token makes one. A compiler makes vectors of plain
/// arrays as long as little else goes on; of a whole Fourier transform it makes halves and single numbers. Every operation
/// rounds each lane by itself, so that all instruction sets give the same bits.
pub(crate) trait Register<T, const L: usize>:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<T, Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Replaces the first `L` of some numbers.
    fn store(self, to: &mut [T]);
    fn sqrt(self) -> Self;
    /// An answer for each lane, all bits set or none: is this above another?
    fn above(self, other: Self) -> Self;
    /// `yes` where the answer is yes, `no` where it is no.
    fn select(self, yes: Self, no: Self) -> Self;
    /// The last lane first.
    fn reversed(self) -> Self;
    /// Rows and columns exchanged.
    fn transposed(rows: [Self; L]) -> [Self; L];
}

/// Plain loops, compiled for whatever the wrapper allows.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

impl Simd for Portable {}

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
