//! Discrete Fourier transforms.
//!
//! Crates for this take their sines from the C library or use fused multiply-add where a machine has it, so that their last
//! bits differ between machines. Here every step is a plain operation on packs of numbers, and sines are those of `libm`.
//!
//! A signal is taken in columns and rows, four columns side by side, then four rows: whatever the signal, all lanes of a
//! vector have work, and what is worked on stays in the first-level cache. Columns and rows go through Stockham's algorithm,
//! pass after pass from one buffer to the other, which needs no reordering (Van Loan, "Computational frameworks for the fast
//! Fourier transform", 1992). Lengths with other factors than 2, 3 and 5 go through a convolution of a length without
//! (Bluestein, "A linear filtering approach to the computation of discrete Fourier transform", 1970).

use std::f64::consts::PI;

use crate::kernel::{Portable, Register, Vectors};

/// Columns, or rows, at a time.
pub(super) const LANES: usize = 4;

/// The longest transform that is not split: a few rows would leave lanes without work as well.
const LONGEST: usize = 128;

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
}

impl Fft {
    pub(super) fn new(n: usize) -> Self {
        if radices(n).is_some() {
            return Self { n, grid: Grid::new(n), detour: None };
        }
        let grid = Grid::new((2 * n - 1).next_power_of_two());
        let detour = Some(Detour::new(n, &grid));
        Self { n, grid, detour }
    }

    /// Memory for a signal, and for all that [`process`](Self::process) does with it.
    pub(super) fn work(&self) -> FftWork {
        self.grid.work()
    }

    /// Transforms the first `n` values of the signal in `work`. What lies behind them is lost.
    #[inline(always)]
    pub(super) fn process<S: Vectors<f64, 4>>(&self, simd: S, work: &mut FftWork) {
        let Some(Detour { chirp, response }) = &self.detour else {
            self.grid.process(simd, work);
            return;
        };
        for first in (0..self.n).step_by(LANES) {
            let x = work.signal.load(simd, first).each_times(chirp.load(simd, first));
            work.signal.store(first, x);
        }
        work.signal.end(self.n);
        self.grid.process(simd, work);
        // The way back is the way there between conjugations.
        for first in (0..self.grid.n).step_by(LANES) {
            let x = work.signal.load(simd, first).each_times(response.load(simd, first));
            work.signal.store(first, x.conjugate());
        }
        self.grid.process(simd, work);
        for first in (0..self.n).step_by(LANES) {
            let x = work.signal.load(simd, first).conjugate();
            work.signal.store(first, x.each_times(chirp.load(simd, first)));
        }
    }
}

impl Detour {
    fn new(n: usize, grid: &Grid) -> Self {
        let mut chirp = ComplexValues::new(n);
        let mut work = grid.work();
        let x = &mut work.signal;
        for j in 0..n {
            // j^2 modulo 2 n keeps the angle small, and exact.
            let [re, im] = root((j as u128 * j as u128 % (2 * n as u128)) as usize, 2 * n);
            (chirp.re[j], chirp.im[j]) = (re, im);
            for at in [j, (grid.n - j) % grid.n] {
                (x.re[at], x.im[at]) = (re, -im);
            }
        }
        grid.process(Portable, &mut work);
        let mut response = work.signal;
        let share = 1.0 / grid.n as f64;
        response.re.iter_mut().chain(&mut response.im).for_each(|x| *x *= share);
        Self { chirp, response }
    }
}

/// Values of a signal one after the other, real parts apart from imaginary ones, with room behind them for a vector.
#[derive(Clone, Debug)]
pub(super) struct ComplexValues {
    pub(super) re: Vec<f64>,
    pub(super) im: Vec<f64>,
}

impl ComplexValues {
    /// `n` zeros.
    fn new(n: usize) -> Self {
        Self { re: vec![0.0; n + LANES], im: vec![0.0; n + LANES] }
    }

    /// Values from `index` on.
    #[inline(always)]
    pub(super) fn load<S: Vectors<f64, 4>>(&self, simd: S, index: usize) -> ComplexPack<S::Register> {
        ComplexPack { re: simd.load(&self.re[index..]), im: simd.load(&self.im[index..]) }
    }

