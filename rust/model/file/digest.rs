//! The digest of what a file says, by which damage is noticed.

use sha2::{Digest, Sha256};

use crate::model::notes::Entries;

/// A tensor as a file holds it: name, type, shape, bytes.
pub(super) type Stored<'a> = (&'a str, &'a str, &'a [usize], &'a [u8]);

/// SHA-256 in hexadecimal digits of the metadata and the tensors, both in the order of their names. Each text has its
/// length ahead, each list its size: no part can pass for another. Order and spacing of the header are not part of it.
pub(super) fn of_content(entries: &Entries, mut tensors: Vec<Stored<'_>>) -> String {
    tensors.sort_unstable_by_key(|(name, ..)| *name);
    let mut hash = Sha256::new();
    number(&mut hash, entries.len());
    for (key, value) in entries {
        text(&mut hash, key.as_bytes());
        text(&mut hash, value.as_bytes());
    }
    number(&mut hash, tensors.len());
    for (name, dtype, shape, bytes) in tensors {
        text(&mut hash, name.as_bytes());
        text(&mut hash, dtype.as_bytes());
        number(&mut hash, shape.len());
        for size in shape {
            number(&mut hash, *size);
        }
        text(&mut hash, bytes);
    }
    hexadecimal(hash)
}

/// SHA-256 of a text in hexadecimal digits.
pub(super) fn of_text(text: &str) -> String {
    hexadecimal(Sha256::new_with_prefix(text))
}

fn number(hash: &mut Sha256, number: usize) {
    hash.update((number as u64).to_le_bytes());
}

fn text(hash: &mut Sha256, bytes: &[u8]) {
    number(hash, bytes.len());
    hash.update(bytes);
}

fn hexadecimal(hash: Sha256) -> String {
    let digits = hash.finalize().into_iter().flat_map(|byte| [byte >> 4, byte & 15]);
    digits.filter_map(|digit| char::from_digit(digit.into(), 16)).collect()
}
