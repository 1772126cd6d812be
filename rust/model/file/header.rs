//! The first bytes of a file: is it safetensors, and are its header and tensors within bounds?

use safetensors::{Dtype, SafeTensors};

use super::json::{self, Json};
use super::read::{OPTIONAL, REQUIRED};
use super::{LENGTH_BYTES, MAX_HEADER_BYTES};
use crate::error::shown;
use crate::model::fault::Fault;
use crate::model::notes::Entries;

/// Kinds of files that are taken for a model now and then, by their first bytes.
const OTHERS: [(&[u8], &str); 6] = [
    (b"\x80\x02", "this is a pickle, which may run code and is never read"),
    (b"\x80\x03", "this is a pickle, which may run code and is never read"),
    (b"\x80\x04", "this is a pickle, which may run code and is never read"),
    (b"\x80\x05", "this is a pickle, which may run code and is never read"),
    (b"PK\x03\x04", "this is a zip archive (an .npz or a .pt file?)"),
    (b"\x89HDF", "this is an HDF5 file"),
];

/// What a header says of a tensor.
const TENSOR_KEYS: [&str; 3] = ["data_offsets", "dtype", "shape"];

/// Where a safetensors header begins: a brace behind eight bytes of length.
const BRACE: u8 = b'{';

/// The text of the header, once its length is known to be possible.
pub(super) fn text(bytes: &[u8]) -> Result<&str, Fault> {
    if bytes.is_empty() {
        return Err(Fault::Foreign { what: "the file is empty" });
    }
    // A safetensors file may begin with any bytes, but not have a brace missing.
    if bytes.get(LENGTH_BYTES) != Some(&BRACE) {
        let other = OTHERS.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, what)| *what);
        return Err(Fault::Foreign {
            what: other.unwrap_or("this is no safetensors file: it has no header"),
        });
    }
    let (length, rest) = bytes.split_first_chunk::<LENGTH_BYTES>().unwrap_or((&[0; LENGTH_BYTES], &[]));
    let header = u64::from_le_bytes(*length);
    let len = usize::try_from(header).unwrap_or(usize::MAX);
    let Some(text) = rest.get(..len) else {
        return Err(Fault::HeaderCut { header, left: rest.len() });
    };
    if len > MAX_HEADER_BYTES {
        return Err(Fault::HeaderSize { bytes: header });
    }
    str::from_utf8(text)
        .map_err(|error| Fault::Json { what: "header", problem: format!("is no UTF-8 text: {error}") })
}

/// The metadata of a header; refuses names that are there twice, which the library would let pass, and tensors and entries
/// that no model has, before anything else is made of them.
pub(super) fn metadata(text: &str) -> Result<Entries, Fault> {
    let mut header = json::object("header", text)?;
    let problem = |problem: String| Fault::Json { what: "header", problem };
    let texts = header.take("__metadata__", "an object of texts", |value| match value {
        Json::Object(entries) => Some(entries),
        _ => None,
    })?;
    let is_known = |name: &&String| REQUIRED.contains(&name.as_str()) || OPTIONAL.contains(&name.as_str());
    if let Some(name) = header.names().find(|name| !is_known(name)) {
        return Err(Fault::UnknownTensor { name: shown(name.as_bytes()) });
    }
    for (name, entry) in header.rest() {
        let Json::Object(entry) = entry else { continue };
        if let Some(key) = entry.keys().find(|key| !TENSOR_KEYS.contains(&key.as_str())) {
            return Err(problem(format!("tensor '{name}' has an unknown key {}", shown(key.as_bytes()))));
        }
    }
    let entries = texts.into_iter().map(|(key, value)| {
        let kind = value.kind();
        match value.text() {
            Some(text) => Ok((key, text)),
            None => Err(problem(format!("metadata {} must be a text, got {kind}", shown(key.as_bytes())))),
        }
    });
    entries.collect()
}

/// The tensors, if they fill the file from the header to its end without gaps and overlaps.
pub(super) fn tensors(bytes: &[u8]) -> Result<SafeTensors<'_>, Fault> {
    SafeTensors::deserialize(bytes).map_err(|error| Fault::Layout { problem: json::complaint(&error) })
}

/// Refuses a type other than float64.
pub(super) fn check_dtype(name: &'static str, dtype: Dtype) -> Result<(), Fault> {
    match dtype {
        Dtype::F64 => Ok(()),
        other => Err(Fault::Dtype { name, got: other.to_string() }),
    }
}
