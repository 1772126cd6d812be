//! Models with random weights.

use std::collections::BTreeMap;
use std::sync::Arc;

use granular_id::model::{Features, ModelError, ModelParts, Tensor, MAX_FILE_BYTES};
use granular_id::multiband::{n_bands, Block, MultiBand, MultiBandSpec, Scales};
use granular_id::stream::StreamingIdentifier;
use granular_id::{Error, FeatureSpec, Model};
use safetensors::SafeTensors;
use sha2::{Digest, Sha256};

use super::signals::{bits, uniform};

/// One-vs-one, with everything that provisional answers need.
pub fn random_model(n_classes: usize, n_samples: usize, n_axes: usize, spec: FeatureSpec) -> Model {
    let n_raw = if spec.raw { n_samples * n_axes } else { 0 };
    let n_features = n_raw + if spec.hfmh { n_axes * spec.n_bins } else { 0 };
    random_of(spec.into(), (n_raw, n_features), (n_samples, n_axes), n_classes)
}

/// The same with multi-band features and scales of its own.
pub fn random_banded(n_classes: usize, n_samples: usize, n_axes: usize, spec: MultiBandSpec) -> Model {
    let mut noise = uniform(10);
    let mut scales = |n: usize| (0..n).map(|_| 0.5 + noise().abs()).collect::<Vec<_>>();
    let bands = n_bands(n_samples);
    let scales = Scales { bands: scales(bands * n_axes), level: scales(n_axes) };
    let n_features = MultiBand::new(spec, n_samples, n_axes, &scales).unwrap().n_features();
    let features = Features::MultiBand {
        spec,
        band_scales: Tensor::new(vec![bands, n_axes], &scales.bands),
        level_scales: spec.wants(Block::Level).then(|| Tensor::new(vec![n_axes], &scales.level)),
    };
    random_of(features, (0, n_features), (n_samples, n_axes), n_classes)
}

/// A file with the digest of what it holds in the place of its own, where it has one.
pub fn sealed(file: &[u8]) -> Vec<u8> {
    let mut file = file.to_vec();
    let key: &[u8] = b"\"content_sha256\":\"";
    let place = file.windows(key.len()).position(|text| text == key).map(|start| start + key.len());
    if let Some((place, digest)) = place.zip(digest(&file)).filter(|(place, _)| place + 64 <= file.len()) {
        file[place..place + 64].copy_from_slice(digest.as_bytes());
    }
    file
}

/// The digest of what a file holds, as the page *Model file* of the documentation defines it.
fn digest(file: &[u8]) -> Option<String> {
    let (_, header) = SafeTensors::read_metadata(file).ok()?;
    let entries: BTreeMap<_, _> = header.metadata().as_ref()?.iter().collect();
    let tensors = SafeTensors::deserialize(file).ok()?;
    let tensors: BTreeMap<_, _> = tensors.tensors().into_iter().collect();
    let number = |number: usize| (number as u64).to_le_bytes().to_vec();
    let text = |text: &[u8]| [number(text.len()), text.to_vec()].concat();
    let mut parts = vec![number(entries.len() - 1)];
    for (key, value) in entries.into_iter().filter(|(key, _)| *key != "content_sha256") {
        parts.extend([text(key.as_bytes()), text(value.as_bytes())]);
    }
    parts.push(number(tensors.len()));
    for (name, tensor) in tensors {
        parts.extend([text(name.as_bytes()), text(tensor.dtype().to_string().as_bytes())]);
        parts.push(number(tensor.shape().len()));
        parts.extend(tensor.shape().iter().map(|size| number(*size)));
        parts.push(text(tensor.data()));
    }
    let digits = Sha256::digest(parts.concat()).into_iter().flat_map(|byte| [byte >> 4, byte & 15]);
    digits.map(|digit| char::from_digit(digit.into(), 16)).collect()
}

/// Asserts that a file with any one bit flipped is refused.
pub fn no_flipped_bit_is_read(good: &[u8]) {
    let mut bytes = good.to_vec();
    for bit in 0..8 * good.len() {
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert!(Model::from_bytes(&bytes, good.len()).is_err(), "bit {bit}");
        bytes[bit / 8] = good[bit / 8];
    }
    assert!(Model::from_bytes(&bytes, good.len()).is_ok());
}

