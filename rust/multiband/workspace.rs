//! Memory that extraction works in.

use super::bank::BankWork;
use super::coupling::CouplingWork;
use super::energies::Energies;
use super::extractor::MultiBand;
use super::spectrum::SpectrumWork;
use super::tally::Tally;

/// Memory for one recording at a time, of the shape that it was made for by
/// [`MultiBand::workspace`](super::MultiBand::workspace). Nothing that it holds ever shows in the features of a recording.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// Samples and axes that it was made for.
    pub(super) shape: (usize, usize),
    pub(super) bank: BankWork,
    pub(super) means: Vec<f64>,
    pub(super) energies: Vec<Energies>,
    pub(super) coupling: Option<CouplingWork>,
    pub(super) tally: Option<Tally>,
    pub(super) spectrum: Option<SpectrumWork>,
}

impl Workspace {
    /// Forgets the recording that went before: the next row is the first one of another.
    pub(crate) fn restart(&mut self) {
        // Before the first block of rows nothing is remembered.
        if self.bank.n_done() == 0 {
            return;
        }
        self.bank.restart();
        if let Some(coupling) = &mut self.coupling {
            coupling.restart();
        }
        if let Some(tally) = &mut self.tally {
            tally.restart();
        }
    }

    /// Whether there is room for all that a design computes.
    pub(super) fn suits(&self, design: &MultiBand) -> bool {
        let there = [self.coupling.is_some(), self.tally.is_some(), self.spectrum.is_some()];
        let needed = [design.coupling.is_some(), design.quantiles.is_some(), design.spectrum.is_some()];
        self.shape == (design.n_samples(), design.n_axes()) && there.iter().zip(needed).all(|(t, n)| *t || !n)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{n_bands, Block, MultiBandSpec, Scales};
    use super::*;

    /// Every selection of blocks, in memory made for every other one and for another shape.
    #[test]
    fn memory_of_another_design_changes_nothing() {
        let (n_samples, n_axes) = (60, 2);
        let scales = Scales::unit(n_bands(n_samples), n_axes).unwrap();
        let rows: Vec<f64> = (0..n_samples * n_axes).map(|i| (0.37 * (i * i) as f64).sin()).collect();
        let designs: Vec<_> = (1..1 << Block::NAMED.len())
            .map(|blocks| {
                let spec = MultiBandSpec::of(500.0, |block| blocks >> block as u8 & 1 == 1);
                MultiBand::new(spec, n_samples, n_axes, &scales).unwrap()
            })
            .collect();
        let short =
            MultiBand::new(MultiBandSpec::default(), 7, n_axes, &Scales::unit(n_bands(7), n_axes).unwrap());
        let extract = |design: &MultiBand, mut work: Workspace| {
            let mut out = vec![f64::NAN; design.n_features()];
            design.extract_into(&rows, &mut work, &mut out).unwrap();
            out
        };
        let short = short.unwrap();
        for design in &designs {
            let own = extract(design, design.workspace().unwrap());
            assert!(own.iter().all(|feature| feature.is_finite()));
            for other in designs.iter().chain([&short]) {
                assert_eq!(extract(design, other.workspace().unwrap()), own);
            }
        }
    }

    #[test]
    fn work_is_done_while_rows_arrive_and_never_much_at_a_time() {
        let (n_samples, n_axes) = (1000, 2);
        let scales = Scales::unit(n_bands(n_samples), n_axes).unwrap();
        let design = MultiBand::new(MultiBandSpec::default(), n_samples, n_axes, &scales).unwrap();
        let rows: Vec<f64> = (0..n_samples * n_axes).map(|i| (0.37 * (i * i) as f64).sin()).collect();
        let mut work = design.workspace().unwrap();
        for n_seen in 1..=n_samples {
            design.advance(&rows[..n_seen * n_axes], &mut work, 1).unwrap();
            assert_eq!(work.bank.n_done(), n_seen / 64 * 64);
        }
        work.restart();
        for n_done in [128, 256, 384] {
            design.advance(&rows, &mut work, 1).unwrap();
            assert_eq!(work.bank.n_done(), n_done);
        }
    }
}
