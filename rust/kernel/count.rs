//! Counting values of 24 lanes into 24 histograms at once: the counts of [`UniformBins`], which defines them, but faster.
//!
//! A value's cell is found by arithmetic, not by a search: `cell = value * scale + offset`, where cell 0 of a lane collects
//! what lies below the range, 1..=n the bins, n + 1 what lies above. The offset holds 2^20 and the first cell of the lane as
//! well, so that the high word of the float64 is the cell among those of all lanes, and the low word the fraction, in units of
//! 2^-32. A fraction within rounding distance of 0 or 1 means that the value is next to an edge: that row is decided by
//! comparison with the float edges. So the counts are exact, and almost no value pays for it.
//!
//! Cells of a block wait until the next block is filtered: counting is loads and stores, filtering is arithmetic, and the
//! machine does both at a time.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m256d, __m256i, _mm256_add_epi32, _mm256_add_pd, _mm256_and_pd, _mm256_and_si256, _mm256_andnot_pd,
    _mm256_castpd_ps, _mm256_castpd_si256, _mm256_castsi256_pd, _mm256_cmp_pd, _mm256_cmpeq_epi32,
    _mm256_loadu_pd, _mm256_max_pd, _mm256_min_epu32, _mm256_min_pd, _mm256_movemask_epi8, _mm256_mul_pd,
    _mm256_or_pd, _mm256_set1_epi32, _mm256_set1_epi64x, _mm256_set1_pd, _mm256_setzero_pd,
    _mm256_shuffle_ps, _mm256_storeu_ps, _mm256_sub_pd, _CMP_LE_OQ, _CMP_LT_OQ,
};
use std::marker::PhantomData;

use super::filter::Overlap;
#[cfg(target_arch = "x86_64")]
use super::simd::Avx2;
use super::simd::Simd;
use super::transpose::{Row, BLOCK, LANES, MAX_WIDTH};
use crate::dsp::{UniformBins, MAX_BINS};

/// 2^20: a float64 between it and 2^21 has 32 bits of fraction.
const MAGIC: f64 = 1_048_576.0;

/// The high word of [`MAGIC`].
const MAGIC_HIGH: u32 = 0x4130_0000;

/// All cells of a row fit in the twenty integer bits below [`MAGIC`].
const _: () = assert!(MAX_WIDTH * LANES * (MAX_BINS + 2) < 1 << 20);

/// The cells of one row, counted from `MAGIC_HIGH`, in any order.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Cells<const W: usize>([[u32; LANES]; W]);

/// Histogram parameters of a row of lanes.
#[derive(Clone, Debug)]
pub(crate) struct LaneBins<'a, const W: usize> {
    scale: Row<W>,
    offset: Row<W>,
    /// The middle of the cell below the range.
    bottom: Row<W>,
    /// The middle of the cell above the range.
    top: Row<W>,
    /// A fraction of at most this, in units of 2^-32, is next to an edge.
    limit: u32,
    /// The edge nearest to zero, where silent axes stay, and what the arithmetic gives for it.
    zero_edge: Row<W>,
    zero_cell: Row<W>,
    /// How far from `zero_cell` a value is next to that edge; half of `limit`.
    reach: f64,
    lanes: Vec<&'a UniformBins>,
    stride: usize,
}

impl<'a, const W: usize> LaneBins<'a, W> {
    /// Parameters for `lanes`, one set of bins per lane in use; all have the same number of bins.
    pub(crate) fn new(lanes: Vec<&'a UniformBins>) -> Self {
        let n_bins = lanes.first().map_or(1, |bins| bins.n_bins());
        assert!(lanes.iter().all(|bins| bins.n_bins() == n_bins), "lanes must have equal numbers of bins");
        let stride = n_bins + 2;
        let margin = lanes.iter().map(|bins| margin(bins)).max().unwrap_or(2);
        let shift = f64::from(margin) / 4_294_967_296.0;
        let mut this = Self {
            scale: Row::ZERO,
            offset: Row::ZERO,
            bottom: Row::ZERO,
            top: Row::ZERO,
            limit: margin.saturating_mul(2),
            zero_edge: Row::ZERO,
            zero_cell: Row::ZERO,
            reach: shift,
            lanes,
            stride,
        };
        // Lanes without a channel count as well, in histograms of their own that nobody reads.
        for lane in 0..W * LANES {
            let first = MAGIC + (lane * stride) as f64;
            this.offset.flat_mut()[lane] = first + 1.5;
            this.bottom.flat_mut()[lane] = first + 0.5;
            this.top.flat_mut()[lane] = first + n_bins as f64 + 1.5;
            let Some(bins) = this.lanes.get(lane) else { continue };
            let scale = bins.scale();
            this.scale.flat_mut()[lane] = scale;
            // Shifted by the margin, so that "next to an edge" is one comparison instead of two.
            this.offset.flat_mut()[lane] = first + (1.0 - bins.low() * scale + shift);
            if this.limit < u32::MAX {
                let edge = nearest_to_zero(bins);
                this.zero_edge.flat_mut()[lane] = bins.edges()[edge];
                this.zero_cell.flat_mut()[lane] = first + 1.0 + edge as f64 + shift;
            }
        }
        this
    }
}

