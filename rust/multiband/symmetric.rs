//! Logarithms of symmetric matrices, a few of them side by side.
//!
//! Each is made tridiagonal by Householder reflections, diagonal by QL iterations (Bowdler, Martin, Reinsch, Wilkinson,
//! "The QR and QL algorithms for symmetric matrices", 1968), and put together again with the logarithms of its
//! eigenvalues. All lanes take the same steps; one that has converged stands still, so that no matrix changes the bits
//! of another.

use super::logarithm;
use super::reflections::{product, tridiagonal};
use super::rotations::diagonalise;
use crate::kernel::{Pack, Quad};

/// Matrices at a time: eight bands of a recording of 1600 samples have one.
pub(super) const MATRICES: usize = 8;

/// One number of each matrix.
pub(super) type Numbers = Pack<MATRICES>;

/// Room for the logarithms of some matrices of `n` rows.
#[derive(Clone, Debug)]
pub(super) struct Logarithms {
    n: usize,
    /// The matrices, row by row; of them only the lower triangles count.
    pub(super) matrices: Vec<Numbers>,
    /// Eigenvectors in the making, column by column.
    vectors: Vec<Numbers>,
    diagonal: Vec<Numbers>,
    below: Vec<Numbers>,
    factors: Vec<Numbers>,
    temporary: Vec<Numbers>,
}

impl Logarithms {
    pub(super) fn new(n: usize) -> Self {
        let zeros = |len| vec![Pack::ZERO; len];
        Self {
            n,
            matrices: zeros(n * n),
            vectors: zeros(n * n),
            diagonal: zeros(n),
            below: zeros(n),
            factors: zeros(n),
            temporary: zeros(n),
        }
    }

    /// Replaces the lower triangle of each matrix by that of its logarithm; eigenvalues below `floor` count as `floor`.
    /// NaN throughout for a matrix of which the trace is not finite.
    #[inline(always)]
    pub(super) fn take<V: Quad>(&mut self, floor: f64) {
        let n = self.n;
        let shrink = self.shrink();
        let Self { matrices, vectors, diagonal, below, factors, temporary, .. } = self;
        tridiagonal(matrices, diagonal, below, factors, temporary);
        product(matrices, factors, vectors);
        diagonalise::<V>(diagonal, below, vectors);
        for (value, log) in self.diagonal.iter().zip(&mut self.temporary) {
            let value = *value / shrink;
            let floor = Pack::splat(floor);
            // NaN is not above anything: it has to be put back.
            *log = logarithm::log(value.above(floor).select(value, floor)) + shrink * Pack::ZERO;
        }
        for j in 0..n {
            for (k, scaled) in self.factors.iter_mut().enumerate() {
                *scaled = self.vectors[k * n + j] * self.temporary[k];
            }
            for i in j..n {
                let row = self.vectors[i..].iter().step_by(n);
                let products = row.zip(&self.factors).map(|(a, b)| *a * *b);
                self.matrices[i * n + j] = products.fold(Pack::ZERO, |sum, product| sum + product);
            }
        }
    }

