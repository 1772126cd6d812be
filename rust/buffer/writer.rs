//! The writer: puts rows in order of device time and counts what it cannot.

use std::sync::Arc;

use super::clock::{ClockLine, LowerEnvelope};
use super::{Buffer, BufferSpec, BufferedRow, Row};
use crate::wrench::{BAD_STATUS, SATURATED};

/// A row so much older than the newest is no late packet: the device has started again.
const RESTART_S: f64 = 1.0;

/// So many late rows one after the other are no late packets either: the device has started again a moment ago.
const LATE_IN_A_ROW: u32 = 8;

/// What became of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Pushed {
    /// Readers can get it.
    Written,
    /// It waits for a row before it.
    Held,
    /// Dropped: its device time was there already.
    Duplicate,
    /// Dropped: later rows are written already.
    Late,
    /// Dropped: a value is NaN or infinite.
    NonFinite,
    /// Dropped and not counted: it has another number of values than the buffer has axes.
    WrongLength,
}

/// Who finds out that a device has started again.
#[derive(Clone, Copy, PartialEq)]
enum Restarts {
    /// The buffer, by the times of the rows.
    Guessed,
    /// The sender of the rows.
    Announced,
}

/// The one writer of a buffer.
///
/// Pushing never blocks and never allocates, whatever readers do; its work is bounded by the reorder depth and the
/// logarithm of the capacity. When the buffer is full the oldest row is overwritten.
///
/// Rows leave in strictly increasing device time. A device time more than a second before the newest (or eight periods,
/// if that is longer), or the eighth late row in a row, is a device that has started again: a new epoch begins by itself,
/// but for rows of [`push_in_epoch`](Self::push_in_epoch).
pub struct Writer {
    buffer: Arc<Buffer>,
    /// Rows that wait for a late one before them, in order of device time; never more than it has room for.
    held: Vec<Row<()>>,
    /// Their values, row by row.
    held_values: Vec<f64>,
    /// The epoch of rows to come.
    epoch: u32,
    /// What the epoch has so far; nothing before its first row.
    written: Option<Written>,
    late_in_a_row: u32,
    restart_ticks: f64,
}

/// What is known of an epoch that has rows.
struct Written {
    /// Number of its first row in the ring.
    begin: u64,
    /// Device time of its newest row.
    newest: u64,
    envelope: LowerEnvelope,
}

impl Writer {
    pub(super) fn new(buffer: Arc<Buffer>) -> Self {
        let spec = &buffer.spec;
        let restart_s = RESTART_S.max(f64::from(LATE_IN_A_ROW) / spec.rate_hz);
        Self {
            // One more than may wait: a row goes in before the first goes out.
            held: Vec::with_capacity(spec.reorder_depth + 1),
            held_values: Vec::with_capacity((spec.reorder_depth + 1) * spec.n_axes),
            epoch: 0,
            written: None,
            late_in_a_row: 0,
            restart_ticks: restart_s * spec.tick_hz,
            buffer,
        }
    }

    /// Takes the next row as it came. Of two rows with the same device time the second is a duplicate.
    pub fn push(&mut self, row: &Row<impl AsRef<[f64]>>) -> Pushed {
        self.take(row, Restarts::Guessed)
    }

    /// The same from a sender that notices when its device starts again, and calls [`new_epoch`](Self::new_epoch) then: a
    /// row before the newest is late, however old it is and however many come in a row.
    pub fn push_in_epoch(&mut self, row: &Row<impl AsRef<[f64]>>) -> Pushed {
        self.take(row, Restarts::Announced)
    }

    /// Begins a new epoch, unless the present one has no rows: device time may start anywhere. Rows that wait are
    /// written first.
    pub fn new_epoch(&mut self) {
        self.flush();
        if self.written.take().is_some() {
            self.epoch = self.epoch.saturating_add(1);
            self.buffer.counters.epochs.add(1);
        }
        self.late_in_a_row = 0;
    }

    /// Writes all rows that wait: no late one will come any more.
    pub fn flush(&mut self) {
        while !self.held.is_empty() {
            self.write_first();
        }
        self.count_held();
    }

