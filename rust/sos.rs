//! Second-order sections: immutable coefficients, and what a stream remembers.

use crate::error::{Error, Result};

/// One biquad `(b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)]
pub struct Section {
    pub b0: f64,
    pub b1: f64,
    pub b2: f64,
    pub a1: f64,
    pub a2: f64,
}

/// A cascade of second-order sections. Never changes; state lives in [`SosState`].
#[derive(Clone, Debug, PartialEq)]
pub struct Sos {
    sections: Vec<Section>,
}

impl Sos {
    /// Checks rows `[b0, b1, b2, a0, a1, a2]` as `scipy.signal` writes them.
    pub fn new(rows: &[[f64; 6]]) -> Result<Self> {
        if rows.is_empty() {
            return Err(Error::NoSections);
        }
        let mut sections = Vec::with_capacity(rows.len());
        for (section, row) in rows.iter().enumerate() {
            if let Some(column) = row.iter().position(|v| !v.is_finite()) {
                let value = row[column];
                return Err(Error::NonFiniteCoefficient { section, column, value });
            }
            let [b0, b1, b2, a0, a1, a2] = *row;
            #[allow(clippy::float_cmp)] // the convention is an exact one
            if a0 != 1.0 {
                return Err(Error::LeadingCoefficient { section, a0 });
            }
            sections.push(Section { b0, b1, b2, a1, a2 });
        }
        Ok(Self { sections })
    }

    /// The sections, in the order in which a sample passes through them.
    #[must_use]
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }
}
