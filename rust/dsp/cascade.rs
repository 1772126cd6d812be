//! Filtering: transposed direct form II, in exactly one order of operations.
//!
//! No fused multiply-add and no other order than that of [`advance`], so that every path, and the compiled loop of
//! `scipy.signal.sosfilt` on x86-64, gives the same bits. Sections only see the output of the section before them and
//! channels do not see each other, so the order in which sections and channels are visited changes no bit.
//!
//! Subnormal numbers are kept, because flushing them to zero would change bits. That costs little: the loops are bound
//! by the latency of the recurrence. The tail of the 8th-order high-pass, which never quite dies (rounding keeps it
//! circling a few units of 2^-1074), runs at 1.1 times the time of noise for one channel and 1.5 times for six on AMD
//! Zen 3. Machines that handle subnormals in microcode may take longer.

use std::array::from_mut;

use crate::dsp::{Section, Sos};
use crate::error::{Error, Result};
use crate::memory::filled;

/// Values of a stretch of samples, which stay in the first-level cache: one group of sections filters them before the next
/// group takes over.
const STRETCH: usize = 1024;

/// Sections that one channel passes through together.
const WIDEST: usize = 8;

/// Channels that pass through a group of sections side by side.
const CHANNELS: usize = 8;

/// What signals come in: f64, or f32, which is calculated with in f64 and rounded once.
pub trait Real: Copy + Send + Sync + private::Values {
    /// The number nearest to another, or infinity.
    fn of(value: f64) -> Self;
    /// This number.
    fn value(self) -> f64;
}

pub(crate) mod private {
    use std::ops::{Add, Div, Mul, Neg, Sub};

    /// Numbers of one of the two kinds.
    pub enum Slice<'a> {
        F64(&'a mut [f64]),
        F32(&'a mut [f32]),
    }

    /// Tells the kinds apart, calculates with either, and admits no others.
    pub trait Values:
        Copy
        + PartialOrd
        + Add<Output = Self>
        + Sub<Output = Self>
        + Mul<Output = Self>
        + Div<Output = Self>
        + Neg<Output = Self>
    {
        const ZERO: Self;
        const ONE: Self;
        /// All bits set.
        const YES: Self;
        fn slice(values: &mut [Self]) -> Slice<'_>;
        fn sqrt(self) -> Self;
        fn abs(self) -> Self;
        fn copysign(self, sign: Self) -> Self;
        /// The bits of this number, in the low bits.
        fn bits(self) -> u64;
    }

    macro_rules! values {
        ($number:ident, $bits:ident, $slice:ident) => {
            impl Values for $number {
                const ZERO: Self = 0.0;
                const ONE: Self = 1.0;
                const YES: Self = Self::from_bits($bits::MAX);

                #[inline(always)]
                fn slice(values: &mut [Self]) -> Slice<'_> {
                    Slice::$slice(values)
                }

                #[inline(always)]
                fn sqrt(self) -> Self {
                    self.sqrt()
                }

                #[inline(always)]
                fn abs(self) -> Self {
                    self.abs()
                }

                #[inline(always)]
                fn copysign(self, sign: Self) -> Self {
                    self.copysign(sign)
                }

                #[inline(always)]
                fn bits(self) -> u64 {
                    self.to_bits().into()
                }
            }
        };
    }
    values!(f64, u64, F64);
    values!(f32, u32, F32);
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self
    }
}

impl Real for f32 {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation)] // what was asked for
    fn of(value: f64) -> Self {
        value as f32
    }

    #[inline(always)]
    fn value(self) -> f64 {
        f64::from(self)
    }
}

/// The memory of a stream of `channels` channels on its way through an [`Sos`]: two values per section and channel.
///
/// Filtering a signal in pieces of any size with one state gives the same bits as filtering it whole, and so does
/// filtering it sample by sample. A state belongs to one stream; it shares the coefficients with all others of its
/// [`Sos`]. Filtering allocates nothing and never blocks.
///
/// ```
/// use granular_id::{butterworth, Band, SosState};
///
/// let sos = butterworth(8, Band::Highpass(23.0), 500.0)?;
/// let mut wrench = SosState::zero(&sos, 6)?;
/// let mut chunk = [0.0; 4 * 6]; // four samples of six axes, sample by sample
/// wrench.filter(&mut chunk)?;
///
/// let mut force = SosState::zero(&sos, 1)?;
/// let [first] = force.advance([1.5_f32])?; // one sample
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SosState {
    sos: Sos,
    channels: usize,
    /// Per section: `z0` of every channel, then `z1` of every channel.
    values: Vec<f64>,
}

