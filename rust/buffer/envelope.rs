//! The lower envelope of (host - device): what a row's arrival would have been without delay.
//!
//! A row is never seen before it was measured, so arrivals lie above a line, and the rows that came fastest lie near it.
//! The line is an edge of the lower convex hull of those points, the one over their mean (S. B. Moon, P. Skelly and
//! D. Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999): the slope follows
//! a drift of the two clocks, and a burst of late rows leaves it where it is.

use super::clock::ClockLine;

/// Points kept: the fastest row of each stretch of time.
const POINTS: usize = 32;

/// Longest stretch that one point stands for: the hull reaches back up to five minutes. A delay that lasts is told from a
/// drift as long as the time without it takes up more of the hull.
const LONGEST_NS: f64 = 1e10;

/// A row this much below the line is a step of a clock, not a faster row.
const STEP_NS: f64 = 5e8;

/// Device time and host minus device time, in nanoseconds since the first row.
type Point = (f64, f64);

/// The fastest rows of the last minutes and the line below them. Never allocates.
pub(super) struct Envelope {
    points: [Point; POINTS],
    len: usize,
    /// Length of a stretch; starts at nothing and doubles, so that the first rows already give a line.
    stretch_ns: f64,
    /// Begin of the newest stretch.
    begin_ns: f64,
    line: ClockLine,
}

impl Envelope {
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
