//! How large a buffer is and how its time runs, checked once.

use crate::error::{Error, Result};

/// Rows that a buffer may hold: nine hours at 500 Hz.
pub const MAX_ROWS: usize = 1 << 24;

/// Largest number of rows that may wait for a late one.
pub const MAX_REORDER_DEPTH: usize = 1024;

/// What a buffer is to hold.
///
/// ```
/// use granular_id::buffer::BufferSpec;
///
/// let spec = BufferSpec { rate_hz: 7000.0, tick_hz: 7000.0, ..BufferSpec::default() };
/// assert_eq!(spec.seconds, 10.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BufferSpec {
    /// Nominal rate of the rows.
    pub rate_hz: f64,
    /// Time that the newest rows reach back; with the rate it gives the capacity.
    pub seconds: f64,
    /// Ticks of the device's clock per second, at least `rate_hz`.
    pub tick_hz: f64,
    /// Rows that wait for a late one at most. 0: a row that comes late is dropped and counted, and nothing ever waits.
    pub reorder_depth: usize,
}

impl Default for BufferSpec {
    fn default() -> Self {
        Self { rate_hz: 500.0, seconds: 10.0, tick_hz: 1e9, reorder_depth: 0 }
    }
}

impl BufferSpec {
    /// Rows the buffer holds: seconds times rate, rounded up.
    pub(super) fn capacity(&self) -> Result<usize> {
        let Self { rate_hz, seconds, tick_hz, reorder_depth } = *self;
        if !(rate_hz.is_finite() && rate_hz > 0.0) {
            return Err(Error::Rate { rate_hz });
        }
        if !(tick_hz.is_finite() && tick_hz >= rate_hz) {
            return Err(Error::TickRate { tick_hz, rate_hz });
        }
        if reorder_depth > MAX_REORDER_DEPTH {
            return Err(Error::ReorderDepth { reorder_depth });
        }
        let rows = (seconds * rate_hz).ceil();
        // NaN is in no range.
        if !(seconds > 0.0 && (1.0..=MAX_ROWS as f64).contains(&rows)) {
            return Err(Error::BufferSize { seconds, rate_hz });
        }
        // Between 1 and MAX_ROWS.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        Ok(rows as usize)
    }

    /// Instants without a row between two rows of one epoch.
    #[inline]
    pub(super) fn missing_between(&self, earlier: u64, later: u64) -> u32 {
        let periods = (later - earlier) as f64 * self.rate_hz / self.tick_hz;
        // Rounded by hand, as `round` is a call on processors without SSE4.1. The cast saturates, as
        // BufferedRow::missing_before says.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let rounded = (periods + 0.5) as u64;
        u32::try_from(rounded.saturating_sub(1)).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn instants_are_rounded_to_the_nearest_period(
            ticks in prop_oneof![0..10_000_u64, any::<u64>()],
            (rate_hz, tick_hz) in prop_oneof![Just((500.0, 1e9)), Just((500.0, 7000.0)), Just((7000.0, 7000.0)), Just((300.0, 1000.0))],
        ) {
            let spec = BufferSpec { rate_hz, tick_hz, ..BufferSpec::default() };
            let wanted = (ticks as f64 * rate_hz / tick_hz).round() - 1.0;
            prop_assert_eq!(f64::from(spec.missing_between(5, ticks.saturating_add(5))), wanted.clamp(0.0, f64::from(u32::MAX)));
        }
    }
}
