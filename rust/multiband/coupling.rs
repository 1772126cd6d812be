//! How axes move together in a band: the logarithm of the matrix of their second moments, now and two samples earlier.
//!
//! Logarithms of covariances make differences of ratios, and their Euclidean distances sensible: Arsigny et al.,
//! "Log-Euclidean metrics for fast and simple calculus on diffusion tensors" (2006); Barachant et al., "Multiclass
//! brain-computer interface classification by Riemannian geometry" (2012).

use super::logarithm::{Logarithms, MATRICES};
use super::{BandSignals, Split, Statistic};
use crate::kernel::{Pack, Register, Simd, Vectors};

/// Added to the second moments of scaled signals: what is a thousandth of the usual energy counts as noise.
const RIDGE: f64 = 1e-3;

/// Stacked samples per row of a matrix at least; fewer leave little but chance in its logarithm.
const MIN_SAMPLES: usize = 4;

/// Samples of the earlier of two instants before the later.
pub(super) const LAG: usize = 2;

/// Axes of a tile: nine sums at a time stay in registers and hide the latency of addition.
const TILE: usize = 3;

/// Partial sums per product.
const LANES: usize = 4;

/// Samples that are multiplied at a time: a dozen axes of them stay in the first-level cache.
const CHUNK: usize = 256;

/// Samples of a band that are worth adding up before the others are there.
const LEAST: usize = 64;

/// Samples of the shortest band that has the statistic.
pub(super) const fn least_samples(n_axes: usize) -> usize {
    n_axes.saturating_mul(2 * MIN_SAMPLES).saturating_add(LAG)
}

/// The statistic for some number of axes.
#[derive(Clone, Debug)]
pub(super) struct Coupling {
    n_axes: usize,
    /// The first bands, those that are long enough.
    pub(super) n_bands: usize,
    /// Octaves that are added up while they grow.
    growing: usize,
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct CouplingWork {
    /// Those of the octaves that are long enough to be added up while they grow.
    growing: Vec<Moments>,
    /// Those of the band whose turn it is, of all its samples.
    whole: Moments,
    logarithms: Logarithms,
}

impl CouplingWork {
    /// Ready for the first sample of a recording.
    pub(super) fn restart(&mut self) {
        self.growing.iter_mut().for_each(Moments::restart);
    }

    /// Adds up what there is of the octaves.
    #[inline(always)]
    pub(super) fn advance(&mut self, simd: impl Vectors<f64, 4>, signals: BandSignals<'_>) {
        for (octave, moments) in self.growing.iter_mut().enumerate() {
            moments.advance(simd, signals, 1 + octave);
        }
    }
}

impl Coupling {
    /// For bands of some numbers of samples, the longest first.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        let n_bands = lengths.partition_point(|n| *n >= least_samples(n_axes));
        let growing = lengths[..n_bands].iter().skip(1).filter(|n| **n >= 2 * LEAST).count();
        Self { n_axes, n_bands, growing }
    }

    /// Numbers per band: the upper triangle of a matrix of twice the axes.
    fn per_band(&self) -> usize {
        self.n_axes * (2 * self.n_axes + 1)
    }
}

impl Statistic for Coupling {
    type Work = CouplingWork;

    fn n_features(&self) -> usize {
        self.n_bands * self.per_band()
    }

    fn work(&self) -> CouplingWork {
        let whole = Moments::new(self.n_axes);
        let growing = vec![whole.clone(); self.growing];
        CouplingWork { growing, whole, logarithms: Logarithms::new(2 * self.n_axes) }
    }

    /// Band by band the upper triangle, row by row, off the diagonal times the square root of two, so that the norm of the
    /// features is that of the matrix.
    #[inline(always)]
    fn compute(&self, simd: impl Simd, split: Split<'_>, work: &mut CouplingWork, out: &mut [f64]) {
        let rows = 2 * self.n_axes;
        let CouplingWork { growing, whole, logarithms } = work;
        for (group, out) in out.chunks_mut(MATRICES * self.per_band()).enumerate() {
            for lane in 0..out.len() / self.per_band() {
                let band = group * MATRICES + lane;
                match growing.get(band.wrapping_sub(1)) {
                    Some(so_far) => whole.copy(so_far),
                    None => whole.restart(),
                }
                whole.finish(simd, split.signals, band, |i, j, moment| {
                    let ridge = if i == j { RIDGE } else { 0.0 };
                    logarithms.matrices[i * rows + j].0[lane] = moment + ridge;
                });
            }
            logarithms.take(simd, RIDGE);
            for (lane, out) in out.chunks_exact_mut(self.per_band()).enumerate() {
                let upper = (0..rows).flat_map(|i| (i..rows).map(move |j| (i, j)));
                for (feature, (i, j)) in out.iter_mut().zip(upper) {
                    let factor = if i == j { 1.0 } else { std::f64::consts::SQRT_2 };
                    *feature = factor * logarithms.matrices[j * rows + i].0[lane];
                }
            }
        }
    }
}

