//! Signals of bands for tests.

use super::bank::{BandSignals, Place};

/// Signals with a place for each.
pub(super) struct Signals {
    values: Vec<f64>,
    places: Vec<Place>,
    n_axes: usize,
}

impl Signals {
    /// Restless signals of some lengths.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        let value = |band: usize, axis: usize, t: usize| {
            let phase = (band * 7 + axis * 3 + 1) as f64;
            (0.37 * phase * t as f64).sin() + (1.3 * (t * t) as f64 + phase).cos() * 0.4
        };
        let axis = |band, axis, n| (0..n).map(|t| value(band, axis, t)).collect();
        let band = |(band, n): (usize, &usize)| (0..n_axes).map(|a| axis(band, a, *n)).collect();
        Self::from(lengths.iter().enumerate().map(band).collect::<Vec<Vec<Vec<f64>>>>())
    }

    pub(super) fn view(&self) -> BandSignals<'_> {
        BandSignals::new(&self.values, &self.places, self.n_axes)
    }

    pub(super) fn lengths(&self) -> Vec<usize> {
        self.places.iter().map(|place| place.len).collect()
    }

    pub(super) fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// All axes of a band.
    pub(super) fn band(&self, band: usize) -> Vec<Vec<f64>> {
        (0..self.n_axes).map(|axis| self.view().axis(band, axis).to_vec()).collect()
    }
}

impl From<Vec<Vec<Vec<f64>>>> for Signals {
    /// By band, axis and sample.
    fn from(bands: Vec<Vec<Vec<f64>>>) -> Self {
        let mut start = 0;
        let place = |band: &Vec<Vec<f64>>| {
            let place = Place { start, stride: band[0].len(), len: band[0].len() };
            start += band.len() * place.stride;
            place
        };
        let (places, n_axes) = (bands.iter().map(place).collect(), bands[0].len());
        Self { values: bands.concat().concat(), places, n_axes }
    }
}
