//! Fourier transforms of one signal in columns and rows: four columns side by side, then four rows.
//!
//! Whatever the signal, all lanes of a vector have work, and what is worked on stays in the first-level cache.

use super::butterfly::{Cell, Complex};
use super::passes::{radices, root, Passes};
use crate::kernel::Quad;

/// Columns, or rows, at a time.
pub(super) const LANES: usize = 4;

/// The longest transform that is not split: a few rows would leave lanes without work as well.
const LONGEST: usize = 128;

/// Values of a signal one after the other, real parts apart from imaginary ones, with room behind them for a vector.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    pub(super) re: Vec<f64>,
    pub(super) im: Vec<f64>,
}

impl Parts {
    /// `n` zeros.
    pub(super) fn new(n: usize) -> Self {
        Self { re: vec![0.0; n + LANES], im: vec![0.0; n + LANES] }
    }

    /// Values from `index` on.
    #[inline(always)]
    pub(super) fn load<V: Quad>(&self, index: usize) -> Complex<V> {
        Complex { re: V::load(&self.re[index..]), im: V::load(&self.im[index..]) }
    }

    /// Nothing from `index` on.
    pub(super) fn end(&mut self, index: usize) {
        self.re[index..].fill(0.0);
        self.im[index..].fill(0.0);
    }

    /// Replaces values from `index` on.
    #[inline(always)]
    pub(super) fn store<V: Quad>(&mut self, index: usize, values: Complex<V>) {
        values.re.store(&mut self.re[index..]);
        values.im.store(&mut self.im[index..]);
    }
}

/// Memory for a transform.
#[derive(Clone, Debug)]
pub(super) struct GridWork {
    /// The signal, afterwards its transform.
    pub(super) signal: Parts,
    /// Transformed columns, one after the other.
    columns: Parts,
    /// Two buffers for columns, or rows, at work.
    buffers: [Vec<Cell>; 2],
}

/// A transform of a length with small factors alone.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub(super) n: usize,
    n_rows: usize,
    n_columns: usize,
    columns: Passes,
    rows: Passes,
    /// Between the two: factors of all values of the first columns, then of the next ones.
    factors: Vec<Cell>,
}

impl Grid {
    pub(super) fn new(n: usize) -> Self {
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

    pub(super) fn work(&self) -> GridWork {
        let buffer = vec![Cell::ZERO; self.n_rows.max(self.n_columns).next_multiple_of(LANES)];
        GridWork {
            signal: Parts::new(self.n),
            columns: Parts::new(self.n_columns.next_multiple_of(LANES) * self.n_rows),
            buffers: [buffer.clone(), buffer],
        }
    }

    /// Transforms the signal, `exp(-2 pi i j k / n)`.
    ///
    /// The last of four may not exist. Then the vector holds what lies behind, and what it leaves behind its place is
    /// overwritten: vectors are written from the last to the first.
    #[inline(always)]
    pub(super) fn process<V: Quad>(&self, work: &mut GridWork) {
        let (n_rows, n_columns) = (self.n_rows, self.n_columns);
        let GridWork { signal, columns, buffers: [a, b] } = work;
        let padded = n_rows.next_multiple_of(LANES);
        for (first, factors) in (0..n_columns).step_by(LANES).zip(self.factors.chunks_exact(padded)) {
            for (k, cell) in a[..n_rows].iter_mut().enumerate() {
                cell.store(signal.load::<V>(k * n_columns + first));
            }
            let four = self.columns.process::<V>(a, b)[..padded].as_chunks::<LANES>().0;
            for (k, (cells, factors)) in four.iter().zip(factors.as_chunks::<LANES>().0).enumerate().rev() {
                let (mut re, mut im) = ([V::splat(0.0); LANES], [V::splat(0.0); LANES]);
                for l in 0..LANES {
                    let turned = cells[l].load::<V>().each_times(factors[l].load());
                    (re[l], im[l]) = (turned.re, turned.im);
                }
                let (re, im) = (V::transposed(re), V::transposed(im));
                for l in 0..LANES {
                    columns.store((first + l) * n_rows + k * LANES, Complex { re: re[l], im: im[l] });
                }
            }
        }
        for first in (0..n_rows).step_by(LANES).rev() {
            for (j, cell) in a[..n_columns].iter_mut().enumerate() {
                cell.store(columns.load::<V>(j * n_rows + first));
            }
            for (k, cell) in self.rows.process::<V>(a, b)[..n_columns].iter().enumerate() {
                signal.store(k * n_rows + first, cell.load::<V>());
            }
        }
    }
}