/// Sums of products of three axes with three.
type Tile = [[Pack<LANES>; TILE]; TILE];

/// Sums of products over the samples of a band so far.
#[derive(Clone, Debug)]
struct Moments {
    n_axes: usize,
    /// Instants from [`LAG`] on that are in the sums; those of a finished band are not to be added to.
    n_added: usize,
    /// Products of axes at the same instant, of all instants but the first two and the last.
    shared: Vec<Tile>,
    /// Products of later axes with earlier ones.
    lagged: Vec<Tile>,
}

impl Moments {
    fn new(n_axes: usize) -> Self {
        let tiles = vec![[[Pack::ZERO; TILE]; TILE]; n_axes.div_ceil(TILE).pow(2)];
        Self { n_axes, n_added: 0, shared: tiles.clone(), lagged: tiles }
    }

    /// Ready for the first sample of a band.
    fn restart(&mut self) {
        self.n_added = 0;
        self.shared.fill([[Pack::ZERO; TILE]; TILE]);
        self.lagged.fill([[Pack::ZERO; TILE]; TILE]);
    }

    /// The sums of another band of as many axes. Allocates nothing.
    fn copy(&mut self, other: &Self) {
        self.n_added = other.n_added;
        self.shared.copy_from_slice(&other.shared);
        self.lagged.copy_from_slice(&other.lagged);
    }

    /// Adds what no sample to come can change, once there is enough of it, and not much more at a time.
    #[inline(always)]
    fn advance(&mut self, simd: impl Vectors<f64, 4>, signals: BandSignals<'_>, band: usize) {
        let end = shared_end(signals.len(band));
        if end >= self.n_added + LEAST {
            let end = end.min(self.n_added + 2 * LEAST);
            self.add(simd, signals, band, end, end);
        }
    }

    /// Second moments of stacked samples of a band, all of which are there: the axes of one instant, then those [`LAG`]
    /// samples earlier. `write(i, j, moment)` is called once for each `i >= j`. All moments of [`LAG`] samples or fewer are
    /// zero.
    ///
    /// Nothing is subtracted, so that a moment is as exact as a sum of its products can be.
    #[inline(always)]
    fn finish(
        &mut self,
        simd: impl Vectors<f64, 4>,
        signals: BandSignals<'_>,
        band: usize,
        mut write: impl FnMut(usize, usize, f64),
    ) {
        let (n, n_axes) = (signals.len(band), self.n_axes);
        if n <= LAG {
            (0..2 * n_axes).for_each(|i| (0..=i).for_each(|j| write(i, j, 0.0)));
            return;
        }
        let lagged_end = (n - LAG) / LANES * LANES;
        let shared_end = shared_end(n);
        self.add(simd, signals, band, lagged_end, shared_end);
        // What is left, and what is of the later or of the earlier instants alone.
        let later = LAG + shared_end..n;
        let between = LAG + shared_end..n.saturating_sub(LAG).max(LAG + shared_end);
        let earlier = 0..LAG.min(n - LAG);
        let left = LAG + lagged_end..n;
        let count = (n - LAG) as f64;
        for i in 0..n_axes {
            let x = signals.axis(band, i);
            for j in 0..n_axes {
                let y = signals.axis(band, j);
                let add = |sum: f64, range: &std::ops::Range<usize>, lag: usize| {
                    let pairs = x[range.clone()].iter().zip(&y[range.start - lag..]);
                    pairs.fold(sum, |sum, (x, y)| sum + x * y)
                };
                let (tile, r, c) = self.tile(i, j);
                let sum = add(self.lagged[tile][r][c].sum(), &left, LAG);
                // The earlier comes second in the stack.
                write(n_axes + j, i, sum / count);
                if j <= i {
                    let sum = self.shared[tile][r][c].sum();
                    write(i, j, add(sum, &later, 0) / count);
                    write(n_axes + i, n_axes + j, add(add(sum, &between, 0), &earlier, 0) / count);
                }
            }
        }
    }

