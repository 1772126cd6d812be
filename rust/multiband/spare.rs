//! Workspaces between two recordings.

use std::sync::Mutex;

use super::workspace::Workspace;
use crate::pool;

/// The largest number of values of a recording whose workspace is kept: twelve times the paper's, or 40 MB of memory.
/// Longer ones take so much time that fresh memory costs nothing beside it.
const MAX_VALUES: usize = 1 << 16;

/// Workspaces of a design that nobody works in, kept for the recordings to come: to a short recording fresh memory costs as
/// much as its features.
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

    /// Keeps one, at most one for each core and none of long recordings.
    pub(super) fn keep(&self, work: Workspace) {
        if work.shape.0.saturating_mul(work.shape.1) > MAX_VALUES {
            return;
        }
        if let Ok(mut spare) = self.0.try_lock() {
            if spare.len() < pool::cores() {
                spare.push(work);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{n_bands, MultiBand, MultiBandSpec, Scales};
    use super::*;
    use crate::BatchShape;

    fn design(n_samples: usize) -> MultiBand {
        let scales = Scales::unit(n_bands(n_samples), 1).unwrap();
        MultiBand::new(MultiBandSpec::default(), n_samples, 1, &scales).unwrap()
    }

    fn extract(design: &MultiBand, last: f64) -> Option<Vec<f64>> {
        let n_samples = design.n_samples();
        let mut wrench: Vec<f64> = (0..n_samples).map(|t| (0.3 * (t * t) as f64).sin()).collect();
        wrench[n_samples - 1] = last;
        let mut out = vec![0.0; design.n_features()];
        let shape = BatchShape { n_recordings: 1, n_samples, n_axes: 1 };
        design.extract_batch(&wrench, shape, 1, &mut out).ok().map(|()| out)
    }

    #[test]
    fn the_next_batch_works_where_the_last_one_did() {
        let design = design(60);
        assert!(design.spare.take().is_none());
        let first = extract(&design, 0.5);
        assert_eq!(extract(&design, f64::NAN), None);
        assert_eq!(extract(&design, 0.5), first);
        assert!(design.clone().spare.take().is_none());
        assert!(design.spare.take().is_some_and(|work| work.shape == (60, 1)));
    }

    #[test]
    fn memory_of_long_recordings_is_given_back() {
        let design = design(MAX_VALUES + 1);
        assert!(extract(&design, 0.5).is_some());
        assert!(design.spare.take().is_none());
    }
}
