//! Whole arrays of any rank, filtered along one axis: once, or forward and backward.

use super::{Sos, SosState};
use crate::error::{Error, Result};
use crate::memory::filled;

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
    for block in blocks(x, along) {
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

/// How a signal is continued beyond its ends before it is filtered in both directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Padding {
    /// Not at all.
    None,
    /// Turned by half a turn about the end point: keeps value and slope.
    Odd,
    /// Mirrored at the end point.
    Even,
    /// The end point, repeated.
    Constant,
}

/// Samples of padding at each end that suit a filter: three times its length.
///
/// Sections of first order, whose last coefficients are zero, are not counted twice.
#[must_use]
pub fn default_padlen(sos: &Sos) -> usize {
    let sections = sos.sections();
    let count = |zero: &dyn Fn(usize) -> bool| (0..sections.len()).filter(|&i| zero(i)).count();
    let first_order = count(&|i| sections[i].b2 == 0.0).min(count(&|i| sections[i].a2 == 0.0));
    3 * (2 * sections.len() + 1 - first_order)
}

/// Filters along one axis forward and then backward, in place: twice the attenuation and no phase shift.
///
/// Each pass starts in the steady state of its first sample. `padlen` is the number of samples that are added at each
/// end beforehand and dropped afterwards.
///
/// # Errors
/// [`Error::Length`] when `x` does not have the size of the view; [`Error::Padding`] when the axis is not longer than
/// `padlen`; [`Error::NoSteadyState`] when a section has a pole at `z = 1`.
pub fn sosfiltfilt(
    sos: &Sos,
    x: &mut [f64],
    along: AlongAxis,
    padding: Padding,
    padlen: usize,
) -> Result<()> {
    along.check("x", along.len, x.len())?;
    let padlen = if padding == Padding::None { 0 } else { padlen };
    if along.len <= padlen {
        return Err(Error::Padding { len: along.len, padlen });
    }
    let steady = sos.steady_state()?;
    if x.is_empty() {
        return Ok(());
    }
    let inner = along.inner;
    let mut state = SosState::zero(sos, inner)?;
    let mut longer = filled(0.0, (along.len + 2 * padlen) * inner)?;
    for block in blocks(x, along) {
        extend(block, &mut longer, inner, padding, padlen);
        for _ in 0..2 {
            state.settle(&steady, &longer[..inner]);
            state.filter(&mut longer)?;
            reverse_rows(&mut longer, inner);
        }
        block.copy_from_slice(&longer[padlen * inner..][..block.len()]);
    }
    Ok(())
}

/// The blocks of an array that is not empty.
fn blocks(x: &mut [f64], along: AlongAxis) -> impl Iterator<Item = &mut [f64]> {
    x.chunks_exact_mut(along.len * along.inner)
}

/// Copies a block of rows into the middle of `longer` and continues it at both ends.
fn extend(block: &[f64], longer: &mut [f64], inner: usize, padding: Padding, padlen: usize) {
    let len = block.len() / inner;
    let row = |i: usize| &block[i * inner..(i + 1) * inner];
    longer[padlen * inner..][..block.len()].copy_from_slice(block);
    for i in 1..=padlen {
        for (end, mirrored, at) in [(0, i, padlen - i), (len - 1, len - 1 - i, padlen + len - 1 + i)] {
            let target = &mut longer[at * inner..(at + 1) * inner];
            match padding {
                Padding::None => {}
                Padding::Even => target.copy_from_slice(row(mirrored)),
                Padding::Constant => target.copy_from_slice(row(end)),
                Padding::Odd => {
                    for ((target, end), mirrored) in target.iter_mut().zip(row(end)).zip(row(mirrored)) {
                        *target = 2.0 * end - mirrored;
                    }
                }
            }
        }
    }
}

fn reverse_rows(rows: &mut [f64], inner: usize) {
    let (mut low, mut high) = (0, rows.len() / inner);
    while low + 1 < high {
        high -= 1;
        let (head, tail) = rows.split_at_mut(high * inner);
        head[low * inner..(low + 1) * inner].swap_with_slice(&mut tail[..inner]);
        low += 1;
    }
}
