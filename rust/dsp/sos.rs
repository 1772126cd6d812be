//! Second-order sections: checked, immutable coefficients.

use std::sync::Arc;

use crate::error::{short_number, Error, Result};
use crate::memory::reserved;

/// How far a coefficient may lie beyond the edge of stability and still count as rounding of an integrator.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// One biquad `(b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Section {
    /// Numerator, of the sample itself.
    pub b0: f64,
    /// Numerator, of the sample before.
    pub b1: f64,
    /// Numerator, of the sample before that.
    pub b2: f64,
    /// Denominator, of the result before.
    pub a1: f64,
    /// Denominator, of the result before that.
    pub a2: f64,
}

impl Section {
    /// The row `[b0, b1, b2, a0, a1, a2]`, with `a0 = 1`.
    #[must_use]
    pub const fn row(&self) -> [f64; 6] {
        [self.b0, self.b1, self.b2, 1.0, self.a1, self.a2]
    }

    /// Distance from the origin to the pole farthest from it.
    fn pole_radius(&self) -> f64 {
        let (half, root) = (0.5 * self.a1.abs(), self.a2.abs().sqrt());
        if self.a2 <= 0.0 {
            half + libm::hypot(half, root)
        } else if root > half {
            root
        } else {
            // sqrt(a1^2 / 4 - a2) without squares, which may overflow.
            half + (half - root).sqrt() * (half + root).sqrt()
        }
    }

    /// A pole outside the unit circle by more than the rounding of its coefficients.
    ///
    /// A section whose numerator equals its denominator passes every sample through unchanged, whatever its poles.
    #[allow(clippy::float_cmp)] // equal to the last bit, or the poles do not cancel
    fn is_unstable(&self) -> bool {
        let cancels = self.b0 == 1.0 && self.b1 == self.a1 && self.b2 == self.a2;
        let beyond = (self.a2 - 1.0).max(self.a1.abs() - (1.0 + self.a2));
        beyond > ROUNDING && !cancels
    }

    /// State in which a constant input of 1 gives a constant output; `None` with a pole at `z = 1`.
    ///
    /// The linear system is solved by elimination with row exchange, in the order in which a general solver does it.
    fn steady_state(&self) -> Option<[f64; 2]> {
        let (c0, c1) = (self.b1 - self.a1 * self.b0, self.b2 - self.a2 * self.b0);
        // [1 + a1, -1; a2, 1] z = [c0; c1]
        let first = 1.0 + self.a1;
        let z = if self.a2.abs() > first.abs() {
            let factor = first * (1.0 / self.a2);
            let z1 = (c0 - factor * c1) / (-1.0 - factor);
            [(c1 - z1) / self.a2, z1]
        } else {
            let factor = self.a2 * (1.0 / first);
            let z1 = (c1 - factor * c0) / (1.0 + factor);
            [(c0 + z1) / first, z1]
        };
        z.iter().all(|v| v.is_finite()).then_some(z)
    }

    /// Gain at frequency zero.
    fn dc_gain(&self) -> f64 {
        (self.b0 + self.b1 + self.b2) / (1.0 + self.a1 + self.a2)
    }
}

/// A cascade of second-order sections. Never changes, and a clone shares the coefficients; what a stream remembers lives
/// in [`SosState`](crate::SosState).
///
/// ```
/// use granular_id::Sos;
///
/// let smooth = Sos::new(&[[0.5, 0.0, 0.0, 1.0, -0.5, 0.0]])?;
/// assert_eq!(smooth.steady_state()?, [[0.5, 0.0]]);
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Sos {
    sections: Arc<Vec<Section>>,
}

impl Sos {
    /// No section: signals pass unchanged.
    pub(crate) fn none() -> Self {
        Self { sections: Arc::default() }
    }

