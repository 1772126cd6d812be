//! Discrete Fourier transforms.
//!
//! Crates for this take their sines from the C library or use fused multiply-add where a machine has it, so that their last
//! bits differ between machines. Here every step is a plain operation on packs of numbers, and sines are those of `libm`.
//!
//! Eight neighbours of a signal fill a vector: its lanes are transforms of every eighth value, which go through Stockham's
//! algorithm, pass after pass from one buffer to the other, which needs no reordering (Van Loan, "Computational frameworks for
//! the fast Fourier transform", 1992). A last pass turns them round and joins them. Lengths with other factors than 2, 3 and 5
//! go through a convolution of a length without (Bluestein, "A linear filtering approach to the computation of discrete
//! Fourier transform", 1970).

use std::f64::consts::PI;

use super::LANES;
use crate::dsp::Real;
use crate::kernel::{Portable, Register, Vectors};

/// As many values as there are transforms side by side.
type Row = [f32; LANES];

/// Rows of real parts, of imaginary parts, and of a window.
type Source<'a> = [&'a [Row]; 3];

/// Calls a method for a radix.
macro_rules! by_radix {
    ($on:expr, $method:ident, $($argument:expr),*) => {
        match $on.radix {
            8 => $on.$method::<Eight, 8>($($argument),*),
            5 => $on.$method::<Five, 5>($($argument),*),
            4 => $on.$method::<Four, 4>($($argument),*),
            3 => $on.$method::<Three, 3>($($argument),*),
            _ => $on.$method::<Two, 2>($($argument),*),
        }
    };
}

/// A transform of some length, `exp(-2 pi i j k / n)`.
#[derive(Clone, Debug)]
pub(super) struct Fft {
    n: usize,
    grid: Grid,
    detour: Option<Detour>,
}

/// A transform as a convolution with a chirp.
#[derive(Clone, Debug)]
struct Detour {
    /// `exp(-pi i j^2 / n)`.
    chirp: ComplexValues,
    /// The transform of the conjugate chirp on both sides of zero, divided by the length.
    response: ComplexValues,
    /// No window.
    ones: Vec<Row>,
}

impl Fft {
    pub(super) fn new(n: usize) -> Self {
        if let Some(radices) = radices(n) {
            return Self { n, grid: Grid::new(n, &radices), detour: None };
        }
        let wide = (2 * n - 1).next_power_of_two().max(2 * LANES);
        let grid = Grid::new(wide, &radices(wide).unwrap_or_default());
        let detour = Some(Detour::new(n, &grid));
        Self { n, grid, detour }
    }

    /// Memory for a transform, and for all that [`process`](Self::process) does with it.
    pub(super) fn work(&self) -> FftWork {
        self.grid.work(self.n, self.detour.is_some())
    }

    /// Transforms a complex signal, its real and its imaginary part, behind a window, with zeros after it. What lies behind the
    /// first `n` values of the result is anything.
    #[inline(always)]
    pub(super) fn process<S: Vectors<f32, LANES>>(&self, simd: S, signal: [&[f32]; 3], work: &mut FftWork) {
        let FftWork { transform, detour, buffers, copies } = work;
        let (mut source, radix) = ([&[][..]; 3], self.grid.radix);
        for ((rows, signal), copy) in source.iter_mut().zip(signal).zip(copies) {
            let (whole, rest) = signal.as_chunks();
            *rows = whole;
            if signal.len() != self.n || !rest.is_empty() || radix != LANES {
                copy.fill([0.0; LANES]);
                for (row, values) in copy.iter_mut().zip(signal.chunks(radix)) {
                    row[..values.len()].copy_from_slice(values);
                }
                *rows = copy;
            }
        }
        if let Some(Detour { chirp, .. }) = &self.detour {
            let [re, im, window] = source.map(<[Row]>::as_flattened);
            for first in (0..self.n).step_by(LANES) {
                let window = simd.load(&window[first..]);
                let (re, im) = (simd.load(&re[first..]) * window, simd.load(&im[first..]) * window);
                detour.store(first, ComplexPack { re, im }.each_times(chirp.load(simd, first)));
            }
            detour.re[self.n..].fill(0.0);
            detour.im[self.n..].fill(0.0);
        }
        // One call for there and back: a compiler takes long for each copy of all radices.
        for back in [false, true] {
            let source = self.detour.as_ref().map_or(source, |way| detour.behind(&way.ones));
            self.grid.process(simd, source, buffers, transform);
            let Some(Detour { chirp, response, .. }) = &self.detour else { return };
            if back {
                for first in (0..self.n).step_by(LANES) {
                    let x = transform.load(simd, first).conjugate();
                    transform.store(first, x.each_times(chirp.load(simd, first)));
                }
            } else {
                // The way back is the way there between conjugations.
                for first in (0..self.grid.n).step_by(LANES) {
                    let x = transform.load(simd, first).each_times(response.load(simd, first));
                    detour.store(first, x.conjugate());
                }
            }
        }
    }
}

