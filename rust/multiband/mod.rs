//! Multi-band features: what a signal does in each octave, and how its axes move together there.
//!
//! A pyramid of band-passes splits a recording into octaves; of each band, blocks of numbers say how its axes are
//! coupled, how their values are distributed, and how their energy goes through the recording; two more hold the whole
//! spectrum and the level. The definition, in plain numpy, is `tests/python/multiband_twin.py`.
//!
//! ```
//! use granular_id::multiband::{MultiBand, MultiBandSpec, Scales};
//!
//! let (n_samples, n_axes) = (1600, 6);
//! let multi_band = MultiBand::new(MultiBandSpec::default(), n_samples, n_axes, &Scales::unit(10, n_axes)?)?;
//! let mut work = multi_band.workspace()?;
//! let mut features = vec![0.0; multi_band.n_features()];
//! multi_band.extract_into(&vec![0.0; n_samples * n_axes], &mut work, &mut features)?;
//! assert_eq!(multi_band.names()?[0], "b0_coupling_fx_fx");
//! # Ok::<(), granular_id::Error>(())
//! ```

mod about;
mod band_signals;
mod bands;
mod bank;
mod batch;
mod butterfly;
mod coupling;
mod energies;
mod envelope;
mod extractor;
mod fft;
mod grid;
mod jobs;
mod level;
mod limits;
mod log_bins;
mod logarithm;
mod moments;
mod names;
mod octave;
mod passes;
mod pyramid;
mod quad;
mod quantiles;
mod reflections;
mod rotations;
mod scales;
#[cfg(test)]
mod signals;
mod spare;
mod spec;
mod spectrum;
mod symmetric;
mod tally;
#[cfg(test)]
mod tests;
mod workspace;

pub use bands::{n_bands, FrequencyBand};
pub use extractor::MultiBand;
pub use scales::Scales;
pub use spec::{Block, MultiBandSpec};
pub use workspace::Workspace;
