//! Names the granular material under a robot's tool from a 6-axis force-torque signal.

pub mod error;
pub mod sos;
pub mod wrench;

#[cfg(feature = "python")]
mod python;

pub use error::{Error, Result};
pub use sos::Sos;
