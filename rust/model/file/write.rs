//! From a model to bytes: the same model always gives the same ones.

use serde_json::{json, Map, Value};

use super::read::{OPTIONAL, REQUIRED};
use super::{digest, json, spec, DIGEST, DIGESTED, FORMAT, LENGTH_BYTES, MAX_HEADER_BYTES};
use crate::error::Result;
use crate::memory::reserved;
use crate::model::extraction::Extraction;
use crate::model::fault::Fault;
use crate::model::notes::Entries;
use crate::model::trained::Model;

impl Model {
    /// The bytes of a model file. There are no times in it: the same model gives the same bytes, on every machine.
    ///
    /// A file larger than [`MAX_FILE_BYTES`](super::MAX_FILE_BYTES) is read only by callers that allow it.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) where there is no room for them.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let (entries, tensors) = (self.entries(), self.tensors());
        let header = header_of(&entries, BLANK, &tensors);
        let len = tensors.iter().map(|(.., n_values, _)| 8 * n_values).sum::<usize>();
        let mut bytes = reserved(LENGTH_BYTES + header.len() + len)?;
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header.as_bytes());
        for (.., n_values, value) in &tensors {
            bytes.extend((0..*n_values).flat_map(|index| value(index).to_le_bytes()));
        }
        let (ahead, mut rest) = bytes.split_at_mut(LENGTH_BYTES + header.len());
        let stored = tensors.iter().map(|(name, shape, n_values, _)| {
            let own = rest.split_off_mut(..8 * n_values).unwrap_or_default();
            (*name, "F64", shape.as_slice(), &*own)
        });
        let digest = digest::of_content(&entries, stored.collect());
        ahead[LENGTH_BYTES..].copy_from_slice(header_of(&entries, &digest, &tensors).as_bytes());
        Ok(bytes)
    }

    /// Refuses notes and labels too long for a header that is read again.
    pub(in crate::model) fn check_header(&self) -> std::result::Result<(), Fault> {
        let bytes = header_of(&self.entries(), BLANK, &self.tensors()).len();
        if bytes > MAX_HEADER_BYTES {
            return Err(Fault::HeaderSize { bytes: bytes as u64 });
        }
        Ok(())
    }

    /// The metadata without the digest.
    fn entries(&self) -> Entries {
        let mut entries = self.notes.entries();
        let spec = match &self.extraction {
            Extraction::Additive { extractor, .. } => spec::write(extractor.spec()),
            Extraction::MultiBand(multiband) => spec::write_multiband(multiband.spec()),
        };
        let own = [
            ("classes", json::list(&self.classes)),
            ("decoding", self.decoding.name().to_owned()),
            ("feature_spec_sha256", digest::of_text(&spec)),
            ("feature_spec", spec),
            ("format", FORMAT.to_owned()),
            ("format_version", DIGESTED.to_owned()),
            ("loss", self.loss.name().to_owned()),
            ("n_axes", self.n_axes.to_string()),
            ("n_samples", self.n_samples.to_string()),
        ];
        entries.extend(own.map(|(key, text)| (key.to_owned(), text)));
        entries
    }

    /// Name, shape, number of values and values of each tensor, in the order of the file.
    fn tensors(&self) -> Vec<OneTensor<'_>> {
        let (n_classes, n_learners, n_features) = (self.classes.len(), self.n_learners(), self.n_features());
        let mut tensors: Vec<OneTensor<'_>> = vec![
            (
                REQUIRED[0],
                vec![n_classes, n_learners],
                n_classes * n_learners,
                Box::new(move |index| f64::from(self.code(index / n_learners, index % n_learners))),
            ),
            (
                REQUIRED[1],
                vec![n_learners, n_features],
                n_learners * n_features,
                Box::new(move |index| self.weights.coef(index / n_features, index % n_features)),
            ),
            list(REQUIRED[2], self.intercepts()),
        ];
        let [band_scales, early, level_scales, posterior_weights, raw_high, raw_low, raw_mean, sigmoid] =
            OPTIONAL;
        let lists = [
            (posterior_weights, &self.posterior_weights),
            (raw_high, &self.raw_high),
            (raw_low, &self.raw_low),
            (raw_mean, &self.raw_mean),
        ];
        tensors.extend(lists.into_iter().filter_map(|(name, values)| Some(list(name, values.as_ref()?))));
        for (name, pairs) in [(early, &self.early), (sigmoid, &self.sigmoid)] {
            if let Some(pairs) = pairs {
                let values = pairs.as_flattened();
                tensors.push((
                    name,
                    vec![pairs.len(), 2],
                    values.len(),
                    Box::new(move |index| values[index]),
                ));
            }
        }
        if let Some(multiband) = self.multiband() {
            let scales = multiband.scales();
            let shape = vec![multiband.n_bands(), self.n_axes];
            let bands = &scales.bands;
            tensors.push((band_scales, shape, bands.len(), Box::new(move |index| bands[index])));
            tensors.extend(multiband.spec().level.then(|| list(level_scales, &scales.level)));
        }
        tensors.sort_by_key(|(name, ..)| *name);
        tensors
    }
}

/// As long as a digest: stands for it until the numbers behind the header are known.
const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// The header, filled up with blanks so that the numbers behind it are aligned.
fn header_of(entries: &Entries, digest: &str, tensors: &[OneTensor<'_>]) -> String {
    let texts = entries.iter().map(|(key, text)| (key.as_str(), text.as_str())).chain([(DIGEST, digest)]);
    let metadata: Map<_, _> = texts.map(|(key, text)| (key.to_owned(), Value::from(text))).collect();
    let mut header = Map::new();
    header.insert("__metadata__".to_owned(), metadata.into());
    let mut start = 0;
    for (name, shape, n_values, _) in tensors {
        let end = start + 8 * n_values;
        let entry = json!({"data_offsets": [start, end], "dtype": "F64", "shape": shape});
        header.insert((*name).to_owned(), entry);
        start = end;
    }
    let mut text = Value::Object(header).to_string();
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(LENGTH_BYTES) - text.len()));
    text
}

type OneTensor<'a> = (&'static str, Vec<usize>, usize, Box<dyn Fn(usize) -> f64 + 'a>);

fn list<'a>(name: &'static str, values: &'a [f64]) -> OneTensor<'a> {
    (name, vec![values.len()], values.len(), Box::new(move |index| values[index]))
}
