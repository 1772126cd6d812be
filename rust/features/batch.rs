//! Batches: teams of recordings go through the lanes side by side, in one pass over the samples.

use std::ops::Range;

use super::{not_finite, Extractor};
use crate::dsp::Outside;
use crate::error::Result;
use crate::kernel::{
    finish_writes, pack, prefetch, transpose6, unpack, Cascade, Counting, Job, LaneBins, LaneHistograms,
    Overlap, Raw, Row, Simd, SimdPath, BLOCK, LANES, MAX_WIDTH,
};
use crate::memory::filled;
use crate::parallel::in_pieces;
use crate::wrench::BatchShape;

/// Results larger than this are written past the caches: they would not find room, and reading every line before it is
/// overwritten would cost a third of the memory traffic.
const STREAM_BYTES: usize = 8 << 20;

impl Extractor {
    /// Features of a batch, one row per recording.
    ///
    /// # Errors
    /// As [`extract_into`](Self::extract_into).
    pub fn extract(&self, wrench: &[f64], shape: BatchShape, threads: usize) -> Result<Vec<f64>> {
        let n_features = self.check_len(wrench.len(), shape)?;
        let mut out = filled(0.0, shape.n_recordings.saturating_mul(n_features))?;
        self.extract_into(wrench, shape, threads, &mut out)?;
        Ok(out)
    }

    /// Features of a batch into `out`, one row per recording. 1 and n threads give the same bits; threads beyond the
    /// number of cores are not used.
    ///
    /// On an error `out` holds unspecified numbers.
    ///
    /// # Errors
    /// [`Error::NonFinite`](crate::Error::NonFinite); [`Error::TooLarge`](crate::Error::TooLarge): the filter
    /// leaves float64; those of sizes that do not fit.
    pub fn extract_into(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.extract_on(SimdPath::detect()?, wrench, shape, threads, out)
    }

    /// [`extract_into`](Self::extract_into) on a path of choice, for tests and benchmarks.
    #[doc(hidden)]
    pub fn extract_on(
        &self,
        path: SimdPath,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        let stream = size_of_val(out) > STREAM_BYTES;
        let n_features = self.check_len(wrench.len(), shape)?;
        in_pieces(wrench, shape, (n_features, team_size(shape.n_axes)), threads, out, |wrench, shape, out| {
            let piece = BatchPiece { extractor: self, shape, n_features, wrench, out, stream };
            if piece.extract(path) {
                return Ok(());
            }
            Err(not_finite(wrench, shape))
        })
    }
}

/// Recordings that share the lanes.
fn team_size(n_axes: usize) -> usize {
    (MAX_WIDTH * LANES / n_axes).max(1)
}

/// A piece of a batch and its rows of features.
struct BatchPiece<'a> {
    extractor: &'a Extractor,
    shape: BatchShape,
    n_features: usize,
    wrench: &'a [f64],
    out: &'a mut [f64],
    /// Write raw features past the caches: worth it when the whole result is larger than they are.
    stream: bool,
}

impl BatchPiece<'_> {
    /// Extracts team after team; true if all values are finite and stay so.
    fn extract(self, path: SimdPath) -> bool {
        let BatchPiece { extractor, shape, n_features, wrench, out, stream } = self;
        let team = team_size(shape.n_axes);
        let mut finite = true;
        // More axes than lanes: some axes of a recording at a time.
        for first_axis in (0..shape.n_axes).step_by(MAX_WIDTH * LANES) {
            let axes = first_axis..shape.n_axes.min(first_axis + MAX_WIDTH * LANES);
            let whole = wrench.len() / shape.recording_len() / team * team;
            let (wrench, wrench_rest) = wrench.split_at(whole * shape.recording_len());
            let (out, out_rest) = out.split_at_mut(whole * n_features);
            for (wrench, out) in [(wrench, out), (wrench_rest, out_rest)] {
                let recordings = (wrench.len() / shape.recording_len()).min(team);
                let layout = Layout { axes: axes.clone(), recordings, stream };
                let batch = TeamBatch { extractor, shape, n_features, layout, wrench, out };
                finite &= match (recordings * axes.len()).div_ceil(LANES) {
                    0 => true,
                    1 => path.run(LaneJob::<1>(batch)),
                    2 => path.run(LaneJob::<2>(batch)),
                    _ => path.run(LaneJob::<MAX_WIDTH>(batch)),
                };
            }
        }
        finite
    }
}