    /// Checks rows `[b0, b1, b2, a0, a1, a2]` as `scipy.signal` writes them.
    ///
    /// # Errors
    /// [`Error::Argument`] for no row at all, a coefficient that is not finite, an `a0` that is not 1, and a pole outside
    /// the unit circle, so that any input would grow without bound. A pole on the circle (an integrator, to within rounding)
    /// is allowed, and so is a pole that a section's own zeros cancel exactly.
    pub fn new(rows: &[[f64; 6]]) -> Result<Self> {
        if rows.is_empty() {
            return Err(Error::argument("sos", "have at least one section", "none"));
        }
        let mut sections = reserved(rows.len())?;
        for (index, row) in rows.iter().enumerate() {
            if let Some(column) = row.iter().position(|v| !v.is_finite()) {
                let value = row[column];
                return Err(Error::argument(
                    "sos",
                    "be finite",
                    format_args!("{value} at [{index}, {column}]"),
                ));
            }
            let [b0, b1, b2, a0, a1, a2] = *row;
            #[allow(clippy::float_cmp)] // the convention is an exact one
            if a0 != 1.0 {
                let got = format_args!("{} in section {index}", short_number(a0));
                return Err(Error::argument("sos[:, 3] (a0)", "be all ones", got));
            }
            let section = Section { b0, b1, b2, a1, a2 };
            if section.is_unstable() {
                let radius = short_number(section.pole_radius());
                let got =
                    format_args!("section {index} with a pole of radius {radius} (at most 1 is wanted)");
                return Err(Error::argument("sos", "be stable", got));
            }
            sections.push(section);
        }
        Ok(Self { sections: Arc::new(sections) })
    }

    /// The sections, in the order in which a sample passes through them.
    #[must_use]
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// The state `[z0, z1]` of each section under a constant input of 1 that has lasted forever.
    ///
    /// Starting from this state, scaled by the first sample, an offset in the signal makes no transient
    /// (`scipy.signal.sosfilt_zi`).
    ///
    /// # Errors
    /// [`Error::Argument`] when a section has a pole at `z = 1`: its output grows for as long as the input lasts.
    pub fn steady_state(&self) -> Result<Vec<[f64; 2]>> {
        let mut scale = 1.0;
        let mut states = reserved(self.sections.len())?;
        for (index, section) in self.sections.iter().enumerate() {
            let no_state = || {
                let got = format_args!("section {index} with a pole at z = 1: no steady state");
                Error::argument("sos", "have a finite gain at frequency zero", got)
            };
            let [z0, z1] = section.steady_state().ok_or_else(no_state)?;
            states.push([scale * z0, scale * z1]);
            scale *= section.dc_gain();
            if !scale.is_finite() {
                return Err(no_state());
            }
        }
        Ok(states)
    }
}

#[cfg(test)]
mod tests {
    use super::Sos;

    const SMOOTH: [f64; 6] = [0.5, 0.0, 0.0, 1.0, -0.5, 0.0];

    #[test]
    fn poles_outside_the_unit_circle_are_refused_with_section_and_radius() {
        for (a1, a2, expected) in [(-1.5, 0.0, 1.5), (0.0, 1.21, 1.1), (3.0, 2.0, 2.0), (0.0, -4.0, 2.0)] {
            let message = Sos::new(&[SMOOTH, [1.0, 0.0, 0.0, 1.0, a1, a2]]).unwrap_err().to_string();
            let (_, radius) = message.split_once("got section 1 with a pole of radius ").unwrap();
            let radius: f64 = radius.split(' ').next().unwrap().parse().unwrap();
            assert!((radius - expected).abs() < 1e-14, "{message}");
        }
        for huge in [f64::MAX, -f64::MAX] {
            for a2 in [0.0, huge] {
                assert!(Sos::new(&[[1.0, 0.0, 0.0, 1.0, huge, a2]]).is_err());
            }
        }
    }

    #[test]
    fn integrators_and_exact_cancellation_are_allowed() {
        let rounding = 1.0 + f64::EPSILON;
        for row in [
            [1.0, 0.0, 0.0, 1.0, -1.0, 0.0],
            [1.0, 0.0, 0.0, 1.0, -2.0, 1.0],
            [1.0, 0.0, 0.0, 1.0, 0.0, rounding],
            [1.0, 2.0, 3.0, 1.0, 2.0, 3.0],
        ] {
            assert!(Sos::new(&[row]).is_ok(), "{row:?}");
        }
    }

    #[test]
    fn a_pole_at_one_has_no_steady_state() {
        let sos = Sos::new(&[SMOOTH, [1.0, 0.0, 0.0, 1.0, -1.0, 0.0]]).unwrap();
        let refused = |sos: &Sos| sos.steady_state().unwrap_err().to_string();
        assert!(refused(&sos).contains("got section 1 with a pole at z = 1"));
        let differentiated = Sos::new(&[[1.0, -1.0, 0.0, 1.0, -1.0, 0.0]]).unwrap();
        assert!(refused(&differentiated).contains("got section 0 with a pole at z = 1"));
    }
}
