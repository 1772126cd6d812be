//! A team of recordings through the lanes, in one pass over the samples.

use crate::dsp::{Outside, Real};
use crate::features::Extractor;
use crate::kernel::{
    fits, pack, unpack, Beside, Cascade, Counting, HalfLines, Job, LaneBins, LaneHistograms, Raw, Row, Simd,
    SimdPath, BLOCK, LANES, MAX_WIDTH,
};
use crate::wrench::BatchShape;

/// Recordings that share the lanes.
pub(crate) fn team_size(n_axes: usize) -> usize {
    (MAX_WIDTH * LANES / n_axes).max(1)
}

/// What was found about the values of some recordings.
#[derive(Clone, Copy)]
pub(crate) struct Found {
    /// All are finite.
    pub(crate) finite: bool,
    /// All features are within reach of the type they were written as.
    pub(crate) fit: bool,
}

/// Some recordings of a batch and their rows of features.
pub(crate) struct Teams<'a, T> {
    pub(crate) extractor: &'a Extractor,
    pub(crate) shape: BatchShape,
    pub(crate) n_features: usize,
    pub(crate) wrench: &'a [f64],
    pub(crate) out: &'a mut [T],
    /// Write raw features past the caches: worth it when the whole result is larger than they are.
    pub(crate) stream: bool,
}

impl<T: Real> Teams<'_, T> {
    /// Extracts them, team after team.
    pub(crate) fn run(self, path: SimdPath) -> Found {
        let Teams { extractor, shape, n_features, wrench, out, stream } = self;
        let team = team_size(shape.n_axes);
        let mut found = Found { finite: true, fit: true };
        // More axes than lanes: some axes of a recording at a time.
        for first_axis in (0..shape.n_axes).step_by(MAX_WIDTH * LANES) {
            let axes = first_axis..shape.n_axes.min(first_axis + MAX_WIDTH * LANES);
            let whole = wrench.len() / shape.recording_len() / team * team;
            let (wrench, wrench_rest) = wrench.split_at(whole * shape.recording_len());
            let (out, out_rest) = out.split_at_mut(whole * n_features);
            for (wrench, out) in [(wrench, out), (wrench_rest, out_rest)] {
                let recordings = (wrench.len() / shape.recording_len()).min(team);
                let layout = Layout { axes: axes.clone(), recordings, stream };
                let alike = Alike { extractor, shape, n_features, layout, wrench, out, found: &mut found };
                match (recordings * axes.len()).div_ceil(LANES) {
                    0 => {}
                    1 => path.run(Wide::<T, 1>(alike)),
                    2 => path.run(Wide::<T, 2>(alike)),
                    _ => path.run(Wide::<T, MAX_WIDTH>(alike)),
                }
            }
        }
        found
    }
}

/// Teams of one layout.
struct Alike<'a, T> {
    extractor: &'a Extractor,
    shape: BatchShape,
    n_features: usize,
    layout: Layout,
    wrench: &'a [f64],
    out: &'a mut [T],
    found: &'a mut Found,
}

/// Teams that fill so many rows of lanes. A job for each width: compilers take far longer for all in one function.
struct Wide<'a, T, const W: usize>(Alike<'a, T>);

impl<T: Real, const W: usize> Job for Wide<'_, T, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Alike { extractor, shape, n_features, layout, wrench, out, found } = self.0;
        BatchKernel::<W>::new(extractor, shape, layout).run(simd, wrench, out, n_features, found);
        simd.finish_writes();
    }
}

