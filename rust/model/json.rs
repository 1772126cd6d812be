//! Reading JSON into types derived by serde.

use std::collections::BTreeMap;
use std::fmt::{self, Display};

use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};

use super::ModelError;
use crate::error::quoted;

/// Characters of a library's message, which may quote the file.
const MAX_CAUSE: usize = 160;

/// A value of JSON text that is called `what` in messages.
pub(super) fn parsed<'a, T: Deserialize<'a>>(what: &'static str, text: &'a str) -> Result<T, ModelError> {
    let refused = |error| ModelError::Json { what, problem: format!("is no such JSON: {}", cause(&error)) };
    serde_json::from_str(text).map_err(refused)
}

/// The same of an object: serde would take a list for one.
pub(super) fn parsed_object<'a, T: Deserialize<'a>>(
    what: &'static str,
    text: &'a str,
) -> Result<T, ModelError> {
    if text.trim_ascii_start().starts_with('{') {
        return parsed(what, text);
    }
    Err(ModelError::Json { what, problem: "must be a JSON object".to_owned() })
}

/// A library's message, short and printable.
fn cause(error: &impl Display) -> String {
    let mut text = String::new();
    for character in error.to_string().chars().take(MAX_CAUSE) {
        if character.is_control() {
            text.extend(character.escape_debug());
        } else {
            text.push(character);
        }
    }
    text
}

/// An object of any names, none of which is there twice.
pub(super) struct Object<V>(pub(super) BTreeMap<String, V>);

impl<'de, V: Deserialize<'de>> Deserialize<'de> for Object<V> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(ObjectVisitor(BTreeMap::new()))
    }
}

struct ObjectVisitor<V>(BTreeMap<String, V>);

impl<'de, V: Deserialize<'de>> Visitor<'de> for ObjectVisitor<V> {
    type Value = Object<V>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut entries: A) -> Result<Object<V>, A::Error> {
        while let Some((name, value)) = entries.next_entry::<String, V>()? {
            let duplicate = A::Error::custom(format_args!("{} is there twice", quoted(&name)));
            if self.0.insert(name, value).is_some() {
                return Err(duplicate);
            }
        }
        Ok(Object(self.0))
    }
}
