//! From a recording to the signals of its bands, as it arrives or all at once.
//!
//! Axes go through a pyramid of filters, four side by side: stages at rates that are halved from one to the next, each with an
//! octave, the first with two.
//!
//! Rows go through in blocks. A block of a stage is half a block of the next one, which runs as soon as it has a whole one.
//! What a recording leaves over at its end goes through all stages in a copy of what they remember, so that more of it may
//! still come. Signals are counted from the first sample: a start as if it had lasted for ever is then a start from rest,
//! and a constant leaves nothing behind, not even rounding.

use super::spec::{halved, halvings, n_octaves, TOP};
use super::{BandSignals, Region};
use crate::dsp::{butterworth, Band};
use crate::error::{Error, Result};
use crate::kernel::{Pack, Register, Simd};

/// Order of the low-pass in front of every halving of the rate. What lies at 0.755 to 0.878 of Nyquist folds onto the octave
/// that is taken next; there the low-pass is down by 55 dB or more.
const HALVING_ORDER: usize = 7;

/// Axes of a group, which go through the bank side by side. Eight would leave a quarter of the work of six axes without use.
const GROUP: usize = 4;

/// The axes of a group at one instant.
type Axes4 = Pack<GROUP>;

/// Rows that go through a stage together: an even number, whole groups.
pub(super) const ROWS: usize = 64;

/// Rows before the first that a stage looks back to.
const BACK: usize = 4;

/// Signals begin at whole cache lines: this many float64.
const LINE: usize = 8;

/// Calls a function for each group of axes, with its first axis and, as a constant, how many it has.
macro_rules! each_group {
    ($n_axes:expr, |$axis:ident, $n:ident| $call:expr) => {
        for $axis in (0..$n_axes).step_by(GROUP) {
            each_group!(@ $n_axes - $axis, $n, $call, 1 2 3)
        }
    };
    (@ $left:expr, $n:ident, $call:expr, $($few:literal)*) => {
        match $left {
            $($few => { const $n: usize = $few; $call })*
            _ => { const $n: usize = GROUP; $call }
        }
    };
}

/// The three filters of the pyramid; the same at every stage, for frequencies are relative to its rate. Both octaves have
/// the same zeros, twice at frequency 0 and twice at Nyquist: `(1 - z^-2)^2` is taken once.
#[derive(Clone, Copy, Debug)]
struct Filters {
    /// The highest octave.
    top: Poles,
    /// The octave below.
    octave: Poles,
    /// Before the rate is halved: `(A(a0) A(a2) + z^-1 A(a1)) / 2` with all-passes `A(a) = (a + z^-2) / (1 + a z^-2)`.
    halving: [f64; 3],
}

/// Two pairs of poles and the gain of a band-pass whose zeros are known.
#[derive(Clone, Copy, Debug)]
struct Poles {
    /// `a1` and `a2` of each pair: `1 + a1 z^-1 + a2 z^-2`.
    pairs: [[f64; 2]; 2],
    /// Factor of the numerator.
    gain: f64,
}

impl Filters {
    fn new() -> Result<Self> {
        Ok(Self { top: Poles::new(TOP)?, octave: Poles::new(TOP / 2.0)?, halving: all_passes()? })
    }
}

impl Poles {
    /// Those of the octave that ends at `high`, a share of the Nyquist frequency.
    fn new(high: f64) -> Result<Self> {
        let sos = butterworth(2, Band::Bandpass(high / 2.0, high), 2.0)?;
        let mut poles = Self { pairs: [[0.0; 2]; 2], gain: 1.0 };
        for (pair, section) in poles.pairs.iter_mut().zip(sos.sections()) {
            *pair = [section.a1, section.a2];
            poles.gain *= section.b0;
        }
        Ok(poles)
    }
}

