//! Names the granular material under a robot's tool from a 6-axis force-torque signal.

// Tests compare results that are exact.
#![cfg_attr(test, allow(clippy::float_cmp))]

mod batch_kernel;
pub mod buffer;
pub mod dsp;
pub mod error;
mod extract;
pub mod features;
mod interleave;
mod kernel;
mod memory;
pub mod model;
pub mod multiband;
mod names;
pub mod number_table;
mod pool;
pub mod rdt;
pub mod stream;
pub mod wrench;

pub use dsp::{
    butterworth, sosfilt, sosfilt_from, sosfiltfilt, AlongAxis, Band, Padding, Sos, SosState, UniformBins,
};
pub use error::{Error, Result};
pub use features::{BatchShape, Extractor, FeatureSpec};
pub use interleave::interleave;
pub use kernel::SimdPath;
pub use model::Model;

/// What the extension module needs beside the public face; no promise to anybody else.
#[doc(hidden)]
pub mod bindings {
    pub use crate::error::brief;
    pub use crate::memory::{collected, filled, reserved, room};
    pub use crate::model::ranking;
    pub use crate::names::listed;
    pub use crate::pool::cores;
}