impl SosState {
    /// The state before the first sample, as if the signal had been zero forever.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn zero(sos: &Sos, channels: usize) -> Result<Self> {
        let values = filled(0.0, channels.saturating_mul(2 * sos.sections().len()))?;
        Ok(Self { sos: sos.clone(), channels, values })
    }

    /// The state as if each channel had held its first sample forever; one value per channel.
    ///
    /// # Errors
    /// [`Error::Argument`] when a section has a pole at `z = 1`; [`Error::Memory`].
    pub fn steady(sos: &Sos, first: &[f64]) -> Result<Self> {
        let mut state = Self::zero(sos, first.len())?;
        state.settle(&sos.steady_state()?, first);
        Ok(state)
    }

    /// A state taken from elsewhere: per section `z0` of every channel, then `z1` of every channel.
    ///
    /// # Errors
    /// [`Error::Length`] when the number of values is not `2 * channels * sections`.
    pub fn from_values(sos: &Sos, channels: usize, values: Vec<f64>) -> Result<Self> {
        // Saturated, the size cannot be that of a vector.
        let expected = channels.saturating_mul(2 * sos.sections().len());
        if values.len() == expected {
            Ok(Self { sos: sos.clone(), channels, values })
        } else {
            Err(Error::Length { what: "state", expected, got: values.len() })
        }
    }

    /// The filter.
    #[must_use]
    pub fn sos(&self) -> &Sos {
        &self.sos
    }

    /// Channels of the stream.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Per section `z0` of every channel, then `z1` of every channel.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Back to the state before the first sample.
    pub fn reset(&mut self) {
        self.values.fill(0.0);
    }

    /// Filters the next chunk in place: rows of one value per channel, any number of rows.
    ///
    /// # Errors
    /// [`Error::Length`] when the chunk does not hold whole rows. Neither the chunk nor the state has changed then.
    pub fn filter<T: Real>(&mut self, chunk: &mut [T]) -> Result<()> {
        let rows = chunk.len().checked_div(self.channels).unwrap_or(0);
        if rows * self.channels != chunk.len() {
            return Err(Error::Length { what: "chunk", expected: rows * self.channels, got: chunk.len() });
        }
        if chunk.is_empty() {
            return Ok(());
        }
        match T::slice(chunk) {
            private::Slice::F64(chunk) => self.filter_wide(chunk),
            private::Slice::F32(chunk) => self.filter_narrow(chunk),
        }
        Ok(())
    }

    /// Filters the next sample of every channel.
    ///
    /// # Errors
    /// [`Error::Length`] when there is not one value per channel. The state has not changed then.
    pub fn advance<T: Real, const C: usize>(&mut self, sample: [T; C]) -> Result<[T; C]> {
        if C != self.channels {
            return Err(Error::Length { what: "sample", expected: self.channels, got: C });
        }
        if C == 0 {
            return Ok(sample);
        }
        let mut x = sample.map(T::value);
        let (z, _) = self.values.as_chunks_mut::<C>().0.as_chunks_mut::<2>();
        for (section, [z0, z1]) in self.sos.sections().iter().zip(z) {
            x = advance::<C, false>(&section.splat(), z0, z1, &x);
        }
        Ok(x.map(T::of))
    }

    fn filter_wide(&mut self, chunk: &mut [f64]) {
        let Self { sos, channels, values } = self;
        if *channels == 1 {
            return one_channel(sos.sections(), values, chunk);
        }
        for first in (0..*channels).step_by(CHANNELS) {
            let place = Place { channels: *channels, first, stride: *channels, at: first };
            side_by_side(sos.sections(), values, place, chunk);
        }
    }

    /// By way of a buffer, so that nothing is rounded between sections.
    fn filter_narrow(&mut self, chunk: &mut [f32]) {
        let Self { sos, channels, values } = self;
        let mut buffer = [0.0; STRETCH];
        for first in (0..*channels).step_by(CHANNELS) {
            let stride = CHANNELS.min(*channels - first);
            for rows in chunk.chunks_mut(*channels * (STRETCH / CHANNELS)) {
                let wide = &mut buffer[..rows.len() / *channels * stride];
                for (wide, row) in wide.chunks_exact_mut(stride).zip(rows.chunks_exact(*channels)) {
                    wide.iter_mut().zip(&row[first..]).for_each(|(wide, x)| *wide = x.value());
                }
                if *channels == 1 {
                    one_channel(sos.sections(), values, wide);
                } else {
                    let place = Place { channels: *channels, first, stride, at: 0 };
                    side_by_side(sos.sections(), values, place, wide);
                }
                for (wide, row) in wide.chunks_exact(stride).zip(rows.chunks_exact_mut(*channels)) {
                    row[first..].iter_mut().zip(wide).for_each(|(x, wide)| *x = f32::of(*wide));
                }
            }
        }
    }

    /// Overwrites the state with the steady one for a row of first samples.
    pub(crate) fn settle(&mut self, steady: &[[f64; 2]], first: &[f64]) {
        let per_section = 2 * self.channels.max(1);
        for (values, zi) in self.values.chunks_exact_mut(per_section).zip(steady) {
            let (z0, z1) = values.split_at_mut(self.channels);
            for (((z0, z1), x), [zi0, zi1]) in z0.iter_mut().zip(z1).zip(first).zip(std::iter::repeat(zi)) {
                (*z0, *z1) = (zi0 * x, zi1 * x);
            }
        }
    }

    /// Per section `z0` of every channel, then `z1`; for callers inside the crate that gather and scatter states.
    pub(crate) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }
}