    /// Multiplies each matrix by a power of two that brings its trace to between one and four, and returns these; NaN
    /// where the trace is not finite.
    #[inline(always)]
    fn shrink(&mut self) -> Numbers {
        let n = self.n;
        let trace = (0..n).fold(Pack::ZERO, |sum, i| sum + self.matrices[i * n + i]);
        let mut shrink = Pack::ZERO;
        for l in 0..MATRICES {
            let exponent = trace.0[l].to_bits() >> 52 & 0x7ff;
            let power = f64::from_bits((2046_u64.saturating_sub(exponent)).max(1) << 52);
            shrink.0[l] = if trace.0[l].is_finite() { power } else { f64::NAN };
        }
        for value in &mut self.matrices {
            *value = *value * shrink;
        }
        shrink
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    type Matrix = Vec<Vec<f64>>;

    /// A rotation made of many plane ones, by angles that any sequence gives.
    fn rotation(n: usize, angles: &[f64]) -> Matrix {
        let mut q: Matrix = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        let planes = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
        for ((i, j), angle) in planes.zip(angles.iter().cycle()) {
            let (s, c) = angle.sin_cos();
            for row in &mut q {
                (row[i], row[j]) = (c * row[i] - s * row[j], s * row[i] + c * row[j]);
            }
        }
        q
    }

    fn compose(q: &Matrix, values: &[f64]) -> Matrix {
        let entry = |i: usize, j: usize| values.iter().enumerate().map(|(k, v)| q[i][k] * v * q[j][k]).sum();
        (0..q.len()).map(|i| (0..q.len()).map(|j| entry(i, j)).collect()).collect()
    }

    fn logarithms<const L: usize>(matrices: &[Matrix; L], floor: f64) -> [Matrix; L] {
        let n = matrices[0].len();
        let mut work = Logarithms::new(n);
        for (l, matrix) in matrices.iter().enumerate() {
            for (i, row) in matrix.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    work.matrices[i * n + j].0[l] = if j <= i { *value } else { f64::NAN };
                }
            }
        }
        work.take::<Pack<4>>(floor);
        std::array::from_fn(|l| {
            let entry = |i: usize, j: usize| work.matrices[i.max(j) * n + i.min(j)].0[l];
            (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
        })
    }

    fn largest_difference(a: &Matrix, b: &Matrix) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).fold(0.0, |most, (a, b)| (a - b).abs().max(most))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn logarithms_of_known_eigenvalues(
            n in 1_usize..27,
            angles in prop::collection::vec(-3.2..3.2, 1..30),
            spread in 0.0..21.0,
            exponents in prop::collection::vec(0.0..1.0, 26),
        ) {
            // Up to a billion times the least eigenvalue, which is the floor.
            let values: Vec<f64> = exponents[..n].iter().map(|x: &f64| 1e-3 * f64::exp(x * spread)).collect();
            let logs: Vec<f64> = values.iter().map(|v| v.ln()).collect();
            let q = rotation(n, &angles);
            let [got, constant] = logarithms(&[compose(&q, &values), compose(&q, &vec![2.0; n])], 1e-3);
            let rounding = 1e-14 * (f64::exp(spread) + 10.0);
            prop_assert!(largest_difference(&got, &compose(&q, &logs)) < rounding);
            prop_assert!(largest_difference(&constant, &compose(&q, &vec![2.0_f64.ln(); n])) < 1e-13);
        }

        #[test]
        fn neighbours_change_no_bit(angles in prop::collection::vec(-3.2..3.2, 30), n in 2_usize..14) {
            let values: Vec<f64> = (0..n).map(|i| 1e-3 * (i as f64).exp2()).collect();
            let matrix = compose(&rotation(n, &angles), &values);
            let diagonal = compose(&rotation(n, &[0.0]), &values);
            let broken = compose(&rotation(n, &[0.0]), &vec![f64::INFINITY; n]);
            let [alone, _, _] = logarithms(&[matrix.clone(), diagonal.clone(), diagonal.clone()], 1e-3);
            let [_, beside, lost] = logarithms(&[diagonal, matrix, broken], 1e-3);
            prop_assert_eq!(alone, beside);
            prop_assert!(lost.iter().flatten().all(|x| x.is_nan()));
        }
    }

    #[test]
    fn two_by_two() {
        // Eigenvalues 1 and 3.
        let [log] = logarithms(&[vec![vec![2.0, 1.0], vec![1.0, 2.0]]], 1e-3);
        let half = 0.5 * 3.0_f64.ln();
        assert!(largest_difference(&log, &vec![vec![half; 2]; 2]) < 1e-15);
    }

    #[test]
    fn any_size_of_numbers() {
        for size in [1e-150, 1e150, 1e300] {
            let [log] = logarithms(&[vec![vec![2.0 * size, size], vec![size, 2.0 * size]]], 1e-200);
            assert!((log[0][0] - (size.ln() + 0.5 * 3.0_f64.ln())).abs() < 1e-12);
            assert!((log[0][1] - 0.5 * 3.0_f64.ln()).abs() < 1e-12);
        }
        let [log] = logarithms(&[vec![vec![0.0; 3]; 3]], 1e-3);
        assert_eq!(log[0], [1e-3_f64.ln(), 0.0, 0.0]);
    }
}