/// Teams of one layout.
struct TeamBatch<'a> {
    extractor: &'a Extractor,
    shape: BatchShape,
    n_features: usize,
    layout: Layout,
    wrench: &'a [f64],
    out: &'a mut [f64],
}

/// Teams that fill so many vectors of lanes. A job for each width: compilers take far longer for all in one function.
struct LaneJob<'a, const W: usize>(TeamBatch<'a>);

impl<const W: usize> Job for LaneJob<'_, W> {
    /// Whether all values are finite and stay so.
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> bool {
        let TeamBatch { extractor, shape, n_features, layout, wrench, out } = self.0;
        let recordings = wrench.chunks_exact(layout.recordings * shape.recording_len());
        let rows = out.chunks_exact_mut(layout.recordings * n_features);
        let mut kernel = BatchKernel::<W>::new(extractor, shape, layout);
        let mut finite = true;
        for (wrench, out) in recordings.zip(rows) {
            finite &= kernel.team(simd, wrench, out, n_features);
        }
        finish_writes(simd);
        finite
    }
}

/// Which channels the lanes hold: `axes` of each of `recordings`, recording by recording.
struct Layout {
    axes: Range<usize>,
    recordings: usize,
    stream: bool,
}

/// What a team of one layout works with.
struct BatchKernel<'a, const W: usize> {
    extractor: &'a Extractor,
    shape: BatchShape,
    layout: Layout,
    cascade: Cascade<W>,
    bins: LaneBins<'a, W>,
    histograms: LaneHistograms<W>,
}

impl<'a, const W: usize> BatchKernel<'a, W> {
    fn new(extractor: &'a Extractor, shape: BatchShape, layout: Layout) -> Self {
        let axes = (0..layout.recordings).flat_map(|_| layout.axes.clone());
        let bins = if extractor.spec().hfmh {
            axes.filter_map(|axis| extractor.bins(axis)).collect()
        } else {
            Vec::new()
        };
        Self {
            cascade: Cascade::new(extractor.sos()),
            histograms: LaneHistograms::new(extractor.spec().n_bins),
            bins: LaneBins::new(bins),
            extractor,
            shape,
            layout,
        }
    }

    /// One team: every sample is read once, every feature written once. True if all values are finite and stay so.
    #[inline(always)]
    fn team(&mut self, simd: impl Simd, wrench: &[f64], out: &mut [f64], n_features: usize) -> bool {
        let hfmh = self.extractor.spec().hfmh;
        let filtered = hfmh && !self.extractor.sos().sections().is_empty();
        let n_samples = self.shape.n_samples;
        let mut rows = [Row::ZERO; BLOCK];
        let mut finite = true;
        self.begin(wrench);
        let mut start = 0;
        let mut end = n_samples.min(rows_to_cache_line(out));
        while start < end {
            self.load(simd, wrench, out, n_features, start..end, &mut rows);
            let rows = &mut rows[..end - start];
            if filtered {
                let next = (self.shape.n_axes == 6).then_some(end + BLOCK);
                let counting = self.histograms.counting(rows.len());
                let mut overlap = CountAndPrefetch { simd, counting, wrench, n_samples, next };
                self.cascade.filter(simd, rows, &mut overlap);
            } else {
                finite &= rows.iter().all(|row| row.flat().iter().all(|value| value.is_finite()));
            }
            if hfmh {
                if !filtered {
                    self.histograms.counting(0);
                }
                self.histograms.find(simd, &self.bins, rows);
            }
            (start, end) = (end, n_samples.min(end + BLOCK));
        }
        if hfmh {
            self.histograms.counting(0);
            finite &= self.cascade.is_finite();
            self.finish(out, n_features);
        }
        finite
    }

    /// Sets the filter as it was before the first sample, and empties the histograms.
    #[inline(always)]
    fn begin(&mut self, wrench: &[f64]) {
        self.histograms.clear();
        self.cascade.rest();
        let axes = self.layout.axes.clone();
        for (section, z) in self.extractor.start().iter().enumerate() {
            for (r, recording) in wrench.chunks_exact(self.shape.recording_len()).enumerate() {
                for (a, first) in recording[axes.clone()].iter().enumerate() {
                    self.cascade.set(section, r * axes.len() + a, z.map(|z| z * first));
                }
            }
        }
    }

