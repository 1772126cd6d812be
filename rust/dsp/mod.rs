//! Butterworth filters as second-order sections, and histograms of equal bins.

mod butterworth;
mod histogram;
mod pairing;
mod sos;
mod sosfilt;

pub use butterworth::{butterworth, Band, MAX_ORDER};
pub use histogram::{Outside, UniformBins, MAX_BINS};
pub use sos::{Section, Sos};
pub(crate) use sosfilt::biquad_step;
pub use sosfilt::{sosfilt, sosfilt_from, AlongAxis, SosState};
