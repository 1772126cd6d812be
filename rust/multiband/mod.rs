//! Multi-band features: what a signal does in each octave, and how its axes move together there.
//!
//! A pyramid of band-passes splits a recording into octaves; of each band, four blocks of numbers say how its axes are
//! coupled, how their values are distributed, how their energy goes through the recording, and what the whole spectrum
//! looks like. The definition, in plain numpy, is `tests/python/multiband_twin.py`.

mod bank;
mod coupling;
mod envelope;
mod fft;
mod log_bins;
mod logarithm;
mod moments;
mod pack;
mod quantiles;
mod spectrum;
mod symmetric;