impl Detour {
    fn new(n: usize, grid: &Grid) -> Self {
        let mut chirp = ComplexValues::new(n);
        let mut work = grid.work(n, true);
        let x = &mut work.detour;
        for j in 0..n {
            // j^2 modulo 2 n keeps the angle small, and exact.
            let [re, im] = root((j as u128 * j as u128 % (2 * n as u128)) as usize, 2 * n);
            (chirp.re[j], chirp.im[j]) = (re, im);
            for at in [j, (grid.n - j) % grid.n] {
                (x.re[at], x.im[at]) = (re, -im);
            }
        }
        let ones = vec![[1.0; LANES]; grid.n / LANES];
        grid.process(Portable, work.detour.behind(&ones), &mut work.buffers, &mut work.transform);
        let mut response = work.transform;
        let share = f32::of(1.0 / grid.n as f64);
        response.re.iter_mut().chain(&mut response.im).for_each(|x| *x *= share);
        Self { chirp, response, ones }
    }
}

/// Values of a signal one after the other, real parts apart from imaginary ones, with room behind them for a vector.
#[derive(Clone, Debug)]
pub(super) struct ComplexValues {
    pub(super) re: Vec<f32>,
    pub(super) im: Vec<f32>,
}

impl ComplexValues {
    /// `n` zeros.
    fn new(n: usize) -> Self {
        Self { re: vec![0.0; n + LANES], im: vec![0.0; n + LANES] }
    }

    /// Replaces values from `index` on.
    #[inline(always)]
    fn store<V: Register<f32, LANES>>(&mut self, index: usize, values: ComplexPack<V>) {
        values.re.store(&mut self.re[index..]);
        values.im.store(&mut self.im[index..]);
    }

    /// Values from `index` on.
    #[inline(always)]
    fn load<S: Vectors<f32, LANES>>(&self, simd: S, index: usize) -> ComplexPack<S::Register> {
        ComplexPack { re: simd.load(&self.re[index..]), im: simd.load(&self.im[index..]) }
    }

    /// Of whole rows.
    #[inline(always)]
    fn behind<'a>(&'a self, window: &'a [Row]) -> Source<'a> {
        [self.re.as_chunks().0, self.im.as_chunks().0, window]
    }
}

/// Memory for a transform.
#[derive(Clone, Debug)]
pub(super) struct FftWork {
    /// The result.
    pub(super) transform: ComplexValues,
    /// What is transformed on a detour.
    detour: ComplexValues,
    /// Two buffers for transforms side by side.
    buffers: [Vec<Cell>; 2],
    /// Rows of what does not lie in whole ones.
    copies: [Vec<Row>; 3],
}

/// A transform of a length with small factors alone: `radix` transforms side by side, and a pass that joins them.
#[derive(Clone, Debug)]
struct Grid {
    n: usize,
    radix: usize,
    passes: Vec<Pass>,
    /// Of the pass that joins: `radix - 1` for eight frequencies, then for the next ones.
    factors: Vec<Cell>,
}

