//! Names the granular material under a robot's tool from a 6-axis force-torque signal.

// Tests compare results that are exact.
#![cfg_attr(test, allow(clippy::float_cmp))]

pub mod buffer;
pub mod butterworth;
mod cascade;
mod complex;
mod crew;
pub mod error;
mod extract;
pub mod features;
pub mod histogram;
mod interleave;
mod lanes;
mod memory;
pub mod model;
pub mod multiband;
mod names;
pub mod number_table;
mod pairing;
mod pool;
pub mod rdt;
pub mod sos;
pub mod sosfilt;
pub mod state;
pub mod stream;
pub mod wrench;

pub use butterworth::{butterworth, Band};
pub use error::{Error, Result};
pub use features::{BatchShape, Extractor, FeatureSpec};
pub use histogram::UniformBins;
pub use interleave::interleave;
pub use lanes::Path;
pub use model::Model;
pub use sos::Sos;
pub use sosfilt::{sosfilt, sosfilt_from, sosfiltfilt, AlongAxis, Padding};
pub use state::SosState;

/// What the extension module needs beside the public face; no promise to anybody else.
#[doc(hidden)]
pub mod bindings {
    pub use crate::error::brief;
    pub use crate::memory::{collected, filled, reserved, room};
    pub use crate::model::ranking;
    pub use crate::names::listed;
    pub use crate::pool::cores;
}
