//! A trained model with the Rust crate alone: the same bits as plain numpy and a plain twin, files that come back, and no
//! panic whatever the bytes.
//!
//! `GRANULAR_ID_MODEL_ROWS=FOLDER cargo test --release --test core model` compares a folder that `make_model_golden.py` wrote,
//! `GRANULAR_ID_RULES=FOLDER` one of `make_rules_golden.py`.

// Results are exact.
#![allow(clippy::float_cmp)]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use granular_id::model::{Loss, ModelError, ModelFileError, ModelParts, Tensor, MAX_FILE_BYTES};
use granular_id::stream::StreamingIdentifier;
use granular_id::{Error, FeatureSpec, Model};
use proptest::prelude::*;

#[allow(dead_code)] // its `main`
#[path = "../../examples/identify.rs"]
mod identify;

use crate::twins::models::{damage_is_an_error_or_a_model, no_flipped_bit_is_read, random_model};
use crate::twins::signals::bits;

fn numbers(path: &Path) -> Vec<f64> {
    let bytes = std::fs::read(path).unwrap();
    bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()
}

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/model")
}

#[test]
fn agrees_with_python_bit_for_bit() {
    let folder = std::env::var_os("GRANULAR_ID_MODEL_ROWS").map_or_else(golden, PathBuf::from);
    let path = folder.join("model.safetensors");
    let model = Model::read(&path).unwrap();
    assert_eq!(model.to_bytes().unwrap(), std::fs::read(&path).unwrap());
    let (wrench, scores, losses) = (
        numbers(&folder.join("wrench.f64")),
        numbers(&folder.join("scores.f64")),
        numbers(&folder.join("losses.f64")),
    );
    let n = wrench.len() / (model.n_samples() * model.n_axes());
    let answers = model.identify_batch(&wrench, n, 2).unwrap();
    assert!(n >= 12 && answers.len() == n);
    let expected = scores.chunks_exact(model.n_learners()).zip(losses.chunks_exact(model.classes().len()));
    let mut winners = vec![0; model.classes().len()];
    for (answer, (scores, losses)) in answers.iter().zip(expected) {
        assert_eq!(bits(&answer.scores), bits(scores));
        assert_eq!(bits(&answer.losses), bits(losses));
        let least = losses.iter().copied().fold(f64::INFINITY, f64::min);
        assert_eq!(Some(answer.best), losses.iter().position(|loss| *loss == least));
        winners[answer.best] += 1;
    }
    println!("{n} recordings: 0 differing bits, 0 differing labels; winners {winners:?}");
}

#[test]
fn a_flipped_bit_is_noticed() {
    no_flipped_bit_is_read(&random_model(3, 4, 1, FeatureSpec::default().with_n_bins(2)).to_bytes().unwrap());
}

/// Parts of a small model, to be changed by tests.
struct Small {
    spec: FeatureSpec,
    coef: Vec<f64>,
    intercept: Vec<f64>,
    codes: Vec<f64>,
    classes: Vec<&'static str>,
    loss: Loss,
    n_samples: usize,
    n_axes: usize,
}

impl Small {
    fn new() -> Self {
        Self {
            spec: FeatureSpec::default().with_n_bins(2).with_order(1),
            coef: (0..15).map(f64::from).map(|value| value / 8.0 - 1.0).collect(),
            intercept: vec![0.5, -0.5, 0.0],
            codes: vec![1.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, -1.0],
            classes: vec!["rice", "salt", "peas"],
            loss: Loss::Hinge,
            n_samples: 3,
            n_axes: 1,
        }
    }

    fn parts(&self) -> ModelParts<'_> {
        let (n_learners, n_classes) = (self.intercept.len(), self.classes.len());
        let mut parts = ModelParts::new(
            self.spec.clone(),
            self.n_samples,
            self.n_axes,
            Tensor::new(vec![n_learners, self.coef.len() / n_learners.max(1)], &self.coef),
            Tensor::new(vec![n_learners], &self.intercept),
            Tensor::new(vec![n_classes, n_learners], &self.codes),
            self.classes.iter().map(|label| (*label).to_owned()).collect(),
        );
        parts.loss = self.loss;
        parts
    }

    fn model(&self) -> Result<Model, ModelError> {
        Model::new(self.parts())
    }
}

