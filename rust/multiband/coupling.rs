//! How axes move together in a band: the logarithm of the matrix of their second moments, now and two samples earlier.
//!
//! Logarithms of covariances make differences of ratios, and their Euclidean distances sensible: Arsigny et al.,
//! "Log-Euclidean metrics for fast and simple calculus on diffusion tensors" (2006); Barachant et al., "Multiclass
//! brain-computer interface classification by Riemannian geometry" (2012).

use super::band_signals::BandSignals;
use super::moments::{Moments, LAG};
use super::symmetric::{Logarithms, MATRICES};
use crate::kernel::{Isa, Job, Quad, SimdPath};

/// Added to the second moments of scaled signals: what is a thousandth of the usual energy counts as noise.
pub(super) const RIDGE: f64 = 1e-3;

/// Stacked samples per row of a matrix at least; fewer leave little but chance in its logarithm.
const MIN_SAMPLES: usize = 4;

/// Samples of the shortest band that has the statistic.
pub(super) const fn least_samples(n_axes: usize) -> usize {
    n_axes.saturating_mul(2 * MIN_SAMPLES).saturating_add(LAG)
}

/// The statistic for some number of axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coupling {
    n_axes: usize,
    n_bands: usize,
    /// Octaves that are added up while they grow.
    growing: usize,
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct CouplingWork {
    /// Those of the octaves that are long enough to be added up while they grow.
    growing: Vec<Moments>,
    /// Those of the band whose turn it is, of all its samples.
    whole: Moments,
    logarithms: Logarithms,
}

impl CouplingWork {
    /// Ready for the first sample of a recording.
    pub(super) fn restart(&mut self) {
        self.growing.iter_mut().for_each(Moments::restart);
    }

    /// Adds up what there is of the octaves.
    #[inline(always)]
    pub(super) fn advance<V: Quad>(&mut self, signals: BandSignals<'_>) {
        for (octave, moments) in self.growing.iter_mut().enumerate() {
            moments.advance::<V>(signals, 1 + octave);
        }
    }
}

impl Coupling {
    /// For bands of some numbers of samples, the longest first; only the first few may be long enough.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        let n_bands = lengths.partition_point(|n| *n >= least_samples(n_axes));
        let growing = lengths[..n_bands].iter().skip(1).filter(|n| Moments::can_grow(**n)).count();
        Self { n_axes, n_bands, growing }
    }

    /// The first bands, those that have this statistic.
    pub(super) fn n_bands(&self) -> usize {
        self.n_bands
    }

    /// Numbers per band: the upper triangle of a matrix of twice the axes.
    pub(super) fn per_band(&self) -> usize {
        self.n_axes * (2 * self.n_axes + 1)
    }

    pub(super) fn n_features(&self) -> usize {
        self.n_bands * self.per_band()
    }

    pub(super) fn work(&self) -> CouplingWork {
        let whole = Moments::new(self.n_axes);
        let growing = vec![whole.clone(); self.growing];
        CouplingWork { growing, whole, logarithms: Logarithms::new(2 * self.n_axes) }
    }

    /// Band by band the upper triangle, row by row, off the diagonal times the square root of two, so that the norm of the
    /// features is that of the matrix. Allocates nothing.
    pub(super) fn compute(
        &self,
        path: SimdPath,
        signals: BandSignals<'_>,
        work: &mut CouplingWork,
        out: &mut [f64],
    ) {
        path.run(Compute { design: *self, signals, work, out });
    }
}

struct Compute<'a> {
    design: Coupling,
    signals: BandSignals<'a>,
    work: &'a mut CouplingWork,
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { design, signals, work, out } = self;
        let n_axes = design.n_axes;
        let rows = 2 * n_axes;
        let CouplingWork { growing, whole, logarithms } = work;
        for (group, out) in out.chunks_mut(MATRICES * design.per_band()).enumerate() {
            for lane in 0..out.len() / design.per_band() {
                let band = group * MATRICES + lane;
                match growing.get(band.wrapping_sub(1)) {
                    Some(so_far) => whole.copy(so_far),
                    None => whole.restart(),
                }
                whole.finish::<I::Quad>(signals, band, |i, j, moment| {
                    let ridge = if i == j { RIDGE } else { 0.0 };
                    logarithms.matrices[i * rows + j].0[lane] = moment + ridge;
                });
            }
            logarithms.take::<I::Quad>(RIDGE);
            for (lane, out) in out.chunks_exact_mut(design.per_band()).enumerate() {
                let upper = (0..rows).flat_map(|i| (i..rows).map(move |j| (i, j)));
                for (feature, (i, j)) in out.iter_mut().zip(upper) {
                    let factor = if i == j { 1.0 } else { std::f64::consts::SQRT_2 };
                    *feature = factor * logarithms.matrices[j * rows + i].0[lane];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::signals::{same_on_every_path, Signals};
    use super::*;

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        let design = Coupling::new(&signals.lengths(), signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        design.compute(path, signals.view(), &mut design.work(), &mut out);
        out
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn only_bands_that_are_long_enough() {
        assert_eq!(Coupling::new(&[1600, 1600, 1600, 800, 400, 200, 100, 50, 25, 13], 6).n_bands(), 8);
        assert_eq!(Coupling::new(&[10, 9], 1).n_bands(), 1);
        assert_eq!(Coupling::new(&[49], 6).n_features(), 0);
    }

    #[test]
    fn silence_is_the_ridge() {
        let signals = Signals::from(vec![vec![vec![0.0; 30]; 1]]);
        let log = libm::log(RIDGE);
        assert_eq!(compute(SimdPath::Baseline, &signals), [log, 0.0, log]);
    }

    #[test]
    fn a_beginning_too_short_for_moments_is_the_ridge() {
        let design = Coupling::new(&[100], 1);
        let signals = Signals::from(vec![vec![vec![5.0; 2]; 1]]);
        let mut out = [0.0; 3];
        design.compute(SimdPath::Baseline, signals.view(), &mut design.work(), &mut out);
        assert_eq!(out, [libm::log(RIDGE), 0.0, libm::log(RIDGE)]);
    }

    #[test]
    fn what_overflows_is_not_hidden() {
        let signals = Signals::from(vec![vec![vec![1e200; 30]; 1]]);
        assert!(compute(SimdPath::Baseline, &signals).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn more_bands_than_fit_at_a_time() {
        let signals = Signals::new(&[60; 19], 2);
        let all = compute(SimdPath::detect().unwrap(), &signals);
        for (band, features) in all.chunks_exact(10).enumerate() {
            let alone = Signals::from(vec![signals.band(band)]);
            assert_eq!(features, compute(SimdPath::detect().unwrap(), &alone));
        }
    }
}
