//! What one stream of samples leaves behind in a filter.

use super::cascade;
use crate::dsp::Sos;
use crate::error::{Error, Result};
use crate::memory::filled;

/// The memory of a stream of `channels` channels on its way through an [`Sos`]: two values per section and channel.
///
/// Filtering a signal in pieces of any size with one state gives the same bits as filtering it whole. A state belongs to
/// one stream; the coefficients may be shared by many. Filtering allocates nothing and never blocks.
///
/// ```
/// use granular_id::{butterworth, Band, SosState};
///
/// let sos = butterworth(8, Band::Highpass(23.0), 500.0)?;
/// let mut state = SosState::zero(&sos, 6)?;
/// let mut chunk = [0.0; 4 * 6]; // four samples of six axes, sample by sample
/// state.filter(&sos, &mut chunk)?;
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SosState {
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
        Ok(Self { channels, values: filled(0.0, channels.saturating_mul(2 * sos.sections().len()))? })
    }

    /// The state as if each channel had held its first sample forever; one value per channel.
    ///
    /// # Errors
    /// [`Error::NoSteadyState`] when a section has a pole at `z = 1`; [`Error::Memory`].
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
            Ok(Self { channels, values })
        } else {
            Err(Error::Length { what: "state", expected, got: values.len() })
        }
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
    /// [`Error::Length`] when the state was made for another number of sections, or when the chunk does not hold whole
    /// rows. Neither the chunk nor the state has changed then.
    pub fn filter(&mut self, sos: &Sos, chunk: &mut [f64]) -> Result<()> {
        let expected = 2 * self.channels * sos.sections().len();
        if self.values.len() != expected {
            return Err(Error::Length { what: "state", expected, got: self.values.len() });
        }
        let rows = chunk.len().checked_div(self.channels).unwrap_or(0);
        if rows * self.channels != chunk.len() {
            return Err(Error::Length { what: "chunk", expected: rows * self.channels, got: chunk.len() });
        }
        match self.channels {
            0 => {}
            1 => cascade::one_channel(sos.sections(), &mut self.values, chunk),
            channels => cascade::many_channels(sos.sections(), &mut self.values, channels, chunk),
        }
        Ok(())
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

#[cfg(test)]
mod tests {
    use super::SosState;
    use crate::dsp::Sos;
    use crate::error::Error;

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
        state.filter(&smooth, &mut chunk).unwrap();
        assert_eq!(chunk, [3.0, -8.0, 3.0, -8.0, 3.0, -8.0]);
    }

    #[test]
    fn reset_forgets() {
        let sos = sos(2);
        let mut state = SosState::zero(&sos, 1).unwrap();
        state.filter(&sos, &mut [1.0, 2.0, 3.0]).unwrap();
        assert_ne!(Ok(&state), SosState::zero(&sos, 1).as_ref());
        state.reset();
        assert_eq!(Ok(&state), SosState::zero(&sos, 1).as_ref());
    }

    #[test]
    fn wrong_lengths_are_refused_and_change_nothing() {
        let (two, three) = (sos(2), sos(3));
        let mut state = SosState::zero(&two, 2).unwrap();
        let mut chunk = [1.0, 2.0, 3.0];
        let error = Error::Length { what: "chunk", expected: 2, got: 3 };
        assert_eq!(state.filter(&two, &mut chunk), Err(error));
        let error = Error::Length { what: "state", expected: 12, got: 8 };
        assert_eq!(state.filter(&three, &mut chunk[..2]), Err(error));
        assert_eq!((chunk, &state), ([1.0, 2.0, 3.0], &SosState::zero(&two, 2).unwrap()));
        let error = Error::Length { what: "state", expected: 8, got: 7 };
        assert_eq!(SosState::from_values(&two, 2, vec![0.0; 7]), Err(error));
    }

    #[test]
    fn no_channels_is_an_empty_stream() {
        let sos = sos(2);
        let mut state = SosState::zero(&sos, 0).unwrap();
        assert_eq!(state.filter(&sos, &mut []), Ok(()));
        let error = Error::Length { what: "chunk", expected: 0, got: 1 };
        assert_eq!(state.filter(&sos, &mut [1.0]), Err(error));
    }

    #[test]
    fn channels_for_which_there_is_no_memory_are_refused() {
        for channels in [usize::MAX, usize::MAX / 4 + 1, 1 << 58] {
            assert!(matches!(SosState::zero(&sos(2), channels), Err(Error::Memory { .. })));
        }
    }
}