/// `b0`, `b1`, `b2`, `a1`, `a2` of `L` lanes.
pub(crate) type Coefficients<const L: usize> = [[f64; L]; 5];

impl Section {
    /// The same in all lanes.
    #[inline(always)]
    pub(crate) fn splat<const L: usize>(&self) -> Coefficients<L> {
        [self.b0, self.b1, self.b2, self.a1, self.a2].map(|c| [c; L])
    }
}

/// One sample through one section in each of `L` lanes: the one order of operations. A lane is a channel, or a section of one
/// channel. A separate loop per result keeps each one a plain vector operation. `MONIC`: `b0` and `b2` are one, and a
/// multiplication by one changes no bit.
#[inline(always)]
pub(crate) fn advance<const L: usize, const MONIC: bool>(
    [b0, b1, b2, a1, a2]: &Coefficients<L>,
    z0: &mut [f64; L],
    z1: &mut [f64; L],
    x: &[f64; L],
) -> [f64; L] {
    let mut y = [0.0; L];
    for l in 0..L {
        y[l] = if MONIC { x[l] + z0[l] } else { b0[l] * x[l] + z0[l] };
    }
    for l in 0..L {
        z0[l] = b1[l] * x[l] - a1[l] * y[l] + z1[l];
    }
    for l in 0..L {
        z1[l] = if MONIC { x[l] - a2[l] * y[l] } else { b2[l] * x[l] - a2[l] * y[l] };
    }
    y
}

/// Filters one channel in place; `state` holds `[z0, z1]` per section.
fn one_channel(sections: &[Section], state: &mut [f64], x: &mut [f64]) {
    let (state, _) = state.as_chunks_mut::<2>();
    let stretch = if sections.len() <= WIDEST { x.len().max(1) } else { STRETCH };
    for x in x.chunks_mut(stretch) {
        for (sections, state) in sections.chunks(WIDEST).zip(state.chunks_mut(WIDEST)) {
            match sections.len() {
                1 => wavefront::<1>(sections, state, x),
                2 => wavefront::<2>(sections, state, x),
                3 => wavefront::<3>(sections, state, x),
                4 => wavefront::<4>(sections, state, x),
                5 => wavefront::<5>(sections, state, x),
                6 => wavefront::<6>(sections, state, x),
                7 => wavefront::<7>(sections, state, x),
                _ => wavefront::<8>(sections, state, x),
            }
        }
    }
}