/// A Butterworth low-pass of odd order that ends at half the Nyquist frequency has its poles on the imaginary axis, so that
/// it is the sum of two chains of all-passes in `z^-2`, one of them a sample later (Gazsi, "Explicit formulas for lattice
/// wave digital filters", 1985). The poles take turns.
fn all_passes() -> Result<[f64; 3]> {
    let sos = butterworth(HALVING_ORDER, Band::Lowpass(0.5), 2.0)?;
    let mut squares: Vec<_> = sos.sections().iter().map(|section| section.a2).collect();
    squares.sort_by(f64::total_cmp);
    // The first is the pole at zero.
    Ok([squares[1], squares[2], squares[3]])
}

/// The last two outputs of a recurrence.
#[derive(Clone, Copy, Debug)]
struct Last {
    latest: Axes4,
    before: Axes4,
}

impl Last {
    const REST: Self = Self { latest: Pack::ZERO, before: Pack::ZERO };

    /// Takes in `x` and gives what a pair of poles makes of it. What is known early comes first: only one product and one
    /// difference wait for the row before.
    #[inline(always)]
    fn resonate(&mut self, [a1, a2]: [f64; 2], x: Axes4) -> Axes4 {
        let y = x - Pack::splat(a2) * self.before - Pack::splat(a1) * self.latest;
        *self = Self { latest: y, before: self.latest };
        y
    }
}

/// What a stage remembers from one block to the next, apart from its input.
#[derive(Clone, Copy, Debug)]
struct Memory {
    /// By how much the input rose over two rows.
    rise: Last,
    top: [Last; 2],
    octave: [Last; 2],
    /// What the all-passes gave last.
    halving: [Axes4; 3],
}

impl Memory {
    const REST: Self =
        Self { rise: Last::REST, top: [Last::REST; 2], octave: [Last::REST; 2], halving: [Pack::ZERO; 3] };

    /// What the zeros that both octaves share make of a row and the one two rows earlier.
    #[inline(always)]
    fn numerator(&mut self, x: Axes4, earlier: Axes4) -> Axes4 {
        let rise = x - earlier;
        let out = rise - self.rise.before;
        self.rise = Last { latest: rise, before: self.rise.latest };
        out
    }

    /// A row of half the rate, of the last four; twice as large as the input.
    #[inline(always)]
    fn halve(&mut self, factors: [f64; 3], [x3, x2, x1, x0]: [Axes4; 4]) -> Axes4 {
        let [a0, a1, a2] = [Pack::splat(factors[0]), Pack::splat(factors[1]), Pack::splat(factors[2])];
        let [before0, before1, before2] = self.halving;
        let y0 = a0 * x0 + x2 - a0 * before0;
        let y1 = a1 * x1 + x3 - a1 * before1;
        let y2 = a2 * y0 + before0 - a2 * before2;
        self.halving = [y0, y1, y2];
        y2 + y1
    }
}

/// What comes out of one block of a stage, without the gain of its filters.
#[derive(Clone, Debug)]
struct Rows {
    top: [Axes4; ROWS],
    octave: [Axes4; ROWS],
}

impl Rows {
    const ZERO: Self = Self { top: [Pack::ZERO; ROWS], octave: [Pack::ZERO; ROWS] };
}

/// At most [`ROWS`] rows, `input` with the [`BACK`] before them, through the filters of a stage: `FIRST` with two octaves.
/// `halved` are the rows of the next stage.
#[inline(always)]
fn run<const FIRST: bool>(
    filters: &Filters,
    mut m: Memory,
    input: &[Axes4],
    rows: &mut Rows,
    halved: &mut [Axes4],
) -> Memory {
    let Filters { top: top_poles, octave: poles, halving } = filters;
    let pairs = input.windows(BACK + 2).step_by(2).zip(halved);
    let outputs = rows.top.as_chunks_mut::<2>().0.iter_mut().zip(rows.octave.as_chunks_mut::<2>().0);
    for ((x, halved), (top, octave)) in pairs.zip(outputs) {
        for i in 0..2 {
            let w = m.numerator(x[BACK + i], x[BACK + i - 2]);
            if FIRST {
                let y = m.top[0].resonate(top_poles.pairs[0], w);
                top[i] = m.top[1].resonate(top_poles.pairs[1], y);
            }
            let y = m.octave[0].resonate(poles.pairs[0], w);
            octave[i] = m.octave[1].resonate(poles.pairs[1], y);
        }
        *halved = m.halve(*halving, [x[BACK - 3], x[BACK - 2], x[BACK - 1], x[BACK]]);
    }
    m
}