/// Of the edges that belong to the bin on their right, the one nearest to zero.
fn nearest_to_zero(bins: &UniformBins) -> usize {
    let edges = &bins.edges()[..bins.n_bins()];
    let right = edges.partition_point(|edge| *edge < 0.0).min(edges.len() - 1);
    let left = right.saturating_sub(1);
    if edges[left].abs() < edges[right].abs() {
        left
    } else {
        right
    }
}

/// How far the quick arithmetic can be off, in units of 2^-32 of a bin, rounded up; `u32::MAX` when it is useless for
/// these bins, so that every value is compared.
fn margin(bins: &UniformBins) -> u32 {
    let reach = bins.low().abs().max(bins.high().abs()) * bins.scale();
    let error = 16.0 * f64::EPSILON * (reach + bins.n_bins() as f64 + 2.0) * 4_294_967_296.0;
    // The offset and the sum are rounded to 2^-32: two units cover both. A NaN or huge error saturates.
    if error < f64::from(1u32 << 29) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 <= error < 2^29
        let units = error.ceil() as u32;
        units + 2
    } else {
        u32::MAX
    }
}

/// Histograms of the lanes of a row, and a block of cells that wait to be counted in them.
#[derive(Clone, Debug)]
pub(crate) struct LaneHistograms<const W: usize> {
    counts: Vec<u32>,
    stride: usize,
    cells: [Cells<W>; BLOCK],
}

impl<const W: usize> LaneHistograms<W> {
    /// Empty histograms of `n_bins` bins.
    pub(crate) fn new(n_bins: usize) -> Self {
        let stride = n_bins + 2;
        // One count more, for rows of a block that hold nothing.
        Self { counts: vec![0; W * LANES * stride + 1], stride, cells: [Self::nothing(stride); BLOCK] }
    }

    /// Back to no counts.
    pub(crate) fn clear(&mut self) {
        self.counts.fill(0);
        self.cells.fill(Self::nothing(self.stride));
    }

    /// Cells that nobody reads.
    #[inline(always)]
    fn nothing(stride: usize) -> Cells<W> {
        #[allow(clippy::cast_possible_truncation)] // all cells of a row are below 2^20
        let cell = MAGIC_HIGH + (W * LANES * stride) as u32;
        Cells([[cell; LANES]; W])
    }

    /// Counts of one lane: below the range, the bins, above the range. Of cells that have been counted.
    pub(crate) fn lane(&self, lane: usize) -> &[u32] {
        &self.counts[lane * self.stride..][..self.stride]
    }

    /// Finds the cells of a block of values; they wait for [`counting`](Self::counting), in place of those found before.
    #[inline(always)]
    pub(crate) fn find(&mut self, simd: impl Simd, bins: &LaneBins<W>, rows: &[Row<W>]) {
        // One check for all the unchecked writes of `Counting`: cells are clamped to the histograms of the lanes.
        assert!(
            bins.stride == self.stride && self.counts.len() > W * LANES * self.stride,
            "histograms must fit"
        );
        for (row, cells) in rows.iter().zip(&mut self.cells) {
            if quick_cells(simd, bins, row, cells) {
                resolve_edge(bins, row, cells);
            }
        }
        self.cells[rows.len()..].fill(Self::nothing(self.stride));
    }

    /// Counts what waits, a little at a time: to be worked on row by row, once each. Rows from `first` on are counted at once.
    #[inline(always)]
    pub(crate) fn counting(&mut self, first: usize) -> Counting<'_, W> {
        let Self { counts, cells, .. } = self;
        // The cells count from `MAGIC_HIGH`. Hidden from the compiler, which would subtract it again for every value.
        let origin = std::hint::black_box(counts.as_mut_ptr().wrapping_sub(MAGIC_HIGH as usize));
        let mut counting = Counting { origin, cells, counts: PhantomData };
        for row in first..BLOCK {
            counting.work::<0, 1>(row);
        }
        counting
    }
}

