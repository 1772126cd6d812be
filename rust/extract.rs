//! The work of [`Extractor`]: a batch in tasks for threads, and what to say when it fails.

use rayon::prelude::*;

use crate::crew::{team_size, Teams};
use crate::error::{Error, Result};
use crate::features::{BatchShape, Extractor};
use crate::lanes::Path;
use crate::pool;

/// Recordings per task at most: about 5 MB in and out, small enough to balance, large enough to stay cheap.
const TASK_RECORDINGS: usize = 32;

/// Results larger than this are written past the caches: they would not find room, and reading every line before it is
/// overwritten would cost a third of the memory traffic.
const STREAM_BYTES: usize = 8 << 20;

impl Extractor {
    /// Features of a batch into `out`, one row per recording. 1 and n threads give the same bits.
    ///
    /// On an error `out` holds unspecified numbers.
    pub fn extract_into(
        &self,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.extract_on(Path::detect(), wrench, shape, threads, out)
    }

    /// [`extract_into`](Self::extract_into) on a path of choice, for tests and benchmarks.
    pub fn extract_on(
        &self,
        path: Path,
        wrench: &[f64],
        shape: BatchShape,
        threads: usize,
        out: &mut [f64],
    ) -> Result<()> {
        let n_features = self.check(wrench, shape)?;
        if threads == 0 {
            return Err(Error::Threads { threads });
        }
        let expected = shape.n_recordings.saturating_mul(n_features);
        if out.len() != expected {
            return Err(Error::Length { what: "out", expected, got: out.len() });
        }
        let teams = shape.n_recordings.div_ceil(team_size(shape.n_axes));
        let threads = threads.min(teams);
        let stream = size_of_val(out) > STREAM_BYTES;
        let job = |wrench, out| path.run(Teams { extractor: self, shape, n_features, wrench, out, stream });
        let finite = if threads <= 1 {
            job(wrench, out)
        } else {
            // Whole teams per task, at least four tasks per thread where there are that many.
            let team = team_size(shape.n_axes);
            let task = teams.div_ceil(4 * threads).min((TASK_RECORDINGS / team).max(1)) * team;
            pool::install(threads, || {
                let recordings = wrench.par_chunks(task * shape.recording_len());
                let rows = out.par_chunks_mut(task * n_features);
                recordings.zip(rows).map(|(wrench, out)| job(wrench, out)).reduce(|| true, |a, b| a && b)
            })
        };
        if finite {
            Ok(())
        } else {
            Err(not_finite(wrench, shape))
        }
    }
}

/// Finds out why the result is not finite: the first bad value, or values too large to filter.
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
