//! Host time, and the line that leads from device time to it.

use std::sync::OnceLock;
use std::time::Instant;

/// Monotonic nanoseconds since this was first asked for in the process: the host's clock of every row.
#[must_use]
pub fn host_ns() -> u64 {
    static ORIGIN: OnceLock<Instant> = OnceLock::new();
    // 584 years fit.
    u64::try_from(ORIGIN.get_or_init(Instant::now).elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// Words of a line in a slot.
pub(super) const CLOCK_WORDS: usize = 7;

/// Host time as a straight line over device time, for one epoch.
///
/// Both are counted from the first row of the epoch, so that float64 keeps fractions of a nanosecond for days.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ClockLine {
    pub(super) epoch: u32,
    /// Nanoseconds per tick.
    pub(super) tick_ns: f64,
    pub(super) origin_ticks: u64,
    pub(super) origin_host_ns: u64,
    /// Device time at which `offset_ns` holds.
    pub(super) at_ns: f64,
    /// Host time minus device time there.
    pub(super) offset_ns: f64,
    /// Growth of the offset per device time: how much faster the host's clock runs.
    pub(super) slope: f64,
}

impl ClockLine {
    /// A line through the first row of an epoch.
    pub(super) fn new(epoch: u32, tick_ns: f64, ticks: u64, host_ns: u64) -> Self {
        Self {
            epoch,
            tick_ns,
            origin_ticks: ticks,
            origin_host_ns: host_ns,
            at_ns: 0.0,
            offset_ns: 0.0,
            slope: 0.0,
        }
    }

    /// Device time since the first row.
    #[inline]
    pub(super) fn device_ns(&self, ticks: u64) -> f64 {
        difference(ticks, self.origin_ticks) * self.tick_ns
    }

    /// Host time minus device time, both since the first row, by the line.
    #[inline]
    pub(super) fn offset_ns(&self, device_ns: f64) -> f64 {
        self.offset_ns + self.slope * (device_ns - self.at_ns)
    }

    /// Host time when the row with these ticks would have come without any delay.
    pub(super) fn host_ns(&self, ticks: u64) -> f64 {
        let device_ns = self.device_ns(ticks);
        self.origin_host_ns as f64 + (device_ns + self.offset_ns(device_ns))
    }

    /// How much later than the undelayed arrival of a row `now` is.
    pub(super) fn lag_ns(&self, ticks: u64, now: u64) -> f64 {
        let device_ns = self.device_ns(ticks);
        difference(now, self.origin_host_ns) - (device_ns + self.offset_ns(device_ns))
    }

    /// Device time, in ticks, at a moment of host time.
    pub(super) fn ticks(&self, host_ns: u64) -> f64 {
        let host_ns = difference(host_ns, self.origin_host_ns);
        let device_ns = (host_ns - self.offset_ns + self.slope * self.at_ns) / (1.0 + self.slope);
        self.origin_ticks as f64 + device_ns / self.tick_ns
    }

    pub(super) fn to_words(self) -> [u64; CLOCK_WORDS] {
        [
            u64::from(self.epoch),
            self.tick_ns.to_bits(),
            self.origin_ticks,
            self.origin_host_ns,
            self.at_ns.to_bits(),
            self.offset_ns.to_bits(),
            self.slope.to_bits(),
        ]
    }

    pub(super) fn from_words(words: &[u64; CLOCK_WORDS]) -> Self {
        let [epoch, tick_ns, origin_ticks, origin_host_ns, at_ns, offset_ns, slope] = *words;
        Self {
            epoch: u32::try_from(epoch).unwrap_or(u32::MAX),
            tick_ns: f64::from_bits(tick_ns),
            origin_ticks,
            origin_host_ns,
            at_ns: f64::from_bits(at_ns),
            offset_ns: f64::from_bits(offset_ns),
            slope: f64::from_bits(slope),
        }
    }
}

/// `a - b` without the loss of turning large counts into float64 first.
#[inline]
fn difference(a: u64, b: u64) -> f64 {
    if a >= b {
        (a - b) as f64
    } else {
        -((b - a) as f64)
    }
}
