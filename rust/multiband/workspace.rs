//! Memory that extraction works in, and batches of recordings that share it.

use std::sync::Mutex;

use super::bank::BankWork;
use super::envelope::Energies;
use super::quantiles::Histogram;
use super::resolvents::Resolvents;
use super::spectrum::SpectrumWork;
use super::{MultiBand, MultiBandSpec};
use crate::error::{Error, Result};
use crate::kernel::SimdPath;
use crate::parallel::{cores, in_pieces};
use crate::wrench::BatchShape;

/// The largest number of values of a recording whose workspace is kept: twelve times the paper's, or 40 MB of memory.
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

/// Workspaces of a design that nobody works in, kept for the recordings to come: to a short recording fresh memory costs as
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
        let BatchShape { n_recordings, n_samples, n_axes } = shape;
        if n_recordings == 0 || n_samples == 0 || n_axes == 0 {
            return Err(Error::Empty { what: "wrench", shape: vec![n_recordings, n_samples, n_axes] });
        }
        if n_samples > self.n_samples() || n_axes != self.n_axes() {
            let wanted = format_args!("have at most {} samples of {} axes", self.n_samples(), self.n_axes());
            let got = format_args!("{n_samples} samples of {n_axes}");
            return Err(Error::argument("recordings", wanted, got));
        }
        let expected = n_recordings.saturating_mul(shape.recording_len());
        if len != expected {
            return Err(Error::Length { what: "wrench", expected, got: len });
        }
        Ok(())
    }

    /// Works through the recordings of a batch, in memory that is made once per thread and kept for the next batch.
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