impl Grid {
    /// For a length that has [`radices`].
    fn new(n: usize, radices: &[usize]) -> Self {
        let (radix, others) = radices.split_last().map_or((1, radices), |(radix, others)| (*radix, others));
        let factors = |first: usize| {
            (1..radix).map(move |j| {
                let mut factors = Cell::ZERO;
                for l in 0..LANES {
                    [factors.re[l], factors.im[l]] = root(j * (first + l) % n, n);
                }
                factors
            })
        };
        let factors = (0..n / radix).step_by(LANES).flat_map(factors).collect();
        Self { n, radix, passes: passes(n / radix, others), factors }
    }

    fn work(&self, n: usize, with_detour: bool) -> FftWork {
        let buffer = vec![Cell::ZERO; (self.n / self.radix).next_multiple_of(LANES)];
        FftWork {
            transform: ComplexValues::new(self.radix * buffer.len()),
            detour: ComplexValues::new(if with_detour { self.n } else { 0 }),
            buffers: [buffer.clone(), buffer],
            copies: std::array::from_fn(|_| vec![[0.0; LANES]; n.div_ceil(self.radix)]),
        }
    }

    /// Transforms a source, `exp(-2 pi i j k / n)`.
    #[inline(always)]
    fn process<S: Vectors<f32, LANES>>(
        &self,
        simd: S,
        source: Source<'_>,
        [from, to]: &mut [Vec<Cell>; 2],
        out: &mut ComplexValues,
    ) {
        let (mut from, mut to) = (&mut from[..], &mut to[..]);
        for (i, pass) in self.passes.iter().enumerate() {
            if i == 0 {
                by_radix!(pass, begin, simd, source, to);
            } else {
                by_radix!(pass, run, simd, from, to);
            }
            (from, to) = (to, from);
        }
        by_radix!(self, join, simd, from, out);
    }

    /// Joins transforms that lie side by side.
    #[inline(always)]
    fn join<B: Butterfly<R>, const R: usize>(
        &self,
        simd: impl Vectors<f32, LANES>,
        cells: &[Cell],
        out: &mut ComplexValues,
    ) {
        let cells = cells.as_chunks::<LANES>().0;
        let out_re = split_mut::<_, R>(out.re.as_chunks_mut::<LANES>().0, cells.len());
        let out_im = split_mut::<_, R>(out.im.as_chunks_mut::<LANES>().0, cells.len());
        for (i, (cells, factors)) in cells.iter().zip(self.factors.chunks_exact(R - 1)).enumerate() {
            let (mut re, mut im) = ([simd.splat(0.0); LANES], [simd.splat(0.0); LANES]);
            for l in 0..LANES {
                (re[l], im[l]) = (simd.load(&cells[l].re), simd.load(&cells[l].im));
            }
            let (re, im) = (Register::transposed(re), Register::transposed(im));
            let mut values = [ComplexPack { re: re[0], im: im[0] }; R];
            for j in 1..R {
                values[j] = ComplexPack { re: re[j], im: im[j] }.each_times(factors[j - 1].load(simd));
            }
            let values = B::of(values);
            for k in 0..R {
                values[k].re.store(&mut out_re[k][i]);
                values[k].im.store(&mut out_im[k][i]);
            }
        }
        // Whole vectors may be more than there is.
        let (there, whole) = (self.n / R, cells.len() * LANES);
        if there != whole {
            for k in 1..R {
                out.re.copy_within(k * whole..k * whole + there, k * there);
                out.im.copy_within(k * whole..k * whole + there, k * there);
            }
        }
    }
}

/// `R` pieces of some values, with lengths that a compiler knows to be the same; `apart` from one to the next.
#[inline(always)]
fn split<T, const R: usize>(values: &[T], len: usize, apart: usize) -> [&[T]; R] {
    let mut pieces = [&values[..len]; R];
    for k in 1..R {
        pieces[k] = &values[k * apart..][..len];
    }
    pieces
}

