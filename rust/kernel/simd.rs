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
    /// [`Error::Argument`]: the variable names none, or one that this machine lacks.
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
        found.copied().ok_or_else(|| {
            let names: Vec<_> = available.iter().map(|path| path.name()).collect();
            let wanted =
                format_args!("be one of the vector units of this machine ({}), or not set", names.join(", "));
            Error::argument("GRANULAR_ID_SIMD", wanted, format_args!("{asked:?}"))
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
pub(crate) trait Simd: Vectors<f64, 4> + Vectors<f32, 8> {
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

/// An instruction set that calculates with `L` numbers at a time: four float64, or eight float32.
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
    use std::panic::{catch_unwind, AssertUnwindSafe};

    use proptest::prelude::*;

    use super::*;

    /// Calculates with vectors of both kinds as with plain numbers.
    struct Compare {
        wide: [f64; 16],
        narrow: [f32; 16],
    }

    impl Compare {
        fn on_every_path(wide: [f64; 16], narrow: [f32; 16]) {
            for path in SimdPath::available() {
                path.run(Self { wide, narrow });
            }
        }
    }

    impl Job for Compare {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) {
            compare::<f64, 4>(simd, self.wide);
            compare::<f32, 8>(simd, self.narrow);
        }
    }

    /// All pairs of some numbers.
    #[inline(always)]
    fn compare<T: Real, const L: usize>(simd: impl Vectors<T, L>, numbers: [T; 16]) {
        for shift in 0..16 {
            let mut others = numbers;
            others.rotate_left(shift);
            for (a, b) in numbers.chunks_exact(L).zip(others.chunks_exact(L)) {
                let (x, y) = (simd.load(a), simd.load(b));
                calculated(x + y, |l| a[l] + b[l]);
                calculated(x - y, |l| a[l] - b[l]);
                calculated(x * y, |l| a[l] * b[l]);
                calculated(x * b[0], |l| a[l] * b[0]);
                calculated(x / y, |l| a[l] / b[l]);
                moved(-x, |l| -a[l]);
                moved(simd.splat(a[1]), |_| a[1]);
                moved(x.above(y), |l| if a[l] > b[l] { T::YES } else { T::ZERO });
                moved(x.above(y).select(x, y), |l| if a[l] > b[l] { a[l] } else { b[l] });
                moved(x.reversed(), |l| a[L - 1 - l]);
            }
        }
        let entry = |row: usize, column: usize| T::of((row * L + column) as f64);
        let rows = std::array::from_fn(|row| {
            let values: [T; L] = std::array::from_fn(|column| entry(row, column));
            simd.load(&values)
        });
        for (column, row) in Register::transposed(rows).into_iter().enumerate() {
            moved(row, |l| entry(l, column));
        }
    }

    /// The same bits.
    fn moved<T: Real, const L: usize>(got: impl Register<T, L>, expected: impl Fn(usize) -> T) {
        let mut values = [T::ONE; 16];
        got.store(&mut values);
        for (l, value) in values.into_iter().enumerate() {
            let expected = if l < L { expected(l) } else { T::ONE };
            assert_eq!(value.bits(), expected.bits(), "lane {l} of {L}: {}", value.value());
        }
    }

    /// The same bits, but of NaN, which no language promises.
    fn calculated<T: Real, const L: usize>(got: impl Register<T, L>, expected: impl Fn(usize) -> T) {
        let mut values = [T::ZERO; L];
        got.store(&mut values);
        moved(got, |l| {
            let expected = expected(l);
            let both = expected.value().is_nan() && values[l].value().is_nan();
            if both {
                values[l]
            } else {
                expected
            }
        });
    }

    #[test]
    fn edges_of_numbers_have_the_bits_of_plain_arithmetic() {
        macro_rules! edges {
            ($number:ident, $signalling:literal) => {
                [
                    $number::INFINITY,
                    $number::NEG_INFINITY,
                    $number::NAN,
                    -$number::from_bits($signalling),
                    0.0,
                    -0.0,
                    $number::from_bits(1),
                    -$number::from_bits(3),
                    $number::MIN_POSITIVE,
                    -$number::MIN_POSITIVE / 2.0,
                    $number::MAX,
                    $number::MIN,
                    1.0 + $number::EPSILON,
                    -1.0,
                    0.1,
                    -3.0,
                ]
            };
        }
        Compare::on_every_path(edges!(f64, 0x7ff4_0000_0000_0001), edges!(f32, 0x7fa0_0001));
    }

    proptest! {
        #[test]
        fn any_numbers_have_the_bits_of_plain_arithmetic(wide in any::<[u64; 16]>(), narrow in any::<[u32; 16]>()) {
            Compare::on_every_path(wide.map(f64::from_bits), narrow.map(f32::from_bits));
        }
    }

    #[test]
    fn short_slices_are_refused() {
        struct Short;
        impl Job for Short {
            type Output = [bool; 4];
            #[inline(always)]
            fn run<S: Simd>(self, simd: S) -> [bool; 4] {
                fn refused<T: Real, const L: usize>(simd: impl Vectors<T, L>) -> [bool; 2] {
                    let load = move || simd.load(&[T::ZERO; 16][..L - 1]).store(&mut [T::ZERO; L]);
                    let store = move || simd.splat(T::ZERO).store(&mut [T::ZERO; 16][..L - 1]);
                    [
                        catch_unwind(AssertUnwindSafe(load)).is_err(),
                        catch_unwind(AssertUnwindSafe(store)).is_err(),
                    ]
                }
                let ([a, b], [c, d]) = (refused::<f64, 4>(simd), refused::<f32, 8>(simd));
                [a, b, c, d]
            }
        }
        for path in SimdPath::available() {
            assert_eq!(path.run(Short), [true; 4], "{}", path.name());
        }
    }

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
