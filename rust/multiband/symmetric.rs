//! Logarithms of symmetric matrices, a few of them side by side.
//!
//! Each is made tridiagonal by Householder reflections, diagonal by QL iterations (Bowdler, Martin, Reinsch, Wilkinson,
//! "The QR and QL algorithms for symmetric matrices", 1968), and put together again with the logarithms of its
//! eigenvalues. All lanes take the same steps; one that has converged stands still, so that no matrix changes the bits
//! of another.

use super::logarithm;
use super::pack::{Mask, Pack};
use crate::lanes::Quad;

/// QL iterations for one eigenvalue at most; two or three do.
const MAX_ITERATIONS: usize = 60;

/// Below this a sum of squares counts as zero, for matrices with a trace of about one: far below rounding, and far from
/// where a reciprocal overflows.
const NOTHING: f64 = 1e-290;

/// Matrices at a time: eight bands of a recording of 1600 samples have one.
pub(super) const MATRICES: usize = 8;

/// Lanes of a register, and registers for all matrices.
const LANES: usize = 4;
const REGISTERS: usize = MATRICES / LANES;

/// One number of each matrix.
type Numbers = Pack<MATRICES>;

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
        self.tridiagonal();
        self.reflections();
        self.diagonalise::<V>();
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

    /// `n - 2` reflections that leave `diagonal` and `below`. Each reflection `1 - factor v v'` stays in the column of
    /// `matrices` that it has cleared.
    #[inline(always)]
    fn tridiagonal(&mut self) {
        let Self { n, matrices: a, diagonal: d, below: e, factors, temporary: p, .. } = self;
        let n = *n;
        for k in 0..n {
            d[k] = a[k * n + k];
            if k + 2 >= n {
                factors[k] = Pack::ZERO;
                e[k] = if k + 1 < n { a[(k + 1) * n + k] } else { Pack::ZERO };
                continue;
            }
            let rest = (k + 2..n).fold(Pack::ZERO, |sum, i| sum + a[i * n + k] * a[i * n + k]);
            let head = a[(k + 1) * n + k];
            let square = head * head + rest;
            let length = square.sqrt();
            let needed = rest.above(Pack::splat(NOTHING));
            let factor = needed.select(Pack::ONE / (square + head.abs() * length), Pack::ZERO);
            factors[k] = factor;
            e[k] = needed.select(-length.with_sign_of(head), head);
            a[(k + 1) * n + k] = head + length.with_sign_of(head);
            // p = factor A v, then w = p - factor / 2 (p'v) v, then A -= v w' + w v'.
            for i in k + 1..n {
                let v_i = a[i * n + k];
                let mut sum = a[i * n + i] * v_i;
                for j in k + 1..i {
                    let a_ij = a[i * n + j];
                    sum = sum + a_ij * a[j * n + k];
                    p[j] = p[j] + a_ij * v_i;
                }
                p[i] = sum;
            }
            let mut dot = Pack::ZERO;
            for i in k + 1..n {
                p[i] = p[i] * factor;
                dot = dot + p[i] * a[i * n + k];
            }
            let half = Pack::splat(0.5) * factor * dot;
            for i in k + 1..n {
                p[i] = p[i] - half * a[i * n + k];
            }
            for i in k + 1..n {
                let (v_i, w_i) = (a[i * n + k], p[i]);
                for j in k + 1..=i {
                    a[i * n + j] = a[i * n + j] - (v_i * p[j] + w_i * a[j * n + k]);
                }
            }
        }
    }

    /// The product of all reflections, into `vectors`.
    #[inline(always)]
    fn reflections(&mut self) {
        let Self { n, matrices: a, vectors: q, factors, .. } = self;
        let n = *n;
        q.fill(Pack::ZERO);
        for i in 0..n {
            q[i * n + i] = Pack::ONE;
        }
        for k in (0..n.saturating_sub(2)).rev() {
            let v = |i: usize| a[i * n + k];
            for column in q.chunks_exact_mut(n).skip(k + 1) {
                let products = (k + 1..n).map(|i| v(i) * factors[k] * column[i]);
                let sum = products.fold(Pack::ZERO, |sum, product| sum + product);
                for i in k + 1..n {
                    column[i] = column[i] - v(i) * sum;
                }
            }
        }
    }

    /// QL iterations until nothing is left in `below`.
    #[inline(always)]
    fn diagonalise<V: Quad>(&mut self) {
        let n = self.n;
        let size = (0..n).fold(Pack::ZERO, |sum, i| sum + self.diagonal[i].abs() + self.below[i].abs());
        let limit = Pack::splat(f64::EPSILON) * size;
        for first in 0..n.saturating_sub(1) {
            for _ in 0..MAX_ITERATIONS {
                let active = self.below[first].abs().above(limit);
                if !active.any() {
                    break;
                }
                self.iterate::<V>(first, active);
            }
        }
    }

    /// One QL iteration on rows `first..n` of the active lanes; other lanes are not turned. Each rotation is done to the
    /// vectors at once: their arithmetic fills the time in which the next one waits for a root and a quotient.
    #[inline(always)]
    fn iterate<V: Quad>(&mut self, first: usize, active: Mask<MATRICES>) {
        let Self { n, diagonal: d, below: e, vectors, .. } = self;
        let n = *n;
        // The eigenvalue of the first two rows that is nearer to the first.
        let half = Pack::splat(0.5) * (d[first + 1] - d[first]);
        let root = (half * half + e[first] * e[first]).sqrt();
        let shift = d[first] - e[first] * e[first] / (half + root.with_sign_of(half));
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let active = answers(active);
        let (mut c, mut s) = ([one; REGISTERS], [zero; REGISTERS]);
        let mut p = [zero; REGISTERS];
        let (mut d_after, mut e_after) = (p, p);
        for k in 0..REGISTERS {
            (d_after[k], e_after[k]) = (load(&d[n - 1], k), load(&e[n - 1], k));
            p[k] = d_after[k] - load(&shift, k);
        }
        for i in (first..n - 1).rev() {
            let (mut cosine, mut sine) = (c, s);
            for k in 0..REGISTERS {
                let (active, shift): (V, V) = (active[k], load(&shift, k));
                let (d_i, e_i) = (load(&d[i], k), load(&e[i], k));
                let (g, h) = (c[k] * e_i, c[k] * p[k]);
                let r = (p[k] * p[k] + e_i * e_i).sqrt();
                store((s[k] * r).or(e_after[k], active), &mut e[i + 1], k);
                let turned = r.above(zero);
                let inverse = one / r;
                s[k] = (e_i * inverse).or(zero, turned);
                c[k] = (p[k] * inverse).or(one, turned);
                (cosine[k], sine[k]) = (c[k].or(one, active), s[k].or(zero, active));
                let centred = d_i - shift;
                p[k] = c[k] * centred - s[k] * g;
                let value = h + s[k] * (c[k] * g + s[k] * centred) + shift;
                store(value.or(d_after[k], active), &mut d[i + 1], k);
                (d_after[k], e_after[k]) = (d_i, e_i);
            }
            turn(&mut vectors[i * n..][..2 * n], cosine, sine);
        }
        for k in 0..REGISTERS {
            let active = active[k];
            store((s[k] * p[k]).or(e_after[k], active), &mut e[first], k);
            store((c[k] * p[k] + load(&shift, k)).or(d_after[k], active), &mut d[first], k);
        }
        e[n - 1] = Pack::ZERO;
    }
}

