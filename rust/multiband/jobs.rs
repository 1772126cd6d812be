//! The step before the blocks, compiled for every path.

use super::energies::measure;
use super::extractor::MultiBand;
use super::limits::means_within;
use super::workspace::Workspace;
use crate::lanes::{Isa, Job};

/// Splits a recording into the bands of a workspace and measures their energies; false, and nothing split, where a value is
/// not to be worked with.
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
            measure::<I::Quad>(work.bank.signals(design.n_axes()), &mut work.energies);
        }
        within
    }
}