/// Rows that are counted while something else is calculated.
pub(crate) struct Counting<'a, const W: usize> {
    /// `MAGIC_HIGH` before the counts.
    origin: *mut u32,
    cells: &'a [Cells<W>; BLOCK],
    counts: PhantomData<&'a mut [u32]>,
}

impl<const W: usize> Overlap for Counting<'_, W> {
    /// Adds one to a part of the cells of a row.
    #[allow(unsafe_code)]
    #[inline(always)]
    fn work<const PART: usize, const PARTS: usize>(&mut self, row: usize) {
        let cells = self.cells[row % BLOCK].0.as_flattened();
        for cell in &cells[cells.len() * PART / PARTS..cells.len() * (PART + 1) / PARTS] {
            // SAFETY: a cell is one of the counts, counted from `MAGIC_HIGH` as `origin` is: so `find` has clamped it, and
            // checked their number.
            unsafe { *self.origin.wrapping_add(*cell as usize) += 1 };
        }
    }
}

/// The quick arithmetic. NaN compares false and ends in the cell below the range.
#[inline(always)]
fn sum<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, w: usize, l: usize) -> f64 {
    let sum = row.0[w][l] * bins.scale.0[w][l] + bins.offset.0[w][l];
    let sum = if sum > bins.bottom.0[w][l] { sum } else { bins.bottom.0[w][l] };
    if sum < bins.top.0[w][l] {
        sum
    } else {
        bins.top.0[w][l]
    }
}

/// Cells of one row; true when a value is too near to an edge for the quick arithmetic to decide.
#[inline(always)]
fn quick_cells<const W: usize>(
    simd: impl Simd,
    bins: &LaneBins<W>,
    row: &Row<W>,
    cells: &mut Cells<W>,
) -> bool {
    #[cfg(target_arch = "x86_64")]
    if let Some(proof) = simd.avx2() {
        return cells_by_avx2(proof, bins, row, cells);
    }
    let _ = simd;
    cells_by_loops(bins, row, cells)
}

#[inline(always)]
fn cells_by_loops<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
    let mut nearest = u32::MAX;
    for w in 0..W {
        for l in 0..LANES {
            let bits = sum(bins, row, w, l).to_bits();
            #[allow(clippy::cast_possible_truncation)] // the low word is the fraction
            let fraction = bits as u32;
            nearest = nearest.min(fraction);
            cells.0[w][l] = (bits >> 32) as u32;
        }
    }
    nearest <= bins.limit && resolve_zeros(bins, row, cells)
}

/// Decides by comparison what lies next to the edge nearest to zero: a silent axis is 0, and with an even number of bins 0 is
/// an edge. True when values next to other edges are left.
#[inline(always)]
#[allow(clippy::needless_bitwise_bool)] // no branches in a loop over lanes
fn resolve_zeros<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
    let mut left = false;
    for w in 0..W {
        for l in 0..LANES {
            let sum = sum(bins, row, w, l);
            let bits = sum.to_bits();
            let is_zero = (sum - bins.zero_cell.0[w][l]).abs() <= bins.reach;
            let is_below = is_zero & (row.0[w][l] < bins.zero_edge.0[w][l]);
            #[allow(clippy::cast_possible_truncation)] // the low word is the fraction
            let is_near = bits as u32 <= bins.limit;
            left |= is_near & !is_zero;
            cells.0[w][l] = (bits >> 32) as u32 - u32::from(is_below);
        }
    }
    left
}

/// Decides by comparison with the float edges what the quick arithmetic could not. Writes the cells of all lanes: they may be
/// in another order before.
#[cold]
#[inline(never)]
fn resolve_edge<const W: usize>(bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) {
    for (lane, resolved) in cells.0.as_flattened_mut().iter_mut().enumerate() {
        let value = row.flat()[lane];
        let bits = sum(bins, row, lane / LANES, lane % LANES).to_bits();
        let Some(bins_of_lane) = bins.lanes.get(lane) else {
            *resolved = (bits >> 32) as u32;
            continue;
        };
        let first = lane * bins.stride;
        let n_bins = bins_of_lane.n_bins();
        #[allow(clippy::cast_possible_truncation)] // the low word is the fraction
        let cell = if bits as u32 > bins.limit {
            (bits >> 32) as usize - MAGIC_HIGH as usize - first
        } else if bins.limit == u32::MAX {
            match bins_of_lane.locate(value) {
                Some(bin) => 1 + bin,
                None if value > bins_of_lane.high() => 1 + n_bins,
                None => 0,
            }
        } else {
            // Next to one edge; the cell below it has the same number.
            let edge = (bits >> 32) as usize - MAGIC_HIGH as usize - first - 1;
            let right = if edge == n_bins {
                value > bins_of_lane.high()
            } else {
                value >= bins_of_lane.edges()[edge]
            };
            edge + usize::from(right)
        };
        #[allow(clippy::cast_possible_truncation)] // all cells of a row are below 2^20
        let cell = (first + cell) as u32;
        *resolved = MAGIC_HIGH + cell;
    }
}

