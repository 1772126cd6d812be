//! How axes move together in a band: the matrix of their second moments, now and two samples earlier, of which sums of
//! [resolvents](Resolvents) are taken, a few matrices side by side: a logarithm that levels off, by `+ - * /` alone.
//!
//! Each resolvent takes an eigenvalue v to (v - c) / (v + c) = tanh(ln(v / c) / 2). Like the logarithm they do not depend on
//! the order of axes, nor on how these are rotated.
//!
//! Logarithms of covariances make differences of ratios, and their Euclidean distances sensible: Arsigny et al.,
//! "Log-Euclidean metrics for fast and simple calculus on diffusion tensors" (2006); Barachant et al., "Multiclass
//! brain-computer interface classification by Riemannian geometry" (2012).

use std::hint::black_box;

use super::spec::halves_early;
use super::{BandSignals, Split, Statistic, LANES};
use crate::kernel::{F32x8, Pack, Simd};

/// Stacked samples per row of a matrix at least; fewer leave little but chance in it.
const MIN_SAMPLES: usize = 4;

/// Samples of the earlier of two instants before the later, where a band has not half its usual rate.
pub(super) const LAG: usize = 2;

/// Axes of a tile: nine sums at a time stay in registers and hide the latency of addition.
const TILE: usize = 3;

/// Samples of the shortest band that has the statistic: where half the lag is the same time, half as many for a row of the matrix.
pub(super) const fn least_samples(n_axes: usize, lag: usize) -> usize {
    n_axes.saturating_mul(2 * MIN_SAMPLES * lag / LAG).saturating_add(LAG)
}

/// The statistic for some number of axes.
#[derive(Clone, Debug)]
pub(super) struct Coupling {
    n_axes: usize,
    /// The bands that are long enough, and how many samples the earlier of two instants is before the later.
    pub(super) bands: Vec<(usize, usize)>,
}

impl Coupling {
    /// For bands of some numbers of samples, the first of which are those of a recording.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        // Octave 2 may have half its usual rate.
        let early = halves_early(lengths[0]);
        let lags = (0..lengths.len()).map(|band| (band, if early && band == 2 { LAG / 2 } else { LAG }));
        let bands = lags.filter(|(band, lag)| lengths[*band] >= least_samples(n_axes, *lag)).collect();
        Self { n_axes, bands }
    }

    /// Row and column of each number of a band in the matrix of stacked axes: the upper triangle of the first block, then the
    /// block of now and earlier.
    pub(super) fn cells(&self) -> impl Iterator<Item = (usize, usize)> {
        let n = self.n_axes;
        let upper = (0..n).flat_map(move |i| (i..n).map(move |j| (i, j)));
        upper.chain((0..n).flat_map(move |i| (n..2 * n).map(move |j| (i, j))))
    }

    /// Numbers per band.
    fn per_band(&self) -> usize {
        let n = self.n_axes;
        n * (n + 1) / 2 + n * n
    }
}

impl Statistic for Coupling {
    type Work = Resolvents;

    fn n_features(&self) -> usize {
        self.bands.len() * self.per_band()
    }

    fn work(&self) -> Resolvents {
        Resolvents::new(2 * self.n_axes)
    }

    /// Band by band the [cells](Self::cells); those at one instant as the mean of both instants.
    #[inline(always)]
    fn compute(&self, simd: impl Simd, split: Split<'_>, resolvents: &mut Resolvents, out: &mut [f64]) {
        let (n, rows) = (self.n_axes, 2 * self.n_axes);
        let groups = self.bands.chunks(MATRICES).zip(out.chunks_mut(MATRICES * self.per_band()));
        for (bands, out) in groups {
            for (lane, &(band, lag)) in bands.iter().enumerate() {
                moments(simd, split.signals, band, lag, |i, j, moment| {
                    resolvents.matrices[i * rows + j].0[lane] = moment;
                });
            }
            resolvents.take();
            for (lane, out) in out.chunks_exact_mut(self.per_band()).enumerate() {
                for (feature, (i, j)) in out.iter_mut().zip(self.cells()) {
                    let cell = |row: usize, column: usize| resolvents.matrices[row * rows + column].0[lane];
                    *feature = if j < n { 0.5 * (cell(j, i) + cell(n + j, n + i)) } else { cell(j, i) };
                }
            }
        }
    }
}