    /// Brings samples into the lanes and, on the way, into the raw features.
    #[inline(always)]
    fn load(
        &mut self,
        simd: impl Simd,
        wrench: &[f64],
        out: &mut [f64],
        n_features: usize,
        samples: Range<usize>,
        rows: &mut [Row<W>; BLOCK],
    ) {
        let BatchShape { n_samples, n_axes, .. } = self.shape;
        let (start, n) = (samples.start, samples.len());
        let recordings = wrench.chunks_exact(self.shape.recording_len());
        for (r, (recording, out)) in recordings.zip(out.chunks_exact_mut(n_features)).enumerate() {
            let samples = &recording[start * n_axes..][..n * n_axes];
            let raw = self.extractor.spec().raw.then_some(&mut *out);
            if let (6, Ok(samples)) = (n_axes, samples.try_into()) {
                let stream = self.layout.stream;
                let raw = raw.map(|values| Raw { values, n_samples, start, stream });
                transpose6(simd, samples, rows, 6 * r, raw);
                continue;
            }
            let first = r * self.layout.axes.len();
            let lanes = first..first + self.layout.axes.len();
            pack(samples, n_axes, self.layout.axes.start, &mut rows[..n], lanes.clone());
            if let Some(values) = raw {
                for (axis, lane) in self.layout.axes.clone().zip(lanes) {
                    unpack(&rows[..n], lane, &mut values[axis * n_samples + start..][..n]);
                }
            }
        }
    }

    /// Writes the histogram block.
    fn finish(&mut self, out: &mut [f64], n_features: usize) {
        let spec = self.extractor.spec();
        let raw_len = if spec.raw { self.shape.recording_len() } else { 0 };
        for (r, out) in out.chunks_exact_mut(n_features).enumerate() {
            for (a, axis) in self.layout.axes.clone().enumerate() {
                let counts = self.histograms.lane(r * self.layout.axes.len() + a);
                let block = &mut out[raw_len + axis * spec.n_bins..][..spec.n_bins];
                for (value, count) in block.iter_mut().zip(&counts[1..]) {
                    *value = f64::from(*count);
                }
                if spec.outside == Outside::Clip {
                    block[0] += f64::from(counts[0]);
                    block[spec.n_bins - 1] += f64::from(counts[spec.n_bins + 1]);
                }
                if let Some(bins) = self.extractor.bins(axis).filter(|_| spec.density) {
                    bins.normalise(block);
                }
            }
        }
    }
}

/// What is done while a block is filtered: the block before it is counted, and one of those behind it is prefetched.
struct CountAndPrefetch<'a, S, const W: usize> {
    simd: S,
    counting: Counting<'a, W>,
    wrench: &'a [f64],
    n_samples: usize,
    next: Option<usize>,
}

impl<S: Simd, const W: usize> Overlap for CountAndPrefetch<'_, S, W> {
    #[inline(always)]
    fn work<const PART: usize, const PARTS: usize>(&mut self, row: usize) {
        if let (0, Some(next)) = (PART, self.next) {
            prefetch_rows(self.simd, self.wrench, self.n_samples, next, row);
        }
        self.counting.work::<PART, PARTS>(row);
    }
}

/// Rows of the first block: as many as bring the writes of all later ones to the start of a cache line, where the
/// sizes are multiples of one, as the paper's are.
fn rows_to_cache_line(out: &[f64]) -> usize {
    match out.as_ptr().align_offset(BLOCK * size_of::<f64>()) {
        rows @ 1..BLOCK => rows,
        _ => BLOCK,
    }
}

/// Asks for a share of the samples of the block from sample `next` on: without it, the filter would wait for memory at the
/// start of every block. Two rows for each recording of a team, three cache lines for each row.
#[inline(always)]
fn prefetch_rows(simd: impl Simd, wrench: &[f64], n_samples: usize, next: usize, row: usize) {
    let (recording, line) = (row / 2, 3 * (row % 2));
    let first = (recording * n_samples + next) * 6 + line * BLOCK;
    for k in 0..3 {
        prefetch(simd, wrench, first + k * BLOCK);
    }
}