#[inline(always)]
fn split_mut<T, const R: usize>(values: &mut [T], len: usize) -> [&mut [T]; R] {
    let mut rest = values;
    std::array::from_fn(|_| {
        let (piece, after) = std::mem::take(&mut rest).split_at_mut(len);
        rest = after;
        piece
    })
}

/// One pass: `blocks` transforms of `radix` values for each of `stride` places.
#[derive(Clone, Debug)]
struct Pass {
    radix: usize,
    blocks: usize,
    stride: usize,
    /// `radix - 1` factors per block.
    factors: Vec<[f32; 2]>,
}

/// `exp(-2 pi i numerator / denominator)` for a fraction below one.
fn root(numerator: usize, denominator: usize) -> [f32; 2] {
    // Within half a turn: the smaller the angle, the smaller its error.
    let (numerator, sign) =
        if 2 * numerator > denominator { (denominator - numerator, 1.0) } else { (numerator, -1.0) };
    let angle = 2.0 * PI * (numerator as f64 / denominator as f64);
    [libm::cos(angle), sign * libm::sin(angle)].map(f32::of)
}

/// The factors of a length, the largest last; none for other lengths, and where there are less than two.
fn radices(n: usize) -> Option<Vec<usize>> {
    let (mut rest, mut radices) = (n, Vec::new());
    for radix in [8, 5, 4, 3, 2] {
        while rest > 1 && rest.is_multiple_of(radix) {
            radices.push(radix);
            rest /= radix;
        }
    }
    radices.reverse();
    (rest == 1 && radices.len() > 1).then_some(radices)
}

/// All passes of a transform of some length.
fn passes(n: usize, radices: &[usize]) -> Vec<Pass> {
    let (mut rest, mut stride) = (n, 1);
    let pass = |radix: &usize| {
        let (radix, blocks) = (*radix, rest / radix);
        let factors = (0..blocks).flat_map(|p| (1..radix).map(move |k| (p, k)));
        let pass = Pass { radix, blocks, stride, factors: factors.map(|(p, k)| root(p * k, rest)).collect() };
        (rest, stride) = (blocks, stride * radix);
        pass
    };
    radices.iter().map(pass).collect()
}

impl Pass {
    /// The first pass.
    #[inline(always)]
    fn begin<B: Butterfly<R>, const R: usize>(
        &self,
        simd: impl Vectors<f32, LANES>,
        [re, im, window]: Source<'_>,
        to: &mut [Cell],
    ) {
        let [re, im, window] = [re, im, window].map(|rows| split::<_, R>(rows, self.blocks, self.blocks));
        let targets = to.as_chunks_mut::<R>().0.iter_mut().zip(self.factors.chunks_exact(R - 1));
        for (block, (target, factors)) in (0..self.blocks).zip(targets) {
            let mut values = [ComplexPack { re: simd.splat(0.0), im: simd.splat(0.0) }; R];
            for k in 0..R {
                let window = simd.load(&window[k][block]);
                let (re, im) = (simd.load(&re[k][block]), simd.load(&im[k][block]));
                values[k] = ComplexPack { re: re * window, im: im * window };
            }
            let values = B::of(values);
            target[0].store(values[0]);
            for k in 1..R {
                target[k].store(values[k].turned(factors[k - 1][0], factors[k - 1][1]));
            }
        }
    }

    /// Another pass.
    #[inline(always)]
    fn run<B: Butterfly<R>, const R: usize>(
        &self,
        simd: impl Vectors<f32, LANES>,
        from: &[Cell],
        to: &mut [Cell],
    ) {
        let (blocks, stride) = (self.blocks, self.stride);
        let targets = to.chunks_exact_mut(R * stride).zip(self.factors.chunks_exact(R - 1));
        for (block, (target, factors)) in (0..blocks).zip(targets) {
            let rows = split::<_, R>(&from[block * stride..], stride, blocks * stride);
            let target = split_mut::<_, R>(target, stride);
            for place in 0..stride {
                let mut values = [rows[0][place].load(simd); R];
                for k in 1..R {
                    values[k] = rows[k][place].load(simd);
                }
                let values = B::of(values);
                target[0][place].store(values[0]);
                // The last pass has nothing left to turn.
                if blocks == 1 {
                    for k in 1..R {
                        target[k][place].store(values[k]);
                    }
                } else {
                    for k in 1..R {
                        target[k][place].store(values[k].turned(factors[k - 1][0], factors[k - 1][1]));
                    }
                }
            }
        }
    }
}