/// Filters between two halvings of the rate.
#[derive(Clone, Debug)]
struct Stage {
    memory: Memory,
    /// Rows that wait, behind the last [`BACK`] that have gone through.
    input: [Axes4; BACK + ROWS],
    n_waiting: usize,
    /// Rows that have gone through.
    n_done: usize,
}

impl Stage {
    const REST: Self =
        Self { memory: Memory::REST, input: [Pack::ZERO; BACK + ROWS], n_waiting: 0, n_done: 0 };
}

/// The stages of a group of axes.
#[derive(Clone, Debug)]
struct Pyramid {
    stages: Vec<Stage>,
    /// Where the rows below the last octave go, and no further.
    below: [Axes4; ROWS / 2],
}

impl Pyramid {
    /// For one octave or more.
    fn new(octaves: usize) -> Self {
        let n_stages = octaves.saturating_sub(1).max(1);
        Self { stages: vec![Stage::REST; n_stages], below: [Pack::ZERO; ROWS / 2] }
    }

    fn restart(&mut self) {
        for stage in &mut self.stages {
            stage.memory = Memory::REST;
            stage.input[..BACK].fill(Pack::ZERO);
            (stage.n_waiting, stage.n_done) = (0, 0);
        }
    }

    /// Rows that have gone through the first stage.
    fn n_done(&self) -> usize {
        self.stages[0].n_done
    }

    /// Where the next rows go: a block, or what is left of a recording.
    fn input(&mut self) -> &mut [Axes4] {
        &mut self.stages[0].input[BACK..]
    }

    /// A block that stands in [`input`](Self::input) through all stages that now have one.
    #[inline(always)]
    fn advance<const N: usize>(&mut self, rows: &mut Rows, out: &mut Output<'_, impl Simd, N>) {
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
    fn finish<const N: usize>(&mut self, mut n: usize, rows: &mut Rows, out: &mut Output<'_, impl Simd, N>) {
        for index in 0..self.stages.len() {
            n += self.stages[index].n_waiting;
            self.through(index, n, rows, out);
            n = n.div_ceil(2);
        }
    }

    /// The first `n` rows that wait at a stage through its filters, and what these remember of them then.
    #[inline(always)]
    fn through<const N: usize>(
        &mut self,
        index: usize,
        n: usize,
        rows: &mut Rows,
        out: &mut Output<'_, impl Simd, N>,
    ) -> Memory {
        let (stages, after) = self.stages.split_at_mut(index + 1);
        let halved = match after {
            [next, ..] => &mut next.input[BACK + next.n_waiting..],
            [] => &mut self.below[..],
        };
        let Stage { memory, input, n_done, .. } = &stages[index];
        // An odd row goes through with whatever lies behind it: nobody looks at what comes of that.
        let (filters, input) = (&out.bank.filters, &input[..BACK + n.next_multiple_of(2)]);
        let memory = if index == 0 {
            let memory = run::<true>(filters, *memory, input, rows, halved);
            out.write(1, *n_done, n, &rows.top);
            memory
        } else {
            run::<false>(filters, *memory, input, rows, halved)
        };
        out.write(2 + index, *n_done, n, &rows.octave);
        memory
    }
}

/// Splits recordings of one shape into bands.
#[derive(Clone, Debug)]
pub(super) struct Bank {
    filters: Filters,
    /// What each signal is multiplied by, in the order of bands, then of axes.
    gains: Vec<f64>,
    n_axes: usize,
    n_samples: usize,
    octaves: usize,
}

/// Memory for one recording and its bands.
#[derive(Clone, Debug)]
pub(super) struct BankWork {
    values: Vec<f64>,
    regions: Vec<Region>,
    /// One for each group of axes; none where there are no octaves.
    pyramids: Vec<Pyramid>,
    // Boxed: its lanes want more alignment than every owner gives, Python's objects for one.
    rows: Box<Rows>,
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
fn aligned(values: &[f64]) -> usize {
    // Speed only: a pointer that cannot be aligned stays as it is.
    values.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE)
}

/// How often the rate is halved before each of the bands.
fn rates(octaves: usize) -> impl Iterator<Item = u32> {
    std::iter::once(0).chain((0..octaves).map(halvings))
}

impl Bank {
    /// For bands that are divided by `scales`, band-major.
    pub(super) fn new(n_samples: usize, n_axes: usize, scales: &[f64]) -> Result<Self> {
        // All bands together hold less than five times the samples of the recording, and some room to align them.
        let room = n_samples
            .checked_add(2 * LINE)
            .and_then(|n| n.checked_mul(n_axes)?.checked_mul(8 * size_of::<f64>()));
        if room.is_none_or(|room| isize::try_from(room).is_err()) {
            return Err(Error::TooLarge { n_samples, n_axes });
        }
        let filters = Filters::new()?;
        let gain = |band: usize| match band {
            0 => 1.0,
            1 => filters.top.gain,
            // Every halving has doubled the signal.
            _ => filters.octave.gain * libm::exp2(-f64::from(halvings(band - 1))),
        };
        let gains = scales.iter().enumerate().map(|(i, scale)| gain(i / n_axes) / scale).collect();
        Ok(Self { filters, gains, n_axes, n_samples, octaves: n_octaves(n_samples) })
    }

