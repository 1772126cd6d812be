//! Features and answers while samples arrive, equal to those of whole recordings bit for bit.
//!
//! [`StreamingExtractor`] keeps what the filter remembers and a running histogram, [`StreamingIdentifier`] the sums of the
//! scores as well. All memory is allocated when a stream is made; pushing rows and reading features or answers allocate
//! nothing, never block and take a bounded time per row.

mod counts;
mod extractor;
mod identifier;
mod outlook;
mod raw;
mod settled;

pub use extractor::{StreamingExtractor, Windows, MAX_WINDOW};
pub use identifier::{Standing, StreamingIdentifier};