/// One sample through one section.
#[inline(always)]
fn single(section: &Section, [z0, z1]: &mut [f64; 2], x: f64) -> f64 {
    let [y] = advance::<1, false>(&section.splat(), from_mut(z0), from_mut(z1), &[x]);
    y
}

/// Runs `N` sections at once, each one sample behind the section before it.
///
/// Then no section waits for another within a step, and the compiler packs neighbouring sections into vectors.
fn wavefront<const N: usize>(sections: &[Section], state: &mut [[f64; 2]], x: &mut [f64]) {
    let (Some(s), Some(z)) = (sections.first_chunk::<N>(), state.first_chunk_mut::<N>()) else {
        return;
    };
    let lag = N - 1;
    if x.len() <= lag {
        for x in x {
            for (s, z) in s.iter().zip(z.iter_mut()) {
                *x = single(s, z, *x);
            }
        }
        return;
    }
    let mut y = [0.0; N];
    // The first samples reach one more section with every step ...
    for (reached, &x) in x[..lag].iter().enumerate() {
        for i in (0..=reached).rev() {
            y[i] = single(&s[i], &mut z[i], if i == 0 { x } else { y[i - 1] });
        }
    }
    y = steps(s, z, y, x);
    // ... and the last ones leave them one by one.
    let tail = x.len() - lag;
    for (left, x) in x[tail..].iter_mut().enumerate() {
        for i in (left + 1..N).rev() {
            y[i] = single(&s[i], &mut z[i], y[i - 1]);
        }
        *x = y[lag];
    }
}

/// The steps in which every section has a sample; returns what each section gave last.
///
/// Never inlined: beside other code the loop does not keep its state in registers and takes half as long again.
#[inline(never)]
fn steps<const N: usize>(
    s: &[Section; N],
    z: &mut [[f64; 2]; N],
    mut last: [f64; N],
    x: &mut [f64],
) -> [f64; N] {
    let lag = N - 1;
    // Copies on the stack, which a write through `x` cannot change: they may stay in registers.
    let coefficients = [s.map(|s| s.b0), s.map(|s| s.b1), s.map(|s| s.b2), s.map(|s| s.a1), s.map(|s| s.a2)];
    let (mut z0, mut z1) = (z.map(|z| z[0]), z.map(|z| z[1]));
    for n in lag..x.len() {
        let mut input = [x[n]; N];
        input[1..].copy_from_slice(&last[..lag]);
        last = advance::<N, false>(&coefficients, &mut z0, &mut z1, &input);
        x[n - lag] = last[lag];
    }
    for (i, z) in z.iter_mut().enumerate() {
        *z = [z0[i], z1[i]];
    }
    last
}

/// Where a few neighbouring channels stand.
#[derive(Clone, Copy)]
struct Place {
    /// Channels of the state, and which of them is the first.
    channels: usize,
    first: usize,
    /// Values of a row, and which of them is the first.
    stride: usize,
    at: usize,
}

/// Filters at most [`CHANNELS`] neighbouring channels in place: they hide each other's latency.
fn side_by_side(sections: &[Section], state: &mut [f64], place: Place, rows: &mut [f64]) {
    match place.channels - place.first {
        1 => in_groups::<1, 4>(sections, state, place, rows),
        2 => in_groups::<2, 4>(sections, state, place, rows),
        3 => in_groups::<3, 4>(sections, state, place, rows),
        4 => in_groups::<4, 4>(sections, state, place, rows),
        5 => in_groups::<5, 4>(sections, state, place, rows),
        6 => in_groups::<6, 4>(sections, state, place, rows),
        7 => in_groups::<7, 4>(sections, state, place, rows),
        // More sections would not find room in the registers.
        _ => in_groups::<CHANNELS, 2>(sections, state, place, rows),
    }
}

