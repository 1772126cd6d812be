//! What the writer and the readers of one buffer share.

use super::clock::{ClockLine, CLOCK_WORDS};
use super::counters::Counters;
use super::ring::Ring;
use super::row::{BufferedRow, WORDS};
use super::spec::BufferSpec;
use crate::error::Result;

/// Lines of the clock that are kept: the newest, and some for readers that are slower than the writer.
const CLOCK_LINES: usize = 8;

pub(super) struct Shared {
    pub(super) spec: BufferSpec,
    pub(super) capacity: u64,
    pub(super) rows: Ring<WORDS>,
    /// The relation of device and host time, as it was last changed.
    pub(super) clock: Ring<CLOCK_WORDS>,
    pub(super) counters: Counters,
}

impl Shared {
    pub(super) fn new(spec: BufferSpec) -> Result<Self> {
        let capacity = spec.capacity()?;
        // Slots to spare: the oldest row that counts is not the one that is being overwritten.
        let slots = capacity + (capacity / 8).max(16);
        Ok(Self {
            spec,
            capacity: capacity as u64,
            rows: Ring::new(slots)?,
            clock: Ring::new(CLOCK_LINES)?,
            counters: Counters::default(),
        })
    }

    /// Number of the oldest row that still counts when `head` rows have been written.
    #[inline]
    pub(super) fn oldest(&self, head: u64) -> u64 {
        head.saturating_sub(self.capacity)
    }

    #[inline]
    pub(super) fn row(&self, n: u64) -> Option<BufferedRow> {
        self.rows.read(n).map(|words| BufferedRow::from_words(&words).0)
    }

    /// The newest row and its number.
    pub(super) fn newest(&self) -> Option<(u64, BufferedRow)> {
        loop {
            let n = self.rows.head().checked_sub(1)?;
            // Overwritten meanwhile: all slots were, and a newer row is there.
            if let Some(row) = self.row(n) {
                return Some((n, row));
            }
        }
    }

    /// The relation of device and host time in an epoch, while it is one of the last few that were published.
    pub(super) fn clock_line(&self, epoch: u32) -> Option<ClockLine> {
        let head = self.clock.head();
        let kept = head.saturating_sub(CLOCK_LINES as u64)..head;
        kept.rev()
            .filter_map(|n| self.clock.read(n))
            .map(|words| ClockLine::from_words(&words))
            .find(|line| line.epoch == epoch)
    }
}
