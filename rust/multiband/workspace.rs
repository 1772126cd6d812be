//! Memory that extraction works in.

use super::bank::BankWork;
use super::coupling::CouplingWork;
use super::quantiles::QuantilesWork;
use super::spectrum::SpectrumWork;

/// Memory for one recording at a time, of the shape that it was made for by
/// [`MultiBand::workspace`](super::MultiBand::workspace). What it holds never shows in a result.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// Samples and axes that it was made for.
    pub(super) shape: (usize, usize),
    pub(super) bank: BankWork,
    pub(super) means: Vec<f64>,
    pub(super) coupling: Option<CouplingWork>,
    pub(super) quantiles: Option<QuantilesWork>,
    pub(super) spectrum: Option<SpectrumWork>,
}
