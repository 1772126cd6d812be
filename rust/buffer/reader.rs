//! Readers: each with a place of its own.

use std::sync::Arc;

use super::clock::ClockLine;
use super::counters::Stats;
use super::row::BufferedRow;
use super::shared::Shared;
use super::spec::BufferSpec;
use super::window::{Window, WindowError, WindowSpec};

/// What one read brought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Rows that were read. They are of one epoch, and none between them was overwritten.
    pub n_rows: usize,
    /// Rows overwritten before the first of them, exactly.
    pub missed: u64,
}

/// One reader of a buffer; a clone starts where the original is.
///
/// Reading never blocks the writer or other readers, and never allocates except for [`window`](Self::window).
#[derive(Clone)]
pub struct Reader {
    shared: Arc<Shared>,
    /// Number of the next row to read.
    next: u64,
}

impl Reader {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        Self { shared, next: 0 }
    }

    /// Another reader that gets the rows to come.
    #[must_use]
    pub fn from_now(&self) -> Self {
        Self { shared: Arc::clone(&self.shared), next: self.shared.rows.head() }
    }

    /// Another reader that gets every row still there, oldest first, and then those to come.
    #[must_use]
    pub fn from_oldest(&self) -> Self {
        Self { shared: Arc::clone(&self.shared), next: self.shared.oldest(self.shared.rows.head()) }
    }

    /// Rows written and not yet read, overwritten ones included.
    #[must_use]
    pub fn n_ahead(&self) -> u64 {
        self.shared.rows.head() - self.next
    }

    /// Reads the oldest rows not yet read, as many as there are and fit. Ends early at the border of an epoch.
    pub fn read(&mut self, rows: &mut [BufferedRow]) -> Taken {
        let mut places = rows.iter_mut();
        self.read_each(places.len(), |row| {
            if let Some(place) = places.next() {
                *place = *row;
            }
        })
    }

    /// The same for rows that go elsewhere, one by one.
    pub fn read_each(&mut self, max_rows: usize, mut take: impl FnMut(&BufferedRow)) -> Taken {
        let mut taken = Taken::default();
        if max_rows == 0 {
            return taken;
        }
        let mut head = self.shared.rows.head();
        let mut epoch = None;
        while self.next < head && taken.n_rows < max_rows {
            let oldest = self.shared.oldest(head);
            // Rows that no longer count are missed, even where their slots are still whole: what is missed must depend
            // on how far behind a reader is, not on how many slots there are to spare.
            let row = if self.next < oldest { None } else { self.shared.row(self.next) };
            match row {
                Some(row) if *epoch.get_or_insert(row.epoch) == row.epoch => {
                    take(&row);
                    taken.n_rows += 1;
                    self.next += 1;
                }
                // Never rows from both sides of a loss, nor of two epochs: the next read goes on there.
                _ if taken.n_rows > 0 => break,
                _ => {
                    head = self.shared.rows.head();
                    let next = self.shared.oldest(head).max(self.next + 1);
                    taken.missed += next - self.next;
                    self.next = next;
                }
            }
        }
        taken
    }

    /// The newest row.
    #[must_use]
    pub fn latest(&self) -> Option<BufferedRow> {
        Some(self.shared.newest()?.1)
    }

    /// The last instants, up to the newest row, as one array: a copy.
    pub fn window(&self, spec: &WindowSpec) -> Result<Window, WindowError> {
        super::window::window(&self.shared, spec)
    }

    /// Counts since the buffer was made.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.shared.counters.stats()
    }

    /// What the buffer was made for.
    #[must_use]
    pub fn spec(&self) -> &BufferSpec {
        &self.shared.spec
    }

    /// Rows the buffer holds.
    #[must_use]
    #[allow(clippy::cast_possible_truncation)] // it came from a usize
    pub fn capacity(&self) -> usize {
        self.shared.capacity as usize
    }

    /// How long before `now` the newest row would have arrived without any delay, in nanoseconds; `None` without rows.
    #[must_use]
    pub fn lag_ns(&self, now: u64) -> Option<f64> {
        let (line, newest) = self.newest_on_line()?;
        Some(line.lag_ns(newest.row.ticks, now))
    }

    /// Host time at which a row with these ticks would have arrived without any delay, in the newest epoch.
    #[must_use]
    pub fn host_ns_at(&self, ticks: u64) -> Option<f64> {
        Some(self.newest_on_line()?.0.host_ns(ticks))
    }

    /// Device time in ticks at a moment of host time, in the newest epoch; `None` too where all rows came at one moment.
    #[must_use]
    pub fn ticks_at(&self, host_ns: u64) -> Option<f64> {
        Some(self.newest_on_line()?.0.ticks(host_ns)).filter(|ticks| ticks.is_finite())
    }

    /// The newest row and the clock of its epoch.
    fn newest_on_line(&self) -> Option<(ClockLine, BufferedRow)> {
        loop {
            let (_, newest) = self.shared.newest()?;
            // The writer publishes a line before the first row on it, so one is there unless it was replaced meanwhile.
            if let Some(line) = self.shared.clock_line(newest.epoch) {
                return Some((line, newest));
            }
        }
    }
}
