//! Memory of a size that a caller chooses: where there is none, an error instead of the end of the process.

use crate::error::{Error, Result};

/// Room for `n` values.
pub fn reserved<T>(n: usize) -> Result<Vec<T>> {
    let mut values = Vec::new();
    let no_room = |_| Error::Memory { bytes: n.saturating_mul(size_of::<T>()) };
    values.try_reserve_exact(n).map_err(no_room)?;
    Ok(values)
}

/// `n` times a value.
pub fn filled<T: Clone>(value: T, n: usize) -> Result<Vec<T>> {
    let mut values = reserved(n)?;
    values.resize(n, value);
    Ok(values)
}

/// Values of which the number is known.
pub fn collected<T>(values: impl ExactSizeIterator<Item = T>) -> Result<Vec<T>> {
    let mut all = reserved(values.len())?;
    all.extend(values);
    Ok(all)
}