    pub(super) fn work(&self) -> BankWork {
        let mut start = 0;
        let region = |halvings| {
            let stride = halved(self.n_samples, halvings).next_multiple_of(LINE);
            let region = Region { start, stride, len: 0 };
            start += self.n_axes * stride;
            region
        };
        let regions: Vec<_> = rates(self.octaves).map(region).collect();
        BankWork {
            values: vec![0.0; start + LINE],
            regions,
            pyramids: match self.octaves {
                0 => Vec::new(),
                octaves => vec![Pyramid::new(octaves); self.n_axes.div_ceil(GROUP)],
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
        each_group!(self.n_axes, |axis, N| self.advance_group::<N>(simd, recording, axis, work));
        for (region, halvings) in work.regions.iter_mut().zip(rates(self.octaves)).skip(1) {
            region.len = (n_after >> halvings) / ROWS * ROWS;
        }
        true
    }

    /// Splits what [`advance`](Self::advance) has left of a recording, of which more may come, and gives band 0; `means` are
    /// those of its axes, counted from the first sample.
    #[inline(always)]
    pub(super) fn finish(&self, simd: impl Simd, recording: &[f64], means: &[f64], work: &mut BankWork) {
        each_group!(self.n_axes, |axis, N| self.finish_group::<N>(simd, recording, axis, means, work));
        let n_seen = recording.len() / self.n_axes;
        for (region, halvings) in work.regions.iter_mut().zip(rates(self.octaves)) {
            region.len = halved(n_seen, halvings);
        }
    }

    /// `N` axes from `axis` on, one block.
    #[inline(always)]
    fn advance_group<const N: usize>(
        &self,
        simd: impl Simd,
        recording: &[f64],
        axis: usize,
        work: &mut BankWork,
    ) {
        let (mut out, pyramid, rows) = self.group::<_, N>(simd, axis, work);
        let Some(pyramid) = pyramid else { return };
        let at_start = first::<N>(&recording[axis..]);
        let block = recording[pyramid.n_done() * self.n_axes..].chunks_exact(self.n_axes);
        for (row, input) in block.zip(pyramid.input()) {
            *input = first::<N>(&row[axis..]) - at_start;
        }
        pyramid.advance(rows, &mut out);
    }

    /// `N` axes from `axis` on, to the end.
    #[inline(always)]
    fn finish_group<const N: usize>(
        &self,
        simd: impl Simd,
        recording: &[f64],
        axis: usize,
        means: &[f64],
        work: &mut BankWork,
    ) {
        let (mut out, mut pyramid, rows) = self.group::<_, N>(simd, axis, work);
        let n_done = pyramid.as_ref().map_or(0, |pyramid| pyramid.n_done());
        let (at_start, mean) = (first::<N>(&recording[axis..]), first::<N>(&means[axis..]));
        for (block, samples) in recording.chunks(ROWS * self.n_axes).enumerate() {
            let (start, n) = (block * ROWS, samples.len() / self.n_axes);
            for (row, centred) in samples.chunks_exact(self.n_axes).zip(&mut rows.top) {
                *centred = first::<N>(&row[axis..]) - at_start - mean;
            }
            out.write(0, start, n, &rows.top);
            let Some(pyramid) = pyramid.as_deref_mut().filter(|_| start >= n_done) else { continue };
            for (row, input) in samples.chunks_exact(self.n_axes).zip(pyramid.input()) {
                *input = first::<N>(&row[axis..]) - at_start;
            }
            if n == ROWS {
                pyramid.advance(rows, &mut out);
            }
        }
        if let Some(pyramid) = pyramid {
            pyramid.finish(recording.len() / self.n_axes % ROWS, rows, &mut out);
        }
    }

    /// What `N` axes from `axis` on work in.
    #[inline(always)]
    fn group<'a, S, const N: usize>(
        &'a self,
        simd: S,
        axis: usize,
        work: &'a mut BankWork,
    ) -> (Output<'a, S, N>, Option<&'a mut Pyramid>, &'a mut Rows) {
        let BankWork { values, regions, pyramids, rows } = work;
        let from = aligned(values);
        let out = Output { simd, values: &mut values[from..], regions, axis, bank: self };
        (out, pyramids.get_mut(axis / GROUP), rows)
    }
}

/// Where all bands of `N` axes from `axis` on go.
struct Output<'a, S, const N: usize> {
    simd: S,
    values: &'a mut [f64],
    regions: &'a [Region],
    axis: usize,
    bank: &'a Bank,
}

impl<S: Simd, const N: usize> Output<'_, S, N> {
    /// Takes the first `n` rows of a band, which are those from `start` on. A band that the recording is too short for is
    /// left out.
    #[inline(always)]
    fn write(&mut self, band: usize, start: usize, n: usize, rows: &[Axes4; ROWS]) {
        let Some(Region { start: region, stride, .. }) = self.regions.get(band) else { return };
        let simd = self.simd;
        let gains = first::<N>(&self.bank.gains[band * self.bank.n_axes + self.axis..]);
        let fours = rows[..n.next_multiple_of(GROUP)].as_chunks::<GROUP>().0;
        let mut axes = self.values[region + self.axis * stride + start..].chunks_mut(*stride);
        let mut axes: [&mut [[f64; GROUP]]; N] = std::array::from_fn(|_| {
            axes.next().map_or(&mut [][..], |axis| &mut axis.as_chunks_mut().0[..fours.len()])
        });
        for (t, [a, b, c, d]) in fours.iter().enumerate() {
            let rows = [simd.load(&a.0), simd.load(&b.0), simd.load(&c.0), simd.load(&d.0)];
            let lanes = Register::transposed(rows);
            for (axis, (lane, gain)) in axes.iter_mut().zip(lanes.into_iter().zip(gains.0)) {
                (lane * gain).store(&mut axis[t]);
            }
        }
    }
}