    /// The tile of a pair of axes, its row and its column.
    #[inline(always)]
    fn tile(&self, i: usize, j: usize) -> (usize, usize, usize) {
        (i / TILE * self.n_axes.div_ceil(TILE) + j / TILE, i % TILE, j % TILE)
    }

    /// Adds up products in whole vectors, chunk by chunk, of instants counted from [`LAG`]: lagged ones until `lagged_end`,
    /// shared ones until `shared_end`.
    #[inline(always)]
    fn add(
        &mut self,
        simd: impl Vectors<f64, 4>,
        signals: BandSignals<'_>,
        band: usize,
        lagged_end: usize,
        shared_end: usize,
    ) {
        let Self { n_axes, n_added: start, shared, lagged } = self;
        let side = n_axes.div_ceil(TILE);
        while *start < lagged_end {
            let len = CHUNK.min(lagged_end - *start);
            let shared_len = len.min(shared_end.saturating_sub(*start));
            // A tile at the edge takes the last axis more than once.
            let axis = |i: usize, r: usize| {
                &signals.axis(band, (TILE * i + r).min(*n_axes - 1))[*start..*start + len + LAG]
            };
            for i in 0..side {
                let rows = [&axis(i, 0)[LAG..], &axis(i, 1)[LAG..], &axis(i, 2)[LAG..]];
                for j in 0..side {
                    let columns = [axis(j, 0), axis(j, 1), axis(j, 2)];
                    add::<false>(simd, &mut lagged[i * side + j], rows, columns, len);
                    let columns = [&columns[0][LAG..], &columns[1][LAG..], &columns[2][LAG..]];
                    if j < i {
                        add::<false>(simd, &mut shared[i * side + j], rows, columns, shared_len);
                    } else if j == i {
                        add::<true>(simd, &mut shared[i * side + j], rows, columns, shared_len);
                    }
                }
            }
            *start += len;
        }
    }
}

/// Where whole vectors of shared products of `n` samples end, counted from [`LAG`].
fn shared_end(n: usize) -> usize {
    n.saturating_sub(2 * LAG) / LANES * LANES
}

