//! How axes move together in a band: the matrix of their second moments, now and two samples earlier, of which
//! [sums of resolvents](Resolvents) are taken. These are logarithms that level off.
//!
//! Logarithms of covariances make differences of ratios, and their Euclidean distances sensible: Arsigny et al.,
//! "Log-Euclidean metrics for fast and simple calculus on diffusion tensors" (2006); Barachant et al., "Multiclass
//! brain-computer interface classification by Riemannian geometry" (2012).

use super::resolvents::{Resolvents, MATRICES};
use super::spec::halves_early;
use super::{BandSignals, Region, Split, Statistic, LANES};
use crate::dsp::Real;
use crate::kernel::{Pack, Register, Simd, Vectors};

/// Stacked samples per row of a matrix at least; fewer leave little but chance in it.
const MIN_SAMPLES: usize = 4;

/// Samples of the earlier of two instants before the later, where a band has not half its usual rate.
pub(super) const LAG: usize = 2;

/// Axes of a tile: nine sums at a time stay in registers and hide the latency of addition.
const TILE: usize = 3;

/// Samples that are multiplied at a time: a dozen axes of them stay in the first-level cache.
const CHUNK: usize = 256;

/// Samples of a tail: a vector, and what it looks back to.
const TAIL: usize = LANES + LAG;

/// Samples of a band that are worth adding up before the others are there.
const LEAST: usize = 64;

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
    /// Those of them that are added up while they grow.
    growing: Vec<(usize, usize)>,
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct CouplingWork {
    /// Bands that are long enough to be added up while they grow.
    growing: Vec<(usize, Moments)>,
    /// Those of the band whose turn it is, of all its samples.
    whole: Moments,
    resolvents: Resolvents,
}

impl CouplingWork {
    /// Ready for the first sample of a recording.
    pub(super) fn restart(&mut self) {
        for (_, moments) in &mut self.growing {
            moments.restart(moments.lag);
        }
    }

    /// Adds up what there is of the octaves.
    #[inline(always)]
    pub(super) fn advance(&mut self, simd: impl Vectors<f32, LANES>, signals: BandSignals<'_>) {
        for (band, moments) in &mut self.growing {
            moments.advance(simd, signals, *band);
        }
    }
}

impl Coupling {
    /// For bands of some numbers of samples, the first of which are those of a recording.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        // Octave 2 may have half its usual rate.
        let early = halves_early(lengths[0]);
        let lags = (0..lengths.len()).map(|band| (band, if early && band == 2 { LAG / 2 } else { LAG }));
        let bands: Vec<_> =
            lags.filter(|(band, lag)| lengths[*band] >= least_samples(n_axes, *lag)).collect();
        // Band 0 is there once its mean is.
        let grows = |(band, _): &(usize, usize)| *band > 0 && lengths[*band] >= 2 * LEAST;
        let growing = bands.iter().copied().filter(grows).collect();
        Self { n_axes, bands, growing }
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
    type Work = CouplingWork;

    fn n_features(&self) -> usize {
        self.bands.len() * self.per_band()
    }

    fn work(&self) -> CouplingWork {
        CouplingWork {
            growing: self
                .growing
                .iter()
                .map(|(band, lag)| (*band, Moments::new(self.n_axes, *lag)))
                .collect(),
            whole: Moments::new(self.n_axes, LAG),
            resolvents: Resolvents::new(2 * self.n_axes),
        }
    }

    /// Band by band the [cells](Self::cells); those at one instant as the mean of both instants.
    #[inline(always)]
    fn compute(&self, simd: impl Simd, split: Split<'_>, work: &mut CouplingWork, out: &mut [f64]) {
        let (n, rows) = (self.n_axes, 2 * self.n_axes);
        let CouplingWork { growing, whole, resolvents } = work;
        let groups = self.bands.chunks(MATRICES).zip(out.chunks_mut(MATRICES * self.per_band()));
        for (bands, out) in groups {
            for (lane, &(band, lag)) in bands.iter().enumerate() {
                match growing.iter().find(|(growing, _)| *growing == band) {
                    Some((_, so_far)) => whole.copy(so_far),
                    None => whole.restart(lag),
                }
                whole.finish(simd, split.signals, band, |i, j, moment| {
                    resolvents.matrices[i * rows + j].0[lane] = moment;
                });
            }
            resolvents.take(simd);
            for (lane, out) in out.chunks_exact_mut(self.per_band()).enumerate() {
                for (feature, (i, j)) in out.iter_mut().zip(self.cells()) {
                    let cell = |row: usize, column: usize| resolvents.matrices[row * rows + column].0[lane];
                    *feature = if j < n { 0.5 * (cell(j, i) + cell(n + j, n + i)) } else { cell(j, i) };
                }
            }
        }
    }
}

