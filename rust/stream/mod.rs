//! Features and answers while samples arrive, equal to those of whole recordings bit for bit.
//!
//! [`StreamingExtractor`] keeps what the filter remembers and a running histogram, [`StreamingIdentifier`] the sums of the
//! scores as well; of a model with multi-band features it keeps the rows, and computes when it is asked. All memory is allocated when a stream is made; pushing rows and reading features or answers allocate
//! nothing, never block and take a bounded time per row.

mod banded;
mod counts;
mod extractor;
mod growing;
mod identifier;
mod outlook;
mod raw;
mod settled;
mod window;

pub use extractor::{StreamingExtractor, Windows, MAX_WINDOW};
pub use identifier::{Standing, StreamingIdentifier};
