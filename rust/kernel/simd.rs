//! Work that is compiled for several instruction sets, and numbers side by side, calculated with as one: eight float32 as the
//! machine holds them, and plain arrays, which are the registers of the baseline.

use std::ops::{Add, Div, Mul, Neg, Sub};

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

/// Numbers that packs are made of.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    const ZERO: Self;
    const ONE: Self;
}

impl Number for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
}

impl Number for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
}

/// `L` independent numbers: plain arrays that a compiler turns into vectors. Every operation rounds each lane by itself,
/// so that all instruction sets give the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Pack<T, const L: usize>(pub(crate) [T; L]);

impl<T: Number, const L: usize> Pack<T, L> {
    pub(crate) const ZERO: Self = Self([T::ZERO; L]);
    pub(crate) const ONE: Self = Self([T::ONE; L]);

    /// The same number in all lanes.
    #[inline(always)]
    pub(crate) fn splat(x: T) -> Self {
        Self([x; L])
    }

    /// The first `L` of some numbers.
    #[inline(always)]
    pub(crate) fn load(x: &[T]) -> Self {
        let mut out = Self::ZERO;
        out.0.copy_from_slice(&x[..L]);
        out
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        let mut out = self;
        for l in 0..L {
            out.0[l] = f(self.0[l], other.0[l]);
        }
        out
    }
}

impl<T: Number> Pack<T, 8> {
    /// The sum of all lanes, halves first, as vectors do it.
    #[inline(always)]
    pub(crate) fn sum(self) -> T {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

/// Plain loops, compiled for whatever the wrapper allows.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

impl Simd for Portable {
    type F32x8 = Pack<f32, 8>;

    #[inline(always)]
    fn splat(self, x: f32) -> Pack<f32, 8> {
        Pack::splat(x)
    }

    #[inline(always)]
    fn load(self, from: &[f32]) -> Pack<f32, 8> {
        Pack::load(from)
    }
}

impl F32x8 for Pack<f32, 8> {
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn transposed(rows: [Self; 8]) -> [Self; 8] {
        let mut out = rows;
        for (column, out) in out.iter_mut().enumerate() {
            for (row, from) in rows.iter().enumerate() {
                out.0[row] = from.0[column];
            }
        }
        out
    }
}

macro_rules! operator {
    ($operator:ident, $method:ident, $sign:tt) => {
        impl<T: Number, const L: usize> $operator for Pack<T, L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.with(other, |a, b| a $sign b)
            }
        }
    };
}
operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl<T: Number, const L: usize> Neg for Pack<T, L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self, |a, _| -a)
    }
}
