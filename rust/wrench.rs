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
}

/// Instants written at a time: those of six axes fill a quarter of the first cache.
const INSTANTS: usize = 1 << 8;

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

/// Puts columns side by side, and tells whether all values are finite.
///
/// `samples[t * columns.len() + axis] = columns[axis][t]`, bit for bit. Writing the columns one after the other
/// would go through all samples once for each; here a few instants at a time stay in the cache until they are done.
///
/// # Errors
///
/// [`Error::Length`] where a column or `samples` has another length than the first column asks for.
///
/// # Examples
///
/// ```
/// let mut samples = [0.0; 4];
/// assert!(granular_id::interleave(&[&[1.0, 2.0], &[3.0, 4.0]], &mut samples)?);
/// assert_eq!(samples, [1.0, 3.0, 2.0, 4.0]);
/// # Ok::<(), granular_id::Error>(())
/// ```
pub fn interleave(columns: &[&[f64]], samples: &mut [f64]) -> Result<bool> {
    let n_axes = columns.len();
    let n_instants = columns.first().map_or(0, |column| column.len());
    let lengths = columns.iter().map(|column| ("columns", n_instants, column.len()));
    for (what, expected, got) in
        lengths.chain([("samples", n_axes.saturating_mul(n_instants), samples.len())])
    {
        if got != expected {
            return Err(Error::Length { what, expected, got });
        }
    }
    if let Ok(columns) = <&[&[f64]; 6]>::try_from(columns) {
        return Ok(interleave_known(columns, samples));
    }
    let mut finite = true;
    for start in (0..n_instants).step_by(INSTANTS) {
        let end = n_instants.min(start + INSTANTS);
        let rows = &mut samples[start * n_axes..end * n_axes];
        for (axis, column) in columns.iter().enumerate() {
            let values = &column[start..end];
            for (row, value) in rows.chunks_exact_mut(n_axes).zip(values) {
                row[axis] = *value;
            }
            // without a branch, which the compiler turns into a few vector instructions
            finite &= values.iter().fold(true, |all, value| all & value.is_finite());
        }
    }
    Ok(finite)
}

/// The same of a number of axes that the compiler knows, in half the time: four instants at a time are a few vectors.
fn interleave_known<const N: usize>(columns: &[&[f64]; N], samples: &mut [f64]) -> bool {
    let (fours, rest) = samples.as_chunks_mut::<N>().0.as_chunks_mut::<4>();
    let n_fours = fours.len();
    let whole: [&[[f64; 4]]; N] = columns.map(|column| &column.as_chunks().0[..n_fours]);
    let mut finite = true;
    for (place, rows) in fours.iter_mut().enumerate() {
        for (axis, column) in whole.iter().enumerate() {
            for (row, value) in rows.iter_mut().zip(column[place]) {
                row[axis] = value;
                finite &= value.is_finite();
            }
        }
    }
    for (instant, row) in rest.iter_mut().enumerate() {
        for (value, column) in row.iter_mut().zip(columns) {
            *value = column[4 * n_fours + instant];
            finite &= value.is_finite();
        }
    }
    finite
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_value_is_where_it_belongs(n_axes in 0_usize..9, n_instants in 0_usize..700, seed in any::<u32>()) {
            let value = |t: usize, axis: usize| f64::from(seed) + (t * 16 + axis) as f64;
            let columns: Vec<Vec<f64>> =
                (0..n_axes).map(|axis| (0..n_instants).map(|t| value(t, axis)).collect()).collect();
            let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let mut samples = vec![f64::NAN; n_axes * n_instants];
            prop_assert!(interleave(&slices, &mut samples)?);
            for (place, found) in samples.iter().enumerate() {
                prop_assert_eq!(*found, value(place / n_axes, place % n_axes));
            }
        }

        #[test]
        fn one_value_that_is_not_finite_is_seen(
            n_axes in prop_oneof![Just(3_usize), Just(6)],
            place in 0_usize..3 * 602,
            bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        ) {
            let mut columns = vec![vec![f64::MAX; 602 * 3 / n_axes]; n_axes];
            columns[place % n_axes][place / n_axes] = bad;
            let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let mut samples = vec![0.0; 3 * 602];
            prop_assert!(!interleave(&slices, &mut samples)?);
            prop_assert_eq!(samples[place].to_bits(), bad.to_bits());
        }
    }

    #[test]
    fn lengths_that_do_not_fit_are_told() {
        let error = |columns: &[&[f64]], room: usize| interleave(columns, &mut vec![0.0; room]).unwrap_err();
        assert_eq!(error(&[&[1.0, 2.0], &[3.0]], 4), Error::Length { what: "columns", expected: 2, got: 1 });
        assert_eq!(error(&[&[1.0, 2.0]], 3), Error::Length { what: "samples", expected: 2, got: 3 });
    }
}
