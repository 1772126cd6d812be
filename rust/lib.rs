#![doc = include_str!("README.md")]
//!
//! # Further examples
//!
//! The paper's features of a recording, 3.2 s at 500 Hz:
//!
//! ```
//! use granular_id::{BatchShape, Extractor, FeatureSpec};
//!
//! let extractor = Extractor::new(FeatureSpec::default().with_cutoff_hz(23.0))?;
//! let shape = BatchShape { n_recordings: 1, n_samples: 1600, n_axes: 6 };
//! let wrench = vec![0.25; 1600 * 6]; // N and N m, sample by sample
//! let features = extractor.extract(&wrench, shape, 1)?;
//! assert_eq!(features.len(), 1600 * 6 + 100 * 6);
//! # Ok::<(), granular_id::Error>(())
//! ```
//!
//! The material, while rows arrive:
//!
#![cfg_attr(feature = "model", doc = "```no_run")]
#![cfg_attr(not(feature = "model"), doc = "```ignore")]
//! use std::sync::Arc;
//!
//! use granular_id::stream::StreamingIdentifier;
//! use granular_id::Model;
//!
//! let model = Arc::new(Model::read("kitchen.safetensors")?);
//! let mut stream = StreamingIdentifier::new(Arc::clone(&model), None)?;
//! while !stream.is_complete() {
//!     stream.push(&[0.25, 0.0, -5.0, 0.0, 0.0, 0.0])?; // fx fy fz tx ty tz
//! }
//! println!("{}", model.classes()[stream.standing()?.best]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules and features
//!
//! All features are on; `default-features = false` compiles a fifth of the crates.
//!
//! | module | holds | feature | brings |
//! |---|---|---|---|
//! | [`dsp`] | Butterworth design, filters of streams and arrays, histograms | | libm, thiserror |
//! | [`features`] | the paper's features of a recording or a batch | | |
//! | [`stream`] | features and answers as rows arrive | answers: `model` | |
//! | [`wrench`] | order, names and units of the six axes | | |
//! | [`multiband`] | statistics of every octave | `multiband` | rustfft |
//! | [`model`] | trained models and their files | `model` | `multiband`, serde, `serde_json`, sha2 |
//! | [`buffer`] | one writer, many readers, nothing lost unnoticed | `buffer` | |
//! | [`rdt`] | force-torque sensors on the network (ATI Net F/T, `OnRobot`) | `rdt` | `buffer`, socket2 |
//!
//! # Limits
//!
//! - Same bits: a stream equals the recording, and the number of threads and the vector unit (SSE2, AVX2, AVX-512, NEON)
//!   change nothing. No fused multiply-add and no fast transcendental function is used for that.
//! - Numbers are float64; streams refuse magnitudes above 1e100.
//! - Filters are second-order sections. Designs are Butterworth of order 1 to 32; any stable sections can be brought along.
//! - Filters pass NaN on and keep it, as scipy does, until they are reset; features refuse it.
//! - Nothing trains a model, and nothing resamples, crops or pads a recording.
//! - Every input ends in a value or an [`Error`] that names the argument; a size beyond the memory is an error, too.
//! - The standard library is needed, Rust 1.89 and a 64-bit target: others have smaller sizes, and x87 rounds otherwise.

// Tests compare results that are exact.
#![cfg_attr(test, allow(clippy::float_cmp))]
// What only some features or the vectors of x86-64 use is dead without them; with all of them nothing may be.
#![cfg_attr(not(all(feature = "default", target_arch = "x86_64")), allow(dead_code, unused_imports))]
#![cfg_attr(docsrs, feature(doc_cfg))]

#[cfg(not(target_pointer_width = "64"))]
compile_error!("granular-id needs a 64-bit target: on 32 bits sizes may overflow, and x87 gives other bits");

#[cfg(feature = "buffer")]
pub mod buffer;
pub mod dsp;
pub mod error;
pub mod features;
mod kernel;
mod memory;
#[cfg(feature = "model")]
pub mod model;
#[cfg(feature = "multiband")]
pub mod multiband;
mod parallel;
#[cfg(feature = "rdt")]
pub mod rdt;
mod specs;
pub mod stream;
pub mod wrench;

pub use dsp::{butterworth, sosfilt, sosfilt_from, AlongAxis, Band, Sos, SosState, UniformBins};
pub use error::{Error, Result};
pub use features::{Extractor, FeatureSpec};
pub use kernel::SimdPath;
#[cfg(feature = "model")]
pub use model::Model;
pub use wrench::BatchShape;

/// What the extension module needs beside the public face; no promise to anybody else.
#[doc(hidden)]
pub mod bindings {
    pub use crate::error::short_number;
    pub use crate::memory::{collected, filled, reserved};
    #[cfg(feature = "model")]
    pub use crate::model::ranking;
    pub use crate::parallel::cores;
    pub use crate::specs::listed;
}
