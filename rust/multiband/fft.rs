//! Discrete Fourier transforms.
//!
//! Crates for this take their sines from the C library or use fused multiply-add where a machine has it, so that their last
//! bits differ between machines. Here every step is a plain operation on packs of numbers, and sines are those of `libm`.
//!
//! Lengths with other factors than 2, 3 and 5 go through a convolution of a length without (Bluestein, "A linear filtering
//! approach to the computation of discrete Fourier transform", 1970).

use super::grid::{Grid, GridWork, Parts, LANES};
use super::passes::{radices, root};
use crate::kernel::{Pack, Quad};

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
    chirp: Parts,
    /// The transform of the conjugate chirp on both sides of zero, divided by the length.
    response: Parts,
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
    pub(super) fn work(&self) -> GridWork {
        self.grid.work()
    }

    /// Transforms the first `n` values of the signal in `work`. What lies behind them is lost.
    #[inline(always)]
    pub(super) fn process<V: Quad>(&self, work: &mut GridWork) {
        let Some(Detour { chirp, response }) = &self.detour else {
            self.grid.process::<V>(work);
            return;
        };
        for first in (0..self.n).step_by(LANES) {
            let x = work.signal.load::<V>(first).each_times(chirp.load(first));
            work.signal.store(first, x);
        }
        work.signal.end(self.n);
        self.grid.process::<V>(work);
        // The way back is the way there between conjugations.
        for first in (0..self.grid.n).step_by(LANES) {
            let x = work.signal.load::<V>(first).each_times(response.load(first));
            work.signal.store(first, x.conjugate());
        }
        self.grid.process::<V>(work);
        for first in (0..self.n).step_by(LANES) {
            let x = work.signal.load::<V>(first).conjugate();
            work.signal.store(first, x.each_times(chirp.load(first)));
        }
    }
}

impl Detour {
    fn new(n: usize, grid: &Grid) -> Self {
        let mut chirp = Parts::new(n);
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
        grid.process::<Pack<4>>(&mut work);
        let mut response = work.signal;
        let share = 1.0 / grid.n as f64;
        response.re.iter_mut().chain(&mut response.im).for_each(|x| *x *= share);
        Self { chirp, response }
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
        fft.process::<Pack<4>>(&mut work);
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
