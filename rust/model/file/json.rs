//! JSON, read strictly: no name twice in an object, no endless objects, no more than 128 levels. And the few kinds of it that are written.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::Value;

use crate::error::shown;
use crate::model::fault::Fault;

/// Characters of what a library says, which may quote the file.
const MAX_COMPLAINT: usize = 160;

/// Names of an object: many more than any of ours has, few enough to be refused at once.
const MAX_NAMES: usize = 4096;

/// A JSON value; numbers as float64.
#[derive(Debug)]
pub(super) enum Json {
    Null,
    Flag(bool),
    Number(f64),
    Text(String),
    List(Vec<Json>),
    Object(BTreeMap<String, Json>),
}

impl<'de> Deserialize<'de> for Json {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(AnyJson)
    }
}

struct AnyJson;

impl<'de> Visitor<'de> for AnyJson {
    type Value = Json;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Json, E> {
        Ok(Json::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Json, E> {
        Ok(Json::Flag(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Json, E> {
        Ok(Json::Number(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Json, E> {
        Ok(Json::Number(value as f64))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Json, E> {
        Ok(Json::Number(value))
    }

    fn visit_str<E>(self, value: &str) -> Result<Json, E> {
        Ok(Json::Text(value.to_owned()))
    }

    fn visit_string<E>(self, value: String) -> Result<Json, E> {
        Ok(Json::Text(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Json, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(Json::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Json, A::Error> {
        let mut object = BTreeMap::new();
        while let Some((name, value)) = entries.next_entry::<String, Json>()? {
            if object.contains_key(&name) {
                return Err(de::Error::custom(format_args!("{} is there twice", shown(name.as_bytes()))));
            }
            if object.len() == MAX_NAMES {
                return Err(de::Error::custom(format_args!("an object has more than {MAX_NAMES} names")));
            }
            object.insert(name, value);
        }
        Ok(Json::Object(object))
    }
}

/// An object from text.
pub(in crate::model) fn object(what: &'static str, text: &str) -> Result<Object, Fault> {
    serde_json::from_str::<Json>(text).map_err(|error| not_json(what, &error))?.object(what)
}

/// A list of names from text.
pub(in crate::model) fn names(what: &'static str, text: &str) -> Result<Vec<String>, Fault> {
    let wrong = || Fault::Json { what, problem: "must be a JSON list of texts".to_owned() };
    serde_json::from_str::<Json>(text)
        .map_err(|error| not_json(what, &error))?
        .list_of(Json::text)
        .ok_or_else(wrong)
}

/// A complaint of the parser, short and printable.
fn not_json(what: &'static str, error: &serde_json::Error) -> Fault {
    Fault::Json { what, problem: format!("is no valid JSON: {}", complaint(error)) }
}

/// What a library says about a file, short and printable.
pub(super) fn complaint(error: &impl fmt::Display) -> String {
    let mut text = String::new();
    for character in error.to_string().chars().take(MAX_COMPLAINT) {
        if character.is_control() {
            text.extend(character.escape_debug());
        } else {
            text.push(character);
        }
    }
    text
}

impl Json {
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Null => "null",
            Self::Flag(_) => "true or false",
            Self::Number(_) => "a number",
            Self::Text(_) => "a text",
            Self::List(_) => "a list",
            Self::Object(_) => "an object",
        }
    }

    pub(super) fn number(self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(number),
            _ => None,
        }
    }

    pub(super) fn flag(self) -> Option<bool> {
        match self {
            Self::Flag(flag) => Some(flag),
            _ => None,
        }
    }

    pub(super) fn text(self) -> Option<String> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// A list whose items are all what `convert` wants.
    pub(super) fn list_of<T>(self, convert: impl FnMut(Self) -> Option<T>) -> Option<Vec<T>> {
        match self {
            Self::List(list) => list.into_iter().map(convert).collect(),
            _ => None,
        }
    }

    /// An object, called `what` in messages.
    pub(super) fn object(self, what: &'static str) -> Result<Object, Fault> {
        match self {
            Self::Object(entries) => Ok(Object { what, entries }),
            other => {
                Err(Fault::Json { what, problem: format!("must be a JSON object, got {}", other.kind()) })
            }
        }
    }
}

/// Entries of an object, to be taken one by one; what is left over is an error.
#[derive(Debug)]
pub(in crate::model) struct Object {
    what: &'static str,
    entries: BTreeMap<String, Json>,
}

impl Object {
    /// Names of the entries that are left.
    pub(super) fn names(&self) -> impl Iterator<Item = &String> {
        self.entries.keys()
    }

    /// The entries that are left.
    pub(super) fn rest(&self) -> impl Iterator<Item = (&String, &Json)> {
        self.entries.iter()
    }

    /// Takes the entry `name` if it is there and not null.
    pub(super) fn optional(&mut self, name: &str) -> Option<Json> {
        self.entries.remove(name).filter(|value| !matches!(value, Json::Null))
    }

    /// Takes the entry `name` if it is what `convert` wants.
    pub(super) fn take<T>(
        &mut self,
        name: &str,
        wanted: &str,
        convert: impl FnOnce(Json) -> Option<T>,
    ) -> Result<T, Fault> {
        let Some(value) = self.entries.remove(name) else {
            return Err(self.fault(format!("'{name}' is missing")));
        };
        let kind = value.kind();
        convert(value).ok_or_else(|| self.fault(format!("'{name}' must be {wanted}, got {kind}")))
    }

    /// Refuses entries that nobody took.
    pub(super) fn end(self) -> Result<(), Fault> {
        match self.names().next() {
            None => Ok(()),
            Some(name) => Err(self.fault(format!("has an unknown entry {}", shown(name.as_bytes())))),
        }
    }

    pub(super) fn fault(&self, problem: String) -> Fault {
        Fault::Json { what: self.what, problem }
    }
}

/// A list of texts as JSON.
pub(in crate::model) fn list(texts: &[String]) -> String {
    Value::from(texts).to_string()
}

/// A finite number with the fewest digits that give the same bits.
pub(in crate::model) fn number(value: f64) -> String {
    Value::from(value).to_string()
}