/// `G` sections at a time, while the samples are at hand.
fn in_groups<const L: usize, const G: usize>(
    sections: &[Section],
    state: &mut [f64],
    place: Place,
    rows: &mut [f64],
) {
    for rows in rows.chunks_mut(place.stride * (STRETCH / L)) {
        for (s, z) in sections.chunks(G).zip(state.chunks_mut(2 * G * place.channels)) {
            match s.len() {
                1 => group::<L, 1>(s, z, place, rows),
                2 => group::<L, 2>(s, z, place, rows),
                3 => group::<L, 3>(s, z, place, rows),
                _ => group::<L, 4>(s, z, place, rows),
            }
        }
    }
}

/// `L` channels through `N` sections.
fn group<const L: usize, const N: usize>(s: &[Section], state: &mut [f64], place: Place, rows: &mut [f64]) {
    let Some(s) = s.first_chunk::<N>() else { return };
    let lanes = place.first..place.first + L;
    let mut z = [[[0.0; L]; 2]; N];
    for (z, values) in z.as_flattened_mut().iter_mut().zip(state.chunks_exact(place.channels)) {
        z.copy_from_slice(&values[lanes.clone()]);
    }
    for row in rows.chunks_exact_mut(place.stride) {
        let Some(x) = row[place.at..].first_chunk_mut::<L>() else { return };
        for (s, [z0, z1]) in s.iter().zip(&mut z) {
            *x = advance::<L, false>(&s.splat(), z0, z1, x);
        }
    }
    for (z, values) in z.as_flattened().iter().zip(state.chunks_exact_mut(place.channels)) {
        values[lanes.clone()].copy_from_slice(z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sos(n_sections: usize) -> Sos {
        let rows: Vec<_> =
            (0..n_sections).map(|i| [1.0, -1.9, 0.9, 1.0, -1.2 + 0.05 * i as f64, 0.5]).collect();
        Sos::new(&rows).unwrap()
    }

    #[test]
    fn a_constant_started_in_its_steady_state_stays_put() {
        let smooth = Sos::new(&[[0.25, 0.25, 0.0, 1.0, -0.5, 0.0]; 3]).unwrap();
        let mut state = SosState::steady(&smooth, &[3.0, -8.0]).unwrap();
        let mut chunk = [3.0, -8.0, 3.0, -8.0, 3.0, -8.0];
        state.filter(&mut chunk).unwrap();
        assert_eq!(chunk, [3.0, -8.0, 3.0, -8.0, 3.0, -8.0]);
    }

    #[test]
    fn reset_forgets() {
        let sos = sos(2);
        let mut state = SosState::zero(&sos, 1).unwrap();
        state.filter(&mut [1.0, 2.0, 3.0]).unwrap();
        assert_ne!(Ok(&state), SosState::zero(&sos, 1).as_ref());
        state.reset();
        assert_eq!(Ok(&state), SosState::zero(&sos, 1).as_ref());
    }

    #[test]
    fn wrong_lengths_are_refused_and_change_nothing() {
        let two = sos(2);
        let mut state = SosState::zero(&two, 2).unwrap();
        let mut chunk = [1.0, 2.0, 3.0];
        let error = Error::Length { what: "chunk", expected: 2, got: 3 };
        assert_eq!(state.filter(&mut chunk), Err(error));
        let error = Error::Length { what: "sample", expected: 2, got: 3 };
        assert_eq!(state.advance(chunk), Err(error));
        assert_eq!((chunk, &state), ([1.0, 2.0, 3.0], &SosState::zero(&two, 2).unwrap()));
        let error = Error::Length { what: "state", expected: 8, got: 7 };
        assert_eq!(SosState::from_values(&two, 2, vec![0.0; 7]), Err(error));
    }

    #[test]
    fn no_channels_is_an_empty_stream() {
        let sos = sos(2);
        let mut state = SosState::zero(&sos, 0).unwrap();
        assert_eq!(state.filter::<f64>(&mut []), Ok(()));
        assert_eq!(state.advance::<f64, 0>([]), Ok([]));
        let error = Error::Length { what: "chunk", expected: 0, got: 1 };
        assert_eq!(state.filter(&mut [1.0]), Err(error));
    }

    #[test]
    fn channels_for_which_there_is_no_memory_are_refused() {
        for channels in [usize::MAX, usize::MAX / 4 + 1, 1 << 58] {
            assert!(matches!(SosState::zero(&sos(2), channels), Err(Error::Memory { .. })));
        }
    }
}
