//! Why parts make no model, or a file holds none: names and numbers, in one sentence.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use crate::Error;

/// Why parts make no model, or bytes no model file.
///
/// Not a variant of [`Error`], which is about arguments: parts and files have names and places.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
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
    /// A file of another version.
    #[error("format_version is {got}, this version of granular_id reads {reads}: update granular_id")]
    Version {
        /// The version that is read.
        reads: &'static str,
        /// The version of the file.
        got: String,
    },
    /// Text that is no JSON, or JSON of another kind.
    #[error("{what}: {problem}")]
    Json {
        /// The header or an entry of the metadata.
        what: &'static str,
        /// What is wrong, with the place where it is known.
        problem: String,
    },
    /// Something else than what was hashed.
    #[error("what the file holds does not have the hash that content_sha256 names: the file was damaged or changed")]
    Damaged,
    /// A feature specification that cannot be, or no memory for the model.
    #[error("{place}{error}", place = if matches!(.0, Error::Memory { .. }) { "" } else { "feature_spec: " }, error = .0)]
    Spec(#[from] Error),
    /// A tensor, a size, or an entry of the metadata that is missing, unknown, or does not fit the others.
    #[error("{what} {problem}")]
    Part {
        /// Its name, with the place in it where one value is wrong: `coef[1, 2]`.
        what: String,
        /// What is wrong: what it must be, and what it is.
        problem: String,
    },
}

impl ModelError {
    pub(super) fn part(what: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Part { what: what.into(), problem: problem.into() }
    }

    /// A tensor that every such model has.
    pub(super) fn missing_tensor(name: &str) -> Self {
        Self::part(format!("tensor '{name}'"), "is missing")
    }

    /// A part that nothing else needs.
    pub(super) fn no_use(what: &str, without: &str) -> Self {
        Self::part(what, format!("is of no use without {without}"))
    }

    /// Refuses a number outside its range.
    pub(super) fn check_range(what: &str, got: usize, range: RangeInclusive<usize>) -> Result<(), Self> {
        if range.contains(&got) {
            return Ok(());
        }
        Err(Self::must_be(what, format_args!("from {} to {}", range.start(), range.end()), got))
    }

    /// A part that is not what it must be.
    pub(super) fn must_be(what: impl Into<String>, wanted: impl Display, got: impl Display) -> Self {
        Self::part(what, format!("must be {wanted}, got {got}"))
    }
}

/// Why a file gives no model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// The file could not be read.
    #[error("{}: {source}", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The file was read, or its size known, and it is no model.
    #[error("{}: {source}", .path.display())]
    NoModel {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: ModelError,
    },
}
