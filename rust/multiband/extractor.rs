//! From recordings to features.

use super::bands::{bands, FrequencyBand};
use super::bank::Bank;
use super::coupling::Coupling;
use super::energies::{mean_square, STRETCHES};
use super::envelope::Envelope;
use super::jobs::{Advance, Finish};
use super::level::Level;
use super::limits::limits;
use super::octave::ROWS;
use super::quantiles::Quantiles;
use super::scales::Scales;
use super::spare::Spare;
use super::spec::{Block, MultiBandSpec};
use super::spectrum::Spectrum;
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::extract::{finite, not_finite};
use crate::features::{BatchShape, MAX_SAMPLES};
use crate::kernel::SimdPath;
use crate::memory::room;

/// The largest number of features of a recording that is worth computing.
const MAX_FEATURES: usize = 100_000_000;

/// The largest number of values of a recording, 23 minutes of six axes at 500 Hz.
const MAX_VALUES: usize = 1 << 22;

/// Bytes that a design takes for each value of a recording at most, and a workspace. Both are made in many pieces.
pub(super) const DESIGN_BYTES: usize = 200;
pub(super) const WORK_BYTES: usize = 650;

/// Extracts multi-band features of recordings of one shape; a checked [`MultiBandSpec`] with its filters and scales.
/// Immutable, shared between threads; it keeps the memory that batches of short recordings worked in.
#[derive(Clone, Debug)]
pub struct MultiBand {
    pub(super) spec: MultiBandSpec,
    pub(super) n_samples: usize,
    pub(super) n_axes: usize,
    pub(super) n_features: usize,
    pub(super) scales: Scales,
    pub(super) bands: Vec<FrequencyBand>,
    /// The largest magnitude of each axis that can be worked with.
    pub(super) limits: Vec<f64>,
    pub(super) bank: Bank,
    pub(super) coupling: Option<Coupling>,
    pub(super) quantiles: Option<Quantiles>,
    pub(super) envelope: Option<Envelope>,
    pub(super) spectrum: Option<Spectrum>,
    pub(super) level: Option<Level>,
    pub(super) spare: Spare,
}

impl MultiBand {
    /// Checks a specification and designs what recordings of `n_samples` samples of `n_axes` axes need. Blocks that such
    /// short recordings do not have are left out, see [`Block::least_samples`].
    ///
    /// # Errors
    /// [`Error::Rate`]; [`Error::Empty`], [`Error::Samples`], [`Error::TooLarge`]: a recording of no samples or axes, or of
    /// too many; [`Error::Memory`]; [`Error::NoBlocks`]; [`Error::Length`], [`Error::Scale`]: scales of another shape, or none to divide by.
    pub fn new(spec: MultiBandSpec, n_samples: usize, n_axes: usize, scales: &Scales) -> Result<Self> {
        if !(spec.rate_hz.is_finite() && spec.rate_hz > 0.0) {
            return Err(Error::Rate { rate_hz: spec.rate_hz });
        }
        Self::check_size(n_samples, n_axes)?;
        room(n_samples * n_axes * DESIGN_BYTES)?;
        let has = |block| spec.has(block, n_samples, n_axes);
        if !Block::NAMED.iter().any(|(_, block)| has(*block)) {
            return Err(Error::NoBlocks { n_samples, n_axes });
        }
        scales.check(n_samples, n_axes)?;
        let bands = bands(n_samples, spec.rate_hz);
        let n_bands = bands.len();
        let lengths: Vec<_> = bands.iter().map(|band| band.n_samples).collect();
        // The couplings of many axes are the most by far.
        let pairs = n_axes.checked_mul(n_axes).and_then(|n| n.checked_mul(4 * n_bands));
        if pairs.is_none_or(|pairs| has(Block::Coupling) && pairs > MAX_FEATURES) {
            return Err(Error::TooLarge { n_samples, n_axes });
        }
        let mut this = Self {
            bank: Bank::new(n_samples, n_axes, &scales.bands)?,
            coupling: has(Block::Coupling).then(|| Coupling::new(&lengths, n_axes)),
            quantiles: has(Block::Quantiles).then(|| Quantiles::new(lengths.clone(), n_axes)),
            envelope: has(Block::Envelope).then(|| Envelope::new(n_bands, n_axes)),
            spectrum: has(Block::Spectrum).then(|| Spectrum::new(n_samples, n_axes)),
            level: has(Block::Level).then(|| Level::new(n_axes, n_samples)),
            bands,
            limits: limits(scales, n_axes),
            scales: scales.clone(),
            n_features: 0,
            spare: Spare::default(),
            spec,
            n_samples,
            n_axes,
        };
        this.n_features = this.block_sizes().iter().map(|(_, size)| size).sum();
        Ok(this)
    }

