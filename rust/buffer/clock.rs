//! Host time, and the line that leads from device time to it.
//!
//! The line is the lower envelope of (host - device): what a row's arrival would have been without delay. A row is never
//! seen before it was measured, so arrivals lie above a line, and the rows that came fastest lie near it. It is an edge of
//! the lower convex hull of those points, the one over their mean (S. B. Moon, P. Skelly and D. Towsley, "Estimation and
//! removal of clock skew from network delay measurements", INFOCOM 1999): the slope follows a drift of the two clocks, and
//! a burst of late rows leaves it where it is.

use std::sync::OnceLock;
use std::time::Instant;

/// Monotonic nanoseconds since the first call in the process: the host's clock of every row.
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

/// Points of the hull: the fastest row of each stretch of time.
const POINTS: usize = 32;

/// Longest stretch that one point stands for: the hull reaches back up to five minutes. A delay that lasts is distinguished from a
/// drift as long as the time without it takes up more of the hull.
const LONGEST_NS: f64 = 1e10;

/// A row this much below the line is a step of a clock, not a faster row.
const STEP_NS: f64 = 5e8;

/// Device time and host minus device time, in nanoseconds since the first row.
type Point = (f64, f64);

/// The fastest rows of the last minutes and the line below them. Never allocates.
pub(super) struct LowerEnvelope {
    points: [Point; POINTS],
    len: usize,
    /// Length of a stretch; starts at nothing and doubles, so that the first rows already give a line.
    stretch_ns: f64,
    /// Begin of the newest stretch.
    begin_ns: f64,
    line: ClockLine,
}

impl LowerEnvelope {
    /// The envelope of an epoch's first row.
    pub(super) fn new(line: ClockLine) -> Self {
        let mut envelope =
            Self { points: [(0.0, 0.0); POINTS], len: 0, stretch_ns: 0.0, begin_ns: 0.0, line };
        envelope.restart((0.0, 0.0));
        envelope
    }

    pub(super) fn line(&self) -> &ClockLine {
        &self.line
    }

    /// Takes in the next row, later in device time than all before; true when the line has changed.
    pub(super) fn add(&mut self, ticks: u64, host_ns: u64) -> bool {
        let device_ns = self.line.device_ns(ticks);
        let above = self.line.lag_ns(ticks, host_ns);
        let point = (device_ns, self.line.offset_ns(device_ns) + above);
        if above < -STEP_NS {
            self.restart(point);
            return true;
        }
        let stretch_goes_on = device_ns < self.begin_ns + self.stretch_ns;
        if stretch_goes_on {
            let newest = &mut self.points[self.len - 1];
            if above < newest.1 - self.line.offset_ns(newest.0) {
                *newest = point;
            }
        } else {
            self.make_room();
            self.points[self.len] = point;
            self.len += 1;
            self.begin_ns = device_ns;
        }
        // A point above the line can only move it when a stretch is complete.
        if stretch_goes_on && above >= 0.0 {
            return false;
        }
        let before = self.line;
        self.fit();
        self.line != before
    }

    fn restart(&mut self, point: Point) {
        self.points[0] = point;
        self.len = 1;
        self.stretch_ns = 0.0;
        self.begin_ns = point.0;
        (self.line.at_ns, self.line.offset_ns, self.line.slope) = (point.0, point.1, 0.0);
    }

    /// Makes stretches twice as long while they are short; forgets the oldest once they are not.
    fn make_room(&mut self) {
        if self.len < POINTS {
            return;
        }
        if self.stretch_ns >= LONGEST_NS {
            self.points.copy_within(1.., 0);
            self.len = POINTS - 1;
            return;
        }
        self.len = POINTS / 2;
        for pair in 0..self.len {
            let [a, b] = [self.points[2 * pair], self.points[2 * pair + 1]];
            let above = |point: Point| point.1 - self.line.offset_ns(point.0);
            self.points[pair] = if above(a) <= above(b) { a } else { b };
        }
        let span_ns = self.points[self.len - 1].0 - self.points[0].0;
        self.stretch_ns = (span_ns / self.len as f64).min(LONGEST_NS);
    }

    /// The edge of the lower convex hull over the mean of the points.
    fn fit(&mut self) {
        let points = &self.points[..self.len];
        let mean = points.iter().map(|point| point.0).sum::<f64>() / self.len as f64;
        let mut hull = [(0.0, 0.0); POINTS];
        let mut corners = 0;
        for point in points {
            while corners >= 2 && !turns_left(hull[corners - 2], hull[corners - 1], *point) {
                corners -= 1;
            }
            hull[corners] = *point;
            corners += 1;
        }
        let edge = hull[..corners].windows(2).find(|edge| edge[1].0 >= mean);
        if let Some(&[a, b]) = edge {
            self.line.slope = (b.1 - a.1) / (b.0 - a.0);
            (self.line.at_ns, self.line.offset_ns) = b;
        }
    }
}

/// True when `b` lies below the straight line from `a` to `c`.
fn turns_left(a: Point, b: Point, c: Point) -> bool {
    (b.0 - a.0) * (c.1 - a.1) > (c.0 - a.0) * (b.1 - a.1)
}
