//! From bytes to a checked model.

use std::fs;
use std::io::Read;
use std::path::Path;

use safetensors::SafeTensors;

use super::{digest, header, json, spec, ADDITIVE, DIGEST, DIGESTED, FORMAT, MAX_FILE_BYTES, MULTIBAND};
use crate::error::shown;
use crate::model::extraction::Features;
use crate::model::fault::{Fault, FileFault};
use crate::model::loss::{Decoding, Loss};
use crate::model::notes::{take, Entries, Notes};
use crate::model::parts::{ModelParts, Tensor};
use crate::model::trained::Model;
use crate::names::listed;

/// The tensors of every model, then those that it may have.
pub(super) const REQUIRED: [&str; 3] = ["coding_matrix", "coef", "intercept"];
pub(super) const OPTIONAL: [&str; 8] = [
    "band_scales",
    "early",
    "level_scales",
    "posterior_weights",
    "raw_high",
    "raw_low",
    "raw_mean",
    "sigmoid",
];

/// The entries of the metadata, all of which every model has, but for the digest.
const ENTRIES: [&str; 17] = [
    "axes",
    "classes",
    "coding",
    "decoding",
    "feature_spec",
    "feature_spec_sha256",
    "format",
    "format_version",
    "lead_s",
    "library_version",
    "loss",
    "n_axes",
    "n_samples",
    "posterior",
    "trained",
    "training_sha256",
    "units",
];

impl Model {
    /// The model in the bytes of a file, of at most `max_file_bytes` ([`MAX_FILE_BYTES`] is what [`read`](Self::read)
    /// allows).
    ///
    /// Memory stays below twice the size of the file and some megabytes for the header and the edges of the histograms; of
    /// multi-band features below 150 bytes for each value of a recording, of which
    /// [`MAX_MULTIBAND_VALUES`](crate::model::MAX_MULTIBAND_VALUES) are allowed.
    pub fn from_bytes(bytes: &[u8], max_file_bytes: usize) -> Result<Self, Fault> {
        check_size(bytes.len() as u64, max_file_bytes)?;
        let mut entries = header::metadata(header::text(bytes)?)?;
        let version = version(&entries)?;
        let stored = if version == DIGESTED { Some(take(&mut entries, DIGEST)?) } else { None };
        if let Some(key) = entries.keys().find(|key| !ENTRIES.contains(&key.as_str())) {
            return Err(Fault::UnknownEntry { key: shown(key.as_bytes()) });
        }
        let tensors = Tensors(header::tensors(bytes)?);
        let matches = stored.as_ref().is_none_or(|stored| *stored == tensors.digest(&entries));
        // A fuzzer would never get past it.
        if !(matches || cfg!(fuzzing)) {
            return Err(Fault::Hash { what: "what the file holds", key: DIGEST });
        }
        let spec_text = take(&mut entries, "feature_spec")?;
        if digest::of_text(&spec_text) != take(&mut entries, "feature_spec_sha256")? && !cfg!(fuzzing) {
            return Err(Fault::Hash { what: "feature_spec", key: "feature_spec_sha256" });
        }
        let parts = ModelParts {
            features: features(version, &spec_text, &tensors)?,
            n_samples: count(&mut entries, "n_samples")?,
            n_axes: count(&mut entries, "n_axes")?,
            coef: tensors.required("coef")?,
            intercept: tensors.required("intercept")?,
            coding_matrix: tensors.required("coding_matrix")?,
            classes: json::names("classes", &take(&mut entries, "classes")?)?,
            loss: choice(&mut entries, "loss", &Loss::NAMED)?,
            decoding: choice(&mut entries, "decoding", &Decoding::NAMED)?,
            raw_mean: tensors.optional("raw_mean")?,
            raw_low: tensors.optional("raw_low")?,
            raw_high: tensors.optional("raw_high")?,
            early: tensors.optional("early")?,
            sigmoid: tensors.optional("sigmoid")?,
            posterior_weights: tensors.optional("posterior_weights")?,
            notes: Notes::take(&mut entries)?,
        };
        Ok(Self { lacks_digest: stored.is_none(), ..Self::new(parts)? })
    }