    /// Refuses recordings of no samples or axes, or of too many, before anything of that size is made or counted.
    #[doc(hidden)]
    pub fn check_size(n_samples: usize, n_axes: usize) -> Result<()> {
        if n_samples == 0 || n_axes == 0 {
            return Err(Error::Empty { what: "a recording", shape: vec![n_samples, n_axes] });
        }
        if n_samples > MAX_SAMPLES {
            return Err(Error::Samples { n_samples, max: MAX_SAMPLES });
        }
        if n_samples.checked_mul(n_axes).is_none_or(|values| values > MAX_VALUES) {
            return Err(Error::TooLarge { n_samples, n_axes });
        }
        Ok(())
    }

    /// Memory for [`extract_into`](Self::extract_into).
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn workspace(&self) -> Result<Workspace> {
        room(self.n_samples * self.n_axes * WORK_BYTES)?;
        Ok(Workspace {
            shape: (self.n_samples, self.n_axes),
            bank: self.bank.work(),
            means: vec![0.0; self.n_axes],
            energies: vec![[0.0; STRETCHES]; self.n_bands() * self.n_axes],
            coupling: self.coupling.as_ref().map(Coupling::work),
            tally: self.quantiles.as_ref().map(Quantiles::work),
            spectrum: self.spectrum.as_ref().map(Spectrum::work),
        })
    }

    /// Features of one recording into `out`, without allocation.
    ///
    /// A recording of fewer samples is taken as the beginning of a whole one: bands and frequencies are those of the whole,
    /// statistics are over what there is.
    ///
    /// # Arguments
    /// - `rows`: 1 to `n_samples` samples of all axes, time-major: `rows[sample * n_axes + axis]`.
    /// - `work`: from [`workspace`](Self::workspace).
    /// - `out`: [`n_features`](Self::n_features) numbers.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::NonFinite`] and [`Error::TooLoud`] call the recording number 0. On an error `out` holds
    /// unspecified numbers.
    pub fn extract_into(&self, rows: &[f64], work: &mut Workspace, out: &mut [f64]) -> Result<()> {
        self.extract_on(SimdPath::detect()?, rows, work, out)
    }

    /// [`extract_into`](Self::extract_into) on a path of choice, for tests and benchmarks.
    pub fn extract_on(
        &self,
        path: SimdPath,
        rows: &[f64],
        work: &mut Workspace,
        out: &mut [f64],
    ) -> Result<()> {
        work.restart();
        let done = self.finish_on(path, rows, work, out);
        work.restart();
        done
    }

