//! The tests of the crate's public face, one program: what they share is compiled once.

mod buffer;
mod buffer_model;
mod buffer_stress;
mod extraction;
mod filter;
mod golden;
mod model;
mod model_multiband;
mod rdt;
mod stream;

/// Plain twins, and what several files take from each other.
mod twins {
    pub mod models;
    pub mod signals;
}
