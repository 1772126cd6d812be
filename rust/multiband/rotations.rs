//! QL iterations: from tridiagonal matrices to their eigenvalues and eigenvectors, a few side by side.

use super::symmetric::{Numbers, MATRICES};
use crate::kernel::{Mask, Pack, Quad};

/// QL iterations for one eigenvalue at most; two or three do.
const MAX_ITERATIONS: usize = 60;

/// Lanes of a register, and registers for all matrices.
const LANES: usize = 4;
const REGISTERS: usize = MATRICES / LANES;

/// QL iterations until nothing is left of `e`, below the diagonal `d`; columns of `vectors` are turned along.
#[inline(always)]
pub(super) fn diagonalise<V: Quad>(d: &mut [Numbers], e: &mut [Numbers], vectors: &mut [Numbers]) {
    let n = d.len();
    let size = d.iter().zip(&*e).fold(Pack::ZERO, |sum, (d, e)| sum + d.abs() + e.abs());
    let limit = Pack::splat(f64::EPSILON) * size;
    for first in 0..n.saturating_sub(1) {
        for _ in 0..MAX_ITERATIONS {
            let active = e[first].abs().above(limit);
            if !active.any() {
                break;
            }
            iterate::<V>(first, active, d, e, vectors);
        }
    }
}

/// One QL iteration on rows `first..n` of the active lanes; other lanes are not turned. Each rotation is done to the
/// vectors at once: their arithmetic fills the time in which the next one waits for a root and a quotient.
#[inline(always)]
fn iterate<V: Quad>(
    first: usize,
    active: Mask<MATRICES>,
    d: &mut [Numbers],
    e: &mut [Numbers],
    vectors: &mut [Numbers],
) {
    let n = d.len();
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
    for (k, out) in out.iter_mut().enumerate() {
        *out = load::<V>(&ones, k).above(V::splat(0.0));
    }
    out
}
