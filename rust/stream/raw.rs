//! The samples of a window, axis by axis as the features want them.

use crate::error::Result;
use crate::memory::filled;

/// A ring per axis: `values[axis * n_slots + slot]`.
#[derive(Clone, Debug)]
pub(super) struct RawSamples {
    n_slots: usize,
    values: Vec<f64>,
}

impl RawSamples {
    pub(super) fn new(n_slots: usize, n_axes: usize) -> Result<Self> {
        Ok(Self { n_slots, values: filled(0.0, n_slots * n_axes)? })
    }

    /// Keeps a row under a slot.
    pub(super) fn set(&mut self, slot: usize, row: &[f64]) {
        for (axis, value) in self.values.chunks_exact_mut(self.n_slots).zip(row) {
            axis[slot] = *value;
        }
    }

    /// The row of a slot.
    pub(super) fn read(&self, slot: usize, out: &mut [f64]) {
        for (axis, value) in self.values.chunks_exact(self.n_slots).zip(out) {
            *value = axis[slot];
        }
    }

    /// The raw block of the features: `n_seen` samples from slot `first` on, round the end; zero where none was seen.
    pub(super) fn write(&self, first: usize, n_seen: usize, out: &mut [f64]) {
        let axes = self.values.chunks_exact(self.n_slots).zip(out.chunks_exact_mut(self.n_slots));
        for (samples, out) in axes {
            let (seen, unseen) = out.split_at_mut(n_seen);
            let (until_end, from_start) = seen.split_at_mut(n_seen.min(self.n_slots - first));
            until_end.copy_from_slice(&samples[first..][..until_end.len()]);
            from_start.copy_from_slice(&samples[..from_start.len()]);
            unseen.fill(0.0);
        }
    }
}