/// Second moments of stacked samples of a band: the axes of one instant, then those a lag earlier. `write(i, j, moment)` is
/// called once for each `i >= j`. All moments of no more samples than the lag are zero.
///
/// Nothing is subtracted, so that a moment is as exact as a sum of its products can be.
#[inline(always)]
fn moments(
    simd: impl Simd,
    signals: BandSignals<'_>,
    band: usize,
    lag: usize,
    mut write: impl FnMut(usize, usize, f64),
) {
    let (n, n_axes) = (signals.len(band), signals.n_axes);
    if n <= lag {
        (0..2 * n_axes).for_each(|i| (0..=i).for_each(|j| write(i, j, 0.0)));
        return;
    }
    let (n_instants, between) = (n - lag, lag.min(n - lag));
    let share = (n_instants as f64).recip();
    for i in (0..n_axes).step_by(TILE) {
        for j in (0..n_axes).step_by(TILE) {
            let [rows, columns] = [i, j].map(|first| tile_axes(signals, band, first));
            let lagged = products(simd, rows.map(|x| &x[lag..]), columns.map(|y| &y[..n_instants]));
            // Of samples that are both a later and an earlier one.
            let mut shared = lagged;
            if j <= i {
                let [x, y] = [rows, columns].map(|tile| tile.map(|axis| &axis[between..n_instants]));
                shared = products(simd, x, y);
            }
            for r in 0..TILE.min(n_axes - i) {
                for c in 0..TILE.min(n_axes - j) {
                    let (x, y, a, b) = (rows[r], columns[c], i + r, j + c);
                    // The earlier comes second in the stack.
                    write(n_axes + b, a, f64::from(lagged[r][c].sum()) * share);
                    if b <= a {
                        let (first, last) = (0..between, lag.max(n_instants)..n);
                        for (offset, others) in [(n_axes, first), (0, last)] {
                            let rest = x[others.clone()].iter().zip(&y[others]);
                            let sum = rest.fold(shared[r][c].sum(), |sum, (x, y)| sum + x * y);
                            write(offset + a, offset + b, f64::from(sum) * share);
                        }
                    }
                }
            }
        }
    }
}

/// The axes of a tile from axis `first` on. A tile at the edge takes the last axis more than once.
#[inline(always)]
fn tile_axes(signals: BandSignals<'_>, band: usize, first: usize) -> [&[f32]; TILE] {
    let axis = |r: usize| signals.axis(band, (first + r).min(signals.n_axes - 1));
    [axis(0), axis(1), axis(2)]
}

/// Sums of the products of each row with each column; all are of one length. What whole vectors leave over is another vector,
/// filled up with zeros.
#[inline(always)]
fn products(
    simd: impl Simd,
    rows: [&[f32]; TILE],
    columns: [&[f32]; TILE],
) -> [[Pack<f32, LANES>; TILE]; TILE] {
    let n = rows[0].len() / LANES;
    // Slices of one length, known to a compiler, need no checks.
    let [x0, x1, x2] = rows.map(|row| &row.as_chunks::<LANES>().0[..n]);
    let [y0, y1, y2] = columns.map(|column| &column.as_chunks::<LANES>().0[..n]);
    let mut sums = [[simd.splat(0.0); TILE]; TILE];
    let mut tails = [[[0.0; LANES]; TILE]; 2];
    for (tails, tile) in tails.iter_mut().zip([rows, columns]) {
        for (tail, axis) in tails.iter_mut().zip(tile) {
            tail.iter_mut().zip(&axis[n * LANES..]).for_each(|(tail, x)| *tail = *x);
        }
    }
    for t in 0..n {
        add(simd, &mut sums, [&x0[t], &x1[t], &x2[t]], [&y0[t], &y1[t], &y2[t]]);
    }
    let [[x0, x1, x2], [y0, y1, y2]] = &tails;
    add(simd, &mut sums, [x0, x1, x2], [y0, y1, y2]);
    let mut out = [[Pack::ZERO; TILE]; TILE];
    for (out, sum) in out.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
        sum.store(&mut out.0);
    }
    out
}

