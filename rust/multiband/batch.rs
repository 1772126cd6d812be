//! Batches of recordings, in tasks for threads.

use super::extractor::MultiBand;
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::extract::in_tasks;
use crate::features::BatchShape;
use crate::kernel::SimdPath;

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
    /// [`Error::Threads`]. On an error `out` holds unspecified numbers.
    pub fn extract_batch(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.extract_batch_on(SimdPath::detect()?, wrench, shape, threads, out)
    }

    /// [`extract_batch`](Self::extract_batch) on a path of choice, for tests and benchmarks.
    pub fn extract_batch_on(
        &self,
        path: SimdPath,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        let batch = Batch { design: self, wrench, shape, threads, row_len: self.n_features() };
        batch.each(out, |rows, work, out| self.extract_on(path, rows, work, out))
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
        let batch = Batch { design: self, wrench, shape, threads, row_len };
        batch.each(out, |rows, work, out| self.rms_into(rows, work, out))
    }

    /// Refuses a batch that is empty, of another number of values, or of recordings that are not of this shape.
    #[doc(hidden)]
    pub fn check_batch(&self, len: usize, shape: BatchShape) -> Result<()> {
        let BatchShape { n_recordings, n_samples, n_axes } = shape;
        if n_recordings == 0 || n_samples == 0 || n_axes == 0 {
            return Err(Error::Empty { what: "wrench", shape: vec![n_recordings, n_samples, n_axes] });
        }
        if n_samples > self.n_samples() || n_axes != self.n_axes() {
            let wanted = (self.n_samples(), self.n_axes());
            return Err(Error::RecordingShape { wanted, got: (n_samples, n_axes) });
        }
        let expected = n_recordings.saturating_mul(shape.recording_len());
        if len != expected {
            return Err(Error::Length { what: "wrench", expected, got: len });
        }
        Ok(())
    }
}

/// A batch, and how many numbers are wanted of each recording.
struct Batch<'a> {
    design: &'a MultiBand,
    wrench: &'a [f64],
    shape: BatchShape,
    threads: usize,
    row_len: usize,
}

impl Batch<'_> {
    /// Works through the recordings, in memory that is made once per thread and kept for the next batch.
    fn each(
        &self,
        out: &mut [f64],
        one: impl Fn(&[f64], &mut Workspace, &mut [f64]) -> Result<()> + Sync,
    ) -> Result<()> {
        let Self { design, wrench, shape, threads, row_len } = *self;
        design.check_batch(wrench.len(), shape)?;
        in_tasks(wrench, shape, row_len, threads, out, |wrench, shape, out| {
            let mut work = design.spare.take().map_or_else(|| design.workspace(), Ok)?;
            let recordings = wrench.chunks_exact(shape.recording_len()).zip(out.chunks_exact_mut(row_len));
            for (recording, (rows, out)) in recordings.enumerate() {
                one(rows, &mut work, out).map_err(|error| error.later(recording))?;
            }
            design.spare.keep(work);
            Ok(())
        })
    }
}
