//! From a recording to the signals of its bands, as it arrives or all at once.
//!
//! Axes go through a pyramid of filters in float32, eight side by side: stages at rates that are halved from one to the next.
//! One of them has two octaves, each of the others one: the first stage has them, or the second where the rate is halved early.
//!
//! Rows go through in blocks. A block of a stage is half a block of the next one, which runs as soon as it has a whole one.
//! What a recording leaves over at its end goes through all stages in a copy of what they remember, so that more of it may
//! still come. Signals are counted from the first sample: a start as if it had lasted for ever is then a start from rest,
//! and a constant leaves nothing behind, not even rounding. They are also divided by the least scale of their axis, in
//! float64, so that the range of float32 is that of a signal and not of its unit; what is left of 24 bits is more than
//! sensors have.

use super::filters::{run, Axes8, Filters, Remembered, Rows, BACK, GROUP, REST, ROWS};
use super::spec::{halved, halves_early, halvings, least_scales, n_octaves};
use super::{BandSignals, Region};
use crate::dsp::Real;
use crate::error::Result;
use crate::features::too_many_features;
use crate::kernel::{Pack, Register, Simd};

/// Signals begin at whole cache lines: this many float32.
const LINE: usize = 16;

/// Calls a function that has the number of axes of a group as a constant.
macro_rules! with_axes {
    ($n_axes:expr, |$n:ident| $call:expr) => { with_axes!(@ $n_axes, $n, $call, 1 2 3 4 5 6 7) };
    (@ $n_axes:expr, $n:ident, $call:expr, $($few:literal)*) => {
        match $n_axes {
            $($few => { const $n: usize = $few; $call })*
            _ => { const $n: usize = GROUP; $call }
        }
    };
}

/// Filters between two halvings of the rate.
#[derive(Clone, Debug)]
struct Stage {
    memory: Remembered,
    /// Rows that wait, behind the last [`BACK`] that have gone through.
    input: [Axes8; BACK + ROWS],
    n_waiting: usize,
    /// Rows that have gone through.
    n_done: usize,
}

impl Stage {
    const REST: Self = Self { memory: REST, input: [Pack::ZERO; BACK + ROWS], n_waiting: 0, n_done: 0 };
}

/// The stages of a group of axes.
#[derive(Clone, Debug)]
struct Pyramid {
    stages: Vec<Stage>,
    /// Where the rows below the last octave go, and no further.
    below: [Axes8; ROWS / 2],
}

impl Pyramid {
    /// As many stages as there are rates.
    fn new(n_stages: usize) -> Self {
        Self { stages: vec![Stage::REST; n_stages], below: [Pack::ZERO; ROWS / 2] }
    }

    fn restart(&mut self) {
        for stage in &mut self.stages {
            stage.memory = REST;
            stage.input[..BACK].fill(Pack::ZERO);
            (stage.n_waiting, stage.n_done) = (0, 0);
        }
    }

    /// Rows that have gone through the first stage.
    fn n_done(&self) -> usize {
        self.stages[0].n_done
    }

    /// Where the next rows go: a block, or what is left of a recording.
    fn input(&mut self) -> &mut [Axes8] {
        &mut self.stages[0].input[BACK..]
    }

    /// A block that stands in [`input`](Self::input) through all stages that now have one.
    #[inline(always)]
    fn advance(&mut self, rows: &mut Rows, out: &mut Output<'_, impl Simd>) {
        self.stages[0].n_waiting = ROWS;
        for index in 0..self.stages.len() {
            if self.stages[index].n_waiting < ROWS {
                return;
            }
            let memory = self.through(index, ROWS, rows, out);
            let stage = &mut self.stages[index];
            stage.memory = memory;
            stage.input.copy_within(ROWS.., 0);
            stage.n_waiting = 0;
            stage.n_done += ROWS;
            if let Some(next) = self.stages.get_mut(index + 1) {
                next.n_waiting += ROWS / 2;
            }
        }
    }

    /// What waits, and `n` rows that stand in [`input`](Self::input), through all stages. Nothing of it is remembered.
    #[inline(always)]
    fn finish(&mut self, mut n: usize, rows: &mut Rows, out: &mut Output<'_, impl Simd>) {
        for index in 0..self.stages.len() {
            n += self.stages[index].n_waiting;
            self.through(index, n, rows, out);
            n = n.div_ceil(2);
        }
    }

