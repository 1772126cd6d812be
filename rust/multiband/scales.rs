//! Typical sizes, by which signals are divided.

use super::bands::n_bands;
use crate::error::{Error, Result};
use crate::memory::filled;

/// Typical size of each band and of the level, learned from training recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Typical root mean square of each band and axis, band-major: `bands[band * n_axes + axis]`.
    pub bands: Vec<f64>,
    /// Typical magnitude of the mean over a stretch of time, axis by axis.
    pub level: Vec<f64>,
}

impl Scales {
    /// One everywhere.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn unit(n_bands: usize, n_axes: usize) -> Result<Self> {
        Ok(Self { bands: filled(1.0, n_bands.saturating_mul(n_axes))?, level: filled(1.0, n_axes)? })
    }

    /// Refuses a wrong number of scales, and scales that are not positive.
    pub(super) fn check(&self, n_samples: usize, n_axes: usize) -> Result<()> {
        let bands = n_bands(n_samples).saturating_mul(n_axes);
        for (what, expected, scales) in
            [("scales", bands, &self.bands), ("level_scales", n_axes, &self.level)]
        {
            if scales.len() != expected {
                return Err(Error::Length { what, expected, got: scales.len() });
            }
            // Half of the exponents of float64: a quotient by such a scale, and its square, stay within its range.
            if let Some(index) = scales.iter().position(|scale| !(*scale >= 1e-150 && *scale <= 1e150)) {
                return Err(Error::Scale {
                    what,
                    band: index / n_axes,
                    axis: index % n_axes,
                    value: scales[index],
                });
            }
        }
        Ok(())
    }
}
