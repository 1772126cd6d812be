//! Samples (all axes of one instant together) from columns (all instants of one axis together).

use crate::{Error, Result};

/// Instants written at a time: those of six axes fill a quarter of the first cache.
const INSTANTS: usize = 1 << 8;

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
            place in 0_usize..3 * 600,
            bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        ) {
            let mut columns = vec![vec![f64::MAX; 600]; 3];
            columns[place % 3][place / 3] = bad;
            let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let mut samples = vec![0.0; 3 * 600];
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