/// Sums of products of three axes with three.
type Tile = [[Pack<f32, LANES>; TILE]; TILE];

/// Sums of products over the samples of a band so far.
#[derive(Clone, Debug)]
struct Moments {
    n_axes: usize,
    /// Samples of the earlier of two instants before the later.
    lag: usize,
    /// Instants from the lag on that are in the sums; those of a finished band are not to be added to.
    n_added: usize,
    /// Products of axes at the same instant, of all instants but those within the lag of the first and the last.
    shared: Vec<Tile>,
    /// Products of later axes with earlier ones.
    lagged: Vec<Tile>,
    /// The last samples of each axis, followed by zeros.
    tails: Vec<f32>,
}

impl Moments {
    fn new(n_axes: usize, lag: usize) -> Self {
        let tiles = vec![[[Pack::ZERO; TILE]; TILE]; n_axes.div_ceil(TILE).pow(2)];
        Self {
            n_axes,
            lag,
            n_added: 0,
            shared: tiles.clone(),
            lagged: tiles,
            tails: vec![0.0; n_axes * TAIL],
        }
    }

    /// Ready for the first sample of a band.
    fn restart(&mut self, lag: usize) {
        (self.lag, self.n_added) = (lag, 0);
        self.shared.fill([[Pack::ZERO; TILE]; TILE]);
        self.lagged.fill([[Pack::ZERO; TILE]; TILE]);
    }

    /// The sums of another band of as many axes. Allocates nothing.
    fn copy(&mut self, other: &Self) {
        (self.lag, self.n_added) = (other.lag, other.n_added);
        self.shared.copy_from_slice(&other.shared);
        self.lagged.copy_from_slice(&other.lagged);
    }

    /// Adds what no sample to come can change, once there is enough of it, and not much more at a time.
    #[inline(always)]
    fn advance(&mut self, simd: impl Vectors<f32, LANES>, signals: BandSignals<'_>, band: usize) {
        let end = shared_end(signals.len(band), self.lag);
        if end >= self.n_added + LEAST {
            let end = end.min(self.n_added + 2 * LEAST);
            self.add(simd, signals, band, end, end);
        }
    }

    /// Second moments of stacked samples of a band, all of which are there: the axes of one instant, then those a lag
    /// earlier. `write(i, j, moment)` is called once for each `i >= j`. All moments of no more samples than the lag are zero.
    ///
    /// Nothing is subtracted, so that a moment is as exact as a sum of its products can be. What is left over by whole vectors
    /// is another vector, filled up with zeros.
    #[inline(always)]
    fn finish(
        &mut self,
        simd: impl Vectors<f32, LANES>,
        signals: BandSignals<'_>,
        band: usize,
        mut write: impl FnMut(usize, usize, f64),
    ) {
        let (n, n_axes, lag) = (signals.len(band), self.n_axes, self.lag);
        if n <= lag {
            (0..2 * n_axes).for_each(|i| (0..=i).for_each(|j| write(i, j, 0.0)));
            return;
        }
        let [lagged_end, shared_end] = [(n - lag) / LANES * LANES, shared_end(n, lag)];
        self.add(simd, signals, band, lagged_end, shared_end);
        if lagged_end < n - lag {
            self.add_tail(simd, signals, band, lagged_end..n, [LANES, 0]);
        }
        if lag + shared_end < n.saturating_sub(lag) {
            self.add_tail(simd, signals, band, shared_end..n - lag, [0, LANES]);
        }
        // What is of the later or of the earlier instants alone.
        let (later, earlier) = (lag.max(n - lag)..n, 0..lag.min(n - lag));
        let share = ((n - lag) as f64).recip();
        for i in 0..n_axes {
            let x = signals.axis(band, i);
            for j in 0..n_axes {
                let (tile, r, c) = self.tile(i, j);
                // The earlier comes second in the stack.
                write(n_axes + j, i, self.lagged[tile][r][c].sum().value() * share);
                if j <= i {
                    let y = signals.axis(band, j);
                    let sum = self.shared[tile][r][c].sum();
                    for (first, range) in [(0, &later), (n_axes, &earlier)] {
                        let mut sum = sum;
                        for (x, y) in x[range.clone()].iter().zip(&y[range.clone()]) {
                            sum += x * y;
                        }
                        write(first + i, first + j, sum.value() * share);
                    }
                }
            }
        }
    }

