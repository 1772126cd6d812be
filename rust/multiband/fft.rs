//! Discrete Fourier transforms of a few signals at once.
//!
//! Crates for this take their sines from the C library or use fused multiply-add where a machine has it, so that their last
//! bits differ between machines. Here every step is a plain operation on [`Pack`]s, and sines are those of `libm`.
//!
//! Lengths with the factors 2, 3, 4 and 5 go through Stockham's algorithm, which needs no reordering (Van Loan,
//! "Computational frameworks for the fast Fourier transform", 1992); others through a convolution of such a length
//! (Bluestein, "A linear filtering approach to the computation of discrete Fourier transform", 1970).

use std::f64::consts::PI;

use super::pack::Pack;

/// Complex numbers side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Complex<const L: usize> {
    pub(super) re: Pack<L>,
    pub(super) im: Pack<L>,
}

impl<const L: usize> Complex<L> {
    pub(super) const ZERO: Self = Self { re: Pack::ZERO, im: Pack::ZERO };

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self { re: self.re - other.re, im: self.im - other.im }
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        Self { re: self.re * Pack::splat(factor), im: self.im * Pack::splat(factor) }
    }

    #[inline(always)]
    fn times_minus_i(self) -> Self {
        Self { re: self.im, im: -self.re }
    }

    /// Times one complex number, the same in all lanes.
    #[inline(always)]
    fn turned(self, [re, im]: [f64; 2]) -> Self {
        let (c, s) = (Pack::splat(re), Pack::splat(im));
        Self { re: self.re * c - self.im * s, im: self.re * s + self.im * c }
    }

    #[inline(always)]
    fn conjugate(self) -> Self {
        Self { re: self.re, im: -self.im }
    }
}

/// One pass of Stockham's algorithm: `blocks` transforms of `radix` values for each of `stride` places.
#[derive(Clone, Debug)]
struct Pass {
    radix: usize,
    blocks: usize,
    stride: usize,
    /// `radix - 1` factors per block.
    factors: Vec<[f64; 2]>,
}

/// A transform of some length, `exp(-2 pi i j k / n)`.
#[derive(Clone, Debug)]
pub(super) struct Fft {
    n: usize,
    passes: Vec<Pass>,
    detour: Option<Box<Detour>>,
}

/// A transform as a convolution with a chirp.
#[derive(Clone, Debug)]
struct Detour {
    fft: Fft,
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

impl Fft {
    pub(super) fn new(n: usize) -> Self {
        let mut passes = Vec::new();
        let (mut rest, mut stride) = (n, 1);
        for radix in [4, 2, 3, 5] {
            while rest > 1 && rest % radix == 0 {
                let blocks = rest / radix;
                let factors = (0..blocks).flat_map(|p| (1..radix).map(move |k| (p, k)));
                let factors = factors.map(|(p, k)| root(p * k, rest)).collect();
                passes.push(Pass { radix, blocks, stride, factors });
                (rest, stride) = (blocks, stride * radix);
            }
        }
        let detour = (rest > 1).then(|| Box::new(Detour::new(n)));
        Self { n, passes, detour }
    }

    /// Values that each of the two buffers of [`process`](Self::process) must hold; the signal is the first `n` of them.
    pub(super) fn room(&self) -> usize {
        self.detour.as_ref().map_or(self.n, |detour| detour.fft.n)
    }

    /// Transforms the first `n` values of `x`; the result is there too. The contents of `y`, and of the rest of `x`, are lost.
    #[inline(always)]
    pub(super) fn process<const L: usize>(&self, x: &mut [Complex<L>], y: &mut [Complex<L>]) {
        match &self.detour {
            None => self.stockham(x, y),
            Some(detour) => detour.process(&mut x[..detour.fft.n], &mut y[..detour.fft.n]),
        }
    }

