//! Filtering, of streams and of whole arrays: transposed direct form II, in exactly one order of operations.
//!
//! No fused multiply-add and no other order than that of [`biquad_step`], so that every path, and the compiled loop of
//! `scipy.signal.sosfilt` on x86-64, gives the same bits. Sections only see the output of the section before them and
//! channels do not see each other, so the order in which sections and channels are visited changes no bit.
//!
//! Subnormal numbers stay, because flushing them to zero would change bits. That costs little: the loops are bound
//! by the latency of the recurrence. The tail of the 8th-order high-pass, which never quite dies (rounding keeps it
//! circling a few units of 2^-1074), runs at 1.1 times the time of noise for one channel and 1.5 times for six on AMD
//! Zen 3. Machines that handle subnormals in microcode may take longer.

use super::{Section, Sos};
use crate::error::{Error, Result};
use crate::memory::filled;

/// Rows that one group of sections filters before the next takes over: they stay in the first-level cache.
const STRETCH: usize = 128;

/// Sections that channels pass through together.
const GROUP: usize = 4;

/// Channels that pass through a group of sections side by side.
const CHANNELS: usize = 8;

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
        state.set_steady(&sos.steady_state()?, first);
        Ok(state)
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
    pub fn filter(&mut self, chunk: &mut [f64]) -> Result<()> {
        let Self { sos, channels, values } = self;
        let rows = chunk.len().checked_div(*channels).unwrap_or(0);
        if rows * *channels != chunk.len() {
            return Err(Error::Length { what: "chunk", expected: rows * *channels, got: chunk.len() });
        }
        for rows in chunk.chunks_mut(STRETCH * (*channels).max(1)) {
            for (s, z) in sos.sections().chunks(GROUP).zip(values.chunks_mut(2 * GROUP * *channels)) {
                for first in (0..*channels).step_by(CHANNELS) {
                    side_by_side(s, z, *channels, first, rows);
                }
            }
        }
        Ok(())
    }

    /// Overwrites the state with the steady one for a row of first samples.
    pub(crate) fn set_steady(&mut self, steady: &[[f64; 2]], first: &[f64]) {
        let per_section = 2 * self.channels.max(1);
        for (values, zi) in self.values.chunks_exact_mut(per_section).zip(steady) {
            let (z0, z1) = values.split_at_mut(self.channels);
            for ((z0, z1), x) in z0.iter_mut().zip(z1).zip(first) {
                (*z0, *z1) = (zi[0] * x, zi[1] * x);
            }
        }
    }
}

/// `b0`, `b1`, `b2`, `a1`, `a2` of `L` lanes.
type Coefficients<const L: usize> = [[f64; L]; 5];

impl Section {
    /// The same in all lanes.
    #[inline(always)]
    pub(crate) fn splat<const L: usize>(&self) -> Coefficients<L> {
        [self.b0, self.b1, self.b2, self.a1, self.a2].map(|c| [c; L])
    }
}

/// One sample through one section in each of `L` lanes: the one order of operations. A lane is a channel. A separate loop
/// per result keeps each one a plain vector operation. `MONIC`: `b0` and `b2` are one, and a multiplication by one changes
/// no bit.
#[inline(always)]
pub(crate) fn biquad_step<const L: usize, const MONIC: bool>(
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

/// At most [`CHANNELS`] neighbouring channels from `first` on through at most [`GROUP`] sections: they hide each other's
/// latency. A compiler that knows both numbers keeps the state in registers.
fn side_by_side(s: &[Section], state: &mut [f64], channels: usize, first: usize, rows: &mut [f64]) {
    macro_rules! of_channels {
        ($($l:literal)*) => {
            match (channels - first, s.len()) {
                $(
                    ($l, 1) => through::<$l, 1>(s, state, channels, first, rows),
                    ($l, 2) => through::<$l, 2>(s, state, channels, first, rows),
                    ($l, 3) => through::<$l, 3>(s, state, channels, first, rows),
                    ($l, _) => through::<$l, GROUP>(s, state, channels, first, rows),
                )*
                (_, 1) => through::<CHANNELS, 1>(s, state, channels, first, rows),
                (_, 2) => through::<CHANNELS, 2>(s, state, channels, first, rows),
                (_, 3) => through::<CHANNELS, 3>(s, state, channels, first, rows),
                _ => through::<CHANNELS, GROUP>(s, state, channels, first, rows),
            }
        };
    }
    of_channels!(1 2 3 4 5 6 7);
}

/// `L` channels through `N` sections.
fn through<const L: usize, const N: usize>(
    s: &[Section],
    state: &mut [f64],
    channels: usize,
    first: usize,
    rows: &mut [f64],
) {
    let Some(s) = s.first_chunk::<N>() else { return };
    let lanes = first..first + L;
    let mut z = [[[0.0; L]; 2]; N];
    for (z, values) in z.as_flattened_mut().iter_mut().zip(state.chunks_exact(channels)) {
        z.copy_from_slice(&values[lanes.clone()]);
    }
    for row in rows.chunks_exact_mut(channels) {
        let Some(x) = row[first..].first_chunk_mut::<L>() else { return };
        for (s, [z0, z1]) in s.iter().zip(&mut z) {
            *x = biquad_step::<L, false>(&s.splat(), z0, z1, x);
        }
    }
    for (z, values) in z.as_flattened().iter().zip(state.chunks_exact_mut(channels)) {
        values[lanes.clone()].copy_from_slice(z);
    }
}

/// A C-ordered array seen from one of its axes: `outer` blocks of `len` rows of `inner` neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlongAxis {
    /// Product of the dimensions before the axis.
    pub outer: usize,
    /// Samples along the axis.
    pub len: usize,
    /// Product of the dimensions after the axis.
    pub inner: usize,
}

