//! JSON of a file: reading into types derived by serde, and what a model extracts, one line with names in order.

use std::collections::BTreeMap;
use std::fmt::{self, Display};

use serde::de::{Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::ModelError;
use crate::dsp::Outside;
use crate::error::quoted;
use crate::features::{FeatureSpec, Initial};
use crate::multiband::{Block, MultiBandSpec};
use crate::specs::listed;

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

const WHAT: &str = "feature_spec";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PaperJson {
    bin_range: Vec<(f64, f64)>,
    cutoff_hz: f64,
    density: bool,
    hfmh: bool,
    initial: String,
    n_bins: usize,
    order: usize,
    outside: String,
    rate_hz: f64,
    raw: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MultiBandJson {
    blocks: Vec<String>,
    rate_hz: f64,
}

/// Text of samples and histograms.
pub(super) fn write_paper(spec: &FeatureSpec) -> String {
    text(&PaperJson {
        bin_range: spec.bin_ranges.clone(),
        cutoff_hz: spec.cutoff_hz,
        density: spec.density,
        hfmh: spec.hfmh,
        initial: spec.initial.name().to_owned(),
        n_bins: spec.n_bins,
        order: spec.order,
        outside: spec.outside.name().to_owned(),
        rate_hz: spec.rate_hz,
        raw: spec.raw,
    })
}

/// Text of multi-band features.
pub(super) fn write_multiband(spec: &MultiBandSpec) -> String {
    text(&MultiBandJson { blocks: names_of(spec).map(str::to_owned).collect(), rate_hz: spec.rate_hz })
}

fn names_of(spec: &MultiBandSpec) -> impl Iterator<Item = &'static str> + '_ {
    Block::NAMED.into_iter().filter(|(_, block)| spec.wants(*block)).map(|(name, _)| name)
}

fn text(spec: &impl Serialize) -> String {
    // Numbers and texts alone: nothing that serde_json refuses.
    serde_json::to_string(spec).unwrap_or_default()
}

/// Samples and histograms. Values outside their range are found later.
pub(super) fn read_paper(text: &str) -> Result<FeatureSpec, ModelError> {
    let json: PaperJson = parsed_object(WHAT, text)?;
    Ok(FeatureSpec {
        bin_ranges: json.bin_range,
        cutoff_hz: json.cutoff_hz,
        density: json.density,
        hfmh: json.hfmh,
        initial: choice("initial", &json.initial, &Initial::NAMED)?,
        n_bins: json.n_bins,
        order: json.order,
        outside: choice("outside", &json.outside, &Outside::NAMED)?,
        rate_hz: json.rate_hz,
        raw: json.raw,
    })
}

/// Multi-band features, whose blocks are named once each and in order.
pub(super) fn read_multiband(text: &str) -> Result<MultiBandSpec, ModelError> {
    let MultiBandJson { blocks, rate_hz } = parsed_object(WHAT, text)?;
    let spec = MultiBandSpec::of(rate_hz, |block| blocks.iter().any(|name| name == block.name()));
    if !blocks.iter().map(String::as_str).eq(names_of(&spec)) {
        let names = Block::NAMED.map(|(name, _)| name).join(", ");
        let problem = format!("'blocks' must be a list of blocks in the order {names}");
        return Err(ModelError::Json { what: WHAT, problem });
    }
    Ok(spec)
}

fn choice<T: Copy>(name: &str, text: &str, named: &[(&str, T)]) -> Result<T, ModelError> {
    let found = named.iter().find(|(known, _)| *known == text).map(|(_, meaning)| *meaning);
    let problem = || format!("'{name}' must be {}", listed(named));
    found.ok_or_else(|| ModelError::Json { what: WHAT, problem: problem() })
}
