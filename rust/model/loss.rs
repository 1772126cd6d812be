//! What a score costs a class, and by what the sum of its costs is divided.
//!
//! Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141; Escalera, Pujol, Radeva
//! (2010), "On the decoding process in ternary error-correcting output codes", IEEE TPAMI 32:120-134.

use std::f64::consts::LN_2;

use crate::names;

/// `exp` is continued along its tangent from here on, so that sums of losses stay finite.
const EXP_TANGENT_FROM: f64 = 650.0;

/// ... as far as the sum over any number of learners is finite, and level from there.
const EXP_TANGENT_TO: f64 = 1e20;

/// A binary loss of the agreement `z` of a code with a score: 1/2 where the score says nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Loss {
    /// `max(0, 1 - z) / 2`: that of support vector machines, and the paper's.
    #[default]
    Hinge,
    /// `(1 - sign(z)) / 2`.
    Hamming,
    /// `(1 - r(min(1, z))) / 2`, `r(x) = sign(x) sqrt(|x|)`: half way from the votes (power 0) to the hinge (power 1).
    Root,
    /// `(1 - z) / 2`.
    Linear,
    /// `exp(-z) / 2`, along its tangent below z = -650.
    Exponential,
    /// `log(1 + exp(-z)) / (2 log 2)`.
    Logit,
    /// `log(1 + exp(-2 z)) / (2 log 2)`.
    Binodeviance,
}

impl Loss {
    /// Each with its name.
    pub const NAMED: [(&str, Self); 7] = [
        ("hinge", Self::Hinge),
        ("hamming", Self::Hamming),
        ("root", Self::Root),
        ("linear", Self::Linear),
        ("exponential", Self::Exponential),
        ("logit", Self::Logit),
        ("binodeviance", Self::Binodeviance),
    ];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        names::of(self, &Self::NAMED)
    }

    /// The loss of a class whose code agrees with the score by `z` (code times score).
    #[must_use]
    pub fn of_agreement(self, z: f64) -> f64 {
        match self {
            Self::Hinge => (1.0 - z).max(0.0) / 2.0,
            Self::Hamming => (1.0 - f64::from(i8::from(z > 0.0) - i8::from(z < 0.0))) / 2.0,
            Self::Root => (1.0 - z.min(1.0).abs().sqrt().copysign(z)) / 2.0,
            Self::Linear => (1.0 - z) / 2.0,
            Self::Exponential => {
                let beyond = (-z - EXP_TANGENT_FROM).clamp(0.0, EXP_TANGENT_TO);
                libm::exp((-z).min(EXP_TANGENT_FROM)) * (1.0 + beyond) / 2.0
            }
            Self::Logit => softplus(-z) / (2.0 * LN_2),
            Self::Binodeviance => softplus(-2.0 * z) / (2.0 * LN_2),
        }
    }
}

/// `log(1 + exp(x))` in a form that does not overflow.
fn softplus(x: f64) -> f64 {
    x.max(0.0) + libm::log1p(libm::exp(-x.abs()))
}

/// By what the summed loss of a class is divided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Decoding {
    /// The number of learners that saw the class: the paper's.
    #[default]
    LossWeighted,
    /// The number of learners.
    LossBased,
}

impl Decoding {
    /// Each with its name.
    pub const NAMED: [(&str, Self); 2] =
        [("loss_weighted", Self::LossWeighted), ("loss_based", Self::LossBased)];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        names::of(self, &Self::NAMED)
    }
}
