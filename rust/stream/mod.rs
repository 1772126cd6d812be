//! Features and answers while samples arrive, equal to those of whole recordings bit for bit.
//!
//! [`StreamingExtractor`] keeps what the filter remembers and a running histogram. All memory is allocated when a
//! stream is made; pushing rows and reading features allocate nothing, never block and take a bounded time per row.

mod counts;
mod extractor;
mod raw;

pub use extractor::{StreamingExtractor, Windows, MAX_WINDOW};