    /// The tile of a pair of axes, its row and its column.
    #[inline(always)]
    fn tile(&self, i: usize, j: usize) -> (usize, usize, usize) {
        (i / TILE * self.n_axes.div_ceil(TILE) + j / TILE, i % TILE, j % TILE)
    }

    /// Adds up products in whole vectors, chunk by chunk, of instants counted from the lag: lagged ones until `lagged_end`,
    /// shared ones until `shared_end`.
    #[inline(always)]
    fn add(
        &mut self,
        simd: impl Vectors<f32, LANES>,
        signals: BandSignals<'_>,
        band: usize,
        lagged_end: usize,
        shared_end: usize,
    ) {
        while self.n_added < lagged_end {
            let len = CHUNK.min(lagged_end - self.n_added);
            let shared_len = len.min(shared_end.saturating_sub(self.n_added));
            let Self { lag, n_added, shared, lagged, .. } = self;
            add_chunk(simd, signals, band, *n_added, *lag, [lagged, shared], [len, shared_len]);
            *n_added += len;
        }
    }

    /// Adds the products of some last samples, all but a lag of which are fewer than a vector; either lagged or shared ones.
    #[inline(always)]
    fn add_tail(
        &mut self,
        simd: impl Vectors<f32, LANES>,
        signals: BandSignals<'_>,
        band: usize,
        samples: std::ops::Range<usize>,
        lens: [usize; 2],
    ) {
        let Self { n_axes, lag, shared, lagged, tails, .. } = self;
        tails.fill(0.0);
        for (axis, tail) in tails.as_chunks_mut::<TAIL>().0.iter_mut().enumerate() {
            for (to, x) in tail.iter_mut().zip(&signals.axis(band, axis)[samples.clone()]) {
                *to = *x;
            }
        }
        let region = Region { start: 0, stride: TAIL, len: TAIL };
        let tails = BandSignals { values: tails, regions: &[region], n_axes: *n_axes };
        add_chunk(simd, tails, 0, 0, *lag, [lagged, shared], lens);
    }
}

/// Adds products of instants of a band from `start` on, counted from the lag, to lagged and to shared sums; so many of each.
#[inline(always)]
fn add_chunk(
    simd: impl Vectors<f32, LANES>,
    signals: BandSignals<'_>,
    band: usize,
    start: usize,
    lag: usize,
    [lagged, shared]: [&mut [Tile]; 2],
    [lagged_len, shared_len]: [usize; 2],
) {
    let side = signals.n_axes.div_ceil(TILE);
    let len = lagged_len.max(shared_len);
    for i in 0..side {
        let rows = tile_axes(signals, band, i).map(|axis| &axis[start + lag..][..len]);
        for j in 0..side {
            let columns = tile_axes(signals, band, j);
            let earlier = columns.map(|axis| &axis[start..][..len]);
            add::<false>(simd, &mut lagged[i * side + j], rows, earlier, lagged_len);
            let columns = columns.map(|axis| &axis[start + lag..][..len]);
            if j < i {
                add::<false>(simd, &mut shared[i * side + j], rows, columns, shared_len);
            } else if j == i {
                add::<true>(simd, &mut shared[i * side + j], rows, columns, shared_len);
            }
        }
    }
}

/// The axes of a row of tiles. A tile at the edge takes the last axis more than once.
#[inline(always)]
fn tile_axes(signals: BandSignals<'_>, band: usize, i: usize) -> [&[f32]; TILE] {
    let axis = |r: usize| signals.axis(band, (TILE * i + r).min(signals.n_axes - 1));
    [axis(0), axis(1), axis(2)]
}

/// Where whole vectors of shared products of `n` samples end, counted from the lag.
fn shared_end(n: usize, lag: usize) -> usize {
    n.saturating_sub(2 * lag) / LANES * LANES
}