/// Adds the products of each row with each column.
#[inline(always)]
fn add<S: Simd>(
    simd: S,
    sums: &mut [[S::F32x8; TILE]; TILE],
    rows: [&[f32; LANES]; TILE],
    columns: [&[f32; LANES]; TILE],
) {
    let x = [simd.load(rows[0]), simd.load(rows[1]), simd.load(rows[2])];
    let y = [simd.load(columns[0]), simd.load(columns[1]), simd.load(columns[2])];
    for r in 0..TILE {
        for c in 0..TILE {
            sums[r][c] = sums[r][c] + x[r] * y[c];
        }
    }
}

/// Between these the sum is about 0.4 ln(v / 0.3), beyond them it levels off at -2 and 2.
const SHIFTS: [f64; 2] = [0.03, 3.0];

/// Of the trace, added to the diagonal: more than moments summed in float32 are off by, but of millions of samples, so that
/// pivots stay positive.
const ROUNDING: f64 = 1e-5;

/// Matrices at a time: eight bands of a recording of 1600 samples have one.
const MATRICES: usize = 8;

/// One number of each matrix.
pub(super) type Numbers = Pack<f64, MATRICES>;

/// Room for the resolvents of some matrices of `n` rows.
#[derive(Clone, Debug)]
pub(super) struct Resolvents {
    n: usize,
    /// The matrices, row by row; of them only the lower triangles count.
    matrices: Vec<Numbers>,
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

    use super::super::tests::Signals;
    use super::super::{narrow, Region};
    use super::*;
    use crate::kernel::{Portable, SimdPath};

    fn compute(signals: &Signals) -> Vec<f64> {
        signals.compute(&Coupling::new(&signals.lengths(), signals.n_axes), SimdPath::detect().unwrap())
    }

    #[test]
    fn what_overflows_is_not_hidden() {
        let signals = Signals::from(vec![vec![vec![1e30; 30]; 1]]);
        assert!(compute(&signals).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn more_bands_than_fit_at_a_time() {
        let signals = Signals::new(&[60; 19], 2);
        let all = compute(&signals);
        for (band, features) in all.chunks_exact(7).enumerate() {
            let alone = Signals::from(vec![signals.band(band)]);
            assert_eq!(features, compute(&alone));
        }
    }

    /// By definition.
    fn slowly(axes: &[Vec<f32>], lag: usize, i: usize, j: usize) -> f64 {
        let n = axes[0].len();
        let stacked = |row: usize, t: usize| {
            let axis = row % axes.len();
            f64::from(axes[axis][if row < axes.len() { t } else { t - lag }])
        };
        (lag..n).map(|t| stacked(i, t) * stacked(j, t)).sum::<f64>() / n.saturating_sub(lag).max(1) as f64
    }

    proptest! {
        #[test]
        fn every_moment_by_definition(n in 1_usize..700, n_axes in 1_usize..8, lag in 1..=LAG, seed in any::<u32>()) {
            let value = |k: usize| narrow(((k as f64 + f64::from(seed)) * 0.731).sin() * if k.is_multiple_of(97) { 1e3 } else { 1.0 });
            let axes: Vec<Vec<f32>> = (0..n_axes).map(|a| (0..n).map(|t| value(a * n + t)).collect()).collect();
            let values = axes.concat();
            let regions = [Region { start: 0, stride: n, len: n }];
            let signals = BandSignals { values: &values, regions: &regions, n_axes };
            let (mut seen, mut far) = (0, 0);
            moments(Portable, signals, 0, lag, |i, j, got| {
                seen += 1;
                let size = (slowly(&axes, lag, i, i) * slowly(&axes, lag, j, j)).sqrt();
                far += usize::from(i < j || (got - slowly(&axes, lag, i, j)).abs() > 1e-6 * size);
            });
            prop_assert_eq!((seen, far), (n_axes * (2 * n_axes + 1), 0));
        }
    }

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
}