    #[inline(always)]
    fn stockham<const L: usize>(&self, x: &mut [Complex<L>], y: &mut [Complex<L>]) {
        let (mut from, mut to) = (&mut x[..self.n], &mut y[..self.n]);
        for pass in &self.passes {
            match pass.radix {
                4 => pass.run(from, to, four),
                2 => pass.run(from, to, two),
                3 => pass.run(from, to, three),
                _ => pass.run(from, to, five),
            }
            (from, to) = (to, from);
        }
        if self.passes.len() % 2 == 1 {
            to.copy_from_slice(from);
        }
    }
}

impl Pass {
    #[inline(always)]
    fn run<const L: usize, const R: usize>(
        &self,
        from: &[Complex<L>],
        to: &mut [Complex<L>],
        butterfly: impl Fn([Complex<L>; R]) -> [Complex<L>; R],
    ) {
        let Self { blocks, stride, .. } = *self;
        let step = blocks * stride;
        let targets = to.chunks_exact_mut(R * stride).zip(self.factors.chunks_exact(R - 1));
        for (block, (target, factors)) in targets.enumerate() {
            for place in 0..stride {
                let mut values = [Complex::ZERO; R];
                for (j, value) in values.iter_mut().enumerate() {
                    *value = from[j * step + block * stride + place];
                }
                let values = butterfly(values);
                target[place] = values[0];
                for k in 1..R {
                    target[k * stride + place] = values[k].turned(factors[k - 1]);
                }
            }
        }
    }
}

impl Detour {
    fn new(n: usize) -> Self {
        let room = (2 * n - 1).next_power_of_two();
        let fft = Fft::new(room);
        // j^2 modulo 2 n keeps the angle small, and exact.
        let chirp: Vec<_> = (0..n as u128).map(|j| root((j * j % (2 * n as u128)) as usize, 2 * n)).collect();
        let mut x = vec![Complex::<1>::ZERO; room];
        for (j, [re, im]) in chirp.iter().enumerate() {
            let value = Complex { re: Pack([*re]), im: Pack([-im]) };
            x[j] = value;
            x[(room - j) % room] = value;
        }
        fft.process(&mut x, &mut vec![Complex::ZERO; room]);
        let share = 1.0 / room as f64;
        let response = x.iter().map(|x| [x.re.0[0] * share, x.im.0[0] * share]).collect();
        Self { fft, chirp, response }
    }

    #[inline(always)]
    fn process<const L: usize>(&self, x: &mut [Complex<L>], y: &mut [Complex<L>]) {
        let n = self.chirp.len();
        x[..n].iter_mut().zip(&self.chirp).for_each(|(x, turn)| *x = x.turned(*turn));
        x[n..].fill(Complex::ZERO);
        self.fft.stockham(x, y);
        // The way back is the way there between conjugations.
        x.iter_mut().zip(&self.response).for_each(|(x, turn)| *x = x.turned(*turn).conjugate());
        self.fft.stockham(x, y);
        x.iter_mut().zip(&self.chirp).for_each(|(x, turn)| *x = x.conjugate().turned(*turn));
    }
}

#[inline(always)]
fn two<const L: usize>([a, b]: [Complex<L>; 2]) -> [Complex<L>; 2] {
    [a.plus(b), a.minus(b)]
}

#[inline(always)]
fn three<const L: usize>([a, b, c]: [Complex<L>; 3]) -> [Complex<L>; 3] {
    const SIN: f64 = 0.866_025_403_784_438_6;
    let (sum, difference) = (b.plus(c), b.minus(c).times_minus_i().times(SIN));
    let middle = a.minus(sum.times(0.5));
    [a.plus(sum), middle.plus(difference), middle.minus(difference)]
}

#[inline(always)]
fn four<const L: usize>([a, b, c, d]: [Complex<L>; 4]) -> [Complex<L>; 4] {
    let (even, odd) = (a.plus(c), a.minus(c));
    let (sum, difference) = (b.plus(d), b.minus(d).times_minus_i());
    [even.plus(sum), odd.plus(difference), even.minus(sum), odd.minus(difference)]
}

#[inline(always)]
fn five<const L: usize>([a, b, c, d, e]: [Complex<L>; 5]) -> [Complex<L>; 5] {
    const COS: [f64; 2] = [0.309_016_994_374_947_45, -0.809_016_994_374_947_5];
    const SIN: [f64; 2] = [0.951_056_516_295_153_5, 0.587_785_252_292_473_1];
    let (outer, inner) = (b.plus(e), c.plus(d));
    let (outer_turn, inner_turn) = (b.minus(e).times_minus_i(), c.minus(d).times_minus_i());
    let first = a.plus(outer.times(COS[0])).plus(inner.times(COS[1]));
    let second = a.plus(outer.times(COS[1])).plus(inner.times(COS[0]));
    let first_turn = outer_turn.times(SIN[0]).plus(inner_turn.times(SIN[1]));
    let second_turn = outer_turn.times(SIN[1]).minus(inner_turn.times(SIN[0]));
    [
        a.plus(outer).plus(inner),
        first.plus(first_turn),
        second.plus(second_turn),
        second.minus(second_turn),
        first.minus(first_turn),
    ]
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
        fn any_length_agrees_with_the_definition(x in prop::collection::vec(prop::array::uniform2(-1e3..1e3), 1..260)) {
            check(&x);
        }
    }
}
