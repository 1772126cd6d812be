//! The work of [`Extractor`]: a batch in tasks for threads, into float64 or float32, and what to say when it fails.

#[cfg(feature = "parallel")]
use rayon::prelude::*;

use crate::batch_kernel::{team_size, Teams};
use crate::error::{Error, Result};
use crate::features::{BatchShape, Extractor};
use crate::kernel::{Real, SimdPath};
use crate::pool;

/// Recordings per task at most: about 5 MB in and out, small enough to balance, large enough to stay cheap.
const TASK_RECORDINGS: usize = 32;

/// Results larger than this are written past the caches: they would not find room, and reading every line before it is
/// overwritten would cost a third of the memory traffic.
const STREAM_BYTES: usize = 8 << 20;

impl Extractor {
    /// Features of a batch into `out`, one row per recording. 1 and n threads give the same bits; threads beyond the
    /// number of cores are not used.
    ///
    /// On an error `out` holds unspecified numbers.
    pub fn extract_into(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.extract_on(SimdPath::detect()?, wrench, shape, threads, out)
    }

    /// [`extract_into`](Self::extract_into) on a path of choice, for tests and benchmarks.
    pub fn extract_on(
        &self,
        path: SimdPath,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        let stream = size_of_val(out) > STREAM_BYTES;
        let n_features = self.check(wrench, shape)?;
        in_tasks(wrench, shape, n_features, threads, out, |wrench, shape, out| {
            self.run_on(path, wrench, shape, out, stream)
        })
    }

    /// [`extract_into`](Self::extract_into) rounded to float32 once, for half the memory.
    pub fn extract_into_f32(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f32],
    ) -> Result<()> {
        let n_features = self.check(wrench, shape)?;
        let path = SimdPath::detect()?;
        in_tasks(wrench, shape, n_features, threads, out, |wrench, shape, out| {
            self.run_on(path, wrench, shape, out, false)?;
            // without a branch, which the compiler turns into a few vector instructions
            if out.iter().fold(true, |all, value| all & value.is_finite()) {
                return Ok(());
            }
            let rows = out.chunks_exact(n_features).zip(wrench.chunks_exact(shape.recording_len()));
            for (recording, (row, samples)) in rows.enumerate() {
                if let Some(index) = row.iter().position(|value| !value.is_finite()) {
                    let one = BatchShape { n_recordings: 1, ..shape };
                    let value = self.extract(samples, one, 1)?[index];
                    return Err(Error::Narrow { recording, value });
                }
            }
            Ok(())
        })
    }

    /// One task. Past the caches, where asked.
    fn run_on<T: Real>(
        &self,
        path: SimdPath,
        wrench: &[f64],
        shape: BatchShape,
        out: &mut [T],
        stream: bool,
    ) -> Result<()> {
        let n_features = self.n_features(shape.n_samples, shape.n_axes)?;
        let finite = path.run(Teams { extractor: self, shape, n_features, wrench, out, stream });
        finite.then_some(()).ok_or_else(|| not_finite(wrench, shape))
    }
}

/// Cuts a checked batch into tasks; each writes `row_len` numbers for each of its recordings. The error is that of the first
/// recording that has one.
pub(crate) fn in_tasks<T: Send>(
    wrench: &[f64],
    shape: BatchShape,
    row_len: usize,
    threads: usize,
    out: &mut [T],
    task: impl Fn(&[f64], BatchShape, &mut [T]) -> Result<()> + Sync,
) -> Result<()> {
    if threads == 0 {
        return Err(Error::Threads { threads });
    }
    let expected = shape.n_recordings.saturating_mul(row_len);
    if out.len() != expected {
        return Err(Error::Length { what: "out", expected, got: out.len() });
    }
    // Whole teams per task, at least four tasks per thread where there are that many.
    let team = team_size(shape.n_axes);
    let teams = shape.n_recordings.div_ceil(team);
    let size = teams.div_ceil(4 * threads.min(teams)).min((TASK_RECORDINGS / team).max(1)) * team;
    let one = |(index, (wrench, out)): (usize, (&[f64], &mut [T]))| {
        let part = BatchShape { n_recordings: wrench.len() / shape.recording_len(), ..shape };
        task(wrench, part, out).map_err(|error| error.later(index * size))
    };
    let (recordings, rows) = (size * shape.recording_len(), size * row_len);
    match pool::of(threads).filter(|_| teams > 1) {
        None => wrench.chunks(recordings).zip(out.chunks_mut(rows)).enumerate().try_for_each(one),
        #[cfg(feature = "parallel")]
        Some(pool) => {
            let tasks = wrench.par_chunks(recordings).zip(out.par_chunks_mut(rows)).enumerate().map(one);
            let errors: Vec<_> = pool.install(|| tasks.filter_map(Result::err).collect());
            errors.into_iter().next().map_or(Ok(()), Err)
        }
    }
}

pub(crate) fn finite(wrench: &[f64]) -> bool {
    wrench.iter().all(|value| value.is_finite())
}

/// Finds out why a result is not finite: the first bad value, or values too large to filter.
pub(crate) fn not_finite(wrench: &[f64], shape: BatchShape) -> Error {
    let place = |index: usize| {
        let (recording, rest) = (index / shape.recording_len(), index % shape.recording_len());
        (recording, rest / shape.n_axes, rest % shape.n_axes)
    };
    if let Some(index) = wrench.iter().position(|value| !value.is_finite()) {
        let (recording, sample, axis) = place(index);
        return Error::NonFinite { recording, sample, axis, value: wrench[index] };
    }
    let (index, largest) = wrench.iter().map(|value| value.abs()).enumerate().fold((0, 0.0), |best, this| {
        if this.1 > best.1 {
            this
        } else {
            best
        }
    });
    Error::Overflow { recording: place(index).0, largest }
}
