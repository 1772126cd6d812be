//! The model file: safetensors with an exact set of tensors and metadata. The page *Model file* of the documentation describes it.
//!
//! Reading trusts nothing. Sizes are compared with limits before anything is parsed or allocated; a file is read only if it
//! is what the writer could have written, but for the order of entries and the spacing of its JSON.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;

use serde::Deserialize;
use serde_json::value::RawValue;
use serde_json::{json, Value};
use sha2::{Digest, Sha256};

use super::json::{parsed, parsed_object, read_multiband, read_paper, write_multiband, write_paper, Object};
use super::metadata::{missing_entry, take, unknown_entry, Entries};
use super::{
    Extraction, Features, Loss, Metadata, Model, ModelError, ModelFileError, ModelParts, NoveltyParts, Tensor,
};
use crate::error::quoted;
use crate::memory::reserved;
use crate::multiband::Block;
use crate::specs::listed;

/// Bytes of a file that are read unless the caller allows more.
pub const MAX_FILE_BYTES: usize = 32 << 20;

/// Bytes of the header that are read at most.
pub const MAX_HEADER_BYTES: usize = 1 << 20;

/// Bytes ahead of the header: its length.
const LENGTH_BYTES: usize = 8;

/// What the metadata calls the format.
const FORMAT: &str = "granular_id.identifier";

/// The version of the format.
const VERSION: &str = "1";

/// The entry of the metadata that holds the digest of all the rest.
const DIGEST: &str = "content_sha256";

/// The other entries, all of which every model has.
const ENTRIES: [&str; 13] = [
    "axes",
    "classes",
    "feature_spec",
    "format",
    "format_version",
    "lead_s",
    "library_version",
    "loss",
    "n_axes",
    "n_samples",
    "trained",
    "training_sha256",
    "units",
];

/// The tensors of every model, then those that it may have.
const TENSORS: [&str; 10] = [
    "coding_matrix",
    "coef",
    "intercept",
    "band_scales",
    "early",
    "level_scales",
    "raw_mean",
    DIRECTIONS,
    MEANS,
    SCALING,
];

// What the novelty is computed with: float32, behind all others so that those stay aligned.
const DIRECTIONS: &str = "unknown_directions";
const MEANS: &str = "unknown_means";
const SCALING: &str = "unknown_scaling";

