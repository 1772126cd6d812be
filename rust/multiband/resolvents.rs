//! Sums of resolvents of symmetric matrices, a few side by side: a logarithm that levels off, by `+ - * /` alone.
//!
//! Each takes an eigenvalue v to (v - c) / (v + c) = tanh(ln(v / c) / 2). Like the logarithm they do not depend on the order of
//! axes, nor on how these are rotated.

use std::hint::black_box;

use crate::kernel::Pack;

/// Between these the sum is about 0.4 ln(v / 0.3), beyond them it levels off at -2 and 2.
const SHIFTS: [f64; 2] = [0.03, 3.0];

/// Of the trace, added to the diagonal: more than moments summed in float32 are off by, but of millions of samples, so that
/// pivots stay positive.
const ROUNDING: f64 = 1e-5;

/// Matrices at a time: eight bands of a recording of 1600 samples have one.
pub(super) const MATRICES: usize = 8;

/// One number of each matrix.
pub(super) type Numbers = Pack<f64, MATRICES>;

/// Room for the resolvents of some matrices of `n` rows.
#[derive(Clone, Debug)]
pub(super) struct Resolvents {
    n: usize,
    /// The matrices, row by row; of them only the lower triangles count.
    pub(super) matrices: Vec<Numbers>,
    swept: Vec<Numbers>,
    sum: Vec<Numbers>,
    column: Vec<Numbers>,
}

impl Resolvents {
    pub(super) fn new(n: usize) -> Self {
        let zeros = |len| vec![Pack::ZERO; len];
        Self { n, matrices: zeros(n * n), swept: zeros(n * n), sum: zeros(n * n), column: zeros(n) }
    }

    /// Replaces the lower triangle of each matrix M by that of the sum over shifts c of
    /// `1 - 2 c (M + c + ROUNDING trace M)^-1`. NaN throughout for a matrix of which the trace is not finite.
    #[inline(always)]
    pub(super) fn take(&mut self) {
        let Self { n, matrices, swept, sum, column } = self;
        let n = *n;
        let trace = (0..n).fold(Pack::ZERO, |sum, i| sum + matrices[i * n + i]);
        let zero = trace * Pack::ZERO;
        sum.fill(zero);
        for i in 0..n {
            sum[i * n + i] = zero + Pack::splat(SHIFTS.len() as f64);
        }
        for shift in SHIFTS {
            swept.copy_from_slice(matrices);
            let least = Pack::splat(shift) + Pack::splat(ROUNDING) * trace;
            for i in 0..n {
                swept[i * n + i] = swept[i * n + i] + least;
            }
            for pivot in 0..n {
                sweep(swept, column, pivot, least);
            }
            let twice = Pack::splat(2.0 * shift);
            for i in 0..n {
                for j in 0..=i {
                    sum[i * n + j] = sum[i * n + j] + twice * swept[i * n + j];
                }
            }
        }
        std::mem::swap(sum, matrices);
    }
}

/// One pivot of an inversion in place, after all of which the lower triangle is that of the inverse, negative (Goodnight, "A
/// tutorial on the SWEEP operator", 1979). Without rounding no pivot would be below `least`.
#[inline(always)]
fn sweep(a: &mut [Numbers], column: &mut [Numbers], k: usize, least: Numbers) {
    let n = column.len();
    let mut pivots = least;
    for (pivot, own) in pivots.0.iter_mut().zip(a[k * n + k].0) {
        *pivot = if own > *pivot { own } else { *pivot };
    }
    let inverse = Pack::ONE / pivots;
    a[k * n + k] = -inverse;
    column[..k].copy_from_slice(&a[k * n..][..k]);
    for i in k + 1..n {
        column[i] = a[i * n + k];
    }
    // The pivot's own row and column are put in behind.
    column[k] = Pack::ZERO;
    for i in 0..n {
        let factor = inverse * column[i];
        for (cell, other) in a[i * n..=i * n + i].iter_mut().zip(&*column) {
            // Hidden from the compiler, which would calculate with the same lane of several cells, and gather them.
            *cell = *cell - factor * *black_box(other);
        }
        if i != k {
            a[i.max(k) * n + i.min(k)] = factor;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Resolvents of matrices of `n` rows, all lanes side by side.
    fn take(n: usize, cell: impl Fn(usize, usize, usize) -> f64) -> Resolvents {
        let mut resolvents = Resolvents::new(n);
        for i in 0..n {
            for j in 0..=i {
                resolvents.matrices[i * n + j].0 = std::array::from_fn(|lane| cell(lane, i, j));
            }
        }
        resolvents.take();
        resolvents
    }

    /// What an eigenvalue becomes where the trace is `trace`.
    fn level(value: f64, trace: f64) -> f64 {
        SHIFTS.iter().map(|c| 1.0 - 2.0 * c / (value + c + ROUNDING * trace)).sum()
    }

    proptest! {
        /// A rotation of known eigenvalues: `1 - 2 v v' / |v|^2` on both sides.
        #[test]
        fn eigenvalues_are_levelled(
            (powers, v) in (1_usize..14).prop_flat_map(|n| {
                (prop::collection::vec(-9.0..9.0, n), prop::collection::vec(0.1..1.0_f64, n))
            }),
            shift in 0..3_i32,
        ) {
            let n = v.len();
            let norm: f64 = v.iter().map(|v| v * v).sum();
            let mirror = |i: usize, j: usize| f64::from(u8::from(i == j)) - 2.0 * v[i] * v[j] / norm;
            let values = |lane: usize| {
                let powers = powers.iter().map(move |power| power * (lane + 1) as f64 / MATRICES as f64);
                powers.map(|power: f64| (power + f64::from(shift)).exp()).collect::<Vec<_>>()
            };
            let of = |values: &[f64], i, j| (0..n).map(|k| mirror(i, k) * values[k] * mirror(k, j)).sum();
            let got = take(n, |lane, i, j| of(&values(lane), i, j));
            for lane in 0..MATRICES {
                let trace = values(lane).iter().sum();
                let levels: Vec<_> = values(lane).iter().map(|value| level(*value, trace)).collect();
                for i in 0..n {
                    for j in 0..=i {
                        let wanted: f64 = of(&levels, i, j);
                        prop_assert!((got.matrices[i * n + j].0[lane] - wanted).abs() < 1e-9);
                    }
                }
            }
        }
    }

    /// Rounding may leave a matrix that is not positive definite: pivots are not taken below the least one.
    #[test]
    fn copies_of_an_axis_stay_bounded() {
        for size in [1e-300, 1.0, 1e15, 1e290] {
            let got = take(6, |lane, i, j| size * if i == j { 1.0 - 1e-15 * lane as f64 } else { 1.0 });
            assert!(got.matrices.iter().flat_map(|cell| cell.0).all(|cell| cell.abs() <= 2.0));
        }
    }

    #[test]
    fn a_trace_that_is_not_finite_is_not_hidden() {
        let got = take(3, |lane, i, j| if lane == 2 && i == 1 && j == 1 { f64::INFINITY } else { 0.5 });
        for i in 0..3 {
            for j in 0..=i {
                let cell = got.matrices[i * 3 + j];
                assert!(cell.0[2].is_nan() && cell.0[1].is_finite());
            }
        }
    }
}