    /// The model in a file of at most [`MAX_FILE_BYTES`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileFault> {
        Self::read_within(path, MAX_FILE_BYTES)
    }

    /// The model in a file of at most `max_file_bytes`.
    pub fn read_within(path: impl AsRef<Path>, max_file_bytes: usize) -> Result<Self, FileFault> {
        let path = path.as_ref();
        let unreadable = |source| FileFault::Unreadable { path: path.to_owned(), source };
        let no_model = |fault| FileFault::NoModel { path: path.to_owned(), fault };
        // A pipe or a device has no end that could be waited for; of a folder the system says what is wrong.
        let about = fs::metadata(path).map_err(unreadable)?;
        if !(about.is_file() || about.is_dir()) {
            return Err(no_model(Fault::Foreign { what: "this is no regular file" }));
        }
        check_size(about.len(), max_file_bytes).map_err(no_model)?;
        let mut bytes = Vec::new();
        let most = u64::try_from(max_file_bytes).unwrap_or(u64::MAX).saturating_add(1);
        // It may have grown since.
        fs::File::open(path).and_then(|file| file.take(most).read_to_end(&mut bytes)).map_err(unreadable)?;
        Self::from_bytes(&bytes, max_file_bytes).map_err(no_model)
    }
}

fn check_size(bytes: u64, max: usize) -> Result<(), Fault> {
    if usize::try_from(bytes).is_ok_and(|bytes| bytes <= max) {
        Ok(())
    } else {
        Err(Fault::FileSize { bytes, max })
    }
}

/// The version of a model file, if it is one that is read here.
fn version(entries: &Entries) -> Result<&'static str, Fault> {
    if entries.get("format").map(String::as_str) != Some(FORMAT) {
        return Err(Fault::Foreign { what: "this is a safetensors file of something else" });
    }
    let version = entries.get("format_version").ok_or(Fault::MissingEntry { key: "format_version" })?;
    let known = [ADDITIVE, MULTIBAND, DIGESTED].into_iter().find(|known| known == version);
    known.ok_or_else(|| Fault::Version { got: shown(version.as_bytes()) })
}

/// What is extracted: as the version of the format says it, since the third as the specification does.
fn features<'a>(version: &str, text: &str, tensors: &Tensors<'a>) -> Result<Features<'a>, Fault> {
    let spec = json::object("feature_spec", text)?;
    if version == MULTIBAND || version == DIGESTED && spec::is_multiband(&spec) {
        return Ok(Features::MultiBand {
            spec: spec::read_multiband(spec)?,
            band_scales: tensors.required("band_scales")?,
            level_scales: tensors.optional("level_scales")?,
        });
    }
    for name in ["band_scales", "level_scales"] {
        if tensors.optional(name)?.is_some() {
            return Err(Fault::Alone { name, needed: "multi-band features" });
        }
    }
    Ok(Features::Additive(spec::read(spec)?))
}

/// A whole number as it is written: no sign, no leading zeros.
fn count(entries: &mut Entries, key: &'static str) -> Result<usize, Fault> {
    let text = take(entries, key)?;
    text.parse().ok().filter(|count: &usize| count.to_string() == text).ok_or_else(|| Fault::Entry {
        key,
        wanted: "a whole number".to_owned(),
        got: shown(text.as_bytes()),
    })
}

fn choice<T: Copy>(entries: &mut Entries, key: &'static str, named: &[(&str, T)]) -> Result<T, Fault> {
    let text = take(entries, key)?;
    named.iter().find(|(name, _)| *name == text).map(|(_, meaning)| *meaning).ok_or_else(|| Fault::Entry {
        key,
        wanted: listed(named),
        got: shown(text.as_bytes()),
    })
}

/// The tensors of a file.
struct Tensors<'a>(SafeTensors<'a>);

impl<'a> Tensors<'a> {
    fn optional(&self, name: &'static str) -> Result<Option<Tensor<'a>>, Fault> {
        let Ok(view) = self.0.tensor(name) else { return Ok(None) };
        header::check_dtype(name, view.dtype())?;
        Ok(Some(Tensor::from_bytes(view.shape().to_vec(), view.data())))
    }

    fn required(&self, name: &'static str) -> Result<Tensor<'a>, Fault> {
        self.optional(name)?.ok_or(Fault::MissingTensor { name })
    }

    /// The digest that a file with these tensors and entries should have.
    fn digest(&self, entries: &Entries) -> String {
        let tensors = self.0.tensors();
        let types: Vec<_> = tensors.iter().map(|(_, view)| view.dtype().to_string()).collect();
        let stored = tensors.iter().zip(&types);
        let stored =
            stored.map(|((name, view), dtype)| (name.as_str(), dtype.as_str(), view.shape(), view.data()));
        digest::of_content(entries, stored.collect())
    }
}