/// Complex numbers side by side.
#[derive(Clone, Copy)]
pub(super) struct ComplexPack<V> {
    pub(super) re: V,
    pub(super) im: V,
}

/// Eight complex numbers in memory.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Cell {
    re: [f32; LANES],
    im: [f32; LANES],
}

impl Cell {
    const ZERO: Self = Self { re: [0.0; LANES], im: [0.0; LANES] };

    #[inline(always)]
    fn load<S: Vectors<f32, LANES>>(&self, simd: S) -> ComplexPack<S::Register> {
        ComplexPack { re: simd.load(&self.re), im: simd.load(&self.im) }
    }

    #[inline(always)]
    fn store<V: Register<f32, LANES>>(&mut self, value: ComplexPack<V>) {
        value.re.store(&mut self.re);
        value.im.store(&mut self.im);
    }
}

impl<V: Register<f32, LANES>> ComplexPack<V> {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self { re: self.re - other.re, im: self.im - other.im }
    }

    #[inline(always)]
    fn times(self, factor: f32) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }

    /// Times `exp(-pi i / 4)`.
    #[inline(always)]
    fn turned_an_eighth(self) -> Self {
        Self { re: self.re + self.im, im: self.im - self.re }.times(std::f32::consts::FRAC_1_SQRT_2)
    }

    #[inline(always)]
    fn times_minus_i(self) -> Self {
        Self { re: self.im, im: -self.re }
    }

    /// Each times one of others.
    #[inline(always)]
    fn each_times(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }

    /// Times one complex number, the same in all lanes.
    #[inline(always)]
    fn turned(self, re: f32, im: f32) -> Self {
        Self { re: self.re * re - self.im * im, im: self.re * im + self.im * re }
    }

    #[inline(always)]
    fn conjugate(self) -> Self {
        Self { re: self.re, im: -self.im }
    }
}

/// A transform of so few values that it is written out.
trait Butterfly<const R: usize> {
    fn of<V: Register<f32, LANES>>(values: [ComplexPack<V>; R]) -> [ComplexPack<V>; R];
}

struct Two;
struct Three;
struct Four;
struct Five;
struct Eight;

impl Butterfly<2> for Two {
    #[inline(always)]
    fn of<V: Register<f32, LANES>>([a, b]: [ComplexPack<V>; 2]) -> [ComplexPack<V>; 2] {
        [a.plus(b), a.minus(b)]
    }
}

impl Butterfly<3> for Three {
    #[inline(always)]
    fn of<V: Register<f32, LANES>>([a, b, c]: [ComplexPack<V>; 3]) -> [ComplexPack<V>; 3] {
        const SIN: f32 = 0.866_025_4;
        let (sum, difference) = (b.plus(c), b.minus(c).times_minus_i().times(SIN));
        let middle = a.minus(sum.times(0.5));
        [a.plus(sum), middle.plus(difference), middle.minus(difference)]
    }
}

impl Butterfly<4> for Four {
    #[inline(always)]
    fn of<V: Register<f32, LANES>>([a, b, c, d]: [ComplexPack<V>; 4]) -> [ComplexPack<V>; 4] {
        let (even, odd) = (a.plus(c), a.minus(c));
        let (sum, difference) = (b.plus(d), b.minus(d).times_minus_i());
        [even.plus(sum), odd.plus(difference), even.minus(sum), odd.minus(difference)]
    }
}