/// Asserts that a file that is cut off anywhere is refused, and one with any byte changed and the digest of that is refused
/// or a model whose answers are numbers or such errors as `is_expected`.
pub fn damage_is_an_error_or_a_model(good: &[u8], wrench: &[f64], is_expected: impl Fn(&Error) -> bool) {
    for len in 0..good.len() {
        assert!(Model::from_bytes(&good[..len], MAX_FILE_BYTES).is_err(), "{len} bytes");
    }
    let mut read = 0;
    for place in 0..good.len() {
        for change in [1, 0x20, 0x80, 0xff] {
            let mut bytes = good.to_vec();
            bytes[place] ^= change;
            let Ok(model) = Model::from_bytes(&sealed(&bytes), MAX_FILE_BYTES) else { continue };
            assert_eq!(Model::from_bytes(&model.to_bytes().unwrap(), MAX_FILE_BYTES), Ok(model.clone()));
            match model.identify(wrench) {
                Ok(answer) => assert!(answer.losses.iter().all(|loss| !loss.is_nan())),
                Err(error) => assert!(is_expected(&error), "{error}"),
            }
            read += 1;
        }
    }
    assert!(read > 100); // weights, scales and labels can be many things
}

/// Asserts that recordings of the paper's size, in rows and blocks, have the scores of the batch bit for bit.
pub fn stream_has_the_scores_of_the_batch(model: Model, wrench: &[f64]) {
    let wanted = model.scores(wrench, wrench.len() / 9600, 2).unwrap();
    let mut stream = StreamingIdentifier::new(Arc::new(model), None).unwrap();
    for (k, (recording, wanted)) in wrench.chunks_exact(9600).zip(wanted.chunks_exact(55)).enumerate() {
        for block in recording.chunks(6 * (1 + k % 40)) {
            stream.push(block).unwrap();
        }
        assert!(bits(stream.scores().unwrap()) == bits(wanted), "recording {k}");
        stream.reset();
    }
}

/// A model of two classes and one learner with nothing that a model may lack.
pub fn parts_of(
    features: Features<'_>,
    coef: &[f64],
    n_samples: usize,
    n_axes: usize,
) -> Result<Model, ModelError> {
    let (coef, intercept) = (Tensor::new(vec![1, coef.len()], coef), Tensor::new(vec![1], &[0.0]));
    let codes = Tensor::new(vec![2, 1], &[1.0, -1.0]);
    let classes = vec!["a".to_owned(), "b".to_owned()];
    Model::new(ModelParts::new(features, n_samples, n_axes, coef, intercept, codes, classes))
}

fn random_of(
    features: Features<'_>,
    (n_raw, n_features): (usize, usize),
    (n_samples, n_axes): (usize, usize),
    n_classes: usize,
) -> Model {
    let mut noise = uniform(9);
    let pairs: Vec<_> = (0..n_classes).flat_map(|a| (a + 1..n_classes).map(move |b| (a, b))).collect();
    let n_learners = pairs.len();
    let coef: Vec<f64> = (0..n_learners * n_features).map(|_| noise()).collect();
    let intercept: Vec<f64> = (0..n_learners).map(|_| noise()).collect();
    let mut codes = vec![0.0; n_classes * n_learners];
    for (learner, (a, b)) in pairs.iter().enumerate() {
        codes[a * n_learners + learner] = 1.0;
        codes[b * n_learners + learner] = -1.0;
    }
    let mean: Vec<f64> = (0..n_raw).map(|_| noise()).collect();
    let mut parts = ModelParts::new(
        features,
        n_samples,
        n_axes,
        Tensor::new(vec![n_learners, n_features], &coef),
        Tensor::new(vec![n_learners], &intercept),
        Tensor::new(vec![n_classes, n_learners], &codes),
        (0..n_classes).map(|class| format!("material {class}")).collect(),
    );
    parts.raw_mean = (n_raw > 0).then(|| Tensor::new(vec![n_raw], &mean));
    parts.early = Some(Tensor::new(vec![1, 2], &[1.0, 0.5]));
    "0.1.0".clone_into(&mut parts.metadata.library_version); // not of this release: files have golden digests
    Model::new(parts).unwrap()
}
