//! Counting values of 24 lanes into 24 histograms at once.
//!
//! A value's cell is found by arithmetic, not by a search: `cell = value * scale + offset`, where cell 0 collects
//! what lies below the range, 1..=n the bins, n + 1 what lies above. Adding 2^20 puts the integer part of the
//! cell into the high word of the float64 and the fraction, in units of 2^-32, into the low word. A fraction
//! within rounding distance of 0 or 1 means that the value is next to an edge: that row is counted again by
//! comparison with the float edges. So the counts are exact, and almost no value pays for it.

use super::path::Isa;
use super::{flat, flat_mut, Row, Vector, LANES, MAX_WIDTH};
use crate::histogram::{UniformBins, MAX_BINS};

/// 2^20: a float64 between it and 2^21 has 32 bits of fraction.
const MAGIC: f64 = 1_048_576.0;

/// The high word of [`MAGIC`].
const MAGIC_HIGH: u32 = 0x4130_0000;

/// All cells of a row fit in the twenty integer bits below [`MAGIC`].
const _: () = assert!(MAX_WIDTH * LANES * (MAX_BINS + 2) < 1 << 20);

/// Rows whose cells are found before any of them is counted: arithmetic and counting then overlap.
const ROWS: usize = 4;

/// One row of `MAGIC + cell`, as bits.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Cells<const W: usize>(pub(crate) [[u64; LANES]; W]);

/// Histogram parameters of a row of lanes.
#[derive(Clone, Debug)]
pub(crate) struct LaneBins<'a, const W: usize> {
    pub(crate) scale: Row<W>,
    pub(crate) offset: Row<W>,
    /// `MAGIC` plus the first cell of the lane.
    pub(crate) base: Row<W>,
    /// The middle of the cell above the range.
    pub(crate) top: f64,
    /// A fraction of at most this, in units of 2^-32, is next to an edge.
    pub(crate) limit: u32,
    lanes: Vec<&'a UniformBins>,
    stride: usize,
}

impl<'a, const W: usize> LaneBins<'a, W> {
    /// Parameters for `lanes`, one set of bins per lane in use; all must have the same number of bins.
    pub(crate) fn new(lanes: Vec<&'a UniformBins>) -> Self {
        let n_bins = lanes.first().map_or(1, |bins| bins.n_bins());
        let stride = n_bins + 2;
        let margin = lanes.iter().map(|bins| margin(bins)).max().unwrap_or(2);
        let mut this = Self {
            scale: [Vector::ZERO; W],
            offset: [Vector([1.5; LANES]); W],
            base: [Vector::ZERO; W],
            top: n_bins as f64 + 1.5,
            limit: margin.saturating_mul(2),
            lanes,
            stride,
        };
        for (lane, bins) in this.lanes.iter().enumerate() {
            let scale = bins.scale();
            flat_mut(&mut this.scale)[lane] = scale;
            // Shifted by the margin, so that "next to an edge" is one comparison instead of two.
            let shift = f64::from(margin) / 4_294_967_296.0;
            flat_mut(&mut this.offset)[lane] = 1.0 - bins.low() * scale + shift;
        }
        // Lanes without a channel count as well, in histograms of their own that nobody reads.
        for (lane, base) in flat_mut(&mut this.base).iter_mut().enumerate() {
            *base = MAGIC + (lane * stride) as f64;
        }
        this
    }
}

/// How far the quick arithmetic can be off, in units of 2^-32 of a bin, rounded up; `u32::MAX` when it is useless for
/// these bins, so that every value is compared.
fn margin(bins: &UniformBins) -> u32 {
    let reach = bins.low().abs().max(bins.high().abs()) * bins.scale();
    let error = 16.0 * f64::EPSILON * (reach + bins.n_bins() as f64 + 2.0) * 4_294_967_296.0;
    // The sum itself is rounded to 2^-32: two units cover that. A NaN or huge error saturates.
    if error < f64::from(1u32 << 29) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 <= error < 2^29
        let units = error.ceil() as u32;
        units + 2
    } else {
        u32::MAX
    }
}

/// Histograms of the lanes of a row.
#[derive(Clone, Debug)]
pub(crate) struct Tally {
    counts: Vec<u32>,
    stride: usize,
}

impl Tally {
    /// Empty histograms for `width` vectors of lanes and `n_bins` bins.
    pub(crate) fn new(width: usize, n_bins: usize) -> Self {
        let stride = n_bins + 2;
        Self { counts: vec![0; width * LANES * stride], stride }
    }