impl Model {
    /// The model in a file of at most [`MAX_FILE_BYTES`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, ModelFileError> {
        Self::read_within(path, MAX_FILE_BYTES)
    }

    /// The model in a file of at most `max_file_bytes`.
    pub fn read_within(path: impl AsRef<Path>, max_file_bytes: usize) -> Result<Self, ModelFileError> {
        let path = path.as_ref();
        let unreadable = |source| ModelFileError::Unreadable { path: path.to_owned(), source };
        let no_model = |source| ModelFileError::NoModel { path: path.to_owned(), source };
        // A pipe or a device has no end that could be waited for; opening a folder fails with the reason.
        let stat = fs::metadata(path).map_err(unreadable)?;
        if !(stat.is_file() || stat.is_dir()) {
            return Err(no_model(ModelError::Foreign { what: "this is no regular file" }));
        }
        check_size(stat.len(), max_file_bytes).map_err(no_model)?;
        let mut bytes = Vec::new();
        let most = u64::try_from(max_file_bytes).unwrap_or(u64::MAX).saturating_add(1);
        // It may have grown since.
        fs::File::open(path).and_then(|file| file.take(most).read_to_end(&mut bytes)).map_err(unreadable)?;
        Self::from_bytes(&bytes, max_file_bytes).map_err(no_model)
    }

    /// The model in the bytes of a file, of at most `max_file_bytes` ([`MAX_FILE_BYTES`] is what [`read`](Self::read)
    /// allows).
    ///
    /// Memory stays below twice the size of the file and some megabytes for the header and the edges of the histograms; of
    /// multi-band features below 150 bytes for each value of a recording, of which
    /// [`MAX_MULTIBAND_VALUES`](crate::model::MAX_MULTIBAND_VALUES) are allowed.
    pub fn from_bytes(bytes: &[u8], max_file_bytes: usize) -> Result<Self, ModelError> {
        check_size(bytes.len() as u64, max_file_bytes)?;
        let (header, data) = header(bytes)?;
        let Object(mut parts) = parsed_object::<Object<&RawValue>>("header", header)?;
        let Some(texts) = parts.remove("__metadata__") else {
            return Err(ModelError::Foreign { what: "this is a safetensors file without metadata" });
        };
        let Object(mut entries) = parsed_object::<Object<String>>("metadata", texts.get())?;
        check_version(&entries)?;
        let digest = take(&mut entries, DIGEST)?;
        if let Some(key) = entries.keys().find(|key| !ENTRIES.contains(&key.as_str())) {
            return Err(unknown_entry(key));
        }
        let tensors = Tensors::of(&parts, data)?;
        // A fuzzer would never get past a digest.
        if digest != tensors.digest(&entries) && !cfg!(fuzzing) {
            return Err(ModelError::Damaged);
        }
        let parts = ModelParts {
            features: tensors.features(&take(&mut entries, "feature_spec")?)?,
            n_samples: count(&mut entries, "n_samples")?,
            n_axes: count(&mut entries, "n_axes")?,
            coef: tensors.required("coef")?,
            intercept: tensors.required("intercept")?,
            coding_matrix: tensors.required("coding_matrix")?,
            classes: parsed("classes", &take(&mut entries, "classes")?)?,
            loss: choice(&mut entries, "loss", &Loss::NAMED)?,
            raw_mean: tensors.optional("raw_mean")?,
            early: tensors.optional("early")?,
            novelty: tensors.novelty()?,
            metadata: Metadata::take(&mut entries)?,
        };
        Self::new(parts)
    }
}

fn check_size(bytes: u64, max: usize) -> Result<(), ModelError> {
    if usize::try_from(bytes).is_ok_and(|bytes| bytes <= max) {
        Ok(())
    } else {
        Err(ModelError::FileSize { bytes, max })
    }
}

/// The text of the header, once its length is known to be possible, and the numbers behind it.
fn header(bytes: &[u8]) -> Result<(&str, &[u8]), ModelError> {
    // A safetensors file may begin with any bytes, but not have a brace missing.
    if bytes.get(LENGTH_BYTES) != Some(&b'{') {
        let what = match bytes {
            [] => "the file is empty",
            [0x80, 2..=5, ..] => "this is a pickle, which may run code and is never read",
            [b'P', b'K', 3, 4, ..] => "this is a zip archive (an .npz or a .pt file?)",
            [0x89, b'H', b'D', b'F', ..] => "this is an HDF5 file",
            _ => "this is no safetensors file: it has no header",
        };
        return Err(ModelError::Foreign { what });
    }
    let (length, rest) = bytes.split_first_chunk::<LENGTH_BYTES>().unwrap_or((&[0; LENGTH_BYTES], &[]));
    let length = u64::from_le_bytes(*length);
    let Some((text, data)) = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length))
    else {
        let left = rest.len();
        let problem = format!(
            "should have {length} bytes, {left} are left in the file: it is cut off, or no safetensors file"
        );
        return Err(ModelError::part("the header", problem));
    };
    check_header_size(text.len())?;
    let no_text = |error| ModelError::part("the header", format!("is no UTF-8 text: {error}"));
    Ok((str::from_utf8(text).map_err(no_text)?, data))
}

fn check_header_size(bytes: usize) -> Result<(), ModelError> {
    if bytes <= MAX_HEADER_BYTES {
        return Ok(());
    }
    Err(ModelError::part("the header", format!("has {bytes} bytes; at most {MAX_HEADER_BYTES} are allowed")))
}

/// Refuses what is no model file, and one of another version.
fn check_version(entries: &Entries) -> Result<(), ModelError> {
    if entries.get("format").map(String::as_str) != Some(FORMAT) {
        return Err(ModelError::Foreign { what: "this is a safetensors file of something else" });
    }
    let version = entries.get("format_version").ok_or_else(|| missing_entry("format_version"))?;
    if version == VERSION {
        return Ok(());
    }
    Err(ModelError::Version { reads: VERSION, got: quoted(version) })
}

