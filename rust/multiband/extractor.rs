//! From recordings to features, alone and in batches, and the memory in which that is done.

use std::sync::Mutex;

use super::bank::{Bank, BankWork};
use super::coupling::{Coupling, Resolvents};
use super::envelope::{mean_square, measure, Energies, Envelope, Level, STRETCHES};
use super::quantiles::{Histogram, Quantiles, PROBABILITIES};
use super::spec::{bands, Block, FrequencyBand, MultiBandSpec, Scales, TOO_LOUD};
use super::spectrum::{Spectrum, SpectrumWork};
use super::{Compute, Split, Statistic};
use crate::error::{Error, Result};
use crate::features::{finite, not_finite, too_many_features, MAX_SAMPLES};
use crate::kernel::{Job, Simd, SimdPath};
use crate::memory::reserved;
use crate::parallel::{cores, in_pieces};
use crate::wrench::{axis_name, BatchShape};

/// The largest number of features of a recording that is worth computing.
const MAX_FEATURES: usize = 100_000_000;

/// The largest number of values of a recording, 23 minutes of six axes at 500 Hz.
pub(super) const MAX_VALUES: usize = 1 << 22;

/// Extracts multi-band features of recordings of one shape; a checked [`MultiBandSpec`] with its filters and scales.
/// Immutable, shared between threads; it keeps the memory that batches of short recordings worked in.
#[derive(Clone, Debug)]
pub struct MultiBand {
    spec: MultiBandSpec,
    n_samples: usize,
    n_axes: usize,
    n_features: usize,
    scales: Scales,
    bands: Vec<FrequencyBand>,
    bank: Bank,
    coupling: Option<Coupling>,
    quantiles: Option<Quantiles>,
    envelope: Option<Envelope>,
    spectrum: Option<Spectrum>,
    level: Option<Level>,
    pub(super) pool: WorkspacePool,
}

impl MultiBand {
    /// Checks a specification and designs what recordings of `n_samples` samples of `n_axes` axes need. Blocks that such
    /// short recordings do not have are left out, see [`Block::least_samples`].
    ///
    /// # Errors
    /// [`Error::Argument`], [`Error::Empty`], [`Error::Range`]: a rate that is not positive, a recording of no samples or
    /// axes or of too many, no block that it has; [`Error::Length`], [`Error::Argument`]: scales of another shape, or none to
    /// divide by.
    pub fn new(spec: MultiBandSpec, n_samples: usize, n_axes: usize, scales: &Scales) -> Result<Self> {
        Error::check_rate(spec.rate_hz)?;
        Self::check_size(n_samples, n_axes)?;
        let has = |block| spec.has(block, n_samples, n_axes);
        if !Block::NAMED.iter().any(|(_, block)| has(*block)) {
            let recordings = format_args!("recordings of {n_samples} samples of {n_axes} axes");
            let wanted = format_args!("name at least one block that {recordings} have");
            return Err(Error::argument("blocks", wanted, "none"));
        }
        scales.check(n_samples, n_axes)?;
        let bands = bands(n_samples, spec.rate_hz);
        let n_bands = bands.len();
        let lengths: Vec<_> = bands.iter().map(|band| band.n_samples).collect();
        // The couplings of many axes are the most by far.
        let pairs = n_axes.checked_mul(n_axes).and_then(|n| n.checked_mul(4 * n_bands));
        if pairs.is_none_or(|pairs| has(Block::Coupling) && pairs > MAX_FEATURES) {
            return Err(too_many_features(n_samples, n_axes));
        }
        let mut this = Self {
            bank: Bank::new(n_samples, n_axes, &scales.bands)?,
            coupling: has(Block::Coupling).then(|| Coupling::new(&lengths, n_axes)),
            quantiles: has(Block::Quantiles).then(|| Quantiles::new(n_bands * n_axes)),
            envelope: has(Block::Envelope).then(|| Envelope { n_signals: n_bands * n_axes }),
            spectrum: has(Block::Spectrum).then(|| Spectrum::new(n_samples, n_axes)),
            level: has(Block::Level).then(|| Level::new(scales.level.clone(), n_samples)),
            bands,
            scales: scales.clone(),
            n_features: 0,
            pool: WorkspacePool::default(),
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
        Error::check_range("n_samples", n_samples, 1..=MAX_SAMPLES)?;
        if n_samples.checked_mul(n_axes).is_none_or(|values| values > MAX_VALUES) {
            return Err(too_many_features(n_samples, n_axes));
        }
        Ok(())
    }

    /// Memory for [`extract_into`](Self::extract_into).
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn workspace(&self) -> Result<Workspace> {
        Ok(Workspace {
            made_for: self.work_key(),
            bank: self.bank.work(),
            energies: vec![[0.0; STRETCHES]; self.n_bands() * self.n_axes],
            coupling: self.coupling.as_ref().map(Statistic::work),
            quantiles: self.quantiles.as_ref().map(Statistic::work),
            spectrum: self.spectrum.as_ref().map(Statistic::work),
        })
    }

    /// By what workspaces differ.
    fn work_key(&self) -> (usize, usize, MultiBandSpec) {
        (self.n_samples, self.n_axes, self.spec)
    }

    /// What is computed.
    #[must_use]
    pub fn spec(&self) -> &MultiBandSpec {
        &self.spec
    }

    /// The largest magnitude of each axis that can be worked with.
    pub(crate) fn limits(&self) -> &[f64] {
        &self.bank.limits
    }

    /// Samples of a whole recording.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.n_samples
    }

