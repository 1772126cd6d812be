//! Threads of our own, made when first needed, one set per process.
//!
//! The global pool of rayon belongs to the application; and a process that was forked has none of its parent's
//! threads, so waiting for them would hang. The pool is therefore remembered together with the process id, and
//! a child makes its own.

use std::sync::OnceLock;
#[cfg(feature = "parallel")]
use std::sync::{Arc, Mutex};

#[cfg(feature = "parallel")]
use rayon::{prelude::*, ThreadPool, ThreadPoolBuilder};

use crate::batch_kernel::team_size;
use crate::error::{Error, Result};
use crate::features::BatchShape;

/// Recordings per task at most: about 5 MB in and out, small enough to balance, large enough to stay cheap.
const TASK_RECORDINGS: usize = 32;

/// The pool of one process.
#[cfg(feature = "parallel")]
struct Owned {
    process: u32,
    threads: usize,
    pool: Arc<ThreadPool>,
}

/// Cores that this process may use. Asked once: the answer takes longer than filtering a recording.
pub fn cores() -> usize {
    static CORES: OnceLock<usize> = OnceLock::new();
    *CORES.get_or_init(|| std::thread::available_parallelism().map_or(1, Into::into))
}

#[cfg(feature = "parallel")]
static CURRENT: Mutex<Option<Owned>> = Mutex::new(None);

/// A pool of `threads`, but of no more than the machine has cores: the work never waits, so more would only cost. `None`
/// for one thread, and where the system gives no threads: the caller then works alone.
#[cfg(feature = "parallel")]
pub(crate) fn of(threads: usize) -> Option<Arc<ThreadPool>> {
    let threads = threads.min(cores());
    if threads <= 1 {
        return None;
    }
    // Never waits: a fork may have copied the lock while another thread of the parent held it.
    let Ok(mut current) = CURRENT.try_lock() else { return build(threads) };
    let process = std::process::id();
    if let Some(owned) = current.as_ref() {
        if owned.process == process && owned.threads == threads {
            return Some(Arc::clone(&owned.pool));
        }
    }
    let pool = build(threads)?;
    let replaced = current.replace(Owned { process, threads, pool: Arc::clone(&pool) });
    if let Some(owned) = replaced.filter(|owned| owned.process != process) {
        // The parent's threads do not exist here, and their locks may have been held when the process was forked:
        // dropping the pool would take them.
        std::mem::forget(owned);
    }
    Some(pool)
}

#[cfg(feature = "parallel")]
fn build(threads: usize) -> Option<Arc<ThreadPool>> {
    let name = |index| format!("granular-id-{index}");
    ThreadPoolBuilder::new().num_threads(threads).thread_name(name).build().ok().map(Arc::new)
}

/// Without the feature `parallel` every caller works alone.
#[cfg(not(feature = "parallel"))]
pub(crate) fn of(_threads: usize) -> Option<std::convert::Infallible> {
    None
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
    match of(threads).filter(|_| teams > 1) {
        None => wrench.chunks(recordings).zip(out.chunks_mut(rows)).enumerate().try_for_each(one),
        #[cfg(feature = "parallel")]
        Some(pool) => {
            let tasks = wrench.par_chunks(recordings).zip(out.par_chunks_mut(rows)).enumerate().map(one);
            let errors: Vec<_> = pool.install(|| tasks.filter_map(Result::err).collect());
            errors.into_iter().next().map_or(Ok(()), Err)
        }
    }
}