impl AlongAxis {
    /// The view from `axis` of an array of this shape; `None` when there is no such axis, or no such large array.
    ///
    /// ```
    /// use granular_id::AlongAxis;
    ///
    /// let view = AlongAxis::new(&[62, 1600, 6], 1);
    /// assert_eq!(view, Some(AlongAxis { outer: 62, len: 1600, inner: 6 }));
    /// ```
    #[must_use]
    pub fn new(shape: &[usize], axis: usize) -> Option<Self> {
        let &len = shape.get(axis)?;
        let product =
            |dimensions: &[usize]| dimensions.iter().try_fold(1_usize, |all, &n| all.checked_mul(n));
        Some(Self { outer: product(&shape[..axis])?, len, inner: product(&shape[axis + 1..])? })
    }

    fn check(self, what: &'static str, len: usize, got: usize) -> Result<()> {
        // Saturated, the size cannot be that of a slice.
        let expected = self.outer.saturating_mul(len).saturating_mul(self.inner);
        if got == expected {
            Ok(())
        } else {
            Err(Error::Length { what, expected, got })
        }
    }
}

/// Filters along one axis, in place, from rest.
///
/// # Errors
/// [`Error::Length`] when `x` does not have the size of the view.
pub fn sosfilt(sos: &Sos, x: &mut [f64], along: AlongAxis) -> Result<()> {
    along.check("x", along.len, x.len())?;
    if x.is_empty() {
        return Ok(());
    }
    let mut state = SosState::zero(sos, along.inner)?;
    for block in x.chunks_exact_mut(along.len * along.inner) {
        state.reset();
        state.filter(block)?;
    }
    Ok(())
}

/// Filters along one axis, in place, from the states `z`, and leaves the final states there.
///
/// `z` is a C-ordered array of shape `(sections, outer, 2, inner)`, as `scipy.signal.sosfilt` has it.
///
/// # Errors
/// [`Error::Length`] when `x` or `z` does not have the size that follows from the view.
pub fn sosfilt_from(sos: &Sos, x: &mut [f64], along: AlongAxis, z: &mut [f64]) -> Result<()> {
    along.check("x", along.len, x.len())?;
    along.check("zi", 2 * sos.sections().len(), z.len())?;
    if z.is_empty() {
        return Ok(());
    }
    let pair = 2 * along.inner;
    let mut state = SosState::zero(sos, along.inner)?;
    for index in 0..along.outer {
        // The state of one block is scattered over the sections of `z`.
        let pairs = z.chunks_exact(pair).skip(index).step_by(along.outer);
        for (to, from) in state.values.chunks_exact_mut(pair).zip(pairs) {
            to.copy_from_slice(from);
        }
        let block = along.len * along.inner;
        state.filter(&mut x[index * block..(index + 1) * block])?;
        let pairs = z.chunks_exact_mut(pair).skip(index).step_by(along.outer);
        for (to, from) in pairs.zip(state.values.chunks_exact(pair)) {
            to.copy_from_slice(from);
        }
    }
    Ok(())
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
    fn wrong_lengths_are_refused_and_change_nothing() {
        let two = sos(2);
        let mut state = SosState::zero(&two, 2).unwrap();
        let mut chunk = [1.0, 2.0, 3.0];
        let error = Error::Length { what: "chunk", expected: 2, got: 3 };
        assert_eq!(state.filter(&mut chunk), Err(error));
        assert_eq!((chunk, &state), ([1.0, 2.0, 3.0], &SosState::zero(&two, 2).unwrap()));
    }

    #[test]
    fn no_channels_is_an_empty_stream() {
        let sos = sos(2);
        let mut state = SosState::zero(&sos, 0).unwrap();
        assert_eq!(state.filter(&mut []), Ok(()));
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