    /// The first `n` rows that wait at a stage through its filters, and what these remember of them then.
    #[inline(always)]
    fn through(
        &mut self,
        index: usize,
        n: usize,
        rows: &mut Rows,
        out: &mut Output<'_, impl Simd>,
    ) -> Remembered {
        let (stages, after) = self.stages.split_at_mut(index + 1);
        let halved = match after {
            [next, ..] => &mut next.input[BACK + next.n_waiting..],
            [] => &mut self.below[..],
        };
        let Stage { memory, input, n_done, .. } = &stages[index];
        // An odd row goes through with whatever lies behind it: nobody looks at what comes of that.
        let (filters, input) = (&out.bank.filters, &input[..BACK + n.next_multiple_of(2)]);
        let (top, octave) = match (index, out.bank.early) {
            (0, false) | (1, true) => (true, true),
            (0, true) => (true, false),
            _ => (false, true),
        };
        let memory = match (top, octave) {
            (true, true) => run::<true, true>(out.simd, filters, memory, input, rows, halved),
            (true, false) => run::<true, false>(out.simd, filters, memory, input, rows, halved),
            _ => run::<false, true>(out.simd, filters, memory, input, rows, halved),
        };
        if top {
            out.write(1 + index, *n_done, n, &rows.top);
        }
        if octave {
            out.write(2 + index, *n_done, n, &rows.octave);
        }
        memory
    }
}

/// Splits recordings of one shape into bands.
#[derive(Clone, Debug)]
pub(super) struct Bank {
    filters: Filters,
    /// What each axis is multiplied by before it becomes float32.
    inverse: Vec<f64>,
    /// What each signal is multiplied by, in the order of bands, then of groups of axes.
    gains: Vec<Axes8>,
    n_axes: usize,
    n_samples: usize,
    octaves: usize,
    /// Whether the rate is halved in front of octave 2 already.
    early: bool,
}

/// Memory for one recording and its bands.
#[derive(Debug)]
pub(super) struct BankWork {
    values: Vec<f32>,
    regions: Vec<Region>,
    /// One for each group of axes; none where there are no octaves.
    pyramids: Vec<Pyramid>,
    // Boxed: its lanes want more alignment than every owner gives, Python's objects for one.
    rows: Box<Rows>,
}

impl Clone for BankWork {
    /// The copy has whole cache lines of its own.
    fn clone(&self) -> Self {
        let len = self.values.len() - LINE;
        let mut values = vec![0.0; self.values.len()];
        let (from, to) = (aligned(&self.values), aligned(&values));
        values[to..][..len].copy_from_slice(&self.values[from..][..len]);
        Self {
            values,
            regions: self.regions.clone(),
            pyramids: self.pyramids.clone(),
            rows: self.rows.clone(),
        }
    }
}

impl BankWork {
    /// What there is of the bands.
    pub(super) fn signals(&self, n_axes: usize) -> BandSignals<'_> {
        BandSignals { values: &self.values[aligned(&self.values)..], regions: &self.regions, n_axes }
    }

    /// Rows of the recording that have become octaves for good.
    pub(super) fn n_done(&self) -> usize {
        self.pyramids.first().map_or(0, Pyramid::n_done)
    }

    /// Ready for the first row of a recording.
    pub(super) fn restart(&mut self) {
        self.pyramids.iter_mut().for_each(Pyramid::restart);
    }
}

/// Values before the first whole cache line.
fn aligned(values: &[f32]) -> usize {
    // Speed only: a pointer that cannot be aligned stays as it is.
    values.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE)
}

impl Bank {
    /// For bands that are divided by `scales`, band-major.
    pub(super) fn new(n_samples: usize, n_axes: usize, scales: &[f64]) -> Result<Self> {
        // All bands together hold less than five times the samples of the recording, and some room to align them.
        let room = n_samples
            .checked_add(2 * LINE)
            .and_then(|n| n.checked_mul(n_axes)?.checked_mul(8 * size_of::<f32>()));
        if room.is_none_or(|room| isize::try_from(room).is_err()) {
            return Err(too_many_features(n_samples, n_axes));
        }
        let filters = Filters::new()?;
        let early = halves_early(n_samples);
        let gain = |band: usize| {
            let poles = match band {
                0 => return 1.0,
                1 => filters.top,
                2 if early => filters.top,
                _ => filters.octave,
            };
            // Every halving has doubled the signal.
            poles.gain * libm::exp2(-f64::from(halvings(band - 1, early)))
        };
        let inverse: Vec<_> = least_scales(scales, n_axes).map(f64::recip).collect();
        let mut gains = Vec::new();
        for (band, scales) in scales.chunks_exact(n_axes).enumerate() {
            for (scales, inverse) in scales.chunks(GROUP).zip(inverse.chunks(GROUP)) {
                let mut of_group = Pack::ZERO;
                for (own, (scale, inverse)) in of_group.0.iter_mut().zip(scales.iter().zip(inverse)) {
                    *own = f32::of(gain(band) / (scale * inverse));
                }
                gains.push(of_group);
            }
        }
        Ok(Self { filters, inverse, gains, n_axes, n_samples, octaves: n_octaves(n_samples), early })
    }