    /// Nothing from `index` on.
    fn end(&mut self, index: usize) {
        self.re[index..].fill(0.0);
        self.im[index..].fill(0.0);
    }

    /// Replaces values from `index` on.
    #[inline(always)]
    fn store<V: Register<f64, 4>>(&mut self, index: usize, values: ComplexPack<V>) {
        values.re.store(&mut self.re[index..]);
        values.im.store(&mut self.im[index..]);
    }
}

/// Memory for a transform.
#[derive(Clone, Debug)]
pub(super) struct FftWork {
    /// The signal, afterwards its transform.
    pub(super) signal: ComplexValues,
    /// Transformed columns, one after the other.
    columns: ComplexValues,
    /// Two buffers for columns, or rows, at work.
    buffers: [Vec<Cell>; 2],
}

/// A transform of a length with small factors alone.
#[derive(Clone, Debug)]
struct Grid {
    n: usize,
    n_rows: usize,
    n_columns: usize,
    columns: Passes,
    rows: Passes,
    /// Between the two: factors of all values of the first columns, then of the next ones.
    factors: Vec<Cell>,
}

impl Grid {
    fn new(n: usize) -> Self {
        let n_factors = |n: usize| radices(n).map_or(usize::MAX / 2, |radices| radices.len());
        // As square as it gets without splitting a factor.
        let square =
            |rows: &usize| n.is_multiple_of(*rows) && n_factors(*rows) + n_factors(n / rows) == n_factors(n);
        let n_rows = if n <= LONGEST { 1 } else { (1..=n.isqrt()).rev().find(square).unwrap_or(1) };
        let n_columns = n / n_rows;
        let factors = |j: usize| {
            (0..n_rows.next_multiple_of(LANES)).map(move |k| {
                let mut factors = Cell::ZERO;
                for l in 0..LANES {
                    [factors.re[l], factors.im[l]] = root((j + l) * k % n, n);
                }
                factors
            })
        };
        let factors = (0..n_columns).step_by(LANES).flat_map(factors).collect();
        Self { n, n_rows, n_columns, columns: Passes::new(n_rows), rows: Passes::new(n_columns), factors }
    }

    fn work(&self) -> FftWork {
        let buffer = vec![Cell::ZERO; self.n_rows.max(self.n_columns).next_multiple_of(LANES)];
        FftWork {
            signal: ComplexValues::new(self.n),
            columns: ComplexValues::new(self.n_columns.next_multiple_of(LANES) * self.n_rows),
            buffers: [buffer.clone(), buffer],
        }
    }

    /// Transforms the signal, `exp(-2 pi i j k / n)`.
    ///
    /// The last of four may not exist. Then the vector holds what lies behind, and what it leaves behind its place is
    /// overwritten: vectors are written from the last to the first.
    #[inline(always)]
    fn process<S: Vectors<f64, 4>>(&self, simd: S, work: &mut FftWork) {
        let (n_rows, n_columns) = (self.n_rows, self.n_columns);
        let FftWork { signal, columns, buffers: [a, b] } = work;
        let padded = n_rows.next_multiple_of(LANES);
        for (first, factors) in (0..n_columns).step_by(LANES).zip(self.factors.chunks_exact(padded)) {
            for (k, cell) in a[..n_rows].iter_mut().enumerate() {
                cell.store(signal.load(simd, k * n_columns + first));
            }
            let four = self.columns.process(simd, a, b)[..padded].as_chunks::<LANES>().0;
            for (k, (cells, factors)) in four.iter().zip(factors.as_chunks::<LANES>().0).enumerate().rev() {
                let (mut re, mut im) = ([simd.splat(0.0); LANES], [simd.splat(0.0); LANES]);
                for l in 0..LANES {
                    let turned = cells[l].load(simd).each_times(factors[l].load(simd));
                    (re[l], im[l]) = (turned.re, turned.im);
                }
                let (re, im) = (Register::transposed(re), Register::transposed(im));
                for l in 0..LANES {
                    columns.store((first + l) * n_rows + k * LANES, ComplexPack { re: re[l], im: im[l] });
                }
            }
        }
        for first in (0..n_rows).step_by(LANES).rev() {
            for (j, cell) in a[..n_columns].iter_mut().enumerate() {
                cell.store(columns.load(simd, j * n_rows + first));
            }
            for (k, cell) in self.rows.process(simd, a, b)[..n_columns].iter().enumerate() {
                signal.store(k * n_rows + first, cell.load(simd));
            }
        }
    }
}

