//! From counts to newton and newton metre.

use super::Fault;

/// Counts per newton that a sensor can have: with fewer, its steps would be coarser than a newton; with more, 32 bits
/// would end at 2 N.
pub const COUNTS_PER_NEWTON: (f64, f64) = (1.0, 1e9);

/// Counts per newton metre: likewise, for lever arms of a millimetre and more.
pub const COUNTS_PER_NEWTON_METRE: (f64, f64) = (1.0, 1e12);

/// Counts per newton and per newton metre, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    counts_per_newton: f64,
    counts_per_newton_metre: f64,
}

impl Scale {
    /// A scale, unless it is one that no sensor has.
    pub fn new(counts_per_newton: f64, counts_per_newton_metre: f64) -> Result<Self, Fault> {
        checked("counts_per_newton", counts_per_newton, COUNTS_PER_NEWTON)?;
        checked("counts_per_newton_metre", counts_per_newton_metre, COUNTS_PER_NEWTON_METRE)?;
        Ok(Self { counts_per_newton, counts_per_newton_metre })
    }

    /// Forces in N and torques in N m; each is one division, rounded once.
    ///
    /// ```
    /// # fn main() -> Result<(), granular_id::rdt::Fault> {
    /// let scale = granular_id::rdt::Scale::new(1e6, 1e6)?;
    /// assert_eq!(scale.wrench([1_500_000, 0, -1, 250_000, 0, 0]), [1.5, 0.0, -1e-6, 0.25, 0.0, 0.0]);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn wrench(&self, counts: [i32; 6]) -> [f64; 6] {
        let [fx, fy, fz, tx, ty, tz] = counts.map(f64::from);
        let (force, torque) = (self.counts_per_newton, self.counts_per_newton_metre);
        [fx / force, fy / force, fz / force, tx / torque, ty / torque, tz / torque]
    }
}

fn checked(what: &'static str, value: f64, (least, most): (f64, f64)) -> Result<(), Fault> {
    // Written so that NaN is refused.
    if value >= least && value <= most {
        Ok(())
    } else {
        Err(Fault::Scale { what, value, least, most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_scales_are_refused() {
        for value in [0.0, -1e6, f64::NAN, f64::INFINITY, 0.999, 1.001e9] {
            assert!(matches!(Scale::new(value, 1e6), Err(Fault::Scale { what: "counts_per_newton", .. })));
        }
        for value in [0.0, -1e6, f64::NAN, f64::INFINITY, 0.999, 1.001e12] {
            let fault = Scale::new(1e6, value);
            assert!(matches!(fault, Err(Fault::Scale { what: "counts_per_newton_metre", .. })));
        }
        assert!(Scale::new(1.0, 1.0).is_ok() && Scale::new(1e9, 1e12).is_ok());
    }
}