    /// How often the rate is halved before each of the bands.
    fn rates(&self) -> impl Iterator<Item = u32> {
        let Self { octaves, early, .. } = *self;
        std::iter::once(0).chain((0..octaves).map(move |octave| halvings(octave, early)))
    }

    pub(super) fn work(&self) -> BankWork {
        let mut start = 0;
        let region = |halvings| {
            let stride = halved(self.n_samples, halvings).next_multiple_of(LINE);
            let region = Region { start, stride, len: 0 };
            start += self.n_axes * stride;
            region
        };
        let regions: Vec<_> = self.rates().map(region).collect();
        BankWork {
            values: vec![0.0; start + LINE],
            regions,
            pyramids: if self.octaves == 0 {
                Vec::new()
            } else {
                let n_stages = 1 + self.rates().fold(0, |most, halvings| most.max(halvings as usize));
                vec![Pyramid::new(n_stages); self.n_axes.div_ceil(GROUP)]
            },
            rows: Box::new(Rows::ZERO),
        }
    }

    /// Splits the next block of a recording of which `recording` is the beginning, time-major, into octaves; false where it
    /// is not there yet.
    #[inline(always)]
    pub(super) fn advance(&self, simd: impl Simd, recording: &[f64], work: &mut BankWork) -> bool {
        let n_after = work.n_done() + ROWS;
        if self.octaves == 0 || recording.len() / self.n_axes < n_after {
            return false;
        }
        for axis in (0..self.n_axes).step_by(GROUP) {
            let (mut out, pyramid, rows) = self.group(simd, axis, work);
            let Some(pyramid) = pyramid else { continue };
            let block = &recording[pyramid.n_done() * self.n_axes..][..ROWS * self.n_axes];
            self.begin(recording, block, axis, pyramid.input());
            pyramid.advance(rows, &mut out);
        }
        for (region, halvings) in work.regions.iter_mut().zip(self.rates()).skip(1) {
            region.len = (n_after >> halvings) / ROWS * ROWS;
        }
        true
    }

    /// Splits what [`advance`](Self::advance) has left of a recording, of which more may come, and gives band 0; `means` are
    /// those of its axes, counted from the first sample.
    #[inline(always)]
    pub(super) fn finish(&self, simd: impl Simd, recording: &[f64], means: &[f64], work: &mut BankWork) {
        for axis in (0..self.n_axes).step_by(GROUP) {
            self.finish_group(simd, recording, axis, means, work);
        }
        let n_seen = recording.len() / self.n_axes;
        for (region, halvings) in work.regions.iter_mut().zip(self.rates()) {
            region.len = halved(n_seen, halvings);
        }
    }

    /// A group of axes from `axis` on, to the end.
    #[inline(always)]
    fn finish_group(
        &self,
        simd: impl Simd,
        recording: &[f64],
        axis: usize,
        means: &[f64],
        work: &mut BankWork,
    ) {
        let (mut out, mut pyramid, rows) = self.group(simd, axis, work);
        let n_done = pyramid.as_ref().map_or(0, |pyramid| pyramid.n_done());
        let mut mean = Pack::ZERO;
        for (mean, (x, inverse)) in mean.0.iter_mut().zip(means[axis..].iter().zip(&self.inverse[axis..])) {
            *mean = f32::of(x * inverse);
        }
        for (block, samples) in recording.chunks(ROWS * self.n_axes).enumerate() {
            let (start, n) = (block * ROWS, samples.len() / self.n_axes);
            let goes_on = start >= n_done;
            let begun = match &mut pyramid {
                Some(pyramid) if goes_on => pyramid.input(),
                _ => &mut rows.octave,
            };
            self.begin(recording, samples, axis, begun);
            for (centred, x) in rows.top.iter_mut().zip(begun) {
                *centred = *x - mean;
            }
            out.write(0, start, n, &rows.top);
            if let Some(pyramid) = pyramid.as_deref_mut().filter(|_| goes_on && n == ROWS) {
                pyramid.advance(rows, &mut out);
            }
        }
        if let Some(pyramid) = pyramid {
            pyramid.finish(recording.len() / self.n_axes % ROWS, rows, &mut out);
        }
    }

