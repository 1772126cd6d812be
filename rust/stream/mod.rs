//! Features and answers while samples arrive, equal to those of whole recordings bit for bit.
//!
//! [`StreamingExtractor`] keeps what the filter remembers and a running histogram, [`StreamingIdentifier`] the sums of the
//! scores as well; of a model with multi-band features it keeps the rows, their octaves and sums over these. All memory is
//! allocated when a stream is made; pushing rows and reading features or answers allocate nothing, never block and take a
//! bounded time per row or answer.

#[cfg(feature = "model")]
mod banded;
mod counts;
mod extractor;
#[cfg(feature = "model")]
mod growing;
#[cfg(feature = "model")]
mod identifier;
#[cfg(feature = "model")]
mod outlook;
mod raw;
#[cfg(feature = "model")]
mod settled;
#[cfg(feature = "model")]
mod window;
mod windows;

pub use extractor::StreamingExtractor;
#[cfg(feature = "model")]
pub use identifier::{Standing, StreamingIdentifier};
pub use windows::{Windows, MAX_WINDOW};