    /// Axes of a recording.
    #[must_use]
    pub fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// Bands, band 0 included.
    #[must_use]
    pub fn n_bands(&self) -> usize {
        self.bands.len()
    }

    /// The bands: band 0, which is the recording without its mean, then octave after octave downward.
    #[must_use]
    pub fn bands(&self) -> &[FrequencyBand] {
        &self.bands
    }

    /// Middle of each bin of the spectrum, in hertz; none without that block.
    #[must_use]
    pub fn frequencies_hz(&self) -> Vec<f64> {
        let step = self.spec.rate_hz / self.n_samples as f64;
        let edges = self.spectrum.as_ref().map_or(&[][..], |spectrum| &spectrum.edges);
        // From the first to the last frequency of a bin, both included.
        edges.windows(2).map(|bin| 0.5 * (bin[0] + bin[1] - 1) as f64 * step).collect()
    }

    /// The scales.
    #[must_use]
    pub fn scales(&self) -> &Scales {
        &self.scales
    }

    /// Features of a recording.
    #[must_use]
    pub fn n_features(&self) -> usize {
        self.n_features
    }

    /// The blocks that there are, in order, and how many features each has.
    #[must_use]
    pub fn block_sizes(&self) -> Vec<(Block, usize)> {
        let sizes = [
            (Block::Coupling, self.coupling.as_ref().map(Statistic::n_features)),
            (Block::Quantiles, self.quantiles.as_ref().map(Statistic::n_features)),
            (Block::Envelope, self.envelope.as_ref().map(Statistic::n_features)),
            (Block::Spectrum, self.spectrum.as_ref().map(Statistic::n_features)),
            (Block::Level, self.level.as_ref().map(Statistic::n_features)),
        ];
        sizes.into_iter().filter_map(|(block, size)| size.map(|size| (block, size))).collect()
    }

    /// Names of the features, in order: `b0_coupling_fx_fx ... b0_q02_fx ... b0_envelope_fx_0 ... spectrum_fx_00`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn names(&self) -> Result<Vec<String>> {
        let n_bands = self.n_bands();
        let axes: Vec<_> = (0..self.n_axes()).map(|axis| axis_name(axis, self.n_axes())).collect();
        let mut names = reserved(self.n_features())?;
        if let Some(coupling) = &self.coupling {
            for &(band, lag) in &coupling.bands {
                let row = |row: usize| match row / axes.len() {
                    0 => axes[row].clone(),
                    _ => format!("{}_lag{lag}", axes[row % axes.len()]),
                };
                let cells = coupling.cells();
                names.extend(cells.map(|(i, j)| format!("b{band}_coupling_{}_{}", row(i), row(j))));
            }
        }
        let each = |names: &mut Vec<String>, name: &dyn Fn(usize, &str, &mut Vec<String>)| {
            for band in 0..n_bands {
                for axis in &axes {
                    name(band, axis, names);
                }
            }
        };
        if self.quantiles.is_some() {
            each(&mut names, &|band, axis, names| {
                names.extend(PROBABILITIES.map(|p| format!("b{band}_q{:02.0}_{axis}", 100.0 * p)));
                names.push(format!("b{band}_logrms_{axis}"));
            });
        }
        if self.envelope.is_some() {
            each(&mut names, &|band, axis, names| {
                names.extend((0..STRETCHES).map(|stretch| format!("b{band}_envelope_{axis}_{stretch}")));
            });
        }
        let bins = self.spectrum.as_ref().map_or(0, |spectrum| spectrum.edges.len() - 1);
        let stretches = self.level.as_ref().map_or(0, |level| level.stretches);
        for (what, n) in [("spectrum", bins), ("level", stretches)] {
            for axis in &axes {
                names.extend((0..n).map(|i| format!("{what}_{axis}_{i:02}")));
            }
        }
        Ok(names)
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
    /// [`Error::Length`]; [`Error::NonFinite`] and [`Error::TooLarge`] call the recording number 0. On an error `out` holds
    /// unspecified numbers.
    pub fn extract_into(&self, rows: &[f64], work: &mut Workspace, out: &mut [f64]) -> Result<()> {
        self.extract_on(SimdPath::detect()?, rows, work, out)
    }