/// The same as [`cells_by_loops`]: a compiler does not find these instructions.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, clippy::needless_range_loop)] // halves of several rows at a time
#[inline(always)]
fn cells_by_avx2<const W: usize>(_: Avx2, bins: &LaneBins<W>, row: &Row<W>, cells: &mut Cells<W>) -> bool {
    // SAFETY: the proof of AVX2; pointers to read are the start of four elements of an array of eight, those to write
    // of an array of eight half as large.
    unsafe {
        let mut nearest = _mm256_set1_epi32(-1);
        let mut sums = [[_mm256_setzero_pd(); 2]; W];
        each_vector!(W, w, {
            for half in 0..2 {
                let load = |row: &Row<W>| _mm256_loadu_pd(row.0[w].as_ptr().add(half * LANES / 2));
                let sum = _mm256_add_pd(_mm256_mul_pd(load(row), load(&bins.scale)), load(&bins.offset));
                // The second operand is the answer for NaN, as in the plain loop.
                let sum = _mm256_min_pd(_mm256_max_pd(sum, load(&bins.bottom)), load(&bins.top));
                sums[w][half] = sum;
                // High words are far above any limit, so one minimum over all words is the least fraction.
                nearest = _mm256_min_epu32(nearest, _mm256_castpd_si256(sum));
            }
            store_high_words(sums[w], &mut cells.0[w]);
        });
        if !is_near(nearest, bins.limit) {
            return false;
        }
        // A silent axis is 0, and so most often next to the edge at 0.
        let mut nearest = _mm256_set1_epi32(-1);
        each_vector!(W, w, {
            for half in 0..2 {
                let load = |row: &Row<W>| _mm256_loadu_pd(row.0[w].as_ptr().add(half * LANES / 2));
                let sum = sums[w][half];
                let distance =
                    _mm256_andnot_pd(_mm256_set1_pd(-0.0), _mm256_sub_pd(sum, load(&bins.zero_cell)));
                let is_zero = _mm256_cmp_pd::<_CMP_LE_OQ>(distance, _mm256_set1_pd(bins.reach));
                let is_below = _mm256_cmp_pd::<_CMP_LT_OQ>(load(row), load(&bins.zero_edge));
                nearest = _mm256_min_epu32(nearest, _mm256_castpd_si256(_mm256_or_pd(sum, is_zero)));
                // All ones are -1.
                let one_less = _mm256_castpd_si256(_mm256_and_pd(is_zero, is_below));
                let bits = _mm256_add_epi32(_mm256_castpd_si256(sum), one_less);
                sums[w][half] = _mm256_castsi256_pd(bits);
            }
            store_high_words(sums[w], &mut cells.0[w]);
        });
        is_near(nearest, bins.limit)
    }
}

/// The high words of eight numbers, in another order.
///
/// # Safety
/// AVX2.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn store_high_words([low, high]: [__m256d; 2], words: &mut [u32; LANES]) {
    // SAFETY: what the caller promises; there is room for eight words.
    unsafe {
        let high = _mm256_shuffle_ps::<0b11_01_11_01>(_mm256_castpd_ps(low), _mm256_castpd_ps(high));
        _mm256_storeu_ps(words.as_mut_ptr().cast(), high);
    }
}

/// Whether one of the low words is at most `limit`.
///
/// # Safety
/// AVX2.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn is_near(words: __m256i, limit: u32) -> bool {
    // SAFETY: what the caller promises.
    unsafe {
        let near = _mm256_cmpeq_epi32(_mm256_min_epu32(words, _mm256_set1_epi32(limit.cast_signed())), words);
        // The mask drops the high words.
        _mm256_movemask_epi8(_mm256_and_si256(near, _mm256_set1_epi64x(0xffff_ffff))) != 0
    }
}