    /// What the buffer was made for.
    #[must_use]
    pub fn spec(&self) -> &BufferSpec {
        &self.buffer.spec
    }

    /// Device time of the newest row of the present epoch, waiting ones included.
    #[must_use]
    pub fn newest_ticks(&self) -> Option<u64> {
        let written = self.written.as_ref()?.newest;
        Some(self.held.last().map_or(written, |row| row.ticks))
    }

    /// Number of the epoch that the next row belongs to, unless its device time begins another.
    #[must_use]
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    fn take(&mut self, row: &Row<impl AsRef<[f64]>>, restarts: Restarts) -> Pushed {
        let wrench = row.wrench.as_ref();
        if wrench.len() != self.buffer.spec.n_axes {
            return Pushed::WrongLength;
        }
        if !wrench.iter().all(|value| value.is_finite()) {
            self.buffer.counters.non_finite.add(1);
            return Pushed::NonFinite;
        }
        match &self.written {
            Some(written) if row.ticks <= written.newest => self.take_late(row, restarts),
            Some(written) => {
                self.late_in_a_row = 0;
                let waits = self.buffer.spec.reorder_depth > 0
                    && self.buffer.spec.missing_between(written.newest, row.ticks) > 0;
                if waits {
                    self.hold(row)
                } else {
                    self.take_next(row)
                }
            }
            None => {
                self.write(row);
                Pushed::Written
            }
        }
    }

    /// A row that nothing is missing before.
    fn take_next(&mut self, row: &Row<impl AsRef<[f64]>>) -> Pushed {
        if !self.held.is_empty() {
            self.buffer.counters.reordered.add(1);
        }
        self.write(row);
        self.release();
        Pushed::Written
    }

    /// A row with a gap before it that a late row may fill yet.
    fn hold(&mut self, row: &Row<impl AsRef<[f64]>>) -> Pushed {
        match self.held.binary_search_by_key(&row.ticks, |row| row.ticks) {
            Ok(_) => return self.duplicate(),
            Err(place) => {
                self.buffer.counters.reordered.add(u64::from(place < self.held.len()));
                let wrench = row.wrench.as_ref();
                self.held.insert(place, row.with(()));
                self.held_values.extend_from_slice(wrench);
                self.held_values[place * wrench.len()..].rotate_right(wrench.len());
            }
        }
        self.release();
        match &self.written {
            Some(written) if written.newest >= row.ticks => Pushed::Written,
            _ => Pushed::Held,
        }
    }

    /// Writes waiting rows as long as there are too many or nothing is missing before them.
    fn release(&mut self) {
        while let (Some(first), Some(written)) = (self.held.first(), &self.written) {
            let next = self.buffer.spec.missing_between(written.newest, first.ticks) == 0;
            if !next && self.held.len() <= self.buffer.spec.reorder_depth {
                break;
            }
            self.write_first();
        }
        self.count_held();
    }

    /// A row at or before the newest one written.
    fn take_late(&mut self, row: &Row<impl AsRef<[f64]>>, restarts: Restarts) -> Pushed {
        let Some(written) = &self.written else { return Pushed::Late };
        let guessed = restarts == Restarts::Guessed;
        // First of all: a device that starts again may repeat the very times it had before.
        if guessed && (written.newest - row.ticks) as f64 > self.restart_ticks {
            return self.restart(row);
        }
        if self.is_written(row.ticks, written.begin) {
            return self.duplicate();
        }
        self.late_in_a_row = self.late_in_a_row.saturating_add(1);
        if guessed && self.late_in_a_row >= LATE_IN_A_ROW {
            return self.restart(row);
        }
        self.buffer.counters.late.add(1);
        Pushed::Late
    }

    /// The first row of a device that has started again.
    fn restart(&mut self, row: &Row<impl AsRef<[f64]>>) -> Pushed {
        self.new_epoch();
        self.write(row);
        Pushed::Written
    }

    fn duplicate(&self) -> Pushed {
        self.buffer.counters.duplicates.add(1);
        Pushed::Duplicate
    }