    /// Samples of a group of axes as the pyramid takes them.
    #[inline(always)]
    fn begin(&self, recording: &[f64], samples: &[f64], axis: usize, rows: &mut [Axes8]) {
        with_axes!(self.n_axes - axis, |N| {
            let (at_start, inverse) = (first::<N>(&recording[axis..]), first::<N>(&self.inverse[axis..]));
            for (row, out) in samples.chunks_exact(self.n_axes).zip(rows) {
                let x = (first::<N>(&row[axis..]) - at_start) * inverse;
                for l in 0..GROUP {
                    out.0[l] = f32::of(x.0[l]);
                }
            }
        });
    }

    /// What a group of axes from `axis` on works in.
    #[inline(always)]
    fn group<'a, S>(
        &'a self,
        simd: S,
        axis: usize,
        work: &'a mut BankWork,
    ) -> (Output<'a, S>, Option<&'a mut Pyramid>, &'a mut Rows) {
        let BankWork { values, regions, pyramids, rows } = work;
        let from = aligned(values);
        let out = Output { simd, values: &mut values[from..], regions, axis, bank: self };
        (out, pyramids.get_mut(axis / GROUP), rows)
    }
}

/// Where all bands of a group of axes from `axis` on go.
struct Output<'a, S> {
    simd: S,
    values: &'a mut [f32],
    regions: &'a [Region],
    axis: usize,
    bank: &'a Bank,
}

impl<S: Simd> Output<'_, S> {
    /// Takes the first `n` rows of a band, which are those from `start` on. A band that the recording is too short for is
    /// left out.
    #[inline(always)]
    fn write(&mut self, band: usize, start: usize, n: usize, rows: &[Axes8; ROWS]) {
        let Some(Region { start: region, stride, .. }) = self.regions.get(band) else { return };
        let Self { simd, bank, axis, .. } = *self;
        let gains = simd.load(&bank.gains[band * bank.n_axes.div_ceil(GROUP) + axis / GROUP].0);
        let n_axes = bank.n_axes - axis;
        let out = &mut self.values[region + axis * stride + start..];
        for (t, eight) in rows[..n.next_multiple_of(GROUP)].as_chunks::<GROUP>().0.iter().enumerate() {
            let mut lanes = [gains; GROUP];
            for l in 0..GROUP {
                lanes[l] = simd.load(&eight[l].0) * gains;
            }
            let lanes = Register::transposed(lanes);
            for l in 0..GROUP {
                if l < n_axes {
                    lanes[l].store(&mut out[l * stride + t * GROUP..]);
                }
            }
        }
    }
}

/// The first `N` of some values; the rest is zero.
#[inline(always)]
fn first<const N: usize>(values: &[f64]) -> Pack<f64, GROUP> {
    let mut out = Pack::ZERO;
    out.0[..N].copy_from_slice(&values[..N]);
    out
}

/// Means of the axes of a time-major recording, counted from its first sample; false where a value is NaN, infinite or
/// beyond the limit of its axis.
#[inline(always)]
pub(super) fn means_within(recording: &[f64], limits: &[f64], means: &mut [f64]) -> bool {
    let mut within = true;
    for axis in (0..limits.len()).step_by(GROUP) {
        with_axes!(limits.len() - axis, |N| within &= group_within::<N>(recording, axis, limits, means));
    }
    within
}

/// `N` axes from `axis` on.
#[inline(always)]
fn group_within<const N: usize>(recording: &[f64], axis: usize, limits: &[f64], means: &mut [f64]) -> bool {
    let n_axes = limits.len();
    let at_start = first::<N>(&recording[axis..]);
    // Two sums side by side: one would wait for itself at every row.
    let mut sums = [Pack::ZERO; 2];
    let mut largest = [Pack::<f64, GROUP>::ZERO; 2];
    let pairs = recording.chunks_exact(2 * n_axes);
    let rest = pairs.remainder();
    for pair in pairs {
        for i in 0..2 {
            let x = first::<N>(&pair[i * n_axes + axis..]);
            sums[i] = sums[i] + (x - at_start);
            largest[i] = x.abs().above(largest[i]).select(x.abs(), largest[i]);
        }
    }
    for row in rest.chunks_exact(n_axes) {
        let x = first::<N>(&row[axis..]);
        sums[0] = sums[0] + (x - at_start);
        largest[0] = x.abs().above(largest[0]).select(x.abs(), largest[0]);
    }
    let n = (recording.len() / n_axes) as f64;
    let sum = sums[0] + sums[1];
    let mut within = true;
    for lane in 0..N {
        // NaN is never the larger one of two, but it stays in a sum.
        within &= sum.0[lane].is_finite() && largest.iter().all(|l| l.0[lane] <= limits[axis + lane]);
        means[axis + lane] = sum.0[lane] / n;
    }
    within
}
