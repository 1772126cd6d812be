//! From a recording to the signals of its bands.
//!
//! Axes go through a pyramid of filters in float32, eight side by side: stages at rates that are halved from one to the next.
//! One of them has two octaves, each of the others one: the first stage has them, or the second where the rate is halved early.
//!
//! Signals are counted from the first sample: a start as if it had lasted for ever is then a start from rest, and a constant
//! leaves nothing behind, not even rounding. They are also divided by the least scale of their axis, in float64, so that the
//! range of float32 is that of a signal and not of its unit; what is left of 24 bits is more than sensors have.

use super::spec::{halved, halves_early, halvings, least_scales, n_octaves, LARGEST, TOP};
use super::{narrow, BandSignals, Region, LANES};
use crate::dsp::{butterworth, Band};
use crate::error::Result;
use crate::kernel::{F32x8, Pack, Simd};

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

/// Splits recordings of one shape into bands.
#[derive(Clone, Debug)]
pub(super) struct Bank {
    filters: Filters,
    /// The largest magnitude of each axis that can be worked with.
    pub(super) limits: Vec<f64>,
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
#[derive(Clone, Debug)]
pub(super) struct BankWork {
    values: Vec<f32>,
    regions: Vec<Region>,
    /// Rows of a group of axes at the rate of a stage, and those of the next stage: [`BACK`] zeros, then the rows.
    rows: [Vec<Axes8>; 2],
    // Boxed: its lanes want more alignment than every owner gives, Python's objects for one.
    filtered: Box<Rows>,
}

impl BankWork {
    /// The bands of the recording that was split last.
    pub(super) fn signals(&self, n_axes: usize) -> BandSignals<'_> {
        BandSignals { values: &self.values[aligned(&self.values)..], regions: &self.regions, n_axes }
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
                    *own = narrow(gain(band) / (scale * inverse));
                }
                gains.push(of_group);
            }
        }
        let limits = least_scales(scales, n_axes).map(|scale| LARGEST * scale).collect();
        Ok(Self { filters, limits, inverse, gains, n_axes, n_samples, octaves: n_octaves(n_samples), early })
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
        let rows = vec![Pack::ZERO; BACK + self.n_samples.next_multiple_of(ROWS)];
        BankWork {
            values: vec![0.0; start + LINE],
            regions,
            rows: [rows.clone(), rows],
            filtered: Box::new(Rows::ZERO),
        }
    }

    /// Splits a recording, or the beginning of one, time-major, into its bands; false where a value is NaN, infinite or beyond
    /// the limit of its axis.
    #[inline(always)]
    pub(super) fn split(&self, simd: impl Simd, recording: &[f64], work: &mut BankWork) -> bool {
        let n_seen = recording.len() / self.n_axes;
        for (region, halvings) in work.regions.iter_mut().zip(self.rates()) {
            region.len = halved(n_seen, halvings);
        }
        // No closure: it would lose the vector features of the caller.
        for axis in (0..self.n_axes).step_by(GROUP) {
            if !self.split_group(simd, recording, axis, work) {
                return false;
            }
        }
        true
    }

    /// The same of a group of axes from `axis` on.
    #[inline(always)]
    fn split_group<S: Simd>(&self, simd: S, recording: &[f64], axis: usize, work: &mut BankWork) -> bool {
        let BankWork { values, regions, rows: [rows, next], filtered } = work;
        let from = aligned(values);
        let mut out = Output { simd, values: &mut values[from..], regions, axis, bank: self };
        let loaded = with_axes!(self.n_axes - axis, |N| self.load::<N>(recording, axis, &mut rows[BACK..]));
        let Some(mean) = loaded else { return false };
        let mut n = recording.len() / self.n_axes;
        for (start, rows) in (0..n).step_by(ROWS).zip(rows[BACK..].chunks_exact(ROWS)) {
            for (centred, x) in filtered.top.iter_mut().zip(rows) {
                *centred = *x - mean;
            }
            out.write(0, start, ROWS.min(n - start), &filtered.top);
        }
        let n_stages = if self.octaves == 0 { 0 } else { 1 + self.rates().max().unwrap_or(0) as usize };
        for stage in 0..n_stages {
            let mut memory = Memory::at_rest(simd.splat(0.0));
            let (top, octave) = match (stage, self.early) {
                (0, false) | (1, true) => (true, true),
                (0, true) => (true, false),
                _ => (false, true),
            };
            for start in (0..n).step_by(ROWS) {
                // An odd row goes through with whatever lies behind it: nobody looks at what comes of that.
                let n_rows = ROWS.min(n - start);
                let input = &rows[start..][..BACK + n_rows.next_multiple_of(2)];
                let halved = &mut next[BACK + start / 2..];
                let (filters, memory) = (&self.filters, &mut memory);
                match (top, octave) {
                    (true, true) => run::<true, true, S>(simd, filters, memory, input, filtered, halved),
                    (true, false) => run::<true, false, S>(simd, filters, memory, input, filtered, halved),
                    _ => run::<false, true, S>(simd, filters, memory, input, filtered, halved),
                }
                if top {
                    out.write(1 + stage, start, n_rows, &filtered.top);
                }
                if octave {
                    out.write(2 + stage, start, n_rows, &filtered.octave);
                }
            }
            std::mem::swap(rows, next);
            n = n.div_ceil(2);
        }
        true
    }

    /// Samples of `N` axes from `axis` on as the pyramid takes them, and their means; `None` where a value is NaN, infinite or
    /// beyond the limit of its axis.
    #[inline(always)]
    fn load<const N: usize>(&self, recording: &[f64], axis: usize, rows: &mut [Axes8]) -> Option<Axes8> {
        let (at_start, inverse) = (first::<N>(&recording[axis..]), first::<N>(&self.inverse[axis..]));
        // Two sums in turn: one would wait for itself at every row.
        let (mut sums, mut largest) = ([Pack::ZERO; 2], Pack::<f64, GROUP>::ZERO);
        for (row, out) in recording.chunks_exact(self.n_axes).zip(rows) {
            let x = first::<N>(&row[axis..]);
            let z = (x - at_start) * inverse;
            sums = [sums[1], sums[0] + z];
            for l in 0..GROUP {
                out.0[l] = narrow(z.0[l]);
                let size = x.0[l].abs();
                largest.0[l] = if size > largest.0[l] { size } else { largest.0[l] };
            }
        }
        let (sum, n) = (sums[0] + sums[1], (recording.len() / self.n_axes) as f64);
        // NaN is never the larger one of two, but it stays in a sum.
        let within = (0..N).all(|l| sum.0[l].is_finite() && largest.0[l] <= self.limits[axis + l]);
        within.then(|| Pack(sum.0.map(|sum| narrow(sum / n))))
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
            let lanes = F32x8::transposed(lanes);
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

/// Order of the low-pass in front of every halving of the rate. What lies at 0.755 to 0.878 of Nyquist folds onto the octave
/// that is taken next; there the low-pass is down by 55 dB or more.
const HALVING_ORDER: usize = 7;

/// Axes of a group, which go through the bank side by side.
const GROUP: usize = LANES;

/// The axes of a group at one instant.
type Axes8 = Pack<f32, GROUP>;

/// Rows that go through a stage at a time: an even number, whole groups.
const ROWS: usize = 64;

/// Rows before the first that a stage looks back to.
const BACK: usize = 4;

/// The three filters of the pyramid; the same at every stage, for frequencies are relative to its rate. Both octaves have
/// the same zeros, twice at frequency 0 and twice at Nyquist: `(1 - z^-2)^2` is taken once.
#[derive(Clone, Copy, Debug)]
struct Filters {
    /// The upper octave of two.
    top: Poles,
    /// The octave below, or the only one, but for the first.
    octave: Poles,
    /// Before the rate is halved: `(A(a0) A(a2) + z^-1 A(a1)) / 2` with all-passes `A(a) = (a + z^-2) / (1 + a z^-2)`.
    halving: [f32; 3],
}

/// Two pairs of poles and the gain of a band-pass whose zeros are known.
#[derive(Clone, Copy, Debug)]
struct Poles {
    /// `a1` and `a2` of each pair: `1 + a1 z^-1 + a2 z^-2`.
    pairs: [[f32; 2]; 2],
    /// Factor of the numerator.
    gain: f64,
}

impl Filters {
    fn new() -> Result<Self> {
        let halving = all_passes()?.map(narrow);
        Ok(Self { top: Poles::new(TOP)?, octave: Poles::new(TOP / 2.0)?, halving })
    }
}

impl Poles {
    /// Those of the octave that ends at `high`, a share of the Nyquist frequency.
    fn new(high: f64) -> Result<Self> {
        let sos = butterworth(2, Band::Bandpass(high / 2.0, high), 2.0)?;
        let mut poles = Self { pairs: [[0.0; 2]; 2], gain: 1.0 };
        for (pair, section) in poles.pairs.iter_mut().zip(sos.sections()) {
            *pair = [section.a1, section.a2].map(narrow);
            poles.gain *= section.b0;
        }
        Ok(poles)
    }

    /// The pairs, each number in all lanes.
    #[inline(always)]
    fn splat<S: Simd>(&self, simd: S) -> [[S::F32x8; 2]; 2] {
        let [[a, b], [c, d]] = self.pairs;
        [[simd.splat(a), simd.splat(b)], [simd.splat(c), simd.splat(d)]]
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
#[derive(Clone, Copy)]
struct Last<V> {
    latest: V,
    before: V,
}

impl<V: F32x8> Last<V> {
    /// Takes in `x` and gives what a pair of poles makes of it. What is known early comes first: only one product and one
    /// difference wait for the row before.
    #[inline(always)]
    fn resonate(&mut self, [a1, a2]: [V; 2], x: V) -> V {
        let y = x - a2 * self.before - a1 * self.latest;
        *self = Self { latest: y, before: self.latest };
        y
    }
}

/// What the filters of a stage remember of the rows before.
struct Memory<V> {
    top: [Last<V>; 2],
    octave: [Last<V>; 2],
    /// What the all-passes gave last.
    halving: [V; 3],
}

impl<V: F32x8> Memory<V> {
    /// Nothing before the first row.
    #[inline(always)]
    fn at_rest(zero: V) -> Self {
        let rest = Last { latest: zero, before: zero };
        Self { top: [rest; 2], octave: [rest; 2], halving: [zero; 3] }
    }

    /// A row of half the rate, of the last four; twice as large as the input.
    #[inline(always)]
    fn halve(&mut self, [a0, a1, a2]: [V; 3], [x3, x2, x1, x0]: [V; 4]) -> V {
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
    top: [Axes8; ROWS],
    octave: [Axes8; ROWS],
}

impl Rows {
    const ZERO: Self = Self { top: [Pack::ZERO; ROWS], octave: [Pack::ZERO; ROWS] };
}

/// Sends at most [`ROWS`] rows, `input` with the [`BACK`] before them, through the filters of a stage, one or both octaves.
/// `halved` are the rows of the next stage.
#[inline(always)]
fn run<const UPPER: bool, const LOWER: bool, S: Simd>(
    simd: S,
    filters: &Filters,
    m: &mut Memory<S::F32x8>,
    input: &[Axes8],
    rows: &mut Rows,
    halved: &mut [Axes8],
) {
    let (top_poles, poles) = (filters.top.splat(simd), filters.octave.splat(simd));
    let [a0, a1, a2] = filters.halving;
    let halving = [simd.splat(a0), simd.splat(a1), simd.splat(a2)];
    let pairs = input.windows(BACK + 2).step_by(2).zip(halved);
    let outputs = rows.top.as_chunks_mut::<2>().0.iter_mut().zip(rows.octave.as_chunks_mut::<2>().0);
    for ((rows, halved), (top, octave)) in pairs.zip(outputs) {
        let mut x = [halving[0]; BACK + 2];
        for (x, row) in x.iter_mut().zip(rows) {
            *x = simd.load(&row.0);
        }
        for i in 0..2 {
            // What the zeros that both octaves share make of the row.
            let w = (x[BACK + i] - x[BACK + i - 2]) - (x[BACK + i - 2] - x[BACK + i - 4]);
            if UPPER {
                let y = m.top[0].resonate(top_poles[0], w);
                m.top[1].resonate(top_poles[1], y).store(&mut top[i].0);
            }
            if LOWER {
                let y = m.octave[0].resonate(poles[0], w);
                m.octave[1].resonate(poles[1], y).store(&mut octave[i].0);
            }
        }
        m.halve(halving, [x[BACK - 3], x[BACK - 2], x[BACK - 1], x[BACK]]).store(&mut halved.0);
    }
}
