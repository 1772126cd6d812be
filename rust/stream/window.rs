//! The rows of a window, side by side as a recording has them.

use super::windows::Windows;
use crate::error::{Error, Result};
use crate::memory::filled;

/// Keeps the rows of a window in the order in which they came. Allocates nothing once it is made.
#[derive(Clone, Debug)]
pub(super) struct Window {
    windows: Windows,
    /// Room for a whole window.
    values: Vec<f64>,
    n_seen: usize,
    /// Rows before the next window: a hop longer than a window.
    ahead: usize,
    first_row: u64,
}

impl Window {
    /// A window before its first row.
    pub(super) fn new(windows: Windows) -> Result<Self> {
        windows.check(1)?;
        let values = filled(0.0, windows.n_samples * windows.n_axes)?;
        Ok(Self { windows, values, n_seen: 0, ahead: 0, first_row: 0 })
    }

    /// Rows so far.
    pub(super) fn n_seen(&self) -> usize {
        self.n_seen
    }

    /// Whether all rows are there.
    pub(super) fn is_complete(&self) -> bool {
        self.n_seen == self.windows.n_samples
    }

    /// Rows of the stream before this window.
    pub(super) fn first_row(&self) -> u64 {
        self.first_row
    }

    /// The rows so far.
    pub(super) fn rows(&self) -> &[f64] {
        &self.values[..self.n_seen * self.windows.n_axes]
    }

    /// Takes rows until the window is complete, of magnitudes up to the limit of each axis; on an error none.
    pub(super) fn push(&mut self, rows: &[f64], limits: &[f64]) -> Result<usize> {
        let Windows { n_samples, n_axes, .. } = self.windows;
        let rows = self.windows.taken(rows, self.ahead.saturating_add(n_samples - self.n_seen))?;
        let n_taken = rows.len() / n_axes;
        let passed = self.ahead.min(n_taken);
        let kept = &rows[passed * n_axes..];
        for (row, values) in (passed..).zip(kept.chunks_exact(n_axes)) {
            if let Some(axis) = values.iter().zip(limits).position(|(value, limit)| value.abs() > *limit) {
                return Err(Error::LoudRow { row, axis, value: values[axis] });
            }
        }
        self.values[self.n_seen * n_axes..][..kept.len()].copy_from_slice(kept);
        self.ahead -= passed;
        self.n_seen += n_taken - passed;
        Ok(n_taken)
    }

    /// Goes on to the next window: rows that it shares with this one stay.
    pub(super) fn advance(&mut self) -> Result<()> {
        let Windows { n_samples, n_axes, hop } = self.windows;
        let hop = hop.ok_or(Error::NoHop)?;
        if !self.is_complete() {
            return Err(Error::Unfinished { n_seen: self.n_seen, n_samples });
        }
        let leaving = hop.min(n_samples);
        self.values.copy_within(leaving * n_axes.., 0);
        self.first_row = self.first_row.saturating_add(hop as u64);
        self.n_seen = n_samples - leaving;
        self.ahead = hop - leaving;
        Ok(())
    }

    /// Back to the state before the first row.
    pub(super) fn reset(&mut self) {
        (self.n_seen, self.ahead, self.first_row) = (0, 0, 0);
    }
}