    /// [`extract_into`](Self::extract_into) on a path of choice, for tests and benchmarks, as are the other `_on`.
    #[doc(hidden)]
    pub fn extract_on(
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
        self.split(SimdPath::detect()?, rows, work)?;
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
    fn blocks(&self, path: SimdPath, rows: &[f64], work: &mut Workspace, mut out: &mut [f64]) {
        let Workspace { bank, energies, coupling, quantiles, spectrum, .. } = work;
        let split = Split { rows, signals: bank.signals(self.n_axes), energies };
        block(path, self.coupling.as_ref(), coupling.as_mut(), split, &mut out);
        block(path, self.quantiles.as_ref(), quantiles.as_mut(), split, &mut out);
        block(path, self.envelope.as_ref(), Some(&mut ()), split, &mut out);
        block(path, self.spectrum.as_ref(), spectrum.as_mut(), split, &mut out);
        block(path, self.level.as_ref(), Some(&mut ()), split, &mut out);
    }

    /// Splits a recording into bands, once it is known to be one.
    fn split(&self, path: SimdPath, rows: &[f64], work: &mut Workspace) -> Result<()> {
        self.fit(rows, work)?;
        if path.run(SplitBands { design: self, rows, work }) {
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
        if work.made_for != self.work_key() {
            *work = self.workspace()?;
        }
        Ok(())
    }

    /// Why a recording cannot be worked with.
    fn refused(&self, rows: &[f64]) -> Error {
        let shape = BatchShape { n_recordings: 1, n_samples: rows.len() / self.n_axes, n_axes: self.n_axes };
        match not_finite(rows, shape) {
            Error::TooLarge { recording, largest, .. } => {
                Error::TooLarge { recording, largest, limit: TOO_LOUD }
            }
            error => error,
        }
    }
}

/// A block, where there is one, into the first numbers of `rest`, which are taken off.
#[allow(clippy::mut_mut)] // the slice itself moves on
fn block<S: Statistic>(
    path: SimdPath,
    statistic: Option<&S>,
    work: Option<&mut S::Work>,
    split: Split<'_>,
    rest: &mut &mut [f64],
) {
    let Some((statistic, work)) = statistic.zip(work) else { return };
    if let Some(out) = rest.split_off_mut(..statistic.n_features()) {
        path.run(Compute { statistic, split, work, out });
    }
}

/// Splits a recording into the bands of a workspace and measures their energies; false where a value is not to be worked with.
struct SplitBands<'a> {
    design: &'a MultiBand,
    rows: &'a [f64],
    work: &'a mut Workspace,
}

impl Job for SplitBands<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> bool {
        let SplitBands { design, rows, work } = self;
        let within = design.bank.split(simd, rows, &mut work.bank);
        if within {
            measure(work.bank.signals(design.n_axes), &mut work.energies);
        }
        within
    }
}

/// The largest number of values of a recording whose workspace stays in the pool: twelve times the paper's, or 40 MB of memory.
/// Longer ones take so much time that fresh memory costs nothing beside it.
pub(super) const MAX_POOLED: usize = 1 << 16;