/// A whole number as it is written: no sign, no leading zeros.
fn count(entries: &mut Entries, key: &str) -> Result<usize, ModelError> {
    let text = take(entries, key)?;
    let count = text.parse().ok().filter(|count: &usize| count.to_string() == text);
    count.ok_or_else(|| ModelError::must_be(key, "a whole number", quoted(&text)))
}

fn choice<T: Copy>(entries: &mut Entries, key: &str, named: &[(&str, T)]) -> Result<T, ModelError> {
    let text = take(entries, key)?;
    let choice = named.iter().find(|(name, _)| *name == text).map(|(_, meaning)| *meaning);
    choice.ok_or_else(|| ModelError::must_be(key, listed(named), quoted(&text)))
}

/// Tensors that do not lie side by side from the header to the end of the file.
fn not_filled(problem: &str) -> ModelError {
    ModelError::part("the tensors", format!("do not fill the file exactly: {problem}"))
}

/// Type, shape and place of a tensor, as a header has them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Place {
    data_offsets: [usize; 2],
    dtype: String,
    shape: Vec<usize>,
}

/// The tensors of a file by their names, with their bytes.
struct Tensors<'a>(BTreeMap<&'a str, (Place, &'a [u8])>);

impl<'a> Tensors<'a> {
    /// Those of a file, which fill it from the header to its end without gaps and overlaps.
    fn of(parts: &'a BTreeMap<String, &RawValue>, data: &'a [u8]) -> Result<Self, ModelError> {
        let mut tensors = BTreeMap::new();
        for (name, text) in parts {
            if !TENSORS.contains(&name.as_str()) {
                return Err(ModelError::part(format!("tensor {}", quoted(name)), "is unknown"));
            }
            let place: Place = parsed_object("header", text.get())?;
            let [start, end] = place.data_offsets;
            let Some(bytes) = data.get(start..end) else {
                let problem = format!("'{name}' lies from byte {start} to {end} of {}", data.len());
                return Err(not_filled(&problem));
            };
            tensors.insert(name.as_str(), (place, bytes));
        }
        let mut places: Vec<_> = tensors.values().map(|(place, _)| place.data_offsets).collect();
        places.sort_unstable();
        let end = places.iter().try_fold(0, |end, [start, next]| (*start == end).then_some(*next));
        if end != Some(data.len()) {
            return Err(not_filled("there are gaps or overlaps"));
        }
        Ok(Self(tensors))
    }

    fn optional(&self, name: &str) -> Result<Option<Tensor<'a>>, ModelError> {
        let Some((Place { dtype, shape, .. }, bytes)) = self.0.get(name) else { return Ok(None) };
        let (wanted, words, size) = match name {
            DIRECTIONS | MEANS | SCALING => ("F32", "float32 (F32)", size_of::<f32>()),
            _ => ("F64", "float64 (F64)", size_of::<f64>()),
        };
        if dtype != wanted {
            return Err(ModelError::must_be(format!("tensor '{name}'"), words, quoted(dtype)));
        }
        let len = shape.iter().try_fold(size, |len, n| len.checked_mul(*n));
        if len != Some(bytes.len()) {
            return Err(not_filled(&format!("'{name}' has {} bytes", bytes.len())));
        }
        let of = if wanted == "F32" { Tensor::of_singles } else { Tensor::of_doubles };
        Ok(Some(of(shape.clone(), bytes)))
    }

    /// What the novelty is computed with: three tensors or none.
    fn novelty(&self) -> Result<Option<NoveltyParts<'a>>, ModelError> {
        if [DIRECTIONS, MEANS, SCALING].iter().all(|name| !self.0.contains_key(name)) {
            return Ok(None);
        }
        let [directions, means, scaling] = [DIRECTIONS, MEANS, SCALING].map(|name| self.required(name));
        Ok(Some(NoveltyParts { scaling: scaling?, directions: directions?, means: means? }))
    }

    fn required(&self, name: &str) -> Result<Tensor<'a>, ModelError> {
        self.optional(name)?.ok_or_else(|| ModelError::missing_tensor(name))
    }

    /// What is extracted: multi-band features have scales.
    fn features(&self, spec: &str) -> Result<Features<'a>, ModelError> {
        let Some(band_scales) = self.optional("band_scales")? else {
            if self.0.contains_key("level_scales") {
                return Err(ModelError::no_use("level_scales", "multi-band features"));
            }
            return Ok(Features::Paper(read_paper(spec)?));
        };
        let level_scales = self.optional("level_scales")?;
        Ok(Features::MultiBand { spec: read_multiband(spec)?, band_scales, level_scales })
    }

    /// The digest that a file with these tensors and entries should have.
    fn digest(&self, entries: &Entries) -> String {
        let stored = self.0.iter();
        digest(entries, stored.map(|(name, (place, bytes))| (*name, &*place.dtype, &*place.shape, *bytes)))
    }
}