    /// Whether a row with this device time is still in the ring. `begin` is the first row of the epoch.
    fn is_written(&self, ticks: u64, begin: u64) -> bool {
        let head = self.buffer.rows.head();
        let (mut low, mut high) = (begin.max(self.buffer.rows.oldest(head)), head);
        while low < high {
            let middle = low + (high - low) / 2;
            let Some(found) = self.buffer.row(middle, &mut ()) else { return false };
            match found.row.ticks.cmp(&ticks) {
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Greater => high = middle,
                std::cmp::Ordering::Equal => return true,
            }
        }
        false
    }

    /// Writes the first of the rows that wait.
    fn write_first(&mut self) {
        let (row, n_axes) = (self.held.remove(0), self.buffer.spec.n_axes);
        let mut values = std::mem::take(&mut self.held_values);
        self.write(&row.with(&values[..n_axes]));
        values.drain(..n_axes);
        self.held_values = values;
    }

    fn write(&mut self, row: &Row<impl AsRef<[f64]>>) {
        let missing_before = self.track_clock(row);
        self.count(row, missing_before);
        let place = BufferedRow { row: row.with(()), missing_before, epoch: self.epoch };
        self.buffer.rows.publish(&place.to_words(), row.wrench.as_ref());
    }

    /// Moves device time on to a row, the clock's line with it; the instants that are missing before it.
    fn track_clock<W>(&mut self, row: &Row<W>) -> u32 {
        let Self { buffer, epoch, written, .. } = self;
        if let Some(written) = written {
            let missing = buffer.spec.missing_between(written.newest, row.ticks);
            written.newest = row.ticks;
            if written.envelope.add(row.ticks, row.host_ns) {
                buffer.clock.publish(&written.envelope.line().to_words(), &[]);
            }
            missing
        } else {
            let line = ClockLine::new(*epoch, 1e9 / buffer.spec.tick_hz, row.ticks, row.host_ns);
            buffer.clock.publish(&line.to_words(), &[]);
            let (begin, envelope) = (buffer.rows.head(), LowerEnvelope::new(line));
            *written = Some(Written { begin, newest: row.ticks, envelope });
            0
        }
    }

    fn count<W>(&self, row: &Row<W>, missing_before: u32) {
        let counters = &self.buffer.counters;
        counters.written.add(1);
        if missing_before > 0 {
            counters.gaps.add(1);
            counters.missing.add(u64::from(missing_before));
        }
        if row.flags & SATURATED != 0 {
            counters.saturated.add(1);
        }
        if row.flags & BAD_STATUS != 0 {
            counters.bad_status.add(1);
        }
    }

    fn count_held(&self) {
        self.buffer.counters.held.set(self.held.len() as u64);
    }
}

/// Device time of rows that come without any: one period after the last.
///
/// Periods are counted from the last row whose time is known, so that one of no whole number of ticks does not drift.
///
/// ```
/// use granular_id::buffer::{wrench_buffer, BufferSpec, DeviceClock};
///
/// let spec = BufferSpec::default().with_rate_hz(300.0).with_tick_hz(1000.0);
/// let (writer, _) = wrench_buffer(spec)?;
/// let mut clock = DeviceClock::new(&spec);
/// assert_eq!([None; 4].map(|own| clock.ticks(own, &writer)), [0, 3, 7, 10]);
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct DeviceClock {
    period_ticks: f64,
    epoch: u32,
    /// Where periods are counted from, and how many have passed.
    base: Option<(u64, u64)>,
    /// Time of the last row, taken or dropped.
    last: Option<u64>,
}

impl DeviceClock {
    /// A clock for the rows of a buffer, before the first.
    #[must_use]
    pub fn new(spec: &BufferSpec) -> Self {
        Self { period_ticks: spec.tick_hz / spec.rate_hz, epoch: 0, base: None, last: None }
    }

    /// The row's own time, or the next instant: one period after the last row of the writer's epoch, whoever pushed it, and
    /// 0 for the first. Call it once for every row, also for one that will be dropped: it has had its instant too.
    pub fn ticks(&mut self, own: Option<u64>, writer: &Writer) -> u64 {
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
