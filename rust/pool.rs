//! Threads of our own, made when first needed, one set per process.
//!
//! The global pool of rayon belongs to the application; and a process that was forked has none of its parent's
//! threads, so waiting for them would hang. The pool is therefore remembered together with the process id, and
//! a child makes its own.

use std::sync::OnceLock;
#[cfg(feature = "parallel")]
use std::sync::{Arc, Mutex};

#[cfg(feature = "parallel")]
use rayon::{ThreadPool, ThreadPoolBuilder};

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
