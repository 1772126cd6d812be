//! What is wrong with the parts of a model or with its file: names and numbers, in one sentence.

use std::path::PathBuf;

use crate::error::brief;
use crate::Error;

/// Why parts make no model, or bytes no model file.
///
/// Not a variant of [`Error`], which is about arguments: parts and files have names and places.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// More bytes than the caller wants to read.
    #[error("the file has {bytes} bytes; at most {max} are read (max_file_bytes raises the limit)")]
    FileSize {
        /// Bytes of the file.
        bytes: u64,
        /// Bytes allowed.
        max: usize,
    },
    /// Something else than a model file.
    #[error("{what}; wanted a model file of granular_id (safetensors)")]
    Foreign {
        /// What it is.
        what: &'static str,
    },
    /// A header that ends behind the file.
    #[error("the header should have {header} bytes, {left} are left in the file: it is cut off, or no safetensors file")]
    HeaderCut {
        /// Bytes of the header, as the file says.
        header: u64,
        /// Bytes behind the length.
        left: usize,
    },
    /// A header larger than any model needs.
    #[error("the header has {bytes} bytes; at most {} are allowed", super::MAX_HEADER_BYTES)]
    HeaderSize {
        /// Bytes of the header.
        bytes: u64,
    },
    /// Text that is no JSON, or JSON of another kind.
    #[error("{what}: {problem}")]
    Json {
        /// The header or an entry of the metadata.
        what: &'static str,
        /// What is wrong, with the place where it is known.
        problem: String,
    },
    /// Tensors that do not lie side by side from the header to the end of the file.
    #[error("the tensors do not fill the file exactly: {problem}")]
    Layout {
        /// What is wrong.
        problem: String,
    },
    /// A file of a later version.
    #[error(
        "format_version is {got}, this version of granular_id reads {}: update granular_id",
        super::file::VERSIONS
    )]
    Version {
        /// The version of the file.
        got: String,
    },
    /// An entry of the metadata that the format asks for.
    #[error("metadata must have an entry '{key}'")]
    MissingEntry {
        /// Its name.
        key: &'static str,
    },
    /// An entry of the metadata that the format does not know.
    #[error("metadata has an unknown entry {key}")]
    UnknownEntry {
        /// Its name, quoted.
        key: String,
    },
    /// An entry of the metadata, or a part of one, with a value it cannot have.
    #[error("{key} must be {wanted}, got {got}")]
    Entry {
        /// Its name.
        key: &'static str,
        /// What is wanted.
        wanted: String,
        /// The value, quoted and cut.
        got: String,
    },
    /// Something else than what was hashed.
    #[error("{what} does not have the hash that {key} names: the file was damaged or changed")]
    Hash {
        /// The feature specification, or all that the file holds.
        what: &'static str,
        /// The entry of the metadata with the hash.
        key: &'static str,
    },
    /// A feature specification that cannot be.
    #[error("feature_spec: {0}")]
    Spec(#[from] Error),
    /// A tensor that every model has.
    #[error("tensor '{name}' is missing")]
    MissingTensor {
        /// Its name.
        name: &'static str,
    },
    /// A tensor that no model has.
    #[error("tensor {name} is unknown")]
    UnknownTensor {
        /// Its name, quoted.
        name: String,
    },
    /// Numbers other than float64.
    #[error("tensor '{name}' must be float64 (F64), got {got}")]
    Dtype {
        /// Name of the tensor.
        name: &'static str,
        /// Its type.
        got: String,
    },
    /// A tensor of another shape than follows from the rest.
    #[error("{name} must have shape {wanted}, got {got:?}")]
    Shape {
        /// Name of the tensor.
        name: &'static str,
        /// The shape wanted, and why.
        wanted: String,
        /// Its shape.
        got: Vec<usize>,
    },
    /// NaN or infinity.
    #[error("{name}{place:?} must be finite, got {value}")]
    NonFinite {
        /// Name of the tensor.
        name: &'static str,
        /// Indices of the first such value.
        place: Vec<usize>,
        /// The value.
        value: f64,
    },
    /// A code that is none.
    #[error("coding_matrix[{class}, {learner}] must be -1, 0 or 1, got {}", brief(*.value))]
    Code {
        /// Row.
        class: usize,
        /// Column.
        learner: usize,
        /// The value.
        value: f64,
    },
    /// A learner with one side only.
    #[error("coding_matrix column {learner} must hold both 1 and -1")]
    OneSided {
        /// Column.
        learner: usize,
    },
    /// A class that no learner knows.
    #[error("coding_matrix row {class} is all 0: no learner ever sees this class")]
    Unseen {
        /// Row.
        class: usize,
    },
    /// A count outside its range.
    #[error("{what} must be from {least} to {most}, got {got}")]
    Count {
        /// What is counted.
        what: &'static str,
        /// The smallest allowed.
        least: usize,
        /// The largest allowed.
        most: usize,
        /// The count.
        got: usize,
    },
    /// A text that cannot stand in a table or a line of a terminal.
    #[error(
        "{what}[{index}] must be 1 to {} bytes of printable text, got {got}",
        super::notes::MAX_NAME_BYTES
    )]
    Name {
        /// The list.
        what: &'static str,
        /// Place in it.
        index: usize,
        /// The text, quoted and cut.
        got: String,
    },
    /// The same name twice.
    #[error("{what}[{first}] and {what}[{second}] are both {name}")]
    Doubled {
        /// The list.
        what: &'static str,
        /// The first place.
        first: usize,
        /// The second place.
        second: usize,
        /// The name, quoted.
        name: String,
    },
    /// A range of raw samples that is reversed.
    #[error("raw_low[{index}] must not be above raw_high[{index}], got {} and {}", brief(*.low), brief(*.high))]
    Reversed {
        /// Place.
        index: usize,
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// A row of the rule for early answers that makes no sense.
    #[error("early[{row}] must be (samples seen, margin): whole, rising, from 1 to {n_samples}; at least 0. Got ({}, {})", brief(*.seen), brief(*.margin))]
    Early {
        /// Row.
        row: usize,
        /// Samples of a recording.
        n_samples: usize,
        /// Its first number.
        seen: f64,
        /// Its second number.
        margin: f64,
    },
    /// A tensor without the one it belongs to.
    #[error("{name} is of no use without {needed}")]
    Alone {
        /// What is there.
        name: &'static str,
        /// What is not.
        needed: &'static str,
    },
}

/// Why a file holds no model.
#[derive(Debug, thiserror::Error)]
pub enum FileFault {
    /// The file could not be read.
    #[error("{}: {source}", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file was read, or its size known, and it is no model.
    #[error("{}: {fault}", .path.display())]
    NoModel {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        fault: Fault,
    },
}
