//! Axis order, units, sample flags and layout of a wrench: the one place where they are listed.

use crate::error::{Error, Result};

/// Names of the six axes in storage order: forces, then torques.
pub const AXES: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];

/// Units of the six axes, in the order of [`AXES`].
pub const UNITS: [&str; 6] = ["N", "N", "N", "N m", "N m", "N m"];

/// Bit of a sample's flags: interpolated inside a gap, no measurement was taken near this instant.
pub const GAP_FILLED: u8 = 1;
/// Bit of a sample's flags: at least one axis was at the end of the sensor's range.
pub const SATURATED: u8 = 2;
/// Bit of a sample's flags: the sensor reported an error with this sample.
pub const BAD_STATUS: u8 = 4;
/// Bit of a sample's flags: the time stamp ran backwards or was repeated, and the sample was sorted or merged.
pub const TIME_REPAIRED: u8 = 8;

/// The bits of a sample's flags by name: the one place where they are listed.
pub const SAMPLE_FLAGS: [(&str, u8); 4] = [
    ("GAP_FILLED", GAP_FILLED),
    ("SATURATED", SATURATED),
    ("BAD_STATUS", BAD_STATUS),
    ("TIME_REPAIRED", TIME_REPAIRED),
];

/// All bits of [`SAMPLE_FLAGS`] together.
pub const KNOWN_FLAGS: u8 = GAP_FILLED | SATURATED | BAD_STATUS | TIME_REPAIRED;

/// Size of a batch of recordings: `values[(recording * n_samples + sample) * n_axes + axis]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchShape {
    /// Recordings.
    pub n_recordings: usize,
    /// Samples per recording.
    pub n_samples: usize,
    /// Axes per sample.
    pub n_axes: usize,
}

impl BatchShape {
    /// Values of one recording; the largest number where there are more.
    #[must_use]
    pub fn recording_len(&self) -> usize {
        self.n_samples.saturating_mul(self.n_axes)
    }

    /// Refuses a batch that is empty, or of another number of values.
    pub(crate) fn check(&self, len: usize) -> Result<()> {
        let &Self { n_recordings, n_samples, n_axes } = self;
        if n_recordings == 0 || n_samples == 0 || n_axes == 0 {
            return Err(Error::Empty { what: "wrench", shape: vec![n_recordings, n_samples, n_axes] });
        }
        let expected = n_recordings.saturating_mul(self.recording_len());
        if len != expected {
            return Err(Error::Length { what: "wrench", expected, got: len });
        }
        Ok(())
    }
}

/// Name of axis `axis` of a recording with `n_axes` axes.
///
/// A full wrench has the names of [`AXES`]; any other number of axes is numbered.
///
/// ```
/// assert_eq!(granular_id::wrench::axis_name(2, 6), "fz");
/// assert_eq!(granular_id::wrench::axis_name(2, 3), "axis2");
/// ```
#[must_use]
pub fn axis_name(axis: usize, n_axes: usize) -> String {
    if n_axes == AXES.len() && axis < AXES.len() {
        AXES[axis].to_owned()
    } else {
        format!("axis{axis}")
    }
}
