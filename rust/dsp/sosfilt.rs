//! Whole arrays of any rank, filtered along one axis.

use super::{Sos, SosState};
use crate::error::{Error, Result};

/// A C-ordered array seen from one of its axes: `outer` blocks of `len` rows of `inner` neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlongAxis {
    /// Product of the dimensions before the axis.
    pub outer: usize,
    /// Samples along the axis.
    pub len: usize,
    /// Product of the dimensions after the axis.
    pub inner: usize,
}

impl AlongAxis {
    /// The view from `axis` of an array of this shape; `None` when there is no such axis, or no such large array.
    ///
    /// ```
    /// use granular_id::AlongAxis;
    ///
    /// let view = AlongAxis::new(&[62, 1600, 6], 1);
    /// assert_eq!(view, Some(AlongAxis { outer: 62, len: 1600, inner: 6 }));
    /// ```
    #[must_use]
    pub fn new(shape: &[usize], axis: usize) -> Option<Self> {
        let &len = shape.get(axis)?;
        let product =
            |dimensions: &[usize]| dimensions.iter().try_fold(1_usize, |all, &n| all.checked_mul(n));
        Some(Self { outer: product(&shape[..axis])?, len, inner: product(&shape[axis + 1..])? })
    }

    fn check(self, what: &'static str, len: usize, got: usize) -> Result<()> {
        // Saturated, the size cannot be that of a slice.
        let expected = self.outer.saturating_mul(len).saturating_mul(self.inner);
        if got == expected {
            Ok(())
        } else {
            Err(Error::Length { what, expected, got })
        }
    }
}

/// Filters along one axis, in place, from rest.
///
/// # Errors
/// [`Error::Length`] when `x` does not have the size of the view.
pub fn sosfilt(sos: &Sos, x: &mut [f64], along: AlongAxis) -> Result<()> {
    along.check("x", along.len, x.len())?;
    if x.is_empty() {
        return Ok(());
    }
    let mut state = SosState::zero(sos, along.inner)?;
    for block in x.chunks_exact_mut(along.len * along.inner) {
        state.reset();
        state.filter(block)?;
    }
    Ok(())
}

/// Filters along one axis, in place, from the states `z`, and leaves the final states there.
///
/// `z` is a C-ordered array of shape `(sections, outer, 2, inner)`, as `scipy.signal.sosfilt` has it.
///
/// # Errors
/// [`Error::Length`] when `x` or `z` does not have the size that follows from the view.
pub fn sosfilt_from(sos: &Sos, x: &mut [f64], along: AlongAxis, z: &mut [f64]) -> Result<()> {
    along.check("x", along.len, x.len())?;
    along.check("zi", 2 * sos.sections().len(), z.len())?;
    if z.is_empty() {
        return Ok(());
    }
    let pair = 2 * along.inner;
    let mut state = SosState::zero(sos, along.inner)?;
    for index in 0..along.outer {
        // The state of one block is scattered over the sections of `z`.
        let pairs = z.chunks_exact(pair).skip(index).step_by(along.outer);
        for (to, from) in state.values_mut().chunks_exact_mut(pair).zip(pairs) {
            to.copy_from_slice(from);
        }
        let block = along.len * along.inner;
        state.filter(&mut x[index * block..(index + 1) * block])?;
        let pairs = z.chunks_exact_mut(pair).skip(index).step_by(along.outer);
        for (to, from) in pairs.zip(state.values().chunks_exact(pair)) {
            to.copy_from_slice(from);
        }
    }
    Ok(())
}
