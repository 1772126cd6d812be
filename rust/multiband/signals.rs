//! Signals of bands for tests.

use super::band_signals::{BandSignals, Place};
use super::energies::{measure, Energies, STRETCHES};
use crate::kernel::{Pack, SimdPath};

/// Asserts that features of restless signals, of many lengths and more axes than fit into a vector, are finite and have the
/// same bits on every path.
pub(super) fn same_on_every_path(compute: impl Fn(SimdPath, &Signals) -> Vec<f64>) {
    let signals = Signals::new(&[1000, 1000, 500, 61, 9, 1], 7);
    let all: Vec<_> = SimdPath::available().into_iter().map(|path| compute(path, &signals)).collect();
    assert!(all[0].iter().all(|x| x.is_finite()));
    assert!(all.windows(2).all(|pair| pair[0] == pair[1]));
}

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

    pub(super) fn energies(&self) -> Vec<Energies> {
        let mut energies = vec![[0.0; STRETCHES]; self.places.len() * self.n_axes];
        measure::<Pack<4>>(self.view(), &mut energies);
        energies
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
