//! Discrete Fourier transforms of a few signals at once.
//!
//! Crates for this take their sines from the C library or use fused multiply-add where a machine has it, so that their last
//! bits differ between machines. Here every step is a plain operation on [`Pack`]s, and sines are those of `libm`.
//!
//! Lengths with the factors 2, 3 and 5 go through Stockham's algorithm, which needs no reordering; long ones in columns
//! and rows that stay in the first-level cache (both in Van Loan, "Computational frameworks for the fast Fourier
//! transform", 1992). Other lengths go through a convolution of such a length (Bluestein, "A linear filtering approach to
//! the computation of discrete Fourier transform", 1970).

use std::f64::consts::PI;

use super::butterfly::{Butterfly, Complex, Eight, Five, Four, Three, Two};
use super::pack::Pack;

/// One pass of Stockham's algorithm: `blocks` transforms of `radix` values for each of `stride` places.
#[derive(Clone, Debug)]
struct Pass {
    radix: usize,
    blocks: usize,
    stride: usize,
    /// `radix - 1` factors per block.
    factors: Vec<[f64; 2]>,
}

/// The longest transform that is made in one go: two buffers of it fit into the first-level cache.
const LONGEST: usize = 128;

/// A transform of some length, `exp(-2 pi i j k / n)`.
#[derive(Clone, Debug)]
pub(super) struct Fft {
    n: usize,
    smooth: Smooth,
    detour: Option<Detour>,
}

/// A transform of a length with small factors alone.
#[derive(Clone, Debug)]
struct Smooth {
    n: usize,
    /// The values as rows of a grid: first each column is transformed, then each row.
    n_rows: usize,
    columns: Vec<Pass>,
    rows: Vec<Pass>,
    /// Between the two: one factor for each value, column by column.
    factors: Vec<[f64; 2]>,
}

/// A transform as a convolution with a chirp.
#[derive(Clone, Debug)]
struct Detour {
    /// `exp(-pi i j^2 / n)`.
    chirp: Vec<[f64; 2]>,
    /// The transform of the conjugate chirp on both sides of zero, divided by the length.
    response: Vec<[f64; 2]>,
}

/// `exp(-2 pi i numerator / denominator)` for a fraction below one.
fn root(numerator: usize, denominator: usize) -> [f64; 2] {
    // Within half a turn: the smaller the angle, the smaller its error.
    let (numerator, sign) =
        if 2 * numerator > denominator { (denominator - numerator, 1.0) } else { (numerator, -1.0) };
    let angle = 2.0 * PI * (numerator as f64 / denominator as f64);
    [libm::cos(angle), sign * libm::sin(angle)]
}

/// The factors of a length, the one that is most work without a factor of its own last; none for other lengths.
fn radices(n: usize) -> Option<Vec<usize>> {
    let (mut rest, mut radices) = (n, Vec::new());
    for radix in [8, 4, 2, 3, 5] {
        while rest > 1 && rest.is_multiple_of(radix) {
            radices.push(radix);
            rest /= radix;
        }
    }
    (rest == 1).then_some(radices)
}

fn passes(n: usize) -> Vec<Pass> {
    let (mut rest, mut stride) = (n, 1);
    let pass = |radix: usize| {
        let blocks = rest / radix;
        let factors = (0..blocks).flat_map(|p| (1..radix).map(move |k| (p, k)));
        let pass = Pass { radix, blocks, stride, factors: factors.map(|(p, k)| root(p * k, rest)).collect() };
        (rest, stride) = (blocks, stride * radix);
        pass
    };
    radices(n).unwrap_or_default().into_iter().map(pass).collect()
}

impl Fft {
    pub(super) fn new(n: usize) -> Self {
        if radices(n).is_some() {
            return Self { n, smooth: Smooth::new(n), detour: None };
        }
        let smooth = Smooth::new((2 * n - 1).next_power_of_two());
        let detour = Some(Detour::new(n, &smooth));
        Self { n, smooth, detour }
    }

    /// Values that each of the two buffers of [`process`](Self::process) must hold; the signal is the first `n` of them.
    pub(super) fn room(&self) -> usize {
        self.smooth.room()
    }

