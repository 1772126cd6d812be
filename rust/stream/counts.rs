//! Histograms of the samples of a window, as they come and go.

use crate::dsp::{Outside, UniformBins, MAX_BINS};
use crate::error::Result;
use crate::features::Extractor;
use crate::memory::filled;

/// The cell of a value that is not counted.
const NONE: u16 = u16::MAX;

/// Every bin has a number of its own beside [`NONE`].
const _: () = assert!(MAX_BINS <= NONE as usize);

/// One histogram per axis, and the cell of every counted row, so that any row can be taken out again.
#[derive(Clone, Debug)]
pub(super) struct Counts {
    n_axes: usize,
    n_bins: usize,
    /// `histograms[axis * n_bins + bin]`: counts.
    histograms: Vec<u32>,
    /// `cells[slot * n_axes + axis]`: the bin, or `NONE`.
    cells: Vec<u16>,
}

impl Counts {
    /// Empty histograms for rows in slots `0..n_slots`.
    pub(super) fn new(n_slots: usize, n_axes: usize, n_bins: usize) -> Result<Self> {
        let (histograms, cells) = (filled(0, n_axes * n_bins)?, filled(NONE, n_slots * n_axes)?);
        Ok(Self { n_axes, n_bins, histograms, cells })
    }

    pub(super) fn clear(&mut self) {
        self.histograms.fill(0);
    }

    /// Counts a filtered row and remembers it under a slot.
    pub(super) fn add(&mut self, extractor: &Extractor, slot: usize, row: &[f64]) {
        let clip = extractor.spec().outside == Outside::Clip;
        let cells = &mut self.cells[slot * self.n_axes..][..self.n_axes];
        let histograms = self.histograms.chunks_exact_mut(self.n_bins);
        for (axis, ((value, cell), counts)) in row.iter().zip(cells).zip(histograms).enumerate() {
            *cell = extractor.bins(axis).map_or(NONE, |bins| cell_of(bins, *value, clip));
            if let Some(count) = counts.get_mut(usize::from(*cell)) {
                *count += 1;
            }
        }
    }

    /// Takes the row of a slot out again.
    pub(super) fn remove(&mut self, slot: usize) {
        let cells = &self.cells[slot * self.n_axes..][..self.n_axes];
        for (cell, counts) in cells.iter().zip(self.histograms.chunks_exact_mut(self.n_bins)) {
            if let Some(count) = counts.get_mut(usize::from(*cell)) {
                *count -= 1;
            }
        }
    }

    /// Counts of one axis.
    pub(super) fn axis(&self, axis: usize) -> &[u32] {
        &self.histograms[axis * self.n_bins..][..self.n_bins]
    }

    /// The histogram block of the features.
    pub(super) fn write(&self, extractor: &Extractor, out: &mut [f64]) {
        for (value, count) in out.iter_mut().zip(&self.histograms) {
            *value = f64::from(*count);
        }
        if extractor.spec().density {
            for (axis, block) in out.chunks_exact_mut(self.n_bins).enumerate() {
                if let Some(bins) = extractor.bins(axis) {
                    bins.normalise(block);
                }
            }
        }
    }
}

fn cell_of(bins: &UniformBins, value: f64, clip: bool) -> u16 {
    let bin = match bins.locate(value) {
        None if clip && value < bins.low() => Some(0),
        None if clip => Some(bins.n_bins() - 1),
        found => found,
    };
    bin.and_then(|bin| u16::try_from(bin).ok()).unwrap_or(NONE)
}