impl Butterfly<5> for Five {
    #[inline(always)]
    fn of<V: Register<f32, LANES>>([a, b, c, d, e]: [ComplexPack<V>; 5]) -> [ComplexPack<V>; 5] {
        // Of the cosines of one and two fifths of a turn half the sum is minus a quarter; this is half the difference.
        const COS: f32 = 0.559_017;
        const SIN: [f32; 2] = [0.951_056_54, 0.587_785_24];
        let (outer, inner) = (b.plus(e), c.plus(d));
        let (outer_turn, inner_turn) = (b.minus(e).times_minus_i(), c.minus(d).times_minus_i());
        let (sum, difference) = (outer.plus(inner), outer.minus(inner).times(COS));
        let middle = a.minus(sum.times(0.25));
        let (first, second) = (middle.plus(difference), middle.minus(difference));
        let first_turn = outer_turn.times(SIN[0]).plus(inner_turn.times(SIN[1]));
        let second_turn = outer_turn.times(SIN[1]).minus(inner_turn.times(SIN[0]));
        [
            a.plus(sum),
            first.plus(first_turn),
            second.plus(second_turn),
            second.minus(second_turn),
            first.minus(first_turn),
        ]
    }
}

impl Butterfly<8> for Eight {
    #[inline(always)]
    fn of<V: Register<f32, LANES>>([a, b, c, d, e, f, g, h]: [ComplexPack<V>; 8]) -> [ComplexPack<V>; 8] {
        let even = Four::of([a, c, e, g]);
        let [p, q, r, s] = Four::of([b, d, f, h]);
        let odd = [p, q.turned_an_eighth(), r.times_minus_i(), s.turned_an_eighth().times_minus_i()];
        let mut out = [even[0]; 8];
        for k in 0..4 {
            out[k] = even[k].plus(odd[k]);
            out[k + 4] = even[k].minus(odd[k]);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// By definition, in float64.
    fn slowly(x: &[[f32; 2]]) -> Vec<[f64; 2]> {
        let n = x.len();
        let sum = |k: usize| {
            x.iter().enumerate().fold([0.0; 2], |[re, im], (j, [a, b])| {
                let (sin, cos) = (-2.0 * PI * (j * k % n) as f64 / n as f64).sin_cos();
                let (a, b) = (f64::from(*a), f64::from(*b));
                [re + a * cos - b * sin, im + a * sin + b * cos]
            })
        };
        (0..n).map(sum).collect()
    }

    fn transformed(x: &[[f32; 2]]) -> Vec<[f32; 2]> {
        let fft = Fft::new(x.len());
        let part = |part: usize| x.iter().map(|x| x[part]).collect::<Vec<_>>();
        let (re, im, ones) = (part(0), part(1), vec![1.0; x.len()]);
        let mut work = fft.work();
        fft.process(Portable, [&re, &im, &ones], &mut work);
        let ComplexValues { re, im } = work.transform;
        re.into_iter().zip(im).map(|(re, im)| [re, im]).take(x.len()).collect()
    }

    fn check(x: &[[f32; 2]]) {
        let size = f64::from(x.iter().flatten().fold(1.0_f32, |most, x| x.abs().max(most))) * x.len() as f64;
        for (got, expected) in transformed(x).into_iter().zip(slowly(x)) {
            for part in 0..2 {
                assert!(
                    (f64::from(got[part]) - expected[part]).abs() <= 5e-7 * size,
                    "{got:?} and {expected:?}"
                );
            }
        }
    }

    #[test]
    fn one_value_is_its_transform() {
        check(&[[3.0, -2.0]]);
    }

    #[test]
    fn a_cosine_has_two_lines() {
        let x: Vec<_> = (0..60).map(|j| [root(7 * j % 60, 60)[0], 0.0]).collect();
        for (k, [re, im]) in transformed(&x).into_iter().enumerate() {
            let expected = if k == 7 || k == 53 { 30.0 } else { 0.0 };
            assert!((re - expected).abs() < 1e-5 && im.abs() < 1e-5, "{k}");
        }
    }

    proptest! {
        #[test]
        fn any_length_agrees_with_the_definition(x in prop::collection::vec(prop::array::uniform2(-1e3_f32..1e3), 1..400)) {
            check(&x);
        }
    }
}
