//! The model file: safetensors with an exact set of tensors and metadata. `docs/live/model-file.md` is its description.
//!
//! Reading trusts nothing. Sizes are compared with limits before anything is parsed or allocated; a file is read only if it
//! is what the writer could have written, but for the order of entries and the spacing of its JSON.

mod digest;
mod header;
pub(crate) mod json;
mod read;
pub(super) mod rules;
mod spec;
mod write;

/// Versions of the format that are read, as it says in a fault.
pub(super) const VERSIONS: &str = "1, 2 and 3";

/// The version of a file with samples and histograms and no digest.
const ADDITIVE: &str = "1";

/// The version of a file with multi-band features and no digest.
const MULTIBAND: &str = "2";

/// The version that is written: with a digest, whatever is extracted.
const DIGESTED: &str = "3";

/// The entry of the metadata that holds the digest of all the rest.
const DIGEST: &str = "content_sha256";

/// What the metadata calls the format.
const FORMAT: &str = "granular_id.identifier";

/// Bytes of a file that are read unless the caller allows more.
pub const MAX_FILE_BYTES: usize = 16 << 20;

/// Bytes of the header that are read at most.
pub const MAX_HEADER_BYTES: usize = 1 << 20;

/// Bytes ahead of the header: its length.
const LENGTH_BYTES: usize = 8;