/// One pass: `blocks` transforms of `radix` values for each of `stride` places.
#[derive(Clone, Debug)]
struct Pass {
    radix: usize,
    blocks: usize,
    stride: usize,
    /// `radix - 1` factors per block.
    factors: Vec<[f64; 2]>,
}

/// All passes of a transform of some length.
#[derive(Clone, Debug)]
struct Passes(Vec<Pass>);

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

impl Passes {
    /// For a length that has [`radices`].
    fn new(n: usize) -> Self {
        let (mut rest, mut stride) = (n, 1);
        let pass = |radix: usize| {
            let blocks = rest / radix;
            let factors = (0..blocks).flat_map(|p| (1..radix).map(move |k| (p, k)));
            let pass =
                Pass { radix, blocks, stride, factors: factors.map(|(p, k)| root(p * k, rest)).collect() };
            (rest, stride) = (blocks, stride * radix);
            pass
        };
        Self(radices(n).unwrap_or_default().into_iter().map(pass).collect())
    }

    /// Transforms the values of `x`, which are lost; returns the buffer that holds the result.
    #[inline(always)]
    fn process<'a>(
        &self,
        simd: impl Vectors<f64, 4>,
        x: &'a mut [Cell],
        y: &'a mut [Cell],
    ) -> &'a mut [Cell] {
        let (mut from, mut to) = (x, y);
        for pass in &self.0 {
            match pass.radix {
                8 => pass.run::<Eight, 8>(simd, from, to),
                4 => pass.run::<Four, 4>(simd, from, to),
                2 => pass.run::<Two, 2>(simd, from, to),
                3 => pass.run::<Three, 3>(simd, from, to),
                _ => pass.run::<Five, 5>(simd, from, to),
            }
            (from, to) = (to, from);
        }
        from
    }
}

impl Pass {
    #[inline(always)]
    fn run<B: Butterfly<R>, const R: usize>(
        &self,
        simd: impl Vectors<f64, 4>,
        from: &[Cell],
        to: &mut [Cell],
    ) {
        let stride = self.stride;
        let step = self.blocks * stride;
        // The last pass has nothing left to turn.
        if self.blocks == 1 {
            for place in 0..stride {
                let values = B::of(every::<_, R>(simd, &from[place..], stride));
                for k in 0..R {
                    to[k * stride + place].store(values[k]);
                }
            }
            return;
        }
        let targets = to.chunks_exact_mut(R * stride).zip(self.factors.chunks_exact(R - 1));
        for (block, (target, factors)) in targets.enumerate() {
            for place in 0..stride {
                let values = B::of(every::<_, R>(simd, &from[block * stride + place..], step));
                target[place].store(values[0]);
                for k in 1..R {
                    target[k * stride + place].store(values[k].turned(factors[k - 1]));
                }
            }
        }
    }
}

/// Values that lie `step` apart. A loop, because closures lose the vector features of the wrapper.
#[inline(always)]
fn every<S: Vectors<f64, 4>, const R: usize>(
    simd: S,
    cells: &[Cell],
    step: usize,
) -> [ComplexPack<S::Register>; R] {
    let mut values = [cells[0].load(simd); R];
    for k in 1..R {
        values[k] = cells[k * step].load(simd);
    }
    values
}

/// Complex numbers side by side.
#[derive(Clone, Copy)]
pub(super) struct ComplexPack<V> {
    pub(super) re: V,
    pub(super) im: V,
}

/// Four complex numbers in memory.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Cell {
    re: [f64; 4],
    im: [f64; 4],
}

impl Cell {
    const ZERO: Self = Self { re: [0.0; 4], im: [0.0; 4] };