/// Scores in the order of addition that is promised, one number at a time.
fn twin(model: &Model, wrench: &[f64]) -> Vec<f64> {
    let (n_samples, n_axes, n_raw) = (model.n_samples(), model.n_axes(), model.n_raw());
    let features = model.extractor().unwrap().extract(wrench, model.batch(1), 1).unwrap();
    let score = |learner: usize| {
        let mut raw = 0.0;
        for sample in 0..if n_raw > 0 { n_samples } else { 0 } {
            for axis in 0..n_axes {
                raw += model.coef(learner, axis * n_samples + sample) * wrench[sample * n_axes + axis];
            }
        }
        let mut hist = 0.0;
        for (j, count) in features[n_raw..].iter().enumerate().filter(|(_, count)| **count != 0.0) {
            hist += model.coef(learner, n_raw + j) * count;
        }
        (model.intercepts()[learner] + raw) + hist
    };
    (0..model.n_learners()).map(score).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn scores_are_those_of_the_twin(
        (n_samples, n_axes, n_bins) in (1..20_usize, 1..9_usize, 1..5_usize),
        (raw, hfmh) in prop_oneof![Just((true, true)), Just((true, false)), Just((false, true))],
        n_learners in 1..12_usize,
        n in 1..10_usize,
        seed in prop::collection::vec(-4.0..4.0_f64, 97),
    ) {
        let spec = FeatureSpec::default().with_n_bins(n_bins).with_raw(raw).with_hfmh(hfmh).with_order(3);
        let n_features = if raw { n_samples * n_axes } else { 0 } + if hfmh { n_axes * n_bins } else { 0 };
        let some = |n: usize, step: usize| (0..n).map(|i| seed[i * step % 97]).collect::<Vec<_>>();
        let small = Small {
            spec,
            coef: some(n_learners * n_features, 5),
            intercept: some(n_learners, 3),
            codes: [vec![1.0; n_learners], vec![-1.0; n_learners]].concat(),
            classes: vec!["a", "b"],
            loss: Loss::Hinge,
            n_samples,
            n_axes,
        };
        let model = small.model().unwrap();
        let wrench = some(n * n_samples * n_axes, 7);
        let scores = model.scores(&wrench, n, 2).unwrap();
        for (scores, wrench) in scores.chunks(n_learners).zip(wrench.chunks(n_samples * n_axes)) {
            prop_assert_eq!(bits(scores), bits(&twin(&model, wrench)));
        }
        for learner in 0..n_learners {
            for feature in 0..n_features {
                let expected = small.coef[learner * n_features + feature];
                prop_assert_eq!(model.coef(learner, feature).to_bits(), expected.to_bits());
            }
        }
        let again = Model::from_bytes(&model.to_bytes().unwrap(), MAX_FILE_BYTES).unwrap();
        prop_assert_eq!(again.to_bytes().unwrap(), model.to_bytes().unwrap());
        prop_assert_eq!(again.scores(&wrench, n, 1).unwrap(), scores);
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(Model::from_bytes(&bytes, MAX_FILE_BYTES).is_err());
    }

    #[test]
    fn any_header_is_read_or_refused(header in r#"\{("[a-z_]{0,4}":[\[{"0-9a-z}\],:]{0,9},?){0,6}\}"#, numbers in 0..40_usize) {
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header.bytes());
        bytes.resize(bytes.len() + numbers, 0);
        prop_assert!(Model::from_bytes(&bytes, MAX_FILE_BYTES).is_err());
    }
}

#[test]
fn cut_or_changed_bytes_are_a_model_or_an_error() {
    let good = Small::new().model().unwrap().to_bytes().unwrap();
    damage_is_an_error_or_a_model(&good, &[0.25, -1.0, 2.0], |error| {
        matches!(error, Error::Score { .. } | Error::Length { .. })
    });
}

#[test]
fn errors_tell_what_and_where() {
    type Change = fn(&mut Small);
    let error = |change: Change| {
        let mut small = Small::new();
        change(&mut small);
        small.model().unwrap_err()
    };
    let cases: [(Change, &str); 9] = [
        (|small| small.codes[5] = 2.0, "coding_matrix[1, 2] must be -1, 0 or 1, got 2"),
        (|small| small.codes[3] = 0.0, "coding_matrix column 0 must hold both 1 and -1"),
        (|small| small.coef[7] = f64::INFINITY, "coef[1, 2] must be finite, got inf"),
        (|small| small.classes[2] = "rice", "classes[0] and classes[2] are both 'rice'"),
        (
            |small| small.n_samples = usize::MAX,
            "n_samples must be from 1 to 1048576, got 18446744073709551615",
        ),
        (|small| small.intercept.clear(), "intercept must have shape (L,), one per learner, got [0]"),
        (
            |small| small.coef.truncate(14),
            "coef must have shape (3, 5), as many rows as intercept and 5 features",
        ),
        (|small| small.codes.push(0.0), "coding_matrix must have shape (3, 3), one row per class"),
        (|small| small.spec.n_bins = usize::MAX, "n_bins of all axes together must be from 1 to 1048576"),
    ];
    for (change, message) in cases {
        let error = error(change);
        assert!(
            matches!(error, ModelError::Part { .. }) && error.to_string().starts_with(message),
            "{error}"
        );
    }
    assert_eq!(ModelError::from(Error::Memory { bytes: 8 }).to_string(), "no memory for 8 bytes");
    let rate = error(|small| small.spec.rate_hz = -1.0);
    assert!(matches!(rate, ModelError::Spec(Error::Argument { what: "rate_hz", .. })));
}

