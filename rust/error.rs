//! Everything that can go wrong with a caller's input.

/// A number for a message. `Display` alone writes 1e300 as a row of 301 digits.
#[doc(hidden)]
#[must_use]
pub fn brief(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1e-6..1e16).contains(&size) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// Characters of a text that a message shows.
const SHOWN: usize = 40;

/// Text from a file in quotes: cut where it is long, control characters and bytes that are no text escaped.
pub(crate) fn shown(cell: &[u8]) -> String {
    let mut text = String::from("'");
    let mut left = SHOWN;
    for chunk in cell.utf8_chunks() {
        for character in chunk.valid().chars().take(left) {
            left -= 1;
            if character.is_ascii_graphic() || character == ' ' {
                text.push(character);
            } else {
                text.extend(character.escape_debug());
            }
        }
        for byte in chunk.invalid().iter().take(left) {
            left -= 1;
            text.extend(byte.escape_ascii().map(char::from));
        }
    }
    text += if left == 0 && characters(cell) > SHOWN { "'..." } else { "'" };
    text
}

fn characters(cell: &[u8]) -> usize {
    cell.utf8_chunks().map(|chunk| chunk.valid().chars().count() + chunk.invalid().len()).sum()
}

/// An input that cannot be used, with the numbers that say why: each is a field of its variant.
///
/// One type for the whole crate, so that design, features and streams pass each other's errors on as they are. What has
/// places or causes of its own, a text, a model file or a sensor, has its own type beside it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A filter order outside 1 to [`MAX_ORDER`](crate::dsp::MAX_ORDER).
    #[error("order must be from 1 to {}, got {order}", crate::dsp::MAX_ORDER)]
    Order {
        /// The order asked for.
        order: usize,
    },
    /// A sampling rate that is not a positive finite number.
    #[error("rate_hz must be positive and finite, got {}", brief(*.rate_hz))]
    Rate {
        /// The rate asked for, in hertz.
        rate_hz: f64,
    },
    /// A critical frequency outside the open interval (0, rate / 2).
    #[error("cutoff_hz must be in (0, rate_hz / 2) = (0, {}), got {} at rate_hz = {}", brief(.rate_hz / 2.0), brief(*.cutoff_hz), brief(*.rate_hz))]
    Cutoff {
        /// The frequency asked for, in hertz.
        cutoff_hz: f64,
        /// The sampling rate, in hertz.
        rate_hz: f64,
    },
    /// Band edges that are equal or reversed.
    #[error("band edges must satisfy low < high, got low = {} and high = {}", brief(*.low_hz), brief(*.high_hz))]
    Band {
        /// The lower edge, in hertz.
        low_hz: f64,
        /// The upper edge, in hertz.
        high_hz: f64,
    },
    /// Second-order sections without a single row.
    #[error("sos must have at least one section, got none")]
    NoSections,
    /// A coefficient that is NaN or infinite.
    #[error("sos[{section}, {column}] must be finite, got {value}")]
    NonFiniteCoefficient {
        /// Row of the coefficient.
        section: usize,
        /// Column of the coefficient, 0 to 5.
        column: usize,
        /// The value found.
        value: f64,
    },
    /// A section whose `a0` is not one.
    #[error("sos[:, 3] (a0) should be all ones, got {} in section {section}", brief(*.a0))]
    LeadingCoefficient {
        /// Row of the section.
        section: usize,
        /// The value found.
        a0: f64,
    },
    /// A section with a pole outside the unit circle: any input would grow without bound.
    #[error(
        "sos must be stable, got section {section} with a pole of radius {} (at most 1 is wanted)",
        brief(*.radius)
    )]
    Unstable {
        /// Row of the section.
        section: usize,
        /// Distance of its outermost pole from the origin.
        radius: f64,
    },
    /// A steady state asked of a section with a pole at `z = 1`.
    #[error("sos must have a finite gain at frequency zero, got section {section} with a pole at z = 1: no steady state")]
    NoSteadyState {
        /// Row of the section.
        section: usize,
    },
    /// A filter whose gain or poles float64 cannot hold.
    #[error("order {order} is too high for so narrow or extreme a band: the gain, {gain:e}, leaves float64")]
    Unrepresentable {
        /// The order asked for.
        order: usize,
        /// The gain, zero or subnormal or not finite.
        gain: f64,
    },
    /// A histogram without bins, or with more than `MAX_BINS`.
    #[error("n_bins must be from 1 to {max}, got {n_bins}")]
    Bins {
        /// The number asked for.
        n_bins: usize,
        /// The largest number allowed.
        max: usize,
    },
    /// A histogram range that is reversed, empty or not finite.
    #[error("bin_range must be finite with low < high, got ({low:?}, {high:?})")]
    BinRange {
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// A range too narrow to hold that many different edges.
    #[error("cannot create {n_bins} finite-sized bins in bin_range ({low:?}, {high:?})")]
    BinWidth {
        /// The number asked for.
        n_bins: usize,
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// Per-axis ranges whose number differs from the number of axes.
    #[error("bin_range must hold one range, or one per axis: got {ranges} ranges for {axes} axes")]
    RangeCount {
        /// Ranges given.
        ranges: usize,
        /// Axes in the data.
        axes: usize,
    },
    /// A feature specification that selects nothing.
    #[error("at least one of raw and hfmh must be true")]
    NoFeatures,
    /// No block of the multi-band features is asked for, or none that such short recordings have.
    #[error(
        "blocks must name at least one block that recordings of {n_samples} samples of {n_axes} axes have"
    )]
    NoBlocks {
        /// Samples of a recording.
        n_samples: usize,
        /// Its axes.
        n_axes: usize,
    },
    /// Recordings of other axes, or of more samples, than features were designed for.
    #[error("recordings must have at most {} samples of {} axes, got {} samples of {}", .wanted.0, .wanted.1, .got.0, .got.1)]
    RecordingShape {
        /// Most samples, and axes.
        wanted: (usize, usize),
        /// Samples and axes given.
        got: (usize, usize),
    },
    /// A scale by which nothing can be divided.
    #[error("{what} must be from 1e-150 to 1e150, got {} for band {band}, axis {axis}", brief(*.value))]
    Scale {
        /// The argument.
        what: &'static str,
        /// Band of the first such scale; 0 for the level.
        band: usize,
        /// Its axis.
        axis: usize,
        /// The value found.
        value: f64,
    },
    /// A recording so much larger than the learned scales that powers would leave float32.
    #[error("wrench is too large for multi-band features: recording {recording} reaches {largest:e}, more than 1e12 times the scale of one of its bands")]
    TooLoud {
        /// The recording.
        recording: usize,
        /// Its largest magnitude.
        largest: f64,
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
        /// The length that the shapes ask for.
        expected: usize,
        /// The length given.
        got: usize,
    },
    /// NaN or infinity where a number is needed.
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
    /// Finite input so large that the filter left the range of float64.
    #[error(
        "wrench is too large to filter: recording {recording} reaches {largest:e} and overflows float64"
    )]
    Overflow {
        /// The recording.
        recording: usize,
        /// Its largest magnitude.
        largest: f64,
    },
    /// NaN or infinity in a table to be written as text.
    #[error("column {column} must be finite, got {value} in row {row}")]
    NonFiniteCell {
        /// Column of the first such value.
        column: usize,
        /// Its row.
        row: usize,
        /// The value found.
        value: f64,
    },
    /// More features than can be addressed, or named.
    #[error("n_samples = {n_samples} and n_axes = {n_axes} ask for too many features")]
    TooLarge {
        /// Samples per recording.
        n_samples: usize,
        /// Axes per sample.
        n_axes: usize,
    },
    /// A feature that float64 holds and float32 does not.
    #[error(
        "features of recording {recording} reach {value:e}, which float32 cannot hold: use dtype float64"
    )]
    Narrow {
        /// The recording.
        recording: usize,
        /// The first such feature.
        value: f64,
    },
    /// A recording with more samples than a histogram can count.
    #[error("a recording may have at most {max} samples, got {n_samples}")]
    Samples {
        /// Samples of the recording.
        n_samples: usize,
        /// The largest number allowed.
        max: usize,
    },
    /// Windows that would never move on.
    #[error("hop must be at least 1 sample, got 0")]
    Hop,
    /// A window too large to keep.
    #[error("a window may hold at most {max} values, got n_samples = {n_samples} of n_axes = {n_axes} with their bins")]
    Window {
        /// Samples per window.
        n_samples: usize,
        /// Axes per sample.
        n_axes: usize,
        /// The largest number of samples times axes, and of axes times bins.
        max: usize,
    },
    /// The next window asked of a stream with only one.
    #[error("a stream without hop has one window: reset it, or make it with hop")]
    NoHop,
    /// The next window asked before this one was complete.
    #[error(
        "the window must be complete before the next one begins: {n_seen} of {n_samples} samples are there"
    )]
    Unfinished {
        /// Samples so far.
        n_seen: usize,
        /// Samples of a window.
        n_samples: usize,
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
    /// A row of a stream that is too large for multi-band features.
    #[error("wrench is too large for multi-band features: {value:e} in row {row}, axis {axis}, is more than 1e12 times the scale of one of its bands; no row was taken")]
    LoudRow {
        /// Row of the first such value, counted from the first one pushed.
        row: usize,
        /// Its axis.
        axis: usize,
        /// The value found.
        value: f64,
    },
    /// Finite rows so large that the filter left the range of float64.
    #[error("wrench is too large to filter: rows that reach {largest:e} overflow float64; no row was taken")]
    FilterOverflow {
        /// The largest magnitude in these rows.
        largest: f64,
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
    /// A device clock slower than the rows, or no clock at all.
    #[cfg(feature = "buffer")]
    #[error("tick_hz must be finite and at least rate_hz = {}, got {}", brief(*.rate_hz), brief(*.tick_hz))]
    TickRate {
        /// The ticks per second asked for.
        tick_hz: f64,
        /// The rate of the rows, in hertz.
        rate_hz: f64,
    },
    /// More waiting rows than a buffer allows.
    #[cfg(feature = "buffer")]
    #[error("reorder_depth must be at most {}, got {reorder_depth}", crate::buffer::MAX_REORDER_DEPTH)]
    ReorderDepth {
        /// The depth asked for.
        reorder_depth: usize,
    },
    /// A buffer of no axes, or of too many.
    #[cfg(feature = "buffer")]
    #[error("n_axes must be from 1 to {}, got {n_axes}", crate::buffer::MAX_AXES)]
    BufferAxes {
        /// The number asked for.
        n_axes: usize,
    },
    /// A buffer of no rows, or of too many.
    #[cfg(feature = "buffer")]
    #[error("seconds must be positive and give at most {} rows, got {} at rate_hz = {}", crate::buffer::MAX_ROWS, brief(*.seconds), brief(*.rate_hz))]
    BufferSize {
        /// The time asked for, in seconds.
        seconds: f64,
        /// The rate of the rows, in hertz.
        rate_hz: f64,
    },
    /// More memory than there is.
    #[error("no memory for {bytes} bytes")]
    Memory {
        /// The memory asked for.
        bytes: usize,
    },
    /// A vector unit that nobody knows, or that this machine lacks.
    #[error("GRANULAR_ID_SIMD must be one of the vector units of this machine ({}), or not set, got {asked:?}", .available.join(", "))]
    VectorUnit {
        /// The name asked for.
        asked: String,
        /// The names that this machine knows.
        available: Vec<&'static str>,
    },
    /// A number of threads that is zero.
    #[error("threads must be at least 1, got {threads}")]
    Threads {
        /// The number asked for.
        threads: usize,
    },
}

impl Error {
    /// The same error in a batch that begins `recordings` earlier.
    #[doc(hidden)]
    #[must_use]
    pub fn later(mut self, recordings: usize) -> Self {
        if let Self::NonFinite { recording, .. }
        | Self::Overflow { recording, .. }
        | Self::TooLoud { recording, .. }
        | Self::Narrow { recording, .. }
        | Self::Score { recording, .. } = &mut self
        {
            *recording += recordings;
        }
        self
    }
}

/// Result of an operation on a caller's input.
pub type Result<T> = std::result::Result<T, Error>;

#[cfg(test)]
mod tests {
    use super::{brief, shown, Error};

    #[test]
    fn numbers_are_written_as_they_are_unless_that_is_a_row_of_digits() {
        for (value, text) in [
            (0.0, "0"),
            (500.0, "500"),
            (-0.25, "-0.25"),
            (1e15, "1000000000000000"),
            (1e300, "1e300"),
            (-1.5e300, "-1.5e300"),
            (2e-300, "2e-300"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(brief(value), text);
        }
        let error = Error::Cutoff { cutoff_hz: f64::MAX, rate_hz: f64::MIN_POSITIVE };
        assert!(error.to_string().len() < 160, "{error}");
    }

    #[test]
    fn long_texts_are_cut() {
        let forty = [b'x'; 40];
        assert_eq!(shown(&forty), format!("'{}'", "x".repeat(40)));
        assert_eq!(shown(&[b'x'; 41]), format!("'{}'...", "x".repeat(40)));
        assert_eq!(shown(&[0xff; 41]), format!("'{}'...", "\\xff".repeat(40)));
        assert_eq!(shown("é".repeat(50).as_bytes()), format!("'{}'...", "é".repeat(40)));
    }
}