/// Which channels the lanes hold: `axes` of each of `recordings`, recording by recording.
struct Layout {
    axes: std::ops::Range<usize>,
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
    /// Raw features of each recording that wait to be written.
    half_lines: [HalfLines; MAX_WIDTH * LANES / 6],
    /// The histogram of one lane, to be written.
    block: Vec<f64>,
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
            half_lines: [HalfLines::EMPTY; MAX_WIDTH * LANES / 6],
            block: vec![0.0; extractor.spec().n_bins],
            bins: LaneBins::new(bins),
            extractor,
            shape,
            layout,
        }
    }

    /// Runs team after team.
    #[inline(always)]
    fn run<T: Real>(
        mut self,
        simd: impl Simd,
        wrench: &[f64],
        out: &mut [T],
        n_features: usize,
        found: &mut Found,
    ) {
        let recordings = wrench.chunks_exact(self.layout.recordings * self.shape.recording_len());
        let rows = out.chunks_exact_mut(self.layout.recordings * n_features);
        for (wrench, out) in recordings.zip(rows) {
            let of_team = self.team(simd, wrench, out, n_features);
            found.finite &= of_team.finite;
            found.fit &= of_team.fit;
        }
    }

    /// One team: every sample is read once, every feature written once.
    #[inline(always)]
    fn team<T: Real>(&mut self, simd: impl Simd, wrench: &[f64], out: &mut [T], n_features: usize) -> Found {
        let hfmh = self.extractor.spec().hfmh;
        let filtered = hfmh && !self.extractor.sos().sections().is_empty();
        let n_samples = self.shape.n_samples;
        let mut rows = [Row::ZERO; BLOCK];
        let (mut finite, mut fit) = (true, true);
        self.begin(wrench);
        let mut start = 0;
        let mut end = n_samples.min(rows_to_cache_line(out));
        while start < end {
            fit &= self.load(simd, wrench, out, n_features, start..end, &mut rows);
            let rows = &mut rows[..end - start];
            if filtered {
                let next = (self.shape.n_axes == 6).then_some(end + BLOCK);
                let counting = self.histograms.counting(rows.len());
                self.cascade.filter(simd, rows, &mut Meanwhile { simd, counting, wrench, n_samples, next });
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
            finite &= self.cascade.is_finite();
            self.histograms.counting(0);
            fit &= self.finish(out, n_features);
        }
        Found { finite, fit }
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

    /// Brings samples into the lanes and, on the way, into the raw features. True when their type reaches far enough.
    #[inline(always)]
    fn load<T: Real>(
        &mut self,
        simd: impl Simd,
        wrench: &[f64],
        out: &mut [T],
        n_features: usize,
        samples: std::ops::Range<usize>,
        rows: &mut [Row<W>; BLOCK],
    ) -> bool {
        let mut fit = true;
        let BatchShape { n_samples, n_axes, .. } = self.shape;
        let (start, n) = (samples.start, samples.len());
        let recordings = wrench.chunks_exact(self.shape.recording_len());
        for (r, (recording, out)) in recordings.zip(out.chunks_exact_mut(n_features)).enumerate() {
            let samples = &recording[start * n_axes..][..n * n_axes];
            let raw = self.extractor.spec().raw.then_some(&mut *out);
            if let (6, Ok(samples)) = (n_axes, samples.try_into()) {
                let stream = if self.layout.stream { self.half_lines.get_mut(r) } else { None };
                fit &= simd.transpose6(
                    samples,
                    rows,
                    6 * r,
                    raw.map(|values| Raw { values, n_samples, start, stream }),
                );
                continue;
            }
            let first = r * self.layout.axes.len();
            let lanes = first..first + self.layout.axes.len();
            pack(samples, n_axes, self.layout.axes.start, &mut rows[..n], lanes.clone());
            if let Some(values) = raw {
                for (axis, lane) in self.layout.axes.clone().zip(lanes) {
                    fit &= unpack(&rows[..n], lane, &mut values[axis * n_samples + start..][..n]);
                }
            }
        }
        fit
    }

    /// Writes the histogram block. True when its type reaches far enough.
    fn finish<T: Real>(&mut self, out: &mut [T], n_features: usize) -> bool {
        let mut fit = true;
        let spec = self.extractor.spec();
        let raw_len = if spec.raw { self.shape.recording_len() } else { 0 };
        let block = &mut self.block;
        for (r, out) in out.chunks_exact_mut(n_features).enumerate() {
            for (a, axis) in self.layout.axes.clone().enumerate() {
                let counts = self.histograms.lane(r * self.layout.axes.len() + a);
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
                let target = &mut out[raw_len + axis * spec.n_bins..][..spec.n_bins];
                for (value, wide) in target.iter_mut().zip(&*block) {
                    *value = T::of(*wide);
                }
                fit &= !spec.density || fits(target);
            }
        }
        fit
    }
}

/// What is done while a block is filtered: the block before it is counted, one of those behind it asked for.
struct Meanwhile<'a, S, const W: usize> {
    simd: S,
    counting: Counting<'a, W>,
    wrench: &'a [f64],
    n_samples: usize,
    next: Option<usize>,
}

impl<S: Simd, const W: usize> Beside for Meanwhile<'_, S, W> {
    #[inline(always)]
    fn work<const PART: usize, const PARTS: usize>(&mut self, row: usize) {
        if let (0, Some(next)) = (PART, self.next) {
            prefetch(self.simd, self.wrench, self.n_samples, next, row);
        }
        self.counting.work::<PART, PARTS>(row);
    }
}

/// Rows of the first block: as many as bring the writes of all later ones to the start of a cache line, where the
/// sizes are multiples of one, as the paper's are.
fn rows_to_cache_line<T>(out: &[T]) -> usize {
    match out.as_ptr().align_offset(BLOCK * size_of::<T>()) {
        rows @ 1..BLOCK => rows,
        _ => BLOCK,
    }
}

/// Asks for a share of the samples of the block from sample `next` on: without it, the filter would wait for memory at the
/// start of every block. Two rows for each recording of a team, three cache lines for each row.
#[inline(always)]
fn prefetch(simd: impl Simd, wrench: &[f64], n_samples: usize, next: usize, row: usize) {
    let (recording, line) = (row / 2, 3 * (row % 2));
    let first = (recording * n_samples + next) * 6 + line * BLOCK;
    for k in 0..3 {
        simd.will_read(wrench, first + k * BLOCK);
    }
}
