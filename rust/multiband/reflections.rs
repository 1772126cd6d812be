//! Householder reflections: from symmetric matrices to tridiagonal ones, a few side by side.

use super::symmetric::Numbers;
use crate::kernel::Pack;

/// Below this a sum of squares counts as zero, for matrices with a trace of about one: far below rounding, and far from
/// where a reciprocal overflows.
const NOTHING: f64 = 1e-290;

/// `n - 2` reflections of matrices `a`, of which the lower triangles count, leave a diagonal `d` and `e` below it. Each
/// reflection `1 - factor v v'` stays in the column of `a` that it has cleared; `p` is room for `n` numbers.
#[inline(always)]
pub(super) fn tridiagonal(
    a: &mut [Numbers],
    d: &mut [Numbers],
    e: &mut [Numbers],
    factors: &mut [Numbers],
    p: &mut [Numbers],
) {
    let n = d.len();
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

/// The product of all reflections that [`tridiagonal`] has left, column by column.
#[inline(always)]
pub(super) fn product(a: &[Numbers], factors: &[Numbers], q: &mut [Numbers]) {
    let n = factors.len();
    q.fill(Pack::ZERO);
    for i in 0..n {
        q[i * n + i] = Pack::ONE;
    }
    for k in (0..n.saturating_sub(2)).rev() {
        let v = |i: usize| a[i * n + k];
        for column in q.chunks_exact_mut(n).skip(k + 1) {
            let products = (k + 1..n).map(|i| v(i) * factors[k] * column[i]);
            let sum = products.fold(Pack::ZERO, |sum, product| sum + product);
            for (i, x) in column.iter_mut().enumerate().skip(k + 1) {
                *x = *x - v(i) * sum;
            }
        }
    }
}