impl Model {
    /// The bytes of a model file. There are no times in it: the same model gives the same bytes, on every machine.
    ///
    /// A file larger than [`MAX_FILE_BYTES`] is read only by callers that allow it.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) where there is no room for them.
    pub fn to_bytes(&self) -> crate::Result<Vec<u8>> {
        let (entries, tensors) = (self.entries(), self.tensors());
        let header = header_of(&entries, BLANK, &tensors);
        let len = tensors.iter().map(OneTensor::n_bytes).sum::<usize>();
        let mut bytes = reserved(LENGTH_BYTES + header.len() + len)?;
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header.as_bytes());
        for tensor in &tensors {
            match &tensor.value {
                Values::Double(value) => {
                    let places = 0..tensor.shape.iter().product();
                    bytes.extend(places.flat_map(|index| value(index).to_le_bytes()));
                }
                Values::Single(values) => bytes.extend(values.iter().flat_map(|value| value.to_le_bytes())),
            }
        }
        let (ahead, mut rest) = bytes.split_at_mut(LENGTH_BYTES + header.len());
        let stored = tensors.iter().map(|tensor| {
            let own = rest.split_off_mut(..tensor.n_bytes()).unwrap_or_default();
            (tensor.name, tensor.dtype(), &*tensor.shape, &*own)
        });
        let digest = digest(&entries, stored);
        ahead[LENGTH_BYTES..].copy_from_slice(header_of(&entries, &digest, &tensors).as_bytes());
        Ok(bytes)
    }

    /// Refuses metadata and labels too long for a header that is read again.
    pub(super) fn check_header(&self) -> Result<(), ModelError> {
        check_header_size(header_of(&self.entries(), BLANK, &self.tensors()).len())
    }

    /// The metadata without the digest.
    fn entries(&self) -> Entries {
        let mut entries = self.metadata.entries();
        let spec = match &self.extraction {
            Extraction::Paper { extractor, .. } => write_paper(extractor.spec()),
            Extraction::MultiBand(multiband) => write_multiband(multiband.spec()),
        };
        let own = [
            ("classes", Value::from(&self.classes[..]).to_string()),
            ("feature_spec", spec),
            ("format", FORMAT.to_owned()),
            ("format_version", VERSION.to_owned()),
            ("loss", self.loss.name().to_owned()),
            ("n_axes", self.n_axes.to_string()),
            ("n_samples", self.n_samples.to_string()),
        ];
        entries.extend(own.map(|(key, text)| (key.to_owned(), text)));
        entries
    }

    /// The tensors by their names, as they stand in the file.
    fn tensors(&self) -> Vec<OneTensor<'_>> {
        let (n_classes, n_learners, n_features) = (self.classes.len(), self.n_learners(), self.n_features());
        let mut tensors = vec![
            OneTensor::new("coding_matrix", vec![n_classes, n_learners], move |index| {
                f64::from(self.code(index / n_learners, index % n_learners))
            }),
            OneTensor::new("coef", vec![n_learners, n_features], move |index| {
                self.coef(index / n_features, index % n_features)
            }),
            OneTensor::list("intercept", self.intercepts()),
        ];
        tensors.extend(self.raw_mean().map(|mean| OneTensor::list("raw_mean", mean)));
        tensors
            .extend(self.early().map(|rows| {
                OneTensor::new("early", vec![rows.len(), 2], |index| rows[index / 2][index % 2])
            }));
        if let Some(multiband) = self.multiband() {
            let scales = multiband.scales();
            let shape = vec![multiband.n_bands(), self.n_axes];
            tensors.push(OneTensor::new("band_scales", shape, |index| scales.bands[index]));
            tensors.extend(
                multiband.spec().wants(Block::Level).then(|| OneTensor::list("level_scales", &scales.level)),
            );
        }
        for (name, (n_rows, values)) in
            [SCALING, DIRECTIONS, MEANS].into_iter().zip(self.novelty().into_iter().flatten())
        {
            tensors.push(OneTensor { name, shape: vec![n_rows, n_features], value: Values::Single(values) });
        }
        tensors.sort_by_key(|tensor| tensor.name);
        tensors
    }
}