/// Turns two columns by an angle with some cosine and sine.
#[inline(always)]
fn turn<V: Quad>(columns: &mut [Numbers], c: [V; REGISTERS], s: [V; REGISTERS]) {
    let (left, right) = columns.split_at_mut(columns.len() / 2);
    for (left, right) in left.iter_mut().zip(right) {
        for k in 0..REGISTERS {
            let (x, y) = (load(left, k), load(right, k));
            store(c[k] * x - s[k] * y, left, k);
            store(s[k] * x + c[k] * y, right, k);
        }
    }
}

/// Those numbers that make up register `k`.
#[inline(always)]
fn load<V: Quad>(numbers: &Numbers, k: usize) -> V {
    V::load(&numbers.0[k * LANES..])
}

#[inline(always)]
fn store<V: Quad>(register: V, numbers: &mut Numbers, k: usize) {
    register.store(&mut numbers.0[k * LANES..]);
}

/// Answers in registers.
#[inline(always)]
fn answers<V: Quad>(mask: Mask<MATRICES>) -> [V; REGISTERS] {
    let (ones, mut out) = (mask.select(Pack::ONE, Pack::ZERO), [V::splat(0.0); REGISTERS]);
    for k in 0..REGISTERS {
        out[k] = load::<V>(&ones, k).above(V::splat(0.0));
    }
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lanes::Plain;

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
        work.take::<Plain>(floor);
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