    /// Transforms the first `n` values of `x`; the result is there too. The contents of `y`, and of the rest of `x`, are lost.
    #[inline(always)]
    pub(super) fn process<const L: usize>(&self, x: &mut [Complex<L>], y: &mut [Complex<L>]) {
        let Some(Detour { chirp, response }) = &self.detour else {
            self.smooth.process(x, y);
            return;
        };
        x[..self.n].iter_mut().zip(chirp).for_each(|(x, turn)| *x = x.turned(*turn));
        x[self.n..].fill(Complex::ZERO);
        // There and back; the way back is the way there between conjugations.
        for back in [false, true] {
            self.smooth.process(x, y);
            let turns = if back { chirp } else { response };
            for (x, turn) in x.iter_mut().zip(turns) {
                *x = if back { x.conjugate().turned(*turn) } else { x.turned(*turn).conjugate() };
            }
        }
    }
}

impl Detour {
    fn new(n: usize, smooth: &Smooth) -> Self {
        // j^2 modulo 2 n keeps the angle small, and exact.
        let chirp: Vec<_> = (0..n as u128).map(|j| root((j * j % (2 * n as u128)) as usize, 2 * n)).collect();
        let mut x = vec![Complex::<1>::ZERO; smooth.room()];
        for (j, [re, im]) in chirp.iter().enumerate() {
            let value = Complex { re: Pack([*re]), im: Pack([-im]) };
            x[j] = value;
            x[(smooth.n - j) % smooth.n] = value;
        }
        let mut y = x.clone();
        smooth.process(&mut x, &mut y);
        let share = 1.0 / smooth.n as f64;
        let response = x[..smooth.n].iter().map(|x| [x.re.0[0] * share, x.im.0[0] * share]).collect();
        Self { chirp, response }
    }
}

impl Smooth {
    fn new(n: usize) -> Self {
        let n_factors = |n: usize| radices(n).map_or(usize::MAX / 2, |radices| radices.len());
        // As square as it gets without splitting a factor.
        let square =
            |rows: &usize| n.is_multiple_of(*rows) && n_factors(*rows) + n_factors(n / rows) == n_factors(n);
        let n_rows = if n <= LONGEST { 1 } else { (1..=n.isqrt()).rev().find(square).unwrap_or(1) };
        let n_columns = n / n_rows;
        let factors = (0..n_columns).flat_map(|j| (0..n_rows).map(move |k| root(j * k, n))).collect();
        Self { n, n_rows, columns: passes(n_rows), rows: passes(n_columns), factors }
    }

    fn room(&self) -> usize {
        if self.n_rows == 1 {
            self.n
        } else {
            self.n + self.n / self.n_rows
        }
    }

    #[inline(always)]
    fn process<const L: usize>(&self, x: &mut [Complex<L>], y: &mut [Complex<L>]) {
        if self.n_rows == 1 {
            let (x, y) = (&mut x[..self.n], &mut y[..self.n]);
            if !straight(&self.rows, x, y) {
                x.copy_from_slice(y);
            }
            return;
        }
        let (n_rows, n_columns) = (self.n_rows, self.n / self.n_rows);
        let (x, a) = x.split_at_mut(self.n);
        let (y, b) = y.split_at_mut(self.n);
        for (j, factors) in self.factors.chunks_exact(n_rows).enumerate() {
            let (a, b) = (&mut a[..n_rows], &mut b[..n_rows]);
            for (value, row) in a.iter_mut().zip(x.chunks_exact(n_columns)) {
                *value = row[j];
            }
            let column = if straight(&self.columns, a, b) { a } else { b };
            for ((value, turn), row) in column.iter().zip(factors).zip(y.chunks_exact_mut(n_columns)) {
                row[j] = value.turned(*turn);
            }
        }
        let b = &mut b[..n_columns];
        for (j, row) in y.chunks_exact_mut(n_columns).enumerate() {
            let row = if straight(&self.rows, row, b) { &*row } else { &*b };
            for (value, target) in row.iter().zip(x.chunks_exact_mut(n_rows)) {
                target[j] = *value;
            }
        }
    }
}