    /// Does what can be done already while a recording arrives, 64 rows at a time: [`finish_into`](Self::finish_into) then
    /// has less to do. Takes a time in proportion to the rows that are new, and catches up where more are left.
    ///
    /// # Arguments
    /// - `rows`: all samples so far, time-major. Those that were there before have not changed since
    ///   [`Workspace::restart`]; where there are fewer than before they are those of another recording.
    /// - `work`: from [`workspace`](Self::workspace) of the same design.
    /// - `n_new`: how many of them are new.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub(crate) fn advance(&self, rows: &[f64], work: &mut Workspace, n_new: usize) -> Result<()> {
        self.advance_on(SimdPath::detect()?, rows, work, n_new)
    }

    /// [`advance`](Self::advance) on a path of choice, for tests and benchmarks.
    pub(crate) fn advance_on(
        &self,
        path: SimdPath,
        rows: &[f64],
        work: &mut Workspace,
        n_new: usize,
    ) -> Result<()> {
        self.fit(rows, work)?;
        path.run(Advance { design: self, rows, work, n_blocks: n_new.div_ceil(ROWS) + 1 });
        Ok(())
    }

    /// Features of a recording of which [`advance`](Self::advance) knows a beginning, or nothing, into `out`: the bits of
    /// [`extract_into`](Self::extract_into). More of it may still come.
    ///
    /// # Errors
    /// As [`extract_into`](Self::extract_into).
    pub(crate) fn finish_into(&self, rows: &[f64], work: &mut Workspace, out: &mut [f64]) -> Result<()> {
        self.finish_on(SimdPath::detect()?, rows, work, out)
    }

    /// [`finish_into`](Self::finish_into) on a path of choice, for tests and benchmarks.
    pub(crate) fn finish_on(
        &self,
        path: SimdPath,
        rows: &[f64],
        work: &mut Workspace,
        out: &mut [f64],
    ) -> Result<()> {
        self.split(path, rows, work)?;
        if out.len() != self.n_features {
            return Err(Error::Length { what: "out", expected: self.n_features, got: out.len() });
        }
        self.blocks(path, rows, work, out);
        if finite(out) {
            return Ok(());
        }
        Err(self.refused(rows))
    }

    /// Root mean square of each band and axis of one recording into `out`, band-major: what scales are learned from.
    ///
    /// # Errors
    /// As [`extract_into`](Self::extract_into).
    pub fn rms_into(&self, rows: &[f64], work: &mut Workspace, out: &mut [f64]) -> Result<()> {
        work.restart();
        let split = self.split(SimdPath::detect()?, rows, work);
        work.restart();
        split?;
        let expected = self.n_bands() * self.n_axes;
        if out.len() != expected {
            return Err(Error::Length { what: "out", expected, got: out.len() });
        }
        let signals = work.bank.signals(self.n_axes);
        for (index, (rms, energies)) in out.iter_mut().zip(&work.energies).enumerate() {
            let n = signals.numbered(index).len();
            *rms = mean_square(energies, n).sqrt() * self.scales.bands[index];
        }
        if finite(out) {
            return Ok(());
        }
        Err(self.refused(rows))
    }

    /// All blocks of the recording that was split last.
    fn blocks(&self, path: SimdPath, rows: &[f64], work: &mut Workspace, out: &mut [f64]) {
        let (signals, energies) = (work.bank.signals(self.n_axes), &work.energies);
        let mut rest = out;
        if let Some((block, work)) = self.coupling.as_ref().zip(work.coupling.as_mut()) {
            block.compute(path, signals, work, first(&mut rest, block.n_features()));
        }
        if let Some((block, work)) = self.quantiles.as_ref().zip(work.tally.as_mut()) {
            block.compute(path, signals, energies, work, first(&mut rest, block.n_features()));
        }
        if let Some(block) = &self.envelope {
            block.compute(path, signals, energies, first(&mut rest, block.n_features()));
        }
        if let Some((block, work)) = self.spectrum.as_ref().zip(work.spectrum.as_mut()) {
            block.compute(path, signals, work, first(&mut rest, block.n_features()));
        }
        if let Some(block) = &self.level {
            block.compute(rows, &self.scales.level, first(&mut rest, block.n_features()));
        }
    }

    /// Splits the rest of a recording into bands, once it is known to be one.
    fn split(&self, path: SimdPath, rows: &[f64], work: &mut Workspace) -> Result<()> {
        self.fit(rows, work)?;
        if path.run(Finish { design: self, rows, work }) {
            return Ok(());
        }
        Err(self.refused(rows))
    }

    /// Refuses what is no recording of this shape, nor the beginning of one.
    fn fit(&self, rows: &[f64], work: &mut Workspace) -> Result<()> {
        let whole = self.n_samples * self.n_axes;
        if rows.is_empty() || rows.len() > whole || !rows.len().is_multiple_of(self.n_axes) {
            return Err(Error::Length { what: "rows", expected: whole, got: rows.len() });
        }
        // A workspace made for something else is replaced: a mistake that costs time only.
        if !work.suits(self) {
            *work = self.workspace()?;
        }
        // One that knows more rows than there are knows another recording.
        if work.bank.n_done() * self.n_axes > rows.len() {
            work.restart();
        }
        Ok(())
    }

    /// Why a recording cannot be worked with.
    fn refused(&self, rows: &[f64]) -> Error {
        let shape = BatchShape { n_recordings: 1, n_samples: rows.len() / self.n_axes, n_axes: self.n_axes };
        match not_finite(rows, shape) {
            Error::Overflow { recording, largest } => Error::TooLoud { recording, largest },
            error => error,
        }
    }
}

/// Takes the first numbers off a slice.
#[allow(clippy::mut_mut)] // the slice itself moves on
fn first<'a>(rest: &mut &'a mut [f64], n: usize) -> &'a mut [f64] {
    let (first, after) = std::mem::take(rest).split_at_mut(n);
    *rest = after;
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_too_large_for_any_memory_are_refused() {
        let unit = Scales::unit(1, 1).unwrap();
        for (n_samples, n_axes) in [
            (usize::MAX, 1),
            (MAX_SAMPLES, 1),
            (MAX_VALUES + 1, 1),
            (MAX_VALUES, 2),
            (1, MAX_VALUES + 1),
            (1, usize::MAX / 8 + 1),
            (MAX_SAMPLES, usize::MAX),
        ] {
            let error = MultiBand::new(MultiBandSpec::default(), n_samples, n_axes, &unit).unwrap_err();
            assert!(matches!(error, Error::Samples { .. } | Error::TooLarge { .. }), "{error}");
        }
    }
}