    /// Back to no counts.
    pub(crate) fn clear(&mut self) {
        self.counts.fill(0);
    }

    /// Counts of one lane: below the range, the bins, above the range.
    pub(crate) fn lane(&self, lane: usize) -> &[u32] {
        &self.counts[lane * self.stride..][..self.stride]
    }

    /// Adds rows of values.
    #[inline(always)]
    pub(crate) fn add<I: Isa, const W: usize>(&mut self, bins: &LaneBins<W>, rows: &[Row<W>]) {
        // One check for all the unchecked writes below: cells are clamped to the histograms of the lanes.
        assert!(
            bins.stride == self.stride && self.counts.len() >= W * LANES * self.stride,
            "histograms must fit"
        );
        let mut cells = [Cells([[0; LANES]; W]); ROWS];
        // The high word of a cell counts from `MAGIC_HIGH`. Hidden from the compiler, which would subtract it again for
        // every value.
        let origin = std::hint::black_box(self.counts.as_mut_ptr().wrapping_sub(MAGIC_HIGH as usize));
        for rows in rows.chunks(ROWS) {
            for (row, cells) in rows.iter().zip(&mut cells) {
                if I::cells(bins, row, cells) {
                    settle(bins, row, cells);
                }
            }
            for cells in &cells[..rows.len()] {
                add_cells(origin, cells);
            }
        }
    }
}

/// Decides by comparison with the float edges what the quick arithmetic could not.
///
/// Never inlined, but not rare: a silent axis is 0, and with an even number of bins 0 is an edge.
#[inline(never)]
fn settle<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) {
    let lanes = bins.lanes.iter().zip(flat(row)).zip(cells.0.as_flattened_mut()).enumerate();
    for (lane, ((bins_of_lane, value), bits)) in lanes {
        #[allow(clippy::cast_possible_truncation)] // the low word is the fraction
        let fraction = *bits as u32;
        if fraction > bins.limit {
            continue;
        }
        let first = lane * bins.stride;
        let n_bins = bins_of_lane.n_bins();
        let cell = if bins.limit == u32::MAX {
            match bins_of_lane.locate(*value) {
                Some(bin) => 1 + bin,
                None if *value > bins_of_lane.high() => 1 + n_bins,
                None => 0,
            }
        } else {
            // Next to one edge; the cell below it has the same number.
            let edge = (*bits >> 32) as usize - MAGIC_HIGH as usize - first - 1;
            let right = if edge == n_bins {
                *value > bins_of_lane.high()
            } else {
                *value >= bins_of_lane.edges()[edge]
            };
            edge + usize::from(right)
        };
        *bits = (u64::from(MAGIC_HIGH) + (first + cell) as u64) << 32;
    }
}

/// Adds one to every cell of a row; `origin` lies `MAGIC_HIGH` before the counts.
#[allow(unsafe_code)]
#[inline(always)]
fn add_cells<const W: usize>(origin: *mut u32, cells: &Cells<W>) {
    // Through memory: taking the numbers out of vector registers one by one is slower.
    let cells = std::hint::black_box(cells);
    for vector in &cells.0 {
        for bits in vector {
            let cell = (*bits >> 32) as usize;
            // SAFETY: cells are clamped to lane * stride .. (lane + 1) * stride, counted from `MAGIC_HIGH` as `origin` is,
            // and `add` has checked that `counts` holds the histograms of all W * LANES lanes.
            unsafe { *origin.wrapping_add(cell) += 1 };
        }
    }
}

/// Plain-loop twin of the vector code in `x86.rs`. NaN compares false and ends in cell 0.
#[inline(always)]
pub(super) fn cells<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
    let mut nearest = u32::MAX;
    for (w, vector) in row.iter().enumerate() {
        for l in 0..LANES {
            let cell = vector.0[l] * bins.scale[w].0[l] + bins.offset[w].0[l];
            let cell = if cell > 0.5 { cell } else { 0.5 };
            let cell = if cell < bins.top { cell } else { bins.top };
            let bits = (cell + bins.base[w].0[l]).to_bits();
            #[allow(clippy::cast_possible_truncation)] // the low word is the fraction
            let fraction = bits as u32;
            nearest = nearest.min(fraction);
            cells.0[w][l] = bits;
        }
    }
    nearest <= bins.limit
}
