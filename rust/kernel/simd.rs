//! Work that is compiled for several instruction sets, and vectors of eight float32.

use std::ops::{Add, Mul, Sub};

/// Work that is compiled once per path. `run` must be `#[inline(always)]`, so that it takes on the features of
/// the wrapper that calls it.
pub(crate) trait Job {
    /// What the work gives.
    type Output;
    /// Does the work with one instruction set.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// The token of an instruction set: who holds one knows that the machine has the instructions.
///
/// The crate `pulp` has such tokens too. Its vectors are as wide as the machine; here all work is eight lanes wide on every
/// machine, so that sums have one order, and transposes, which it lacks, are a good part of it.
pub(crate) trait Simd: Copy {
    /// Whether the state of four sections and 24 lanes stays in registers.
    const MANY_REGISTERS: bool = false;
    /// Eight float32 as the machine holds them.
    type F32x8: F32x8;

    /// The same number in all lanes.
    fn splat(self, x: f32) -> Self::F32x8;
    /// The first eight of some numbers.
    fn load(self, from: &[f32]) -> Self::F32x8;

    /// The proof of AVX2, for what plain loops do not reach; `None` where work is compiled for less.
    #[inline(always)]
    fn avx2(self) -> Option<Avx2> {
        None
    }
}

/// Eight float32, calculated with as one. Only a token makes them. Every operation rounds each lane by itself, so that all
/// instruction sets give the same bits.
pub(crate) trait F32x8: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Replaces the first eight of some numbers.
    fn store(self, to: &mut [f32]);
    /// Rows and columns exchanged.
    fn transposed(rows: [Self; 8]) -> [Self; 8];
}

/// The proof that this machine has AVX2: only [`detect`](Self::detect) makes one.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(());

impl Avx2 {
    /// The proof, where the machine has the instructions.
    pub(super) fn detect() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Some(Self(()));
        }
        None
    }
}
