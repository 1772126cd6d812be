//! Second moments of the axes of a band, and of the axes with themselves two samples earlier.

use super::pack::Pack;

/// Samples of the earlier of two instants before the later.
pub(super) const LAG: usize = 2;

/// Axes of a tile: nine sums at a time stay in registers and hide the latency of addition.
const TILE: usize = 3;

/// Partial sums per product.
const LANES: usize = 4;

/// Second moments of stacked samples: the axes of one instant, then those [`LAG`] samples earlier. `write(i, j, moment)` is
/// called for each `i >= j`. All moments of a signal of [`LAG`] samples or fewer are zero.
///
/// Nothing is subtracted, so that a moment is as exact as a sum of its products can be.
#[inline(always)]
pub(super) fn lagged<'a>(
    axes: impl Fn(usize) -> &'a [f64],
    n_axes: usize,
    mut write: impl FnMut(usize, usize, f64),
) {
    let n = if n_axes == 0 { 0 } else { axes(0).len() };
    if n <= LAG {
        (0..2 * n_axes).for_each(|i| (0..=i).for_each(|j| write(i, j, 0.0)));
        return;
    }
    let count = (n - LAG) as f64;
    // What the moments of both instants share; the last samples are of the later alone, the first of the earlier alone.
    let shared = LAG..n.saturating_sub(LAG).max(LAG);
    let last = shared.end..n;
    let first = 0..LAG.min(n - LAG);
    let tiles = (0..n_axes).step_by(TILE);
    for i in tiles.clone() {
        for j in tiles.clone() {
            // A tile at the edge takes the last axis more than once.
            let rows: [&[f64]; TILE] = std::array::from_fn(|r| axes((i + r).min(n_axes - 1)));
            let columns: [&[f64]; TILE] = std::array::from_fn(|c| axes((j + c).min(n_axes - 1)));
            let in_tile = |r: usize, c: usize| i + r < n_axes && j + c < n_axes;
            // Later times earlier; the earlier comes second in the stack.
            let sums = products::<false>(columns.map(|y| &y[LAG..]), rows.map(|y| &y[..n - LAG]));
            for (c, r) in pairs().filter(|(c, r)| in_tile(*r, *c)) {
                write(n_axes + i + r, j + c, sums[c][r] / count);
            }
            if j > i {
                continue;
            }
            let (rows_shared, columns_shared) =
                (rows.map(|y| &y[shared.clone()]), columns.map(|y| &y[shared.clone()]));
            let sums = if i == j {
                products::<true>(rows_shared, columns_shared)
            } else {
                products::<false>(rows_shared, columns_shared)
            };
            for (r, c) in pairs().filter(|(r, c)| in_tile(*r, *c) && (i > j || r >= c)) {
                let with = |range: &std::ops::Range<usize>| {
                    let ends = rows[r][range.clone()].iter().zip(&columns[c][range.clone()]);
                    ends.fold(sums[r][c], |sum, (a, b)| sum + a * b) / count
                };
                write(i + r, j + c, with(&last));
                write(n_axes + i + r, n_axes + j + c, with(&first));
            }
        }
    }
}

#[inline(always)]
fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..TILE).flat_map(|r| (0..TILE).map(move |c| (r, c)))
}

/// Sums over time of the products of each row with each column, or only of those on and below the diagonal.
#[inline(always)]
fn products<const TRIANGLE: bool>(rows: [&[f64]; TILE], columns: [&[f64]; TILE]) -> [[f64; TILE]; TILE] {
    let n = rows[0].len();
    let whole = n - n % LANES;
    let mut sums = [[Pack::<LANES>::ZERO; TILE]; TILE];
    let (heads, tails) = (rows.map(|y| &y[..whole]), columns.map(|y| &y[..whole]));
    let mut t = 0;
    while t < whole {
        let x = [0, 1, 2].map(|r| Pack::load(&heads[r][t..]));
        let y = [0, 1, 2].map(|c| Pack::load(&tails[c][t..]));
        for r in 0..TILE {
            for c in 0..TILE {
                if !TRIANGLE || r >= c {
                    sums[r][c] = sums[r][c] + x[r] * y[c];
                }
            }
        }
        t += LANES;
    }
    let mut out = [[0.0; TILE]; TILE];
    for (r, c) in pairs() {
        let rest = rows[r][whole..n].iter().zip(&columns[c][whole..n]);
        out[r][c] = rest.fold(sums[r][c].sum(), |sum, (a, b)| sum + a * b);
    }
    out
}
