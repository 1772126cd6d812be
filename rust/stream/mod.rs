//! Features and answers while samples arrive, equal to those of whole recordings bit for bit.
//!
//! [`StreamingExtractor`] keeps what the filter remembers and a running histogram, [`StreamingIdentifier`] the sums of the
//! scores as well; of a model with multi-band features it keeps the rows. All memory is allocated when a stream is made;
//! pushing rows and reading features or answers allocate nothing, never block and take a bounded time per row or answer.

mod extractor;
#[cfg(feature = "model")]
mod identifier;
#[cfg(feature = "model")]
mod scores;

pub use extractor::StreamingExtractor;
#[cfg(feature = "model")]
pub use identifier::{Standing, StreamingIdentifier};

use crate::error::{Error, Result};
use crate::specs::setters;

/// The largest number of values of a window, 134 MB of samples: with six axes at 500 Hz more than an hour and a half.
pub const MAX_WINDOW: usize = 1 << 24;

/// Which stretches of a stream are windows.
///
/// ```
/// use granular_id::stream::Windows;
///
/// assert_eq!(Windows::default(), Windows::new(1600, 6));
/// assert_eq!(Windows::new(400, 6).with_hop(Some(100)).hop, Some(100));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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
        Self::new(1600, 6)
    }
}

setters! { Windows: with_hop hop Option<usize>, }

impl Windows {
    /// One window of so many samples of so many axes, from the first row on.
    #[must_use]
    pub fn new(n_samples: usize, n_axes: usize) -> Self {
        Self { n_samples, n_axes, hop: None }
    }

    /// Refuses windows that are empty, too large to keep, or never move on.
    fn check(self, n_bins: usize) -> Result<()> {
        let Self { n_samples, n_axes, hop } = self;
        Error::check_range("hop", hop.unwrap_or(1), 1..=usize::MAX)?;
        if n_samples == 0 || n_axes == 0 {
            return Err(Error::Empty { what: "a window", shape: vec![n_samples, n_axes] });
        }
        if n_samples.max(n_bins).saturating_mul(n_axes) > MAX_WINDOW {
            let wanted = format_args!("hold at most {MAX_WINDOW} values");
            let got = format_args!("n_samples = {n_samples} of n_axes = {n_axes} with their bins");
            return Err(Error::argument("a window", wanted, got));
        }
        Ok(())
    }
}

/// How far a stream of windows has come.
#[derive(Clone, Copy, Debug)]
struct Position {
    windows: Windows,
    /// Rows of the window so far.
    n_seen: usize,
    /// Rows to pass over before the next window: a hop longer than a window.
    ahead: usize,
    /// Rows of the stream before the window.
    first_row: u64,
}

impl Position {
    fn new(windows: Windows) -> Self {
        Self { windows, n_seen: 0, ahead: 0, first_row: 0 }
    }

    fn is_complete(&self) -> bool {
        self.n_seen == self.windows.n_samples
    }

    /// The rows that are taken of those given: whole and finite ones, until the window is complete.
    fn taken<'a>(&self, rows: &'a [f64]) -> Result<&'a [f64]> {
        let Windows { n_samples, n_axes, .. } = self.windows;
        let room = self.ahead.saturating_add(n_samples - self.n_seen);
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

    /// Goes on to the next window. Returns how many rows of this one leave; the others are the first of the next.
    fn next_window(&mut self) -> Result<usize> {
        let Windows { n_samples, hop, .. } = self.windows;
        let no_next = |problem| Error::NoNextWindow { problem };
        let one = || no_next("a stream without hop has one window: reset it, or make it with hop".to_owned());
        let hop = hop.ok_or_else(one)?;
        if !self.is_complete() {
            let seen = format!("{} of {n_samples} samples are there", self.n_seen);
            return Err(no_next(format!("the window must be complete before the next one begins: {seen}")));
        }
        let leaving = hop.min(n_samples);
        self.n_seen = n_samples - leaving;
        self.ahead = hop - leaving;
        self.first_row = self.first_row.saturating_add(hop as u64);
        Ok(leaving)
    }
}