/// Memory for one recording at a time, of the shape that it was made for by
/// [`MultiBand::workspace`](super::MultiBand::workspace). Nothing that it holds ever shows in the features of a recording.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// Samples, axes and blocks that it was made for.
    pub(super) made_for: (usize, usize, MultiBandSpec),
    pub(super) bank: BankWork,
    pub(super) energies: Vec<Energies>,
    pub(super) coupling: Option<Resolvents>,
    pub(super) quantiles: Option<Histogram>,
    pub(super) spectrum: Option<SpectrumWork>,
}

/// Workspaces of a design that nobody works in, for the recordings to come: to a short recording fresh memory costs as
/// much as its features.
#[derive(Debug, Default)]
pub(super) struct WorkspacePool(Mutex<Vec<Workspace>>);

impl Clone for WorkspacePool {
    /// A clone makes its own.
    fn clone(&self) -> Self {
        Self::default()
    }
}

// Neither side ever waits: a fork may have copied the lock while another thread of the parent held it.
impl WorkspacePool {
    /// One of them, if there is any.
    pub(super) fn take(&self) -> Option<Workspace> {
        self.0.try_lock().ok().and_then(|mut pool| pool.pop())
    }

    /// Keeps one, at most one for each core and none of long recordings.
    pub(super) fn keep(&self, work: Workspace) {
        if work.made_for.0.saturating_mul(work.made_for.1) > MAX_POOLED {
            return;
        }
        if let Ok(mut pool) = self.0.try_lock() {
            if pool.len() < cores() {
                pool.push(work);
            }
        }
    }
}

impl MultiBand {
    /// Features of a batch, one row per recording. 1 and n threads give the same bits; threads beyond the number of cores
    /// are not used.
    ///
    /// # Arguments
    /// - `wrench`: `wrench[(recording * shape.n_samples + sample) * n_axes + axis]`.
    /// - `shape`: the axes that this was made for, and at most as many samples; see [`extract_into`](Self::extract_into).
    /// - `threads`: at least 1.
    /// - `out`: [`n_features`](Self::n_features) numbers for each recording.
    ///
    /// # Errors
    /// As [`extract_into`](Self::extract_into), naming the first recording that is refused; [`Error::Empty`];
    /// [`Error::Range`]. On an error `out` holds unspecified numbers.
    pub fn extract_batch(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.extract_batch_on(SimdPath::detect()?, wrench, shape, threads, out)
    }

    #[doc(hidden)]
    pub fn extract_batch_on(
        &self,
        path: SimdPath,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.each(wrench, shape, threads, self.n_features(), out, |rows, work, out| {
            self.extract_on(path, rows, work, out)
        })
    }

    /// Root mean squares of a batch, `n_bands * n_axes` numbers per recording, as [`rms_into`](Self::rms_into).
    pub fn rms_batch(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        let row_len = self.n_bands() * self.n_axes();
        self.each(wrench, shape, threads, row_len, out, |rows, work, out| self.rms_into(rows, work, out))
    }

    /// Refuses a batch that is empty, of another number of values, or of recordings that are not of this shape.
    #[doc(hidden)]
    pub fn check_batch(&self, len: usize, shape: BatchShape) -> Result<()> {
        shape.check(len)?;
        let BatchShape { n_samples, n_axes, .. } = shape;
        if n_samples > self.n_samples() || n_axes != self.n_axes() {
            let wanted = format_args!("have at most {} samples of {} axes", self.n_samples(), self.n_axes());
            let got = format_args!("{n_samples} samples of {n_axes}");
            return Err(Error::argument("recordings", wanted, got));
        }
        Ok(())
    }

    /// Works through the recordings of a batch, in memory that is made once per thread and serves the next batch, too.
    fn each(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        row_len: usize,
        out: &mut [f64],
        one: impl Fn(&[f64], &mut Workspace, &mut [f64]) -> Result<()> + Sync,
    ) -> Result<()> {
        self.check_batch(wrench.len(), shape)?;
        in_pieces(wrench, shape, (row_len, 1), threads, out, |wrench, shape, out| {
            let mut work = self.pool.take().map_or_else(|| self.workspace(), Ok)?;
            let recordings = wrench.chunks_exact(shape.recording_len()).zip(out.chunks_exact_mut(row_len));
            for (recording, (rows, out)) in recordings.enumerate() {
                one(rows, &mut work, out).map_err(|error| error.after(recording))?;
            }
            self.pool.keep(work);
            Ok(())
        })
    }
}
