//! What a model file says in JSON, the feature specification and the confidence rules, and how JSON is read: strictly. No
//! name twice in an object, no endless objects, no more than 128 levels, nothing left out and nothing added.
//!
//! Serde could derive the readers. Its messages would not name the entry that has the wrong type.

use std::fmt;

use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::{json, Map, Value};

use super::rules::{CandidateRule, UnknownRule};
use super::{ModelError, Rules};
use crate::dsp::Outside;
use crate::error::quoted;
use crate::features::Initial;
use crate::multiband::{Block, MultiBandSpec};
use crate::specs::listed;
use crate::FeatureSpec;

/// Characters of what a library says, which may quote the file.
const MAX_QUOTED: usize = 160;

/// Names of an object: many more than any of ours has, few enough to be refused at once.
const MAX_NAMES: usize = 4096;

/// Where the rules stand in what is known of a training.
const RULES: &str = "confidence";

const CANDIDATES: &str = "granular-id candidates 1";
const UNKNOWN: &str = "granular-id unknown rule 1";

/// A value without a name that is there twice.
struct Strict(Value);

impl<'de> Deserialize<'de> for Strict {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(StrictVisitor).map(Self)
    }
}

struct StrictVisitor;

impl<'de> Visitor<'de> for StrictVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Strict(item)) = items.next_element()? {
            list.push(item);
        }
        Ok(list.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some((name, Strict(value))) = entries.next_entry::<String, _>()? {
            if object.contains_key(&name) {
                return Err(de::Error::custom(format_args!("{} is there twice", quoted(&name))));
            }
            if object.len() == MAX_NAMES {
                return Err(de::Error::custom(format_args!("an object has more than {MAX_NAMES} names")));
            }
            object.insert(name, value);
        }
        Ok(object.into())
    }
}

fn parsed(what: &'static str, text: &str) -> Result<Value, ModelError> {
    let no_json = |error| ModelError::Json { what, problem: format!("is no valid JSON: {}", cause(&error)) };
    serde_json::from_str(text).map(|Strict(value)| value).map_err(no_json)
}

/// An object from text.
pub(super) fn object(what: &'static str, text: &str) -> Result<Object, ModelError> {
    Object::of(what, parsed(what, text)?)
}

/// A list of names from text.
pub(super) fn names(what: &'static str, text: &str) -> Result<Vec<String>, ModelError> {
    let wrong = || ModelError::Json { what, problem: "must be a JSON list of texts".to_owned() };
    list(&parsed(what, text)?, string).ok_or_else(wrong)
}

/// What a library says about a file, short and printable.
pub(super) fn cause(error: &impl fmt::Display) -> String {
    let mut text = String::new();
    for character in error.to_string().chars().take(MAX_QUOTED) {
        if character.is_control() {
            text.extend(character.escape_debug());
        } else {
            text.push(character);
        }
    }
    text
}

/// What kind of value stands where another one is wanted.
pub(super) fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

/// Entries of an object, to be taken one by one; what is left over is an error.
pub(super) struct Object {
    what: &'static str,
    pub(super) entries: Map<String, Value>,
}

impl Object {
    fn of(what: &'static str, value: Value) -> Result<Self, ModelError> {
        match value {
            Value::Object(entries) => Ok(Self { what, entries }),
            other => Err(ModelError::Json {
                what,
                problem: format!("must be a JSON object, got {}", kind(&other)),
            }),
        }
    }

