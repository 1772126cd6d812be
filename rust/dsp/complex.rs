//! The little complex arithmetic that a filter design needs.
//!
//! Written out here so that every machine rounds alike: no FMA, and square roots and magnitudes from `libm`.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A complex number, `re + j im`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Complex {
    pub re: f64,
    pub im: f64,
}

impl Complex {
    pub const ZERO: Self = Self::real(0.0);
    pub const ONE: Self = Self::real(1.0);

    pub const fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    pub const fn real(re: f64) -> Self {
        Self { re, im: 0.0 }
    }

    pub const fn conj(self) -> Self {
        Self { re: self.re, im: -self.im }
    }

    /// Exactly on the real axis.
    pub fn is_real(self) -> bool {
        self.im == 0.0
    }

    pub const fn is_finite(self) -> bool {
        self.re.is_finite() && self.im.is_finite()
    }

    pub fn abs(self) -> f64 {
        libm::hypot(self.re, self.im)
    }

    pub const fn scale(self, factor: f64) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }

    /// The root with a non-negative real part; each part is computed without cancellation.
    pub fn sqrt(self) -> Self {
        let magnitude = self.abs();
        if magnitude == 0.0 {
            return Self::ZERO;
        }
        if self.re >= 0.0 {
            let re = (0.5 * (magnitude + self.re)).sqrt();
            Self::new(re, 0.5 * (self.im / re))
        } else {
            let im = (0.5 * (magnitude - self.re)).sqrt();
            Self::new((0.5 * (self.im / im)).abs(), im.copysign(self.im))
        }
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.re + other.re, self.im + other.im)
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.re - other.re, self.im - other.im)
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.re, -self.im)
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self::new(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)
    }
}

impl Div for Complex {
    type Output = Self;
    /// Smith's algorithm: the larger part of the divisor is divided out first, so nothing overflows on the way.
    fn div(self, other: Self) -> Self {
        if other.re.abs() >= other.im.abs() {
            let ratio = other.im / other.re;
            let scale = 1.0 / (other.re + other.im * ratio);
            Self::new((self.re + self.im * ratio) * scale, (self.im - self.re * ratio) * scale)
        } else {
            let ratio = other.re / other.im;
            let scale = 1.0 / (other.im + other.re * ratio);
            Self::new((self.re * ratio + self.im) * scale, (self.im * ratio - self.re) * scale)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Complex;

    #[test]
    fn division_undoes_multiplication() {
        let (a, b) = (Complex::new(3.0, -4.0), Complex::new(-0.5, 2.0));
        let back = a * b / b;
        assert!((back - a).abs() < 1e-15 * a.abs());
        assert_eq!(Complex::ONE / Complex::new(0.0, 2.0), Complex::new(0.0, -0.5));
    }

    #[test]
    fn division_survives_huge_parts() {
        let huge = Complex::new(1e300, 1e300);
        assert!(((huge / huge) - Complex::ONE).abs() < 1e-15);
    }

    #[test]
    fn square_root_squares_back_in_every_quadrant() {
        for (re, im) in [(3.0, 4.0), (-3.0, 4.0), (-3.0, -4.0), (3.0, -4.0), (-2.0, 0.0), (0.0, 0.0)] {
            let root = Complex::new(re, im).sqrt();
            assert!((root * root - Complex::new(re, im)).abs() < 1e-14);
            assert!(root.re >= 0.0);
        }
    }

    #[test]
    fn conjugate_input_gives_conjugate_root() {
        let z = Complex::new(-0.3, 0.7);
        assert_eq!(z.conj().sqrt(), z.sqrt().conj());
    }
}
