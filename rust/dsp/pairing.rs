//! Zeros, poles and a gain as second-order sections.
//!
//! The pairing is the one that `scipy.signal.zpk2sos` calls "nearest": take the pole closest to the unit circle, give it
//! the zero closest to it, and put that section last, so that the sharpest resonance comes when the signal is tamest.

use std::ops::{Add, Div, Mul, Sub};

/// Below this fraction of its magnitude an imaginary part is rounding.
const REAL_TOLERANCE: f64 = 100.0 * f64::EPSILON;

/// Which zeros may be paired with a pole.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Any,
    Real,
    Complex,
}

/// Rows `[b0, b1, b2, a0, a1, a2]`; the gain goes into the first.
///
/// There must be as many zeros as poles, and complex ones must come with their conjugates.
pub(crate) fn to_rows(zeros: &[Complex], poles: &[Complex], gain: f64) -> Vec<[f64; 6]> {
    let n_sections = poles.len().div_ceil(2);
    let (mut zeros, mut poles) = (zeros.to_vec(), poles.to_vec());
    if poles.len() % 2 == 1 {
        // A first-order section is a second-order one with a root at the origin on both sides.
        zeros.push(Complex::ZERO);
        poles.push(Complex::ZERO);
    }
    let (mut zeros, mut poles) = (one_of_each_pair(&zeros), one_of_each_pair(&poles));

    let mut rows = Vec::with_capacity(n_sections);
    while !poles.is_empty() {
        rows.push(next_row(&mut zeros, &mut poles));
    }
    rows.reverse();
    if let Some(first) = rows.first_mut() {
        for b in &mut first[..3] {
            *b *= gain;
        }
    }
    rows
}

/// Takes the worst pole with its partner and the zeros that suit it.
fn next_row(zeros: &mut Vec<Complex>, poles: &mut Vec<Complex>) -> [f64; 6] {
    let p1 = take_worst(poles, Kind::Any);
    let real_poles = count_real(poles);
    if p1.is_real() && real_poles == 0 {
        let z1 = take_nearest(zeros, p1, Kind::Real);
        return row([z1, Complex::ZERO], [p1, Complex::ZERO]);
    }
    if !p1.is_real() && poles.len() + 1 == zeros.len() && real_poles == 1 && count_real(zeros) == 1 {
        // The last real zero belongs to the last real pole.
        let z1 = take_nearest(zeros, p1, Kind::Complex);
        return row([z1, z1.conj()], [p1, p1.conj()]);
    }
    let p2 = if p1.is_real() { take_worst(poles, Kind::Real) } else { p1.conj() };
    let z1 = take_nearest(zeros, p1, Kind::Any);
    let z2 = if z1.is_real() { take_nearest(zeros, p1, Kind::Real) } else { z1.conj() };
    row([z1, z2], [p1, p2])
}

/// Upper halves of the conjugate pairs, ordered by real part and then by imaginary part; after them the real roots.
fn one_of_each_pair(roots: &[Complex]) -> Vec<Complex> {
    let is_real = |z: &Complex| z.im.abs() <= REAL_TOLERANCE * z.abs();
    let mut reals: Vec<_> = roots.iter().filter(|z| is_real(z)).map(|z| Complex::real(z.re)).collect();
    reals.sort_by(|a, b| a.re.total_cmp(&b.re));
    let mut upper: Vec<_> = roots.iter().copied().filter(|z| !is_real(z) && z.im > 0.0).collect();
    upper.sort_by(|a, b| a.re.total_cmp(&b.re).then(a.im.total_cmp(&b.im)));
    // Roots above each other differ in their real parts by rounding only: there the imaginary part decides.
    let mut start = 0;
    for end in 1..=upper.len() {
        let same = |i: usize| upper[i].re - upper[i - 1].re <= REAL_TOLERANCE * upper[i - 1].abs();
        if end == upper.len() || !same(end) {
            upper[start..end].sort_by(|a, b| a.im.total_cmp(&b.im));
            start = end;
        }
    }
    upper.append(&mut reals);
    upper
}

/// Removes the pole closest to the unit circle.
fn take_worst(poles: &mut Vec<Complex>, kind: Kind) -> Complex {
    take_smallest(poles, kind, |p| (1.0 - p.abs()).abs())
}

/// Removes the zero closest to `pole`.
fn take_nearest(zeros: &mut Vec<Complex>, pole: Complex, kind: Kind) -> Complex {
    take_smallest(zeros, kind, |z| (z - pole).abs())
}

/// Removes the first root of a kind with the smallest key; the origin when there is none.
fn take_smallest(roots: &mut Vec<Complex>, kind: Kind, key: impl Fn(Complex) -> f64) -> Complex {
    let suits = |z: Complex| kind == Kind::Any || (kind == Kind::Real) == z.is_real();
    let best = (0..roots.len())
        .filter(|&i| suits(roots[i]))
        .min_by(|&i, &j| key(roots[i]).total_cmp(&key(roots[j])));
    best.map_or(Complex::ZERO, |i| roots.remove(i))
}

fn count_real(roots: &[Complex]) -> usize {
    roots.iter().filter(|z| z.is_real()).count()
}

fn row(zeros: [Complex; 2], poles: [Complex; 2]) -> [f64; 6] {
    let [b1, b2] = monic(zeros);
    let [a1, a2] = monic(poles);
    [1.0, b1, b2, 1.0, a1, a2]
}

/// The last two coefficients of `(z - r0) (z - r1)`.
fn monic([r0, r1]: [Complex; 2]) -> [f64; 2] {
    [-r0.re - r1.re, (r0 * r1).re]
}

/// A complex number, `re + j im`. Written out here so that every machine rounds alike: no FMA, and square roots and
/// magnitudes from `libm`.
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
