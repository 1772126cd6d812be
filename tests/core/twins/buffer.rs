//! A wrench buffer written for its obviousness: it keeps rows in a queue, sorts those that wait and searches the rest.

use std::collections::VecDeque;

use granular_id::buffer::{BufferedRow, Fill, Pushed, Row, Stats, Window, WindowError, WindowSpec};
use granular_id::wrench::{BAD_STATUS, GAP_FILLED, SATURATED};

/// Ticks per period: half a period is a whole number of them.
pub const PERIOD: u64 = 10;

/// A row waiting or written, with the number of its packet.
type Numbered = (Row, Option<u64>);

/// What the buffer promises, done the slow way.
pub struct Naive {
    capacity: usize,
    depth: usize,
    /// The newest rows up to the capacity.
    pub rows: VecDeque<BufferedRow>,
    packets: VecDeque<Option<u64>>,
    pub n_overwritten: u64,
    held: Vec<Numbered>,
    epoch: u32,
    late_in_a_row: u32,
    pub stats: Stats,
}

fn missing_between(earlier: u64, later: u64) -> u32 {
    let periods = (later - earlier + PERIOD / 2) / PERIOD;
    u32::try_from(periods.saturating_sub(1)).unwrap_or(u32::MAX)
}

impl Naive {
    pub fn new(capacity: usize, depth: usize) -> Self {
        Self {
            capacity,
            depth,
            rows: VecDeque::new(),
            packets: VecDeque::new(),
            n_overwritten: 0,
            held: Vec::new(),
            epoch: 0,
            late_in_a_row: 0,
            stats: Stats::default(),
        }
    }

    /// Device time of the newest row of this epoch.
    fn newest(&self) -> Option<u64> {
        self.rows.back().filter(|row| row.epoch == self.epoch).map(|row| row.row.ticks)
    }

    pub fn push(&mut self, row: Row, packet: Option<u64>) -> Pushed {
        if row.wrench.iter().any(|value| !value.is_finite()) {
            self.stats.non_finite += 1;
            return Pushed::NonFinite;
        }
        let Some(newest) = self.newest() else {
            self.write((row, packet));
            return Pushed::Written;
        };
        if row.ticks > newest {
            self.late_in_a_row = 0;
        }
        if newest > row.ticks + 500 * PERIOD {
            return self.restart((row, packet));
        }
        let written = self.rows.iter().zip(&self.packets);
        let here = written.filter(|(row, _)| row.epoch == self.epoch).map(|(row, packet)| (row.row, *packet));
        if let Some((_, first)) =
            here.chain(self.held.iter().copied()).find(|(had, _)| had.ticks == row.ticks)
        {
            return if first.is_some() && packet.is_some() && first != packet {
                self.stats.stale += 1;
                Pushed::Stale
            } else {
                self.stats.duplicates += 1;
                Pushed::Duplicate
            };
        }
        if row.ticks < newest {
            self.late_in_a_row += 1;
            if self.late_in_a_row == 8 {
                return self.restart((row, packet));
            }
            self.stats.late += 1;
            return Pushed::Late;
        }
        self.stats.reordered += u64::from(self.held.iter().any(|(had, _)| had.ticks > row.ticks));
        self.held.push((row, packet));
        self.held.sort_by_key(|(row, _)| row.ticks);
        while let (Some((first, _)), Some(newest)) = (self.held.first(), self.newest()) {
            if missing_between(newest, first.ticks) > 0 && self.held.len() <= self.depth {
                break;
            }
            let first = self.held.remove(0);
            self.write(first);
        }
        self.stats.held = self.held.len() as u64;
        if self.newest().is_some_and(|newest| newest >= row.ticks) {
            Pushed::Written
        } else {
            Pushed::Held
        }
    }

    fn restart(&mut self, row: Numbered) -> Pushed {
        self.new_epoch();
        self.write(row);
        Pushed::Written
    }

    fn write(&mut self, (row, packet): Numbered) {
        let missing_before = self.newest().map_or(0, |newest| missing_between(newest, row.ticks));
        self.stats.written += 1;
        self.stats.gaps += u64::from(missing_before > 0);
        self.stats.missing += u64::from(missing_before);
        self.stats.saturated += u64::from(row.flags & SATURATED != 0);
        self.stats.bad_status += u64::from(row.flags & BAD_STATUS != 0);
        self.rows.push_back(BufferedRow { row, missing_before, epoch: self.epoch });
        self.packets.push_back(packet);
        if self.rows.len() > self.capacity {
            self.rows.pop_front();
            self.packets.pop_front();
            self.n_overwritten += 1;
        }
    }

