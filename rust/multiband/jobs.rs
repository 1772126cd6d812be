//! The steps before the blocks, compiled for every path.

use super::bank::BandSignals;
use super::extractor::MultiBand;
use super::limits::means_within;
use super::workspace::Workspace;
use crate::lanes::{Isa, Job};

/// Splits a recording into the bands of a workspace; false, and nothing split, where a value is not to be worked with.
pub(super) struct Split<'a> {
    pub(super) design: &'a MultiBand,
    pub(super) rows: &'a [f64],
    pub(super) work: &'a mut Workspace,
}

impl Job for Split<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<I: Isa>(self) -> bool {
        let Split { design, rows, work } = self;
        let within = means_within(rows, &design.limits, &mut work.means);
        if within {
            design.bank.split::<I>(rows, &work.means, &mut work.bank);
        }
        within
    }
}

/// Root mean square of each band and axis, band-major.
pub(super) struct RootMeanSquares<'a> {
    pub(super) signals: BandSignals<'a>,
    pub(super) out: &'a mut [f64],
}

impl Job for RootMeanSquares<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { signals, out } = self;
        let bands = out.chunks_exact_mut(signals.n_axes()).enumerate();
        for (band, out) in bands.take(signals.n_bands()) {
            for (axis, rms) in out.iter_mut().enumerate() {
                let samples = signals.axis(band, axis);
                let mut sums = [0.0; 8];
                for eight in samples.chunks(sums.len()) {
                    sums.iter_mut().zip(eight).for_each(|(sum, y)| *sum += y * y);
                }
                *rms = (sums.iter().sum::<f64>() / samples.len() as f64).sqrt();
            }
        }
    }
}
