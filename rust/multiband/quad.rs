//! Four float32 side by side, which `rustfft` takes for one number: four transforms in the time of little more than one.

use std::ops::{Add, Div, Mul, Neg, Rem, Sub};

use rustfft::num_traits::{FromPrimitive, Num, One, Signed, Zero};

use super::narrow;

/// Lanes of a [`Quad`].
pub(super) const QUAD: usize = 4;

/// Four numbers; every operation is that of each lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub(super) struct Quad(pub(super) [f32; QUAD]);

macro_rules! operators {
    ($($operator:ident $method:ident $sign:tt),*) => {$(
        impl $operator for Quad {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut out = self;
                for l in 0..QUAD {
                    out.0[l] = self.0[l] $sign other.0[l];
                }
                out
            }
        }
    )*};
}

operators!(Add add +, Sub sub -, Mul mul *, Div div /, Rem rem %);

impl Neg for Quad {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Zero for Quad {
    fn zero() -> Self {
        Self::default()
    }

    fn is_zero(&self) -> bool {
        *self == Self::default()
    }
}

impl One for Quad {
    fn one() -> Self {
        Self([1.0; QUAD])
    }
}

impl FromPrimitive for Quad {
    fn from_i64(n: i64) -> Option<Self> {
        f32::from_i64(n).map(|x| Self([x; QUAD]))
    }

    fn from_u64(n: u64) -> Option<Self> {
        f32::from_u64(n).map(|x| Self([x; QUAD]))
    }

    fn from_f64(x: f64) -> Option<Self> {
        Some(Self([narrow(x); QUAD]))
    }
}

// A transform calls none of these: they make a number of a Quad.
impl Num for Quad {
    type FromStrRadixErr = <f32 as Num>::FromStrRadixErr;

    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        f32::from_str_radix(text, radix).map(|x| Self([x; QUAD]))
    }
}

impl Signed for Quad {
    fn abs(&self) -> Self {
        Self(self.0.map(f32::abs))
    }

    fn abs_sub(&self, other: &Self) -> Self {
        (*self - *other).abs()
    }

    fn signum(&self) -> Self {
        Self(self.0.map(f32::signum))
    }

    fn is_positive(&self) -> bool {
        self.0.iter().all(|x| *x > 0.0)
    }

    fn is_negative(&self) -> bool {
        self.0.iter().all(|x| *x < 0.0)
    }
}
