//! What describes a model. None of it changes a score or a label; the rules for whole recordings stand in it.

use std::collections::BTreeMap;

use super::fault::Fault;
use super::file::json;
use crate::error::shown;
use crate::wrench::{axis_name, AXES, UNITS};

/// Longest label, name of an axis, unit, or short text.
pub const MAX_NAME_BYTES: usize = 256;

/// Texts of the metadata that are not part of the computation.
#[derive(Clone, Debug, PartialEq)]
pub struct Notes {
    /// Name of each axis.
    pub axes: Vec<String>,
    /// Unit of each axis; empty where unknown.
    pub units: Vec<String>,
    /// Name of the coding design; empty for a matrix of the user's own.
    pub coding: String,
    /// How probabilities are coupled; empty without sigmoids.
    pub posterior: String,
    /// SHA-256 of the training data, 64 hexadecimal digits, or empty.
    pub training_sha256: String,
    /// Version of the library that trained the model.
    pub library_version: String,
    /// Seconds of rest that were kept ahead of the trigger, where known.
    pub lead_s: Option<f64>,
    /// A JSON object: what was fitted on, options, estimates; under `confidence` the [`Rules`](super::Rules) of the model.
    pub trained: String,
}

/// Entries of the metadata, by name.
#[doc(hidden)]
pub type Entries = BTreeMap<String, String>;

impl Notes {
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
            coding: String::new(),
            posterior: String::new(),
            training_sha256: String::new(),
            library_version: env!("CARGO_PKG_VERSION").to_owned(),
            lead_s: None,
            trained: "{}".to_owned(),
        }
    }

    /// The same with some entries of the metadata replaced.
    pub fn with(&self, texts: BTreeMap<String, String>) -> Result<Self, Fault> {
        let mut entries = self.entries();
        for (key, text) in texts {
            if entries.insert(key.clone(), text).is_none() {
                return Err(Fault::UnknownEntry { key: shown(key.as_bytes()) });
            }
        }
        Self::take(&mut entries)
    }

    /// As entries of the metadata.
    #[doc(hidden)]
    #[must_use]
    pub fn entries(&self) -> Entries {
        let texts = [
            ("axes", json::list(&self.axes)),
            ("units", json::list(&self.units)),
            ("coding", self.coding.clone()),
            ("posterior", self.posterior.clone()),
            ("training_sha256", self.training_sha256.clone()),
            ("library_version", self.library_version.clone()),
            ("lead_s", self.lead_s.map_or_else(String::new, json::number)),
            ("trained", self.trained.clone()),
        ];
        texts.map(|(key, text)| (key.to_owned(), text)).into()
    }

    /// Takes them out of the metadata.
    pub(crate) fn take(entries: &mut Entries) -> Result<Self, Fault> {
        let lead_s = take(entries, "lead_s")?;
        let seconds = || lead_s.parse().ok().filter(|lead_s: &f64| lead_s.is_finite() && *lead_s >= 0.0);
        Ok(Self {
            axes: json::names("axes", &take(entries, "axes")?)?,
            units: json::names("units", &take(entries, "units")?)?,
            coding: take(entries, "coding")?,
            posterior: take(entries, "posterior")?,
            training_sha256: take(entries, "training_sha256")?,
            library_version: take(entries, "library_version")?,
            lead_s: match lead_s.as_str() {
                "" => None,
                text => Some(seconds().ok_or_else(|| Fault::Entry {
                    key: "lead_s",
                    wanted: "seconds, at least 0, or empty".to_owned(),
                    got: shown(text.as_bytes()),
                })?),
            },
            trained: take(entries, "trained")?,
        })
    }

    /// Refuses what cannot be shown, or does not fit the number of axes.
    pub(super) fn check(&self, n_axes: usize) -> Result<(), Fault> {
        for (what, names) in [("axes", &self.axes), ("units", &self.units)] {
            if names.len() != n_axes {
                return Err(Fault::Count { what, least: n_axes, most: n_axes, got: names.len() });
            }
        }
        check_names("axes", &self.axes)?;
        for (index, unit) in self.units.iter().enumerate() {
            if !(unit.is_empty() || printable(unit)) {
                return Err(Fault::Name { what: "units", index, got: shown(unit.as_bytes()) });
            }
        }
        let texts = [
            ("coding", &self.coding),
            ("posterior", &self.posterior),
            ("library_version", &self.library_version),
        ];
        for (key, text) in texts {
            if !(text.is_empty() || printable(text)) {
                let wanted = format!("at most {MAX_NAME_BYTES} bytes of printable text");
                return Err(Fault::Entry { key, wanted, got: shown(text.as_bytes()) });
            }
        }
        let hash = self.training_sha256.as_bytes();
        let hexadecimal = |byte: &u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if !(hash.is_empty() || hash.len() == 64 && hash.iter().all(hexadecimal)) {
            return Err(Fault::Entry {
                key: "training_sha256",
                wanted: "64 hexadecimal digits in lower case, or empty".to_owned(),
                got: shown(hash),
            });
        }
        if let Some(lead_s) = self.lead_s.filter(|lead_s| !(lead_s.is_finite() && *lead_s >= 0.0)) {
            let wanted = "seconds, at least 0, or empty".to_owned();
            return Err(Fault::Entry { key: "lead_s", wanted, got: lead_s.to_string() });
        }
        Ok(())
    }
}

/// Takes an entry that must be there.
pub(super) fn take(entries: &mut Entries, key: &'static str) -> Result<String, Fault> {
    entries.remove(key).ok_or(Fault::MissingEntry { key })
}

/// Refuses names that are empty, long, not printable or there twice.
pub(super) fn check_names(what: &'static str, names: &[String]) -> Result<(), Fault> {
    let mut places = BTreeMap::new();
    for (second, name) in names.iter().enumerate() {
        let got = || shown(name.as_bytes());
        if !printable(name) {
            return Err(Fault::Name { what, index: second, got: got() });
        }
        if let Some(first) = places.insert(name, second) {
            return Err(Fault::Doubled { what, first, second, name: got() });
        }
    }
    Ok(())
}

/// Text that is there, is short, and does nothing to a terminal.
fn printable(text: &str) -> bool {
    (1..=MAX_NAME_BYTES).contains(&text.len()) && !text.chars().any(char::is_control)
}