/// The first `N` of some values; the rest is zero.
#[inline(always)]
fn first<const N: usize>(values: &[f64]) -> Axes4 {
    let mut out = Pack::ZERO;
    out.0[..N].copy_from_slice(&values[..N]);
    out
}

/// Means of the axes of a time-major recording, counted from its first sample; false where a value is NaN, infinite or
/// beyond the limit of its axis.
#[inline(always)]
pub(super) fn means_within(recording: &[f64], limits: &[f64], means: &mut [f64]) -> bool {
    let mut within = true;
    each_group!(limits.len(), |axis, N| within &= group_within::<N>(recording, axis, limits, means));
    within
}

/// `N` axes from `axis` on.
#[inline(always)]
fn group_within<const N: usize>(recording: &[f64], axis: usize, limits: &[f64], means: &mut [f64]) -> bool {
    let n_axes = limits.len();
    let at_start = first::<N>(&recording[axis..]);
    // Four sums side by side: one would wait for itself at every row.
    let mut sums = [Axes4::ZERO; 4];
    let mut largest = [Axes4::ZERO; 4];
    let fours = recording.chunks_exact(4 * n_axes);
    let rest = fours.remainder();
    for four in fours {
        for i in 0..4 {
            let x = first::<N>(&four[i * n_axes + axis..]);
            sums[i] = sums[i] + (x - at_start);
            largest[i] = x.abs().above(largest[i]).select(x.abs(), largest[i]);
        }
    }
    for (i, row) in rest.chunks_exact(n_axes).enumerate() {
        let x = first::<N>(&row[axis..]);
        sums[i] = sums[i] + (x - at_start);
        largest[i] = x.abs().above(largest[i]).select(x.abs(), largest[i]);
    }
    let n = (recording.len() / n_axes) as f64;
    let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    let mut within = true;
    for lane in 0..N {
        // NaN is never the larger one of two, but it stays in a sum.
        within &= sum.0[lane].is_finite() && largest.iter().all(|l| l.0[lane] <= limits[axis + lane]);
        means[axis + lane] = sum.0[lane] / n;
    }
    within
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numerators_are_those_of_the_designs() {
        let filters = Filters::new().unwrap();
        for (high, poles) in [(TOP, filters.top), (TOP / 2.0, filters.octave)] {
            let sos = butterworth(2, Band::Bandpass(high / 2.0, high), 2.0).unwrap();
            assert_eq!(sos.sections().len(), 2);
            let [p, q] = [sos.sections()[0], sos.sections()[1]].map(|s| [s.b0, s.b1, s.b2]);
            for (power, zero) in [1.0, 0.0, -2.0, 0.0, 1.0].iter().enumerate() {
                let product: f64 =
                    (0..3).filter(|i| (*i..i + 3).contains(&power)).map(|i| p[i] * q[power - i]).sum();
                assert!((product - poles.gain * zero).abs() < 1e-12 * poles.gain, "{high} {power}");
            }
        }
    }

    #[test]
    fn all_passes_are_the_low_pass() {
        let sos = butterworth(HALVING_ORDER, Band::Lowpass(0.5), 2.0).unwrap();
        let mut impulse = [0.0; 40];
        impulse[0] = 1.0;
        let mut expected = impulse;
        for s in sos.sections() {
            let (mut z0, mut z1) = (0.0, 0.0);
            for x in &mut expected {
                let y = s.b0 * *x + z0;
                (z0, z1) = (s.b1 * *x - s.a1 * y + z1, s.b2 * *x - s.a2 * y);
                *x = y;
            }
        }
        let all_pass = |a: f64, x: [f64; 40]| {
            let mut y = [0.0; 40];
            for t in 0..40 {
                let before = |values: &[f64; 40]| if t < 2 { 0.0 } else { values[t - 2] };
                y[t] = a * x[t] + before(&x) - a * before(&y);
            }
            y
        };
        let [a0, a1, a2] = all_passes().unwrap();
        let (first, second) = (all_pass(a2, all_pass(a0, impulse)), all_pass(a1, impulse));
        for t in 1..40 {
            assert!((expected[t] - 0.5 * (first[t] + second[t - 1])).abs() < 1e-15, "{t}");
        }
    }
}
