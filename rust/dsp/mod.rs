//! Butterworth filters as second-order sections, and histograms of equal bins.

mod butterworth;
mod cascade;
mod histogram;
mod pairing;
mod sos;
mod sosfilt;

pub use butterworth::{butterworth, Band, MAX_ORDER};
pub(crate) use cascade::advance;
pub(crate) use cascade::private::Slice;
pub use cascade::{Real, SosState};
pub use histogram::{Outside, UniformBins, MAX_BINS};
pub use sos::{Section, Sos};
pub use sosfilt::{sosfilt, sosfilt_from, AlongAxis};
