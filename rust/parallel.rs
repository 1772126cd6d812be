//! Batches on several threads, which live as long as the call.
//!
//! Nothing waits for a thread of another call, so a process that was forked works as any other does.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread;

use crate::error::{Error, Result};
use crate::wrench::BatchShape;

/// Recordings in a piece of a batch at most: about 5 MB in and out.
const MAX_RECORDINGS: usize = 32;

/// Cores that this process may use. Found once: the answer takes longer than filtering a recording.
pub fn cores() -> usize {
    static CORES: OnceLock<usize> = OnceLock::new();
    *CORES.get_or_init(|| thread::available_parallelism().map_or(1, Into::into))
}

/// Works through a checked batch in pieces of `granule` recordings or a multiple of it; `task` writes `row_len` numbers for
/// each recording. The error is that of the first recording that has one.
///
/// Threads beyond the number of cores are not used: the work never waits, so more would only cost.
pub(crate) fn in_pieces<T: Send>(
    wrench: &[f64],
    shape: BatchShape,
    (row_len, granule): (usize, usize),
    threads: usize,
    out: &mut [T],
    task: impl Fn(&[f64], BatchShape, &mut [T]) -> Result<()> + Sync,
) -> Result<()> {
    Error::check_range("threads", threads, 1..=usize::MAX)?;
    let expected = shape.n_recordings.saturating_mul(row_len);
    if out.len() != expected {
        return Err(Error::Length { what: "out", expected, got: out.len() });
    }
    let granules = shape.n_recordings.div_ceil(granule);
    let threads = threads.min(cores()).min(granules);
    // Four pieces for each thread, where there are that many: none waits long for the last one.
    let size = granules.div_ceil(4 * threads).min((MAX_RECORDINGS / granule).max(1)) * granule;
    let pieces = wrench.chunks(size * shape.recording_len()).zip(out.chunks_mut(size * row_len)).enumerate();
    let (pieces, first_error) = (Mutex::new(pieces), Mutex::new(None));
    let next = || pieces.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || {
        while let Some((index, (wrench, out))) = next() {
            let part = BatchShape { n_recordings: wrench.len() / shape.recording_len(), ..shape };
            if let Err(error) = task(wrench, part, out) {
                let mut first = first_error.lock().unwrap_or_else(PoisonError::into_inner);
                // All pieces before this one are taken already: the smallest index is the first of all.
                if first.as_ref().is_none_or(|(other, _)| index < *other) {
                    *first = Some((index, error));
                }
                return;
            }
        }
    };
    thread::scope(|scope| {
        for _ in 1..threads {
            // Where the system gives no thread, the others do its work.
            let _ = thread::Builder::new().spawn_scoped(scope, work);
        }
        work();
    });
    match first_error.into_inner().unwrap_or_else(PoisonError::into_inner) {
        None => Ok(()),
        Some((index, error)) => Err(error.after(index * size)),
    }
}