/// Adds products of each row with each column, or only those on and below the diagonal.
#[inline(always)]
fn add<const TRIANGLE: bool>(
    simd: impl Vectors<f64, 4>,
    sums: &mut Tile,
    rows: [&[f64]; TILE],
    columns: [&[f64]; TILE],
    len: usize,
) {
    let n = len / LANES;
    let [x0, x1, x2] = rows;
    let [y0, y1, y2] = columns;
    let (x0, x1, x2) =
        (&x0.as_chunks::<LANES>().0[..n], &x1.as_chunks::<LANES>().0[..n], &x2.as_chunks::<LANES>().0[..n]);
    let (y0, y1, y2) =
        (&y0.as_chunks::<LANES>().0[..n], &y1.as_chunks::<LANES>().0[..n], &y2.as_chunks::<LANES>().0[..n]);
    let mut local = [[simd.splat(0.0); TILE]; TILE];
    for r in 0..TILE {
        for c in 0..TILE {
            local[r][c] = simd.load(&sums[r][c].0);
        }
    }
    for t in 0..n {
        let x = [simd.load(&x0[t]), simd.load(&x1[t]), simd.load(&x2[t])];
        // The rows themselves are the columns of a tile on the diagonal.
        let y = if TRIANGLE { x } else { [simd.load(&y0[t]), simd.load(&y1[t]), simd.load(&y2[t])] };
        for r in 0..TILE {
            for c in 0..TILE {
                if !TRIANGLE || r >= c {
                    local[r][c] = local[r][c] + x[r] * y[c];
                }
            }
        }
    }
    for r in 0..TILE {
        for c in 0..TILE {
            local[r][c].store(&mut sums[r][c].0);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::{same_on_every_path, Signals};
    use super::super::Region;
    use super::*;
    use crate::kernel::Portable;
    use crate::kernel::SimdPath;

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        signals.compute(&Coupling::new(&signals.lengths(), signals.n_axes), path)
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn only_bands_that_are_long_enough() {
        assert_eq!(Coupling::new(&[1600, 1600, 1600, 800, 400, 200, 100, 50, 25, 13], 6).n_bands, 8);
        assert_eq!(Coupling::new(&[10, 9], 1).n_bands, 1);
        assert_eq!(Coupling::new(&[49], 6).n_features(), 0);
    }

    #[test]
    fn silence_is_the_ridge() {
        let signals = Signals::from(vec![vec![vec![0.0; 30]; 1]]);
        let log = libm::log(RIDGE);
        assert_eq!(compute(SimdPath::Baseline, &signals), [log, 0.0, log]);
    }

    #[test]
    fn a_beginning_too_short_for_moments_is_the_ridge() {
        let design = Coupling::new(&[100], 1);
        let signals = Signals::from(vec![vec![vec![5.0; 2]; 1]]);
        assert_eq!(signals.compute(&design, SimdPath::Baseline), [libm::log(RIDGE), 0.0, libm::log(RIDGE)]);
    }

    #[test]
    fn what_overflows_is_not_hidden() {
        let signals = Signals::from(vec![vec![vec![1e200; 30]; 1]]);
        assert!(compute(SimdPath::Baseline, &signals).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn more_bands_than_fit_at_a_time() {
        let signals = Signals::new(&[60; 19], 2);
        let all = compute(SimdPath::detect().unwrap(), &signals);
        for (band, features) in all.chunks_exact(10).enumerate() {
            let alone = Signals::from(vec![signals.band(band)]);
            assert_eq!(features, compute(SimdPath::detect().unwrap(), &alone));
        }
    }

    /// By definition.
    fn slowly(axes: &[Vec<f64>], i: usize, j: usize) -> f64 {
        let n = axes[0].len();
        let stacked = |row: usize, t: usize| {
            let axis = row % axes.len();
            axes[axis][if row < axes.len() { t } else { t - LAG }]
        };
        (LAG..n).map(|t| stacked(i, t) * stacked(j, t)).sum::<f64>() / n.saturating_sub(LAG).max(1) as f64
    }

    proptest! {
        #[test]
        fn every_moment_by_definition(n in 1_usize..700, n_axes in 1_usize..8, seed in any::<u32>()) {
            let value = |k: usize| ((k as f64 + f64::from(seed)) * 0.731).sin() * if k.is_multiple_of(97) { 1e6 } else { 1.0 };
            let axes: Vec<Vec<f64>> = (0..n_axes).map(|a| (0..n).map(|t| value(a * n + t)).collect()).collect();
            let values = axes.concat();
            let regions = [Region { start: 0, stride: n, len: n }];
            let mut seen = 0;
            let mut moments = Moments::new(n_axes);
            let mut far = 0;
            moments.finish(Portable, BandSignals { values: &values, regions: &regions, n_axes }, 0, |i, j, got| {
                seen += 1;
                let size = (slowly(&axes, i, i) * slowly(&axes, j, j)).sqrt();
                far += usize::from(i < j || (got - slowly(&axes, i, j)).abs() > 1e-12 * size);
            });
            prop_assert_eq!((seen, far), (n_axes * (2 * n_axes + 1), 0));
        }

        #[test]
        fn sums_that_grew_with_their_band_have_the_same_bits(cuts in prop::collection::vec(1_usize..300, 0..8), n_axes in 1_usize..7) {
            let n = 700;
            let values: Vec<f64> = (0..n * n_axes).map(|k| (k as f64 * 0.731).sin()).collect();
            let seen = |len| [Region { start: 0, stride: n, len }];
            let finished = |moments: &Moments| {
                let (mut whole, mut out, regions) = (Moments::new(n_axes), Vec::new(), seen(n));
                whole.copy(moments);
                let signals = BandSignals { values: &values, regions: &regions, n_axes };
                whole.finish(Portable, signals, 0, |_, _, moment| out.push(moment.to_bits()));
                out
            };
            let expected = finished(&Moments::new(n_axes));
            let mut moments = Moments::new(n_axes);
            let mut len = 0;
            for cut in cuts {
                len = (len + cut).min(n);
                let (before, regions) = (moments.n_added, seen(len));
                moments.advance(Portable, BandSignals { values: &values, regions: &regions, n_axes }, 0);
                let end = shared_end(len);
                let added = if end < before + LEAST { 0 } else { (end - before).min(2 * LEAST) };
                prop_assert_eq!(moments.n_added, before + added);
            }
            prop_assert!(finished(&moments) == expected);
        }
    }
}
