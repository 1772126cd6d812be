//! Second moments of the axes of a band, and of the axes with themselves two samples earlier.

use super::band_signals::BandSignals;
use crate::kernel::{Pack, Quad};

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

/// Sums of products of three axes with three.
type Tile = [[Pack<LANES>; TILE]; TILE];

/// Sums of products over the samples of a band so far.
#[derive(Clone, Debug)]
pub(super) struct Moments {
    n_axes: usize,
    /// Instants from [`LAG`] on that are in the sums; those of a finished band are not to be added to.
    n_added: usize,
    /// Products of axes at the same instant, of all instants but the first two and the last.
    shared: Vec<Tile>,
    /// Products of later axes with earlier ones.
    lagged: Vec<Tile>,
}

impl Moments {
    pub(super) fn new(n_axes: usize) -> Self {
        let tiles = vec![[[Pack::ZERO; TILE]; TILE]; n_axes.div_ceil(TILE).pow(2)];
        Self { n_axes, n_added: 0, shared: tiles.clone(), lagged: tiles }
    }

    /// Ready for the first sample of a band.
    pub(super) fn restart(&mut self) {
        self.n_added = 0;
        self.shared.fill([[Pack::ZERO; TILE]; TILE]);
        self.lagged.fill([[Pack::ZERO; TILE]; TILE]);
    }

    /// The sums of another band of as many axes. Allocates nothing.
    pub(super) fn copy(&mut self, other: &Self) {
        self.n_added = other.n_added;
        self.shared.copy_from_slice(&other.shared);
        self.lagged.copy_from_slice(&other.lagged);
    }

    /// Whether a band of so many samples is worth adding up while it grows.
    pub(super) fn can_grow(n: usize) -> bool {
        n >= 2 * LEAST
    }

    /// Adds what no sample to come can change, once there is enough of it, and not much more at a time.
    #[inline(always)]
    pub(super) fn advance<V: Quad>(&mut self, signals: BandSignals<'_>, band: usize) {
        let end = shared_end(signals.len(band));
        if end >= self.n_added + LEAST {
            let end = end.min(self.n_added + 2 * LEAST);
            self.add::<V>(signals, band, end, end);
        }
    }

    /// Second moments of stacked samples of a band, all of which are there: the axes of one instant, then those [`LAG`]
    /// samples earlier. `write(i, j, moment)` is called once for each `i >= j`. All moments of [`LAG`] samples or fewer are
    /// zero.
    ///
    /// Nothing is subtracted, so that a moment is as exact as a sum of its products can be.
    #[inline(always)]
    pub(super) fn finish<V: Quad>(
        &mut self,
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
        self.add::<V>(signals, band, lagged_end, shared_end);
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
                let (tile, r, c) = self.place(i, j);
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
    fn place(&self, i: usize, j: usize) -> (usize, usize, usize) {
        (i / TILE * self.n_axes.div_ceil(TILE) + j / TILE, i % TILE, j % TILE)
    }

    /// Adds up products in whole vectors, chunk by chunk, of instants counted from [`LAG`]: lagged ones until `lagged_end`,
    /// shared ones until `shared_end`.
    #[inline(always)]
    fn add<V: Quad>(&mut self, signals: BandSignals<'_>, band: usize, lagged_end: usize, shared_end: usize) {
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
                    add::<V, false>(&mut lagged[i * side + j], rows, columns, len);
                    let columns = [&columns[0][LAG..], &columns[1][LAG..], &columns[2][LAG..]];
                    if j < i {
                        add::<V, false>(&mut shared[i * side + j], rows, columns, shared_len);
                    } else if j == i {
                        add::<V, true>(&mut shared[i * side + j], rows, columns, shared_len);
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
fn add<V: Quad, const TRIANGLE: bool>(
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
    let mut local = [[V::splat(0.0); TILE]; TILE];
    for r in 0..TILE {
        for c in 0..TILE {
            local[r][c] = V::load(&sums[r][c].0);
        }
    }
    for t in 0..n {
        let x = [V::load(&x0[t]), V::load(&x1[t]), V::load(&x2[t])];
        // The rows themselves are the columns of a tile on the diagonal.
        let y = if TRIANGLE { x } else { [V::load(&y0[t]), V::load(&y1[t]), V::load(&y2[t])] };
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

    use super::super::band_signals::Place;
    use super::*;

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
            let places = [Place { start: 0, stride: n, len: n }];
            let mut seen = 0;
            let mut moments = Moments::new(n_axes);
            let mut far = 0;
            moments.finish::<Pack<4>>(BandSignals::new(&values, &places, n_axes), 0, |i, j, got| {
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
            let seen = |len| [Place { start: 0, stride: n, len }];
            let finished = |moments: &Moments| {
                let (mut whole, mut out, places) = (Moments::new(n_axes), Vec::new(), seen(n));
                whole.copy(moments);
                let signals = BandSignals::new(&values, &places, n_axes);
                whole.finish::<Pack<4>>(signals, 0, |_, _, moment| out.push(moment.to_bits()));
                out
            };
            let expected = finished(&Moments::new(n_axes));
            let mut moments = Moments::new(n_axes);
            let mut len = 0;
            for cut in cuts {
                len = (len + cut).min(n);
                let (before, places) = (moments.n_added, seen(len));
                moments.advance::<Pack<4>>(BandSignals::new(&values, &places, n_axes), 0);
                let end = shared_end(len);
                let added = if end < before + LEAST { 0 } else { (end - before).min(2 * LEAST) };
                prop_assert_eq!(moments.n_added, before + added);
            }
            prop_assert!(finished(&moments) == expected);
        }
    }
}
