//! Complex numbers side by side, and Fourier transforms of a few of them.

use super::pack::Pack;

/// Complex numbers side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
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

    /// Times `exp(-pi i / 4)`.
    #[inline(always)]
    fn turned_an_eighth(self) -> Self {
        Self { re: self.re + self.im, im: self.im - self.re }.times(std::f64::consts::FRAC_1_SQRT_2)
    }

    #[inline(always)]
    fn times_minus_i(self) -> Self {
        Self { re: self.im, im: -self.re }
    }

    /// Times one complex number, the same in all lanes.
    #[inline(always)]
    pub(super) fn turned(self, [re, im]: [f64; 2]) -> Self {
        let (c, s) = (Pack::splat(re), Pack::splat(im));
        Self { re: self.re * c - self.im * s, im: self.re * s + self.im * c }
    }

    #[inline(always)]
    pub(super) fn conjugate(self) -> Self {
        Self { re: self.re, im: -self.im }
    }
}

/// A transform of so few values that it is written out.
pub(super) trait Butterfly<const R: usize> {
    fn of<const L: usize>(values: [Complex<L>; R]) -> [Complex<L>; R];
}

pub(super) struct Two;
pub(super) struct Three;
pub(super) struct Four;
pub(super) struct Five;
pub(super) struct Eight;

impl Butterfly<2> for Two {
    #[inline(always)]
    fn of<const L: usize>([a, b]: [Complex<L>; 2]) -> [Complex<L>; 2] {
        [a.plus(b), a.minus(b)]
    }
}

impl Butterfly<3> for Three {
    #[inline(always)]
    fn of<const L: usize>([a, b, c]: [Complex<L>; 3]) -> [Complex<L>; 3] {
        const SIN: f64 = 0.866_025_403_784_438_6;
        let (sum, difference) = (b.plus(c), b.minus(c).times_minus_i().times(SIN));
        let middle = a.minus(sum.times(0.5));
        [a.plus(sum), middle.plus(difference), middle.minus(difference)]
    }
}

impl Butterfly<4> for Four {
    #[inline(always)]
    fn of<const L: usize>([a, b, c, d]: [Complex<L>; 4]) -> [Complex<L>; 4] {
        let (even, odd) = (a.plus(c), a.minus(c));
        let (sum, difference) = (b.plus(d), b.minus(d).times_minus_i());
        [even.plus(sum), odd.plus(difference), even.minus(sum), odd.minus(difference)]
    }
}

impl Butterfly<5> for Five {
    #[inline(always)]
    fn of<const L: usize>([a, b, c, d, e]: [Complex<L>; 5]) -> [Complex<L>; 5] {
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
    fn of<const L: usize>([a, b, c, d, e, f, g, h]: [Complex<L>; 8]) -> [Complex<L>; 8] {
        let even = Four::of([a, c, e, g]);
        let [p, q, r, s] = Four::of([b, d, f, h]);
        let odd = [p, q.turned_an_eighth(), r.times_minus_i(), s.turned_an_eighth().times_minus_i()];
        let mut out = [Complex::ZERO; 8];
        for k in 0..4 {
            out[k] = even[k].plus(odd[k]);
            out[k + 4] = even[k].minus(odd[k]);
        }
        out
    }
}