/// All passes, from one buffer to the other and back; true when the result is in `x`.
#[inline(always)]
fn straight<const L: usize>(passes: &[Pass], x: &mut [Complex<L>], y: &mut [Complex<L>]) -> bool {
    for (i, pass) in passes.iter().enumerate() {
        let (from, to) = if i % 2 == 0 { (&*x, &mut *y) } else { (&*y, &mut *x) };
        match pass.radix {
            8 => pass.run::<Eight, L, 8>(from, to),
            4 => pass.run::<Four, L, 4>(from, to),
            2 => pass.run::<Two, L, 2>(from, to),
            3 => pass.run::<Three, L, 3>(from, to),
            _ => pass.run::<Five, L, 5>(from, to),
        }
    }
    passes.len().is_multiple_of(2)
}

impl Pass {
    #[inline(always)]
    fn run<B: Butterfly<R>, const L: usize, const R: usize>(
        &self,
        from: &[Complex<L>],
        to: &mut [Complex<L>],
    ) {
        let stride = self.stride;
        let step = self.blocks * stride;
        // The last pass has nothing left to turn.
        if self.blocks == 1 {
            for place in 0..stride {
                let values = B::of(std::array::from_fn(|j| from[j * stride + place]));
                for k in 0..R {
                    to[k * stride + place] = values[k];
                }
            }
            return;
        }
        let targets = to.chunks_exact_mut(R * stride).zip(self.factors.chunks_exact(R - 1));
        for (block, (target, factors)) in targets.enumerate() {
            for place in 0..stride {
                let values = B::of(std::array::from_fn(|j| from[j * step + block * stride + place]));
                target[place] = values[0];
                for k in 1..R {
                    target[k * stride + place] = values[k].turned(factors[k - 1]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// By definition.
    fn slowly(x: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let n = x.len();
        let sum = |k: usize| {
            x.iter().enumerate().fold([0.0; 2], |[re, im], (j, [a, b])| {
                let [c, s] = root(j * k % n, n);
                [re + a * c - b * s, im + a * s + b * c]
            })
        };
        (0..n).map(sum).collect()
    }

    fn check(x: &[[f64; 2]]) {
        let fft = Fft::new(x.len());
        let mut values = vec![Complex::<2>::ZERO; fft.room()];
        for (value, [re, im]) in values.iter_mut().zip(x) {
            *value = Complex { re: Pack([*re, 0.0]), im: Pack([*im, *re]) };
        }
        fft.process(&mut values, &mut vec![Complex::ZERO; fft.room()]);
        let imaginary: Vec<_> = x.iter().map(|[re, _]| [0.0, *re]).collect();
        let size = x.iter().flatten().fold(1.0, |most, x| x.abs().max(most)) * x.len() as f64;
        for (lane, expected) in [slowly(x), slowly(&imaginary)].into_iter().enumerate() {
            for (got, [re, im]) in values.iter().zip(expected) {
                assert!((got.re.0[lane] - re).abs() <= 1e-15 * size, "{} and {re}", got.re.0[lane]);
                assert!((got.im.0[lane] - im).abs() <= 1e-15 * size, "{} and {im}", got.im.0[lane]);
            }
        }
    }

    #[test]
    fn one_value_is_its_transform() {
        check(&[[3.0, -2.0]]);
    }

    #[test]
    fn a_cosine_has_two_lines() {
        let fft = Fft::new(60);
        let mut x: Vec<_> = (0..60)
            .map(|j| root(7 * j % 60, 60)[0])
            .collect::<Vec<_>>()
            .into_iter()
            .map(|re| Complex { re: Pack([re]), im: Pack([0.0]) })
            .collect();
        fft.process(&mut x, &mut vec![Complex::ZERO; 60]);
        for (k, x) in x.iter().enumerate() {
            let expected = if k == 7 || k == 53 { 30.0 } else { 0.0 };
            assert!((x.re.0[0] - expected).abs() < 1e-13 && x.im.0[0].abs() < 1e-13, "{k}");
        }
    }

    proptest! {
        #[test]
        fn any_length_agrees_with_the_definition(x in prop::collection::vec(prop::array::uniform2(-1e3..1e3), 1..400)) {
            check(&x);
        }
    }
}