#[test]
fn answers_rank_classes_and_ties_go_to_the_first() {
    let mut small = Small::new();
    small.coef = vec![0.0; 15];
    small.intercept = vec![1.0, 1.0, 1.0];
    let answer = small.model().unwrap().identify(&[0.0; 3]).unwrap();
    // Learners say rice over salt, rice over peas, salt over peas.
    assert_eq!((answer.best, answer.ranking()), (0, vec![0, 1, 2]));
    assert_eq!(answer.losses, [0.0, 0.5, 1.0]);
    assert_eq!(answer.margin(), 0.5);
    small.intercept = vec![0.0; 3];
    let answer = small.model().unwrap().identify(&[0.0; 3]).unwrap();
    assert_eq!((answer.best, answer.margin()), (0, 0.0));
}

#[test]
fn wrong_lengths_and_numbers_are_errors() {
    let model = Small::new().model().unwrap();
    assert_eq!(model.identify(&[0.0; 4]), Err(Error::Length { what: "wrench", expected: 3, got: 4 }));
    assert_eq!(
        model.identify(&[0.0, f64::NAN, 0.0]).map_err(|error| error.to_string()),
        Err("wrench must be finite, got NaN at recording 0, sample 1, axis 0".to_owned())
    );
    assert!(matches!(model.identify_batch(&[], 0, 1), Err(Error::Empty { what: "wrench", .. })));
    assert!(matches!(model.scores(&[0.0; 3], 1, 0), Err(Error::Range { what: "threads", .. })));
    let mut losses = [0.0; 3];
    assert_eq!(
        model.decode(&[0.0; 2], &mut losses),
        Err(Error::Length { what: "scores", expected: 3, got: 2 })
    );
    assert_eq!(
        model.decode(&[0.0; 3], &mut losses[..2]),
        Err(Error::Length { what: "losses", expected: 3, got: 2 })
    );
    let wrong = model.decode(&[0.0, f64::INFINITY, 0.0], &mut losses);
    assert_eq!(wrong, Err(Error::Score { recording: 0, learner: 1, value: f64::INFINITY }));
    assert_eq!(model.losses(&[0.0; 4]), Err(Error::Length { what: "scores", expected: 3, got: 4 }));
    let wrong = model.losses(&[0.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0]);
    assert_eq!(wrong, Err(Error::Score { recording: 1, learner: 1, value: f64::INFINITY }));
    let mut out = [0.0; 2];
    assert_eq!(
        model.scores_into(&[0.0; 3], 1, 1, &mut out),
        Err(Error::Length { what: "out", expected: 3, got: 2 })
    );
}

#[test]
fn files_are_named_in_errors() {
    let path = golden().join("none.safetensors");
    let error = Model::read(&path).unwrap_err();
    assert!(matches!(error, ModelFileError::Unreadable { .. }));
    assert!(error.to_string().starts_with(&path.display().to_string()));
    let path = golden().join("wrench.f64");
    assert!(matches!(
        Model::read(&path).unwrap_err(),
        ModelFileError::NoModel { source: ModelError::Foreign { .. }, .. }
    ));
    assert!(matches!(
        Model::read_within(golden().join("model.safetensors"), 100).unwrap_err(),
        ModelFileError::NoModel { source: ModelError::FileSize { max: 100, .. }, .. }
    ));
}

/// A recording as CSV text, its columns in another order than the axes of the model.
fn csv(wrench: &[f64], step_s: f64) -> String {
    let line = |(sample, row): (usize, &[f64])| {
        let [fx, fy, fz, tx, ty, tz] = row.try_into().unwrap();
        format!("{tz:?},{fx:?},{fy:?},{fz:?},{tx:?},{ty:?},{}\n", sample as f64 * step_s)
    };
    let names = "tz,fx,fy,fz,tx,ty,time\n".to_owned();
    std::iter::once(names).chain(wrench.chunks_exact(6).enumerate().map(line)).collect()
}