/// A tensor to be written, its values by their places.
struct OneTensor<'a> {
    name: &'static str,
    shape: Vec<usize>,
    value: Values<'a>,
}

enum Values<'a> {
    Double(Box<dyn Fn(usize) -> f64 + 'a>),
    Single(Vec<f32>),
}

impl<'a> OneTensor<'a> {
    fn new(name: &'static str, shape: Vec<usize>, value: impl Fn(usize) -> f64 + 'a) -> Self {
        Self { name, shape, value: Values::Double(Box::new(value)) }
    }

    fn list(name: &'static str, values: &'a [f64]) -> Self {
        Self::new(name, vec![values.len()], |index| values[index])
    }

    fn dtype(&self) -> &'static str {
        match self.value {
            Values::Double(_) => "F64",
            Values::Single(_) => "F32",
        }
    }

    fn n_bytes(&self) -> usize {
        let size = match self.value {
            Values::Double(_) => size_of::<f64>(),
            Values::Single(_) => size_of::<f32>(),
        };
        size * self.shape.iter().product::<usize>()
    }
}

/// As long as a digest: stands for it until the numbers behind the header are known.
const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// The header, filled up with blanks so that the numbers behind it are aligned.
fn header_of(entries: &Entries, digest: &str, tensors: &[OneTensor<'_>]) -> String {
    // Sorted here: another crate of the program may make serde_json preserve the order of insertion.
    let mut metadata: BTreeMap<_, _> = entries.iter().map(|(key, text)| (&**key, &**text)).collect();
    metadata.insert(DIGEST, digest);
    let mut header = BTreeMap::from([("__metadata__", json!(metadata))]);
    let mut start = 0;
    for tensor in tensors {
        let end = start + tensor.n_bytes();
        let entry = json!({"data_offsets": [start, end], "dtype": tensor.dtype(), "shape": tensor.shape});
        header.insert(tensor.name, entry);
        start = end;
    }
    let mut text = json!(header).to_string();
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(LENGTH_BYTES) - text.len()));
    text
}

/// SHA-256 in hexadecimal digits of the metadata and the tensors (name, type, shape, bytes), both in the order of their
/// names. Each text has its length ahead, each list its size: no part can pass for another. Order and spacing of the header
/// are not part of it.
fn digest<'a>(
    entries: &Entries,
    tensors: impl ExactSizeIterator<Item = (&'a str, &'a str, &'a [usize], &'a [u8])>,
) -> String {
    fn number(hash: &mut Sha256, number: usize) {
        hash.update((number as u64).to_le_bytes());
    }
    fn text(hash: &mut Sha256, bytes: &[u8]) {
        number(hash, bytes.len());
        hash.update(bytes);
    }
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
    let digits = hash.finalize().into_iter().flat_map(|byte| [byte >> 4, byte & 15]);
    digits.filter_map(|digit| char::from_digit(digit.into(), 16)).collect()
}
