//! Device time of rows that come without any: one period after the last.

use granular_id::buffer::{BufferSpec, Writer};

/// Counts periods from the last row whose time is known, so that a period of no whole number of ticks does not drift.
pub(super) struct DeviceClock {
    period_ticks: f64,
    epoch: u32,
    /// Where periods are counted from, and how many have passed.
    base: Option<(u64, u64)>,
    /// Time of the last row, taken or dropped: a row of NaN has had its instant too.
    last: Option<u64>,
}

impl DeviceClock {
    pub(super) fn new(spec: &BufferSpec) -> Self {
        Self { period_ticks: spec.tick_hz / spec.rate_hz, epoch: 0, base: None, last: None }
    }

    /// The row's own time, or the next instant.
    pub(super) fn ticks(&mut self, own: Option<u64>, writer: &Writer) -> u64 {
        let newest = writer.newest_ticks();
        if self.epoch != writer.epoch() || newest > self.last {
            self.start(newest, writer);
        }
        if let Some(ticks) = own {
            if own > self.last {
                self.start(own, writer);
            }
            return ticks;
        }
        let (base, periods) = self.base.map_or((0, 0), |(base, periods)| (base, periods + 1));
        self.base = Some((base, periods));
        // Rounded and not negative; it saturates after centuries.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let ticks = base.saturating_add((periods as f64 * self.period_ticks).round() as u64);
        self.last = Some(ticks);
        ticks
    }

    fn start(&mut self, at: Option<u64>, writer: &Writer) {
        self.epoch = writer.epoch();
        self.base = at.map(|ticks| (ticks, 0));
        self.last = at;
    }
}
