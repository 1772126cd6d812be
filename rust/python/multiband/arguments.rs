//! What the constructor is given.

use numpy::{PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::arrays::{owned_real, tuple};
use crate::convert::OrRaise;
use crate::scalars::{shown, word};
use granular_id::bindings::{collected, filled};
use granular_id::multiband::{Block, MultiBandSpec};

/// Names of blocks, in any order.
pub(super) fn blocks_of(value: &Bound<'_, PyAny>, rate_hz: f64) -> PyResult<MultiBandSpec> {
    let mut wanted = Vec::new();
    let wrong = || PyTypeError::new_err(format!("blocks must be a sequence of names, got {}", shown(value)));
    if value.is_instance_of::<PyString>() {
        return Err(wrong());
    }
    for block in value.try_iter().map_err(|_| wrong())? {
        let block = word(&block?, "each of blocks", &Block::NAMED)?;
        if wanted.contains(&block) {
            let message = format!("blocks must name each block once, got '{}' twice", block.name());
            return Err(PyValueError::new_err(message));
        }
        wanted.push(block);
    }
    Ok(MultiBandSpec::of(rate_hz, |block| wanted.contains(&block)))
}

/// Scales of one shape; ones where there are none.
pub(super) fn given_scales(
    value: Option<&Bound<'_, PyAny>>,
    name: &str,
    shape: &[usize],
) -> PyResult<Vec<f64>> {
    let Some(value) = value else {
        return filled(1.0, shape.iter().product()).or_raise();
    };
    let array = owned_real(value, name)?;
    if array.shape() != shape {
        let (wanted, got) = (tuple(shape), tuple(array.shape()));
        return Err(PyValueError::new_err(format!("{name} must have shape {wanted}, got {got}")));
    }
    let array = array.try_readonly()?;
    collected(array.as_slice()?.iter().copied()).or_raise()
}
