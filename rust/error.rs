//! Everything that can go wrong with a caller's input: the messages.
//!
//! A limit is a constant `MAX_...` at the head of the file that checks it; its message is the variant of [`Error`] that the
//! check gives, most often [`Error::Range`] or [`Error::Argument`]. Model files, sensors and windows of a buffer have errors
//! of their own: `model/error.rs`, `rdt/mod.rs`, `buffer/reader.rs`.

use std::fmt::Display;
use std::ops::RangeInclusive;

/// A number for a message. `Display` alone writes 1e300 as a row of 301 digits.
#[doc(hidden)]
#[must_use]
pub fn short_number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1e-6..1e16).contains(&size) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// Characters of a text that a message shows.
const MAX_QUOTED: usize = 40;

/// Text from a file in quotes: cut where it is long, control characters escaped.
pub(crate) fn quoted(text: &str) -> String {
    let cut = text.char_indices().nth(MAX_QUOTED).map_or(text.len(), |(end, _)| end);
    let shown = text[..cut].escape_debug();
    format!("'{shown}'{}", if cut < text.len() { "..." } else { "" })
}

/// An input that cannot be used, with the numbers that show why.
///
/// One type for the whole crate, so that design, features and streams pass each other's errors on as they are. What has
/// places or causes of its own, a model file or a sensor, has its own type beside it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument of a value that nothing can be done with.
    #[error("{what} must {wanted}, got {got}")]
    Argument {
        /// The argument.
        what: &'static str,
        /// What it must be, or have.
        wanted: String,
        /// What came.
        got: String,
    },
    /// A number of things outside its range.
    #[error("{what} must be {}, got {got}", range(*.min, *.max))]
    Range {
        /// The argument.
        what: &'static str,
        /// The number given.
        got: usize,
        /// The smallest number allowed.
        min: usize,
        /// The largest number allowed; `usize::MAX` where there is no limit.
        max: usize,
    },
    /// An array with an empty dimension.
    #[error("{what} must not be empty, got shape {shape:?}")]
    Empty {
        /// The argument.
        what: &'static str,
        /// Its shape.
        shape: Vec<usize>,
    },
    /// A buffer whose length does not follow from the shapes.
    #[error("{what} must hold {expected} values, got {got}")]
    Length {
        /// The argument.
        what: &'static str,
        /// The length that the shapes give.
        expected: usize,
        /// The length given.
        got: usize,
    },
    /// NaN or infinity in a recording.
    #[error("wrench must be finite, got {value} at recording {recording}, sample {sample}, axis {axis}")]
    NonFinite {
        /// Recording of the first such value.
        recording: usize,
        /// Its sample.
        sample: usize,
        /// Its axis.
        axis: usize,
        /// The value found.
        value: f64,
    },
    /// NaN or infinity in a row of a stream.
    #[error("wrench must be finite, got {value} in row {row}, axis {axis}; no row was taken")]
    NonFiniteRow {
        /// Row of the first such value, counted from the first one pushed.
        row: usize,
        /// Its axis.
        axis: usize,
        /// The value found.
        value: f64,
    },
    /// A finite recording so large that its features would leave the range of their numbers.
    #[error("wrench is too large: recording {recording} reaches {largest:e}, {limit}")]
    TooLarge {
        /// The recording.
        recording: usize,
        /// Its largest magnitude.
        largest: f64,
        /// What it exceeds.
        limit: &'static str,
    },
    /// A finite row of a stream so large that features would leave the range of their numbers.
    #[error("wrench is too large: {value:e} in row {row}, axis {axis}, {limit}; no row was taken")]
    TooLargeRow {
        /// The row, counted from the first one pushed.
        row: usize,
        /// Its axis.
        axis: usize,
        /// The value found.
        value: f64,
        /// What it exceeds.
        limit: &'static str,
    },
    /// A score of a learner that float64 cannot hold.
    #[error("score of learner {learner} of recording {recording} must be finite, got {value}: the wrench or the weights are too large")]
    Score {
        /// The recording.
        recording: usize,
        /// The learner.
        learner: usize,
        /// The value found.
        value: f64,
    },
    /// A stream that has no next window, or not yet.
    #[error("{problem}")]
    NoNextWindow {
        /// Why.
        problem: String,
    },
    /// More memory than there is.
    #[error("no memory for {bytes} bytes")]
    Memory {
        /// The size that was refused.
        bytes: usize,
    },
}

fn range(min: usize, max: usize) -> String {
    match max {
        usize::MAX => format!("at least {min}"),
        _ => format!("from {min} to {max}"),
    }
}

impl Error {
    /// An argument that `must` be or have something else.
    pub(crate) fn argument(what: &'static str, wanted: impl Display, got: impl Display) -> Self {
        Self::Argument { what, wanted: wanted.to_string(), got: got.to_string() }
    }

    /// Refuses a number of things outside its range.
    pub(crate) fn check_range(what: &'static str, got: usize, range: RangeInclusive<usize>) -> Result<()> {
        if range.contains(&got) {
            return Ok(());
        }
        Err(Self::Range { what, got, min: *range.start(), max: *range.end() })
    }

    /// Refuses a rate that is not positive and finite.
    pub(crate) fn check_rate(rate_hz: f64) -> Result<()> {
        if rate_hz.is_finite() && rate_hz > 0.0 {
            return Ok(());
        }
        Err(Self::argument("rate_hz", "be positive and finite", short_number(rate_hz)))
    }

    /// The same error in a batch that begins `recordings` earlier.
    #[must_use]
    pub(crate) fn after(mut self, recordings: usize) -> Self {
        if let Self::NonFinite { recording, .. }
        | Self::TooLarge { recording, .. }
        | Self::Score { recording, .. } = &mut self
        {
            *recording += recordings;
        }
        self
    }
}

/// Result of an operation on a caller's input.
pub type Result<T> = std::result::Result<T, Error>;
