//! Complex numbers side by side, and Fourier transforms of a few of them.

use crate::kernel::Quad;

/// Complex numbers side by side.
#[derive(Clone, Copy)]
pub(super) struct Complex<V> {
    pub(super) re: V,
    pub(super) im: V,
}

/// Four complex numbers in memory.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Cell {
    pub(super) re: [f64; 4],
    pub(super) im: [f64; 4],
}

impl Cell {
    pub(super) const ZERO: Self = Self { re: [0.0; 4], im: [0.0; 4] };

    #[inline(always)]
    pub(super) fn load<V: Quad>(&self) -> Complex<V> {
        Complex { re: V::load(&self.re), im: V::load(&self.im) }
    }

    #[inline(always)]
    pub(super) fn store<V: Quad>(&mut self, value: Complex<V>) {
        value.re.store(&mut self.re);
        value.im.store(&mut self.im);
    }
}

impl<V: Quad> Complex<V> {
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
        Self { re: self.re * V::splat(factor), im: self.im * V::splat(factor) }
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
    pub(super) fn each_times(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }

    /// Times one complex number, the same in all lanes.
    #[inline(always)]
    pub(super) fn turned(self, [re, im]: [f64; 2]) -> Self {
        self.each_times(Self { re: V::splat(re), im: V::splat(im) })
    }

    #[inline(always)]
    pub(super) fn conjugate(self) -> Self {
        Self { re: self.re, im: -self.im }
    }
}

/// A transform of so few values that it is written out.
pub(super) trait Butterfly<const R: usize> {
    fn of<V: Quad>(values: [Complex<V>; R]) -> [Complex<V>; R];
}

pub(super) struct Two;
pub(super) struct Three;
pub(super) struct Four;
pub(super) struct Five;
pub(super) struct Eight;

impl Butterfly<2> for Two {
    #[inline(always)]
    fn of<V: Quad>([a, b]: [Complex<V>; 2]) -> [Complex<V>; 2] {
        [a.plus(b), a.minus(b)]
    }
}

impl Butterfly<3> for Three {
    #[inline(always)]
    fn of<V: Quad>([a, b, c]: [Complex<V>; 3]) -> [Complex<V>; 3] {
        const SIN: f64 = 0.866_025_403_784_438_6;
        let (sum, difference) = (b.plus(c), b.minus(c).times_minus_i().times(SIN));
        let middle = a.minus(sum.times(0.5));
        [a.plus(sum), middle.plus(difference), middle.minus(difference)]
    }
}

impl Butterfly<4> for Four {
    #[inline(always)]
    fn of<V: Quad>([a, b, c, d]: [Complex<V>; 4]) -> [Complex<V>; 4] {
        let (even, odd) = (a.plus(c), a.minus(c));
        let (sum, difference) = (b.plus(d), b.minus(d).times_minus_i());
        [even.plus(sum), odd.plus(difference), even.minus(sum), odd.minus(difference)]
    }
}

impl Butterfly<5> for Five {
    #[inline(always)]
    fn of<V: Quad>([a, b, c, d, e]: [Complex<V>; 5]) -> [Complex<V>; 5] {
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
    fn of<V: Quad>([a, b, c, d, e, f, g, h]: [Complex<V>; 8]) -> [Complex<V>; 8] {
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