    /// Takes the entry `name` if it is what `convert` wants.
    pub(super) fn take<T>(
        &mut self,
        name: &str,
        wanted: &str,
        convert: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<T, ModelError> {
        let Some(value) = self.entries.remove(name) else {
            return Err(self.error(format!("'{name}' is missing")));
        };
        convert(&value).ok_or_else(|| self.error(format!("'{name}' must be {wanted}, got {}", kind(&value))))
    }

    fn number(&mut self, name: &str) -> Result<f64, ModelError> {
        self.take(name, "a number", Value::as_f64)
    }

    fn count(&mut self, name: &str) -> Result<usize, ModelError> {
        self.take(name, "a whole number", count)
    }

    fn flag(&mut self, name: &str) -> Result<bool, ModelError> {
        self.take(name, "true or false", Value::as_bool)
    }

    fn text(&mut self, name: &str) -> Result<String, ModelError> {
        self.take(name, "a text", string)
    }

    fn choice<T: Copy>(&mut self, name: &str, named: &[(&str, T)]) -> Result<T, ModelError> {
        self.take(name, &listed(named), |value| {
            named.iter().find(|(name, _)| value == name).map(|(_, meaning)| *meaning)
        })
    }

    /// The object in the entry `name`, called `what` in messages, if it is there and not null.
    fn optional(&mut self, name: &str, what: &'static str) -> Result<Option<Self>, ModelError> {
        let value = self.entries.remove(name).filter(|value| !value.is_null());
        value.map(|value| Self::of(what, value)).transpose()
    }

    /// Refuses entries that nobody took.
    fn end(self) -> Result<(), ModelError> {
        match self.entries.keys().next() {
            None => Ok(()),
            Some(name) => Err(self.error(format!("has an unknown entry {}", quoted(name)))),
        }
    }

    pub(super) fn error(&self, problem: String) -> ModelError {
        ModelError::Json { what: self.what, problem }
    }
}

fn string(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // whole and small enough to be exact
fn count(value: &Value) -> Option<usize> {
    let count = value.as_f64()?;
    (count.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&count)).then_some(count as usize)
}

/// A list whose items are all what `convert` wants.
fn list<T>(value: &Value, convert: impl FnMut(&Value) -> Option<T>) -> Option<Vec<T>> {
    value.as_array()?.iter().map(convert).collect()
}

/// The specification as one line, names in order.
pub(super) fn write_spec(spec: &FeatureSpec) -> String {
    json!({
        "bin_range": spec.bin_ranges,
        "cutoff_hz": spec.cutoff_hz,
        "density": spec.density,
        "hfmh": spec.hfmh,
        "initial": spec.initial.name(),
        "n_bins": spec.n_bins,
        "order": spec.order,
        "outside": spec.outside.name(),
        "rate_hz": spec.rate_hz,
        "raw": spec.raw,
    })
    .to_string()
}

/// The specification that is described. Whether it makes sense is not asked here.
pub(super) fn read_spec(mut object: Object) -> Result<FeatureSpec, ModelError> {
    let pair = |pair: &Value| <[f64; 2]>::try_from(list(pair, Value::as_f64)?).ok().map(<(f64, f64)>::from);
    let spec = FeatureSpec {
        bin_ranges: object.take("bin_range", "a list of pairs of numbers", |value| list(value, pair))?,
        cutoff_hz: object.number("cutoff_hz")?,
        density: object.flag("density")?,
        hfmh: object.flag("hfmh")?,
        initial: object.choice("initial", &Initial::NAMED)?,
        n_bins: object.count("n_bins")?,
        order: object.count("order")?,
        outside: object.choice("outside", &Outside::NAMED)?,
        rate_hz: object.number("rate_hz")?,
        raw: object.flag("raw")?,
    };
    object.end()?;
    Ok(spec)
}

/// Whether multi-band features are described.
pub(super) fn is_multiband(object: &Object) -> bool {
    object.entries.contains_key("blocks")
}

/// Multi-band features as one line, names in order.
pub(super) fn write_multiband(spec: &MultiBandSpec) -> String {
    let named = Block::NAMED.into_iter().filter(|(_, block)| spec.wants(*block));
    let blocks: Vec<_> = named.map(|(name, _)| name).collect();
    json!({ "blocks": blocks, "rate_hz": spec.rate_hz }).to_string()
}

/// The multi-band features that are described.
pub(super) fn read_multiband(mut object: Object) -> Result<MultiBandSpec, ModelError> {
    let wanted = format!("a list of blocks in the order {}", Block::NAMED.map(|(name, _)| name).join(", "));
    let [coupling, quantiles, envelope, spectrum, level] = object.take("blocks", &wanted, blocks)?;
    let rate_hz = object.number("rate_hz")?;
    object.end()?;
    Ok(MultiBandSpec { rate_hz, coupling, quantiles, envelope, spectrum, level })
}

/// Which blocks a list names, if it does so once each and in order.
fn blocks(value: &Value) -> Option<[bool; 5]> {
    let names = list(value, string)?;
    let has = Block::NAMED.map(|(block, _)| names.iter().any(|name| name == block));
    let in_order = Block::NAMED.iter().zip(has).filter(|(_, has)| *has).map(|((name, _), _)| *name);
    names.iter().map(String::as_str).eq(in_order).then_some(has)
}

/// The rules in what is known of a training: what `CandidateRule.to_dict` and `UnknownRule.to_dict` of the Python package
/// give. None where there are none; each must be whole, and for these classes.
pub(super) fn read_rules(trained: &str, classes: &[String]) -> Result<Rules, ModelError> {
    let Some(mut stored) = object("trained", trained)?.optional(RULES, "trained.confidence")? else {
        return Ok(Rules::default());
    };
    let candidates = stored.optional("candidates", "trained.confidence.candidates")?;
    let unknown = stored.optional("unknown", "trained.confidence.unknown")?;
    stored.end()?;
    Ok(Rules {
        candidates: candidates.map(|rule| read_candidates(rule, classes)).transpose()?,
        unknown: unknown.map(|rule| read_unknown(rule, classes)).transpose()?,
    })
}

fn read_candidates(mut rule: Object, classes: &[String]) -> Result<CandidateRule, ModelError> {
    begin(&mut rule, CANDIDATES, classes)?;
    for share in ["level", "mean", "worst"] {
        rule.take(share, "a number from 0 to 1", |value| {
            value.as_f64().filter(|share| (0.0..=1.0).contains(share))
        })?;
    }
    let limit = rule.number("threshold")?;
    rule.count("n_rows")?;
    rule.count("n_sessions")?;
    rule.end()?;
    Ok(CandidateRule { limit })
}

fn read_unknown(mut rule: Object, classes: &[String]) -> Result<UnknownRule, ModelError> {
    begin(&mut rule, UNKNOWN, classes)?;
    let threshold = rule.number("threshold")?;
    rule.take("share_known", "a number between 0 and 1", |value| {
        value.as_f64().filter(|share| 0.0 < *share && *share < 1.0)
    })?;
    let weights = rule.take("weights", "two numbers, at least 0", |value| {
        let weights = <[f64; 2]>::try_from(list(value, Value::as_f64)?).ok()?;
        weights.iter().all(|weight| *weight >= 0.0).then_some(weights)
    })?;
    rule.count("n_calibration")?;
    rule.text("held_out")?;
    rule.end()?;
    Ok(UnknownRule { weights, threshold })
}

/// Takes what both kinds of rules begin with.
fn begin(rule: &mut Object, format: &str, classes: &[String]) -> Result<(), ModelError> {
    rule.take("format", &format!("'{format}'"), |value| (*value == format).then_some(()))?;
    rule.take("classes", "the labels of the model in their order", |value| {
        list(value, string).filter(|labels| labels == classes)
    })
    .map(drop)
}
