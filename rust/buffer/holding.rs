//! Rows that wait for a late one before them.

use super::row::{Packet, Row};

/// Rows in order of device time, up to a depth fixed when it is made. Never allocates afterwards.
pub(super) struct Holding {
    rows: Vec<(Row, Packet)>,
    depth: usize,
}

impl Holding {
    pub(super) fn new(depth: usize) -> Self {
        // One more than may wait: a row goes in before the first goes out.
        Self { rows: Vec::with_capacity(depth + 1), depth }
    }

    pub(super) fn depth(&self) -> usize {
        self.depth
    }

    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    pub(super) fn is_overfull(&self) -> bool {
        self.rows.len() > self.depth
    }

    /// The first in device time.
    pub(super) fn first(&self) -> Option<&Row> {
        self.rows.first().map(|(row, _)| row)
    }

    /// The last in device time.
    pub(super) fn last(&self) -> Option<&Row> {
        self.rows.last().map(|(row, _)| row)
    }

    /// Puts a row in its place, or returns the packet of the row that has its device time.
    pub(super) fn insert(&mut self, row: &Row, packet: Packet) -> Result<(), Packet> {
        match self.rows.binary_search_by_key(&row.ticks, |(row, _)| row.ticks) {
            Ok(same) => Err(self.rows[same].1),
            Err(place) => {
                self.rows.insert(place, (*row, packet));
                Ok(())
            }
        }
    }

    /// Takes the first in device time.
    pub(super) fn pop(&mut self) -> Option<(Row, Packet)> {
        if self.rows.is_empty() {
            None
        } else {
            Some(self.rows.remove(0))
        }
    }
}