    #[inline(always)]
    fn load<S: Vectors<f64, 4>>(&self, simd: S) -> ComplexPack<S::Register> {
        ComplexPack { re: simd.load(&self.re), im: simd.load(&self.im) }
    }

    #[inline(always)]
    fn store<V: Register<f64, 4>>(&mut self, value: ComplexPack<V>) {
        value.re.store(&mut self.re);
        value.im.store(&mut self.im);
    }
}

impl<V: Register<f64, 4>> ComplexPack<V> {
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
        Self { re: self.re * factor, im: self.im * factor }
    }

    /// Times `exp(-pi i / 4)`.
    #[inline(always)]
    fn turned_an_eighth(self) -> Self {
        Self { re: self.re + self.im, im: self.im - self.re }.times(std::f64::consts::FRAC_1_SQRT_2)
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
    fn turned(self, [re, im]: [f64; 2]) -> Self {
        Self { re: self.re * re - self.im * im, im: self.re * im + self.im * re }
    }

    #[inline(always)]
    fn conjugate(self) -> Self {
        Self { re: self.re, im: -self.im }
    }
}

/// A transform of so few values that it is written out.
trait Butterfly<const R: usize> {
    fn of<V: Register<f64, 4>>(values: [ComplexPack<V>; R]) -> [ComplexPack<V>; R];
}

struct Two;
struct Three;
struct Four;
struct Five;
struct Eight;

impl Butterfly<2> for Two {
    #[inline(always)]
    fn of<V: Register<f64, 4>>([a, b]: [ComplexPack<V>; 2]) -> [ComplexPack<V>; 2] {
        [a.plus(b), a.minus(b)]
    }
}

impl Butterfly<3> for Three {
    #[inline(always)]
    fn of<V: Register<f64, 4>>([a, b, c]: [ComplexPack<V>; 3]) -> [ComplexPack<V>; 3] {
        const SIN: f64 = 0.866_025_403_784_438_6;
        let (sum, difference) = (b.plus(c), b.minus(c).times_minus_i().times(SIN));
        let middle = a.minus(sum.times(0.5));
        [a.plus(sum), middle.plus(difference), middle.minus(difference)]
    }
}

impl Butterfly<4> for Four {
    #[inline(always)]
    fn of<V: Register<f64, 4>>([a, b, c, d]: [ComplexPack<V>; 4]) -> [ComplexPack<V>; 4] {
        let (even, odd) = (a.plus(c), a.minus(c));
        let (sum, difference) = (b.plus(d), b.minus(d).times_minus_i());
        [even.plus(sum), odd.plus(difference), even.minus(sum), odd.minus(difference)]
    }
}

impl Butterfly<5> for Five {
    #[inline(always)]
    fn of<V: Register<f64, 4>>([a, b, c, d, e]: [ComplexPack<V>; 5]) -> [ComplexPack<V>; 5] {
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
}

impl Butterfly<8> for Eight {
    #[inline(always)]
    fn of<V: Register<f64, 4>>([a, b, c, d, e, f, g, h]: [ComplexPack<V>; 8]) -> [ComplexPack<V>; 8] {
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

    fn transformed(x: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let fft = Fft::new(x.len());
        let mut work = fft.work();
        for (j, [re, im]) in x.iter().enumerate() {
            (work.signal.re[j], work.signal.im[j]) = (*re, *im);
        }
        fft.process(Portable, &mut work);
        work.signal.re.into_iter().zip(work.signal.im).map(|(re, im)| [re, im]).take(x.len()).collect()
    }

    fn check(x: &[[f64; 2]]) {
        let size = x.iter().flatten().fold(1.0, |most, x| x.abs().max(most)) * x.len() as f64;
        for (got, expected) in transformed(x).into_iter().zip(slowly(x)) {
            for part in 0..2 {
                assert!((got[part] - expected[part]).abs() <= 1e-15 * size, "{got:?} and {expected:?}");
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
            assert!((re - expected).abs() < 1e-13 && im.abs() < 1e-13, "{k}");
        }
    }

    proptest! {
        #[test]
        fn any_length_agrees_with_the_definition(x in prop::collection::vec(prop::array::uniform2(-1e3..1e3), 1..400)) {
            check(&x);
        }
    }
}