/// Adds products of each row with each column, or only those on and below the diagonal.
#[inline(always)]
fn add<const TRIANGLE: bool>(
    simd: impl Vectors<f32, LANES>,
    sums: &mut Tile,
    rows: [&[f32]; TILE],
    columns: [&[f32]; TILE],
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
        let bands = |lengths: &[usize], n_axes| {
            let bands = Coupling::new(lengths, n_axes).bands;
            bands.into_iter().map(|(band, _)| band).collect::<Vec<_>>()
        };
        assert_eq!(bands(&[1600, 1600, 800, 800, 400, 200, 100, 50, 25, 13], 6), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(bands(&[107, 107, 54, 54, 27, 14], 13), [0, 1, 2]);
        assert_eq!(bands(&[106, 106, 53, 53, 27, 14], 13), [0, 1]);
        assert!(bands(&[105, 105, 53, 53, 27, 14], 13).is_empty());
        // Too short to halve the rate early.
        assert_eq!(bands(&[50, 50, 50, 25], 6), [0, 1, 2]);
        assert_eq!(bands(&[10, 9], 1), [0]);
        assert!(bands(&[49], 6).is_empty());
    }

    /// Of one axis whose moments are all zero.
    const FLOOR: [f64; 2] = [-2.0, 0.0];

    #[test]
    fn silence_is_the_floor() {
        let signals = Signals::from(vec![vec![vec![0.0; 30]; 1]]);
        assert_eq!(compute(SimdPath::Baseline, &signals), FLOOR);
    }

    #[test]
    fn a_beginning_too_short_for_moments_is_the_floor() {
        let signals = Signals::from(vec![vec![vec![5.0; 2]; 1]]);
        let design = Coupling::new(&[100], 1);
        assert_eq!(signals.compute(&design, SimdPath::Baseline), FLOOR);
    }

    #[test]
    fn what_overflows_is_not_hidden() {
        let signals = Signals::from(vec![vec![vec![1e30; 30]; 1]]);
        assert!(compute(SimdPath::Baseline, &signals).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn more_bands_than_fit_at_a_time() {
        let signals = Signals::new(&[60; 19], 2);
        let all = compute(SimdPath::detect().unwrap(), &signals);
        for (band, features) in all.chunks_exact(7).enumerate() {
            let alone = Signals::from(vec![signals.band(band)]);
            assert_eq!(features, compute(SimdPath::detect().unwrap(), &alone));
        }
    }

    /// By definition.
    fn slowly(axes: &[Vec<f32>], lag: usize, i: usize, j: usize) -> f64 {
        let n = axes[0].len();
        let stacked = |row: usize, t: usize| {
            let axis = row % axes.len();
            axes[axis][if row < axes.len() { t } else { t - lag }].value()
        };
        (lag..n).map(|t| stacked(i, t) * stacked(j, t)).sum::<f64>() / n.saturating_sub(lag).max(1) as f64
    }

    proptest! {
        #[test]
        fn every_moment_by_definition(n in 1_usize..700, n_axes in 1_usize..8, lag in 1..=LAG, seed in any::<u32>()) {
            let value = |k: usize| f32::of(((k as f64 + f64::from(seed)) * 0.731).sin() * if k.is_multiple_of(97) { 1e3 } else { 1.0 });
            let axes: Vec<Vec<f32>> = (0..n_axes).map(|a| (0..n).map(|t| value(a * n + t)).collect()).collect();
            let values = axes.concat();
            let regions = [Region { start: 0, stride: n, len: n }];
            let mut seen = 0;
            let mut moments = Moments::new(n_axes, lag);
            let mut far = 0;
            moments.finish(Portable, BandSignals { values: &values, regions: &regions, n_axes }, 0, |i, j, got| {
                seen += 1;
                let size = (slowly(&axes, lag, i, i) * slowly(&axes, lag, j, j)).sqrt();
                far += usize::from(i < j || (got - slowly(&axes, lag, i, j)).abs() > 1e-6 * size);
            });
            prop_assert_eq!((seen, far), (n_axes * (2 * n_axes + 1), 0));
        }

        #[test]
        fn sums_that_grew_with_their_band_have_the_same_bits(cuts in prop::collection::vec(1_usize..300, 0..8), n_axes in 1_usize..7, lag in 1..=LAG) {
            let n = 700;
            let values: Vec<f32> = (0..n * n_axes).map(|k| f32::of((k as f64 * 0.731).sin())).collect();
            let seen = |len| [Region { start: 0, stride: n, len }];
            let finished = |moments: &Moments| {
                let (mut whole, mut out, regions) = (Moments::new(n_axes, LAG), Vec::new(), seen(n));
                whole.copy(moments);
                let signals = BandSignals { values: &values, regions: &regions, n_axes };
                whole.finish(Portable, signals, 0, |_, _, moment| out.push(moment.to_bits()));
                out
            };
            let expected = finished(&Moments::new(n_axes, lag));
            let mut moments = Moments::new(n_axes, lag);
            let mut len = 0;
            for cut in cuts {
                len = (len + cut).min(n);
                let (before, regions) = (moments.n_added, seen(len));
                moments.advance(Portable, BandSignals { values: &values, regions: &regions, n_axes }, 0);
                let end = shared_end(len, lag);
                let added = if end < before + LEAST { 0 } else { (end - before).min(2 * LEAST) };
                prop_assert_eq!(moments.n_added, before + added);
            }
            prop_assert!(finished(&moments) == expected);
        }
    }
}