#[test]
fn the_example_identifies_a_csv_file() {
    let model = Model::read(golden().join("model.safetensors")).unwrap();
    let wrench = &numbers(&golden().join("wrench.f64"))[..120];
    let text = csv(wrench, 0.002);
    assert_eq!(bits(&identify::recording(&model, text.as_bytes()).unwrap()), bits(wrench));
    let path = std::env::temp_dir().join(format!("granular-id-example-{}.csv", std::process::id()));
    std::fs::write(&path, &text).unwrap();
    let lines = identify::identified(&model, path.to_str().unwrap());
    std::fs::remove_file(&path).unwrap();
    let label = &model.classes()[model.identify(wrench).unwrap().best];
    assert!(lines.as_ref().unwrap().contains(&format!(": {label}, by a margin of ")));
    assert_eq!(lines.unwrap().lines().count(), 1 + model.classes().len());
}

/// `pushes.npz` holds the first two recordings of `wrench.f64`, as `granular-id record` would write them.
#[test]
fn the_example_reads_the_files_of_the_package() {
    let model = Model::read(golden().join("model.safetensors")).unwrap();
    let zip = std::fs::read(golden().join("pushes.npz")).unwrap();
    let pushes = identify::archived(&model, &zip).unwrap();
    assert_eq!(bits(&pushes.concat()), bits(&numbers(&golden().join("wrench.f64"))[..240]));
    let lines = identify::identified(&model, golden().join("pushes.npz").to_str().unwrap()).unwrap();
    assert_eq!(lines.lines().count(), 2 * (1 + model.classes().len()));
    for end in 0..zip.len() {
        let problem = identify::archived(&model, &zip[..end]).unwrap_err().to_string();
        assert_eq!(problem, "not an NPZ file as granular-id writes it");
    }
}

/// 60 pushes of known materials and 20 of others, and what the rules in plain numpy say of them.
#[test]
fn the_example_refuses_what_the_package_refuses() {
    let own = || Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/rules");
    let folder = std::env::var_os("GRANULAR_ID_RULES").map_or_else(own, PathBuf::from);
    let model = Arc::new(Model::read(folder.join("model.safetensors")).unwrap());
    let bytes = std::fs::read(folder.join("wrench.f32")).unwrap();
    let values = bytes.as_chunks().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes)));
    let values: Vec<_> = values.collect();
    let wanted = std::fs::read_to_string(folder.join("answers.txt")).unwrap();
    let wanted: Vec<_> = wanted.lines().collect();
    assert_eq!((wanted.len(), values.len()), (80, 80 * 6 * model.n_samples()));
    let mut stream = StreamingIdentifier::new(model.clone(), None).unwrap();
    for (push, wanted) in values.chunks_exact(6 * model.n_samples()).zip(wanted) {
        let text = csv(push, 1.0 / model.rate_hz());
        let answer = model.identify(&identify::recording(&model, text.as_bytes()).unwrap()).unwrap();
        let candidates: Vec<_> =
            answer.candidates.iter().map(|class| model.classes()[*class].as_str()).collect();
        let (best, is_unknown) = (&model.classes()[answer.best], answer.unknown.unwrap());
        let unknown = if is_unknown { "True" } else { "False" };
        assert_eq!(format!("{best}\t{}\t{unknown}", candidates.join(", ")), wanted);
        let words = identify::in_words(&model, &answer);
        assert!(words.starts_with(&if is_unknown {
            format!("like no known material (nearest: {best}), by a margin")
        } else {
            format!("{best}, by a margin")
        }));
        let may_be = format!("; may be {}", candidates.join(" or "));
        assert_eq!(words.ends_with(&may_be), candidates != [best]);
        stream.reset();
        stream.push(&push[..6]).unwrap();
        let early = stream.standing().unwrap();
        assert_eq!((early.candidates, early.unknown), (&[][..], None));
        stream.push(&push[6..]).unwrap();
        let last = stream.standing().unwrap();
        assert_eq!((last.candidates, last.unknown), (&answer.candidates[..], answer.unknown));
    }
}

#[test]
fn the_example_says_what_is_wrong_with_a_csv_file() {
    let model = Model::read(golden().join("model.safetensors")).unwrap();
    let wrench = numbers(&golden().join("wrench.f64"))[..120].to_vec();
    let problem = |text: &str| identify::recording(&model, text.as_bytes()).unwrap_err().to_string();
    assert_eq!(problem(""), "there is no line of names, then numbers");
    assert_eq!(problem("fx,fy\n1,2\n"), "wanted a column fz, got fx, fy");
    assert_eq!(problem(&csv(&wrench[..60], 0.002)), "wanted 20 samples, got 10");
    assert!(problem(&csv(&wrench, 0.01)).starts_with("wanted a sample every 0.002 s, got one every 0.01"));
    assert_eq!(problem(&csv(&wrench, 0.002).replace("0.002", "soon")), "'soon' is not a number");
}
