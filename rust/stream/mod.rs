//! Features and answers while samples arrive, equal to those of whole recordings bit for bit.
//!
//! [`StreamingExtractor`] keeps what the filter remembers and a running histogram, [`StreamingIdentifier`] the sums of the
//! scores as well; of a model with multi-band features it keeps the rows, their octaves and sums over these. All memory is
//! allocated when a stream is made; pushing rows and reading features or answers allocate nothing, never block and take a
//! bounded time per row or answer.

mod banded;
mod counts;
mod extractor;
mod growing;
mod identifier;
mod outlook;
mod raw;
mod settled;
mod window;
mod windows;

pub use extractor::StreamingExtractor;
pub use identifier::{Standing, StreamingIdentifier};
pub use windows::{Windows, MAX_WINDOW};
