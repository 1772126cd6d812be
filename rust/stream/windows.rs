//! Which stretches of a stream are windows, and which rows they take.

use crate::error::{Error, Result};

/// The largest number of values of a window, 134 MB of samples: with six axes at 500 Hz more than an hour and a half.
pub const MAX_WINDOW: usize = 1 << 24;

/// Which stretches of a stream are windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Samples per window.
    pub n_samples: usize,
    /// Axes per sample.
    pub n_axes: usize,
    /// Samples from the start of a window to that of the next; `None` for one window from the first row on.
    pub hop: Option<usize>,
}

impl Default for Windows {
    /// One recording of the paper: 1600 samples of six axes.
    fn default() -> Self {
        Self { n_samples: 1600, n_axes: 6, hop: None }
    }
}

impl Windows {
    /// Refuses windows that are empty, too large to keep, or never move on.
    pub(super) fn check(self, n_bins: usize) -> Result<()> {
        let Self { n_samples, n_axes, hop } = self;
        if hop == Some(0) {
            return Err(Error::Hop);
        }
        if n_samples == 0 || n_axes == 0 {
            return Err(Error::Empty { what: "a window", shape: vec![n_samples, n_axes] });
        }
        if n_samples.max(n_bins).saturating_mul(n_axes) > MAX_WINDOW {
            return Err(Error::Window { n_samples, n_axes, max: MAX_WINDOW });
        }
        Ok(())
    }

    /// The rows that are taken where there is room for so many: whole and finite ones.
    pub(super) fn taken(self, rows: &[f64], room: usize) -> Result<&[f64]> {
        let n_axes = self.n_axes;
        let n_rows = rows.len() / n_axes;
        if n_rows * n_axes != rows.len() {
            return Err(Error::Length { what: "wrench", expected: n_rows * n_axes, got: rows.len() });
        }
        let rows = &rows[..n_rows.min(room) * n_axes];
        match rows.iter().position(|value| !value.is_finite()) {
            None => Ok(rows),
            Some(index) => {
                Err(Error::NonFiniteRow { row: index / n_axes, axis: index % n_axes, value: rows[index] })
            }
        }
    }
}