    pub fn flush(&mut self) {
        for row in std::mem::take(&mut self.held) {
            self.write(row);
        }
        self.stats.held = 0;
    }

    pub fn new_epoch(&mut self) {
        self.flush();
        if self.newest().is_some() {
            self.epoch += 1;
            self.stats.epochs += 1;
        }
        self.late_in_a_row = 0;
    }

    /// Rows and missed from a place on, and the next place.
    pub fn read(&self, place: u64, max_rows: usize) -> (Vec<BufferedRow>, u64, u64) {
        let missed = self.n_overwritten.saturating_sub(place);
        let mut place = place + missed;
        let mut rows: Vec<BufferedRow> = Vec::new();
        while let Some(row) = usize::try_from(place - self.n_overwritten).ok().and_then(|i| self.rows.get(i))
        {
            if rows.len() == max_rows || rows.last().is_some_and(|last| last.epoch != row.epoch) {
                break;
            }
            rows.push(*row);
            place += 1;
        }
        (rows, missed, place)
    }

    /// The window, or the obstacle nearest to the newest row.
    pub fn window(&self, spec: &WindowSpec) -> Result<Window, WindowError> {
        let n = spec.n;
        if n > self.capacity {
            return Err(WindowError::TooLong { n, capacity: self.capacity as u64 });
        }
        if n > 0 && self.rows.is_empty() {
            return Err(WindowError::TooFew { n, have: 0 });
        }
        let tail: Vec<_> = self
            .rows
            .iter()
            .rev()
            .take_while(|row| Some(row.epoch) == self.rows.back().map(|r| r.epoch))
            .collect();
        let mut instants: Vec<(usize, u64)> = Vec::new(); // newest first: row of the tail, place in the gap before it
        for (i, row) in tail.iter().enumerate() {
            instants.push((i, 0));
            let here = instants.len() as u64 - 1;
            if here < n as u64 && row.row.flags & SATURATED != 0 && !spec.allow_saturated {
                return Err(WindowError::Saturated { ago: here });
            }
            if instants.len() >= n {
                break;
            }
            if row.missing_before > spec.max_gap {
                return Err(WindowError::Gap {
                    missing: row.missing_before,
                    max_gap: spec.max_gap,
                    ago: here,
                });
            }
            if i + 1 == tail.len() {
                let have = instants.len() as u64;
                return Err(if tail.len() < self.rows.len() {
                    WindowError::EpochBorder { n, have }
                } else {
                    WindowError::TooFew { n, have }
                });
            }
            for place in (1..=u64::from(row.missing_before)).rev() {
                instants.push((i, place));
            }
            if instants.len() >= n {
                if spec.fill == Fill::Linear
                    && tail[i + 1].row.flags & SATURATED != 0
                    && !spec.allow_saturated
                {
                    return Err(WindowError::Saturated { ago: instants.len() as u64 });
                }
                break;
            }
        }
        instants.truncate(n);
        let mut window = Window::default();
        for (i, place) in instants.into_iter().rev() {
            window.mask.push(place == 0);
            let row = if place == 0 {
                tail[i].row
            } else if spec.fill == Fill::None {
                continue;
            } else {
                filled(&tail[i + 1].row, tail[i], place, spec.fill)
            };
            window.ticks.push(row.ticks);
            window.host_ns.push(row.host_ns);
            window.wrench.push(row.wrench);
            window.flags.push(row.flags);
        }
        Ok(window)
    }
}

fn filled(earlier: &Row, later: &BufferedRow, place: u64, fill: Fill) -> Row {
    let steps = u64::from(later.missing_before) + 1;
    let later = later.row;
    let whole = |a: u64, b: u64| {
        let way = (i128::from(b) - i128::from(a)) * i128::from(place) / i128::from(steps);
        u64::try_from(i128::from(a) + way).unwrap()
    };
    let value = |axis: usize| match fill {
        Fill::Linear => {
            earlier.wrench[axis] + (later.wrench[axis] - earlier.wrench[axis]) * (place as f64 / steps as f64)
        }
        _ => f64::NAN,
    };
    Row {
        ticks: whole(earlier.ticks, later.ticks),
        host_ns: whole(earlier.host_ns, later.host_ns),
        wrench: std::array::from_fn(value),
        flags: if fill == Fill::Linear { GAP_FILLED } else { 0 },
    }
}
