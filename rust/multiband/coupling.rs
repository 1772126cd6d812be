//! How axes move together in a band: the logarithm of the matrix of their second moments, now and two samples earlier.
//!
//! Logarithms of covariances make differences of ratios, and their Euclidean distances sensible: Arsigny et al.,
//! "Log-Euclidean metrics for fast and simple calculus on diffusion tensors" (2006); Barachant et al., "Multiclass
//! brain-computer interface classification by Riemannian geometry" (2012).

use super::bank::BandSignals;
use super::moments::{Moments, LAG};
use super::symmetric::Logarithms;
use crate::lanes::{Isa, Job, Path};

/// Added to the second moments of scaled signals: what is a thousandth of the usual energy counts as noise.
pub(super) const RIDGE: f64 = 1e-3;

/// Stacked samples per row of a matrix at least; fewer leave little but chance in its logarithm.
const MIN_SAMPLES: usize = 4;

/// Samples of the shortest band that has the statistic.
pub(super) const fn least_samples(n_axes: usize) -> usize {
    n_axes.saturating_mul(2 * MIN_SAMPLES).saturating_add(LAG)
}

/// Matrices whose logarithms are taken at a time: eight bands of a recording of 1600 samples have one.
const MATRICES: usize = 8;

/// The statistic for some number of axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coupling {
    n_axes: usize,
    n_bands: usize,
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct CouplingWork {
    moments: Moments,
    logarithms: Logarithms<MATRICES>,
}

impl Coupling {
    /// For bands of some numbers of samples, the longest first; only the first few may be long enough.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        Self { n_axes, n_bands: lengths.partition_point(|n| *n >= least_samples(n_axes)) }
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
        CouplingWork { moments: Moments::new(self.n_axes), logarithms: Logarithms::new(2 * self.n_axes) }
    }

    /// Band by band the upper triangle, row by row, off the diagonal times the square root of two, so that the norm of the
    /// features is that of the matrix. Allocates nothing.
    pub(super) fn compute(
        &self,
        path: Path,
        signals: BandSignals<'_>,
        scales: &[f64],
        work: &mut CouplingWork,
        out: &mut [f64],
    ) {
        path.run(Compute { design: *self, signals, scales, work, out });
    }
}

struct Compute<'a> {
    design: Coupling,
    signals: BandSignals<'a>,
    scales: &'a [f64],
    work: &'a mut CouplingWork,
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { design, signals, scales, work, out } = self;
        let n_axes = design.n_axes;
        let rows = 2 * n_axes;
        let CouplingWork { moments, logarithms } = work;
        for (group, out) in out.chunks_mut(MATRICES * design.per_band()).enumerate() {
            for lane in 0..out.len() / design.per_band() {
                let band = group * MATRICES + lane;
                let scales = &scales[band * n_axes..][..n_axes];
                moments.take(signals, band, scales, |i, j, moment| {
                    let ridge = if i == j { RIDGE } else { 0.0 };
                    logarithms.matrices[i * rows + j].0[lane] = moment + ridge;
                });
            }
            logarithms.take(RIDGE);
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
