//! Workspaces between two recordings.

use std::sync::Mutex;

use super::workspace::Workspace;
use crate::pool;

/// Workspaces of a design that nobody works in, kept for the recordings to come: fresh memory costs as much as a few of them.
#[derive(Debug, Default)]
pub(super) struct Spare(Mutex<Vec<Workspace>>);

impl Clone for Spare {
    /// A clone makes its own.
    fn clone(&self) -> Self {
        Self::default()
    }
}

// Neither side ever waits: a fork may have copied the lock while another thread of the parent held it.
impl Spare {
    /// One of them, if there is any.
    pub(super) fn take(&self) -> Option<Workspace> {
        self.0.try_lock().ok().and_then(|mut spare| spare.pop())
    }

    /// Keeps one, at most one for each core.
    pub(super) fn keep(&self, work: Workspace) {
        if let Ok(mut spare) = self.0.try_lock() {
            if spare.len() < pool::cores() {
                spare.push(work);
            }
        }
    }
}
