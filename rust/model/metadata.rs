//! What describes a model. None of it changes a score or a label; the rules for whole recordings stand in it.

use std::collections::BTreeMap;

use serde_json::Value;

use super::json::parsed;
use super::ModelError;
use crate::error::quoted;
use crate::wrench::{axis_name, AXES, UNITS};

/// Longest label, name of an axis, unit, or short text.
pub const MAX_NAME_BYTES: usize = 256;

/// Texts of the metadata that are not part of the computation. Made by [`Metadata::of_axes`]; then each can be set.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Metadata {
    /// Name of each axis.
    pub axes: Vec<String>,
    /// Unit of each axis; empty where unknown.
    pub units: Vec<String>,
    /// SHA-256 of the training data, 64 hexadecimal digits, or empty.
    pub training_sha256: String,
    /// Version of the library that trained the model.
    pub library_version: String,
    /// Seconds of rest ahead of the trigger, where known.
    pub lead_s: Option<f64>,
    /// A JSON object: what was fitted on, options, estimates; under `confidence` the [`Rules`](super::Rules) of the model.
    pub trained: String,
}

/// Entries of the metadata, by name.
#[doc(hidden)]
pub type Entries = BTreeMap<String, String>;

impl Metadata {
    /// Nothing known but the axes; those of a wrench have their units.
    #[must_use]
    pub fn of_axes(n_axes: usize) -> Self {
        let n_axes = n_axes.min(super::MAX_AXES + 1); // more are refused
        let units = if n_axes == AXES.len() {
            UNITS.map(str::to_owned).to_vec()
        } else {
            vec![String::new(); n_axes]
        };
        Self {
            axes: (0..n_axes).map(|axis| axis_name(axis, n_axes)).collect(),
            units,
            training_sha256: String::new(),
            library_version: env!("CARGO_PKG_VERSION").to_owned(),
            lead_s: None,
            trained: "{}".to_owned(),
        }
    }

    /// The same with some entries of the metadata replaced.
    pub fn with(&self, texts: BTreeMap<String, String>) -> Result<Self, ModelError> {
        let mut entries = self.entries();
        for (key, text) in texts {
            if entries.insert(key.clone(), text).is_none() {
                return Err(unknown_entry(&key));
            }
        }
        Self::take(&mut entries)
    }

    /// As entries of the metadata.
    #[doc(hidden)]
    #[must_use]
    pub fn entries(&self) -> Entries {
        let texts = [
            ("axes", Value::from(&self.axes[..]).to_string()),
            ("units", Value::from(&self.units[..]).to_string()),
            ("training_sha256", self.training_sha256.clone()),
            ("library_version", self.library_version.clone()),
            ("lead_s", self.lead_s.map_or_else(String::new, |lead_s| Value::from(lead_s).to_string())),
            ("trained", self.trained.clone()),
        ];
        texts.map(|(key, text)| (key.to_owned(), text)).into()
    }

    /// Takes them out of the metadata.
    pub(super) fn take(entries: &mut Entries) -> Result<Self, ModelError> {
        let lead_s = take(entries, "lead_s")?;
        let seconds = || lead_s.parse().ok().filter(|lead_s| is_lead(*lead_s));
        Ok(Self {
            axes: parsed("axes", &take(entries, "axes")?)?,
            units: parsed("units", &take(entries, "units")?)?,
            training_sha256: take(entries, "training_sha256")?,
            library_version: take(entries, "library_version")?,
            lead_s: match lead_s.as_str() {
                "" => None,
                text => Some(seconds().ok_or_else(|| ModelError::must_be("lead_s", LEAD, quoted(text)))?),
            },
            trained: take(entries, "trained")?,
        })
    }

    /// Refuses what cannot be shown, or does not fit the number of axes.
    pub(super) fn check(&self, n_axes: usize) -> Result<(), ModelError> {
        for (what, names) in [("axes", &self.axes), ("units", &self.units)] {
            if names.len() != n_axes {
                return Err(ModelError::must_be(
                    what,
                    format_args!("a list of {n_axes}, one for each axis"),
                    names.len(),
                ));
            }
        }
        check_names("axes", &self.axes)?;
        if let Some(index) = self.units.iter().position(|unit| !(unit.is_empty() || printable(unit))) {
            return Err(bad_name("units", index, &self.units[index]));
        }
        let version = &self.library_version;
        if !(version.is_empty() || printable(version)) {
            let wanted = format_args!("at most {MAX_NAME_BYTES} bytes of printable text");
            return Err(ModelError::must_be("library_version", wanted, quoted(version)));
        }
        let hash = self.training_sha256.as_bytes();
        let hexadecimal = |byte: &u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if !(hash.is_empty() || hash.len() == 64 && hash.iter().all(hexadecimal)) {
            let wanted = "64 hexadecimal digits in lower case, or empty";
            return Err(ModelError::must_be("training_sha256", wanted, quoted(&self.training_sha256)));
        }
        match self.lead_s.filter(|lead_s| !is_lead(*lead_s)) {
            None => Ok(()),
            Some(lead_s) => Err(ModelError::must_be("lead_s", LEAD, lead_s)),
        }
    }
}

const LEAD: &str = "seconds, at least 0, or empty";

fn is_lead(lead_s: f64) -> bool {
    lead_s.is_finite() && lead_s >= 0.0
}

/// Takes an entry that must be there.
pub(super) fn take(entries: &mut Entries, key: &str) -> Result<String, ModelError> {
    entries.remove(key).ok_or_else(|| missing_entry(key))
}

pub(super) fn missing_entry(key: &str) -> ModelError {
    ModelError::part("metadata", format!("must have an entry '{key}'"))
}

pub(super) fn unknown_entry(key: &str) -> ModelError {
    ModelError::part("metadata", format!("has an unknown entry {}", quoted(key)))
}

/// Refuses names that are empty, long, not printable or there twice.
pub(super) fn check_names(what: &str, names: &[String]) -> Result<(), ModelError> {
    let mut places = BTreeMap::new();
    for (second, name) in names.iter().enumerate() {
        if !printable(name) {
            return Err(bad_name(what, second, name));
        }
        if let Some(first) = places.insert(name, second) {
            let problem = format!("and {what}[{second}] are both {}", quoted(name));
            return Err(ModelError::part(format!("{what}[{first}]"), problem));
        }
    }
    Ok(())
}

fn bad_name(what: &str, index: usize, name: &str) -> ModelError {
    let wanted = format_args!("1 to {MAX_NAME_BYTES} bytes of printable text");
    ModelError::must_be(format!("{what}[{index}]"), wanted, quoted(name))
}

/// Text that is there, is short, and does nothing to a terminal.
fn printable(text: &str) -> bool {
    (1..=MAX_NAME_BYTES).contains(&text.len()) && !text.chars().any(char::is_control)
}
