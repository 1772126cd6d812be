//! The steps before the statistics, compiled for every path.

use super::energies::measure;
use super::extractor::MultiBand;
use super::limits::means_within;
use super::workspace::Workspace;
use crate::kernel::{Isa, Job};

/// Splits the next blocks of rows of the beginning of a recording into octaves, and adds up what the statistics make of them.
pub(super) struct Advance<'a> {
    pub(super) design: &'a MultiBand,
    pub(super) rows: &'a [f64],
    pub(super) work: &'a mut Workspace,
    /// Blocks of rows, at most.
    pub(super) n_blocks: usize,
}

impl Job for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Advance { design, rows, work, n_blocks } = self;
        for _ in 0..n_blocks {
            if !design.bank.advance::<I>(rows, &mut work.bank) {
                return;
            }
            let signals = work.bank.signals(design.n_axes);
            if let Some(coupling) = &mut work.coupling {
                coupling.advance::<I::Quad>(signals);
            }
            if let Some(tally) = &mut work.tally {
                tally.advance(signals);
            }
        }
    }
}

/// Splits what is left of a recording into the bands of a workspace and measures their energies; false, and nothing split,
/// where a value is not to be worked with.
pub(super) struct Finish<'a> {
    pub(super) design: &'a MultiBand,
    pub(super) rows: &'a [f64],
    pub(super) work: &'a mut Workspace,
}

impl Job for Finish<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<I: Isa>(self) -> bool {
        let Finish { design, rows, work } = self;
        let within = means_within(rows, &design.limits, &mut work.means);
        if within {
            design.bank.finish::<I>(rows, &work.means, &mut work.bank);
            measure::<I::Quad>(work.bank.signals(design.n_axes), &mut work.energies);
        }
        within
    }
}
