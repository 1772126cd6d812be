//! Models of multi-band features: scores of a plain twin, streams against whole recordings, and their files.

use std::sync::Arc;

use granular_id::model::{Features, ModelError, Tensor, MAX_FILE_BYTES};
use granular_id::multiband::{Block, MultiBandSpec};
use granular_id::stream::StreamingIdentifier;
use granular_id::{Error, Model};
use proptest::prelude::*;

use crate::twins::models::{
    damage_is_an_error_or_a_model, no_flipped_bit_is_read, random_banded, sealed,
    stream_has_the_scores_of_the_batch,
};
use crate::twins::signals::{bits, noise};

/// Any selection of blocks but none.
fn spec() -> impl Strategy<Value = MultiBandSpec> {
    (1..32_u8).prop_map(|bits| MultiBandSpec::of(500.0, |block| bits >> block as u8 & 1 == 1))
}

/// Scores of the beginning of a recording in the order of addition that is promised, one number at a time.
fn twin(model: &Model, rows: &[f64]) -> Vec<f64> {
    let multiband = model.multiband().unwrap();
    let mut features = vec![0.0; multiband.n_features()];
    multiband.extract_into(rows, &mut multiband.workspace().unwrap(), &mut features).unwrap();
    let score = |learner: usize| {
        let mut sum = 0.0;
        for (j, value) in features.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            sum += model.coef(learner, j) * value;
        }
        model.intercepts()[learner] + sum
    };
    (0..model.n_learners()).map(score).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn batch_stream_and_twin_agree_in_every_bit(
        spec in spec(),
        n_classes in 2..6_usize,
        (n_samples, n_axes) in (4..300_usize, 1..7_usize),
        n in 1..6_usize,
        blocks in prop::collection::vec(0..50_usize, 1..9),
        seed in 0..1000_u64,
    ) {
        let fits = |block: Block| spec.wants(block) && n_samples >= block.least_samples(n_axes);
        prop_assume!(Block::NAMED.iter().any(|(_, block)| fits(*block)));
        let model = Arc::new(random_banded(n_classes, n_samples, n_axes, spec));
        let wrench = noise(seed, n * n_samples * n_axes);
        let scores = model.scores(&wrench, n, 2).unwrap();
        prop_assert_eq!(bits(&scores), bits(&model.scores(&wrench, n, 1).unwrap()));
        let again = Model::from_bytes(&model.to_bytes().unwrap(), MAX_FILE_BYTES).unwrap();
        prop_assert_eq!(&again, &*model);
        prop_assert_eq!(again.to_bytes().unwrap(), model.to_bytes().unwrap());
        prop_assert_eq!(bits(&again.scores(&wrench, n, 1).unwrap()), bits(&scores));
        let mut stream = StreamingIdentifier::new(model.clone(), None).unwrap();
        let recordings = wrench.chunks_exact(n_samples * n_axes).zip(scores.chunks_exact(model.n_learners()));
        for (recording, scores) in recordings {
            prop_assert_eq!(bits(scores), bits(&twin(&model, recording)));
            stream.reset();
            let mut taken = 0;
            for size in blocks.iter().copied().chain([1]).cycle() {
                let rows = &recording[taken * n_axes..(taken + size).min(n_samples) * n_axes];
                taken += stream.push(rows).unwrap();
                if taken == n_samples {
                    break;
                }
                if taken > 0 && size > 20 {
                    let so_far = twin(&model, &recording[..taken * n_axes]);
                    prop_assert_eq!(bits(stream.scores().unwrap()), bits(&so_far));
                }
                let standing = stream.standing().unwrap();
                prop_assert!(!standing.is_final);
            }
            prop_assert_eq!(bits(stream.scores().unwrap()), bits(scores));
            let wanted = model.identify(recording).unwrap();
            let standing = stream.standing().unwrap();
            prop_assert_eq!(bits(standing.losses), bits(&wanted.losses));
            prop_assert_eq!((standing.best, standing.is_final), (wanted.best, true));
        }
    }

    #[test]
    fn every_window_of_a_stream_is_a_recording(
        (n_samples, hop) in (8..150_usize, 1..120_usize),
        block in 1..40_usize,
        asks in any::<bool>(),
        seed in 0..1000_u64,
    ) {
        let model = Arc::new(random_banded(3, n_samples, 2, MultiBandSpec::default()));
        let rows = noise(seed, 2 * 400);
        let mut stream = StreamingIdentifier::new(model.clone(), Some(hop)).unwrap();
        let (mut taken, mut windows) = (0, 0);
        while taken < 400 {
            taken += stream.push(&rows[2 * taken..2 * (taken + block).min(400)]).unwrap();
            if asks && taken % 3 == 0 {
                stream.scores().unwrap();
            }
            if stream.is_complete() {
                let first = windows * hop;
                prop_assert_eq!(stream.first_row(), first as u64);
                let wanted = model.scores(&rows[2 * first..2 * (first + n_samples)], 1, 1).unwrap();
                prop_assert_eq!(bits(stream.scores().unwrap()), bits(&wanted));
                stream.next_window().unwrap();
                windows += 1;
            }
        }
        prop_assert_eq!(windows, (400 - n_samples) / hop + 1);
    }
}

/// 200 recordings of the paper's size in rows and blocks.
#[test]
fn recordings_of_the_papers_size_differ_in_no_bit() {
    let model = random_banded(11, 1600, 6, MultiBandSpec::default());
    stream_has_the_scores_of_the_batch(model, &noise(1, 200 * 9600));
}

#[test]
fn refused_rows_change_nothing_and_none_gives_intercepts() {
    let model = Arc::new(random_banded(3, 16, 2, MultiBandSpec::default()));
    let rows = noise(4, 32);
    let mut stream = StreamingIdentifier::new(model.clone(), None).unwrap();
    assert_eq!(stream.scores().unwrap(), model.intercepts());
    stream.push(&rows[..12]).unwrap();
    let before = stream.scores().unwrap().to_vec();
    let error = stream.push(&[0.0, 0.0, 0.0, f64::INFINITY]).unwrap_err();
    assert_eq!(error, Error::NonFiniteRow { row: 1, axis: 1, value: f64::INFINITY });
    assert!(matches!(stream.push(&[0.0; 3]), Err(Error::Length { what: "wrench", expected: 2, got: 3 })));
    assert!(matches!(stream.next_window(), Err(Error::NoNextWindow { .. })));
    assert_eq!(stream.scores().unwrap(), before);
    assert_eq!(stream.push(&rows[12..]).unwrap(), 10);
    assert_eq!(stream.scores().unwrap(), model.identify(&rows).unwrap().scores);
    stream.reset();
    assert_eq!(stream.scores().unwrap(), model.intercepts());
}

#[test]
fn values_too_large_and_wrong_sizes_are_errors() {
    let model = random_banded(3, 16, 2, MultiBandSpec::default());
    let mut wrench = noise(5, 64);
    wrench[40] = 1e200;
    assert!(matches!(model.scores(&wrench, 2, 1), Err(Error::TooLarge { recording: 1, .. })));
    wrench[3] = f64::NAN;
    assert!(matches!(
        model.scores(&wrench, 2, 1),
        Err(Error::NonFinite { recording: 0, sample: 1, axis: 1, .. })
    ));
    assert_eq!(model.scores(&wrench, 1, 1), Err(Error::Length { what: "wrench", expected: 32, got: 64 }));
    assert!(matches!(model.scores(&[], 0, 1), Err(Error::Empty { what: "wrench", .. })));
    assert!(matches!(model.scores(&noise(5, 32), 1, 0), Err(Error::Range { what: "threads", .. })));
    let no_hop = StreamingIdentifier::new(Arc::new(model), Some(0)).map(drop).unwrap_err();
    assert!(matches!(no_hop, Error::Range { what: "hop", .. }));
}

#[test]
fn rows_too_large_are_not_taken() {
    let model = Arc::new(random_banded(3, 16, 2, MultiBandSpec::default()));
    let mut stream = StreamingIdentifier::new(model.clone(), None).unwrap();
    let rows = noise(5, 32);
    let mut loud = rows[..10].to_vec();
    loud[7] = -1e200;
    let error = stream.push(&loud).unwrap_err();
    assert!(matches!(error, Error::TooLargeRow { row: 3, axis: 1, value: -1e200, .. }), "{error}");
    assert_eq!((stream.n_seen(), stream.push(&rows)), (0, Ok(16)));
    // What lies behind the window is not looked at.
    assert_eq!(stream.push(&loud[6..8]), Ok(0));
    assert_eq!(stream.scores().unwrap(), model.scores(&rows, 1, 1).unwrap());
    // Nor are rows between windows.
    let mut stream = StreamingIdentifier::new(model, Some(18)).unwrap();
    stream.push(&rows).unwrap();
    stream.next_window().unwrap();
    assert_eq!(stream.push(&[1e200, 0.0, 0.0, 1e200]), Ok(2));
    let error = stream.push(&[0.0, 0.0, 0.0, 1e200]).unwrap_err();
    assert!(matches!(error, Error::TooLargeRow { row: 1, axis: 1, value: 1e200, .. }), "{error}");
}

#[test]
fn cut_or_changed_bytes_are_a_model_or_an_error() {
    let spec = MultiBandSpec::of(500.0, |block| !matches!(block, Block::Coupling | Block::Spectrum));
    let good = random_banded(3, 5, 1, spec).to_bytes().unwrap();
    no_flipped_bit_is_read(&good);
    damage_is_an_error_or_a_model(&good, &[0.25, -1.0, 2.0, 0.0, 1.0], |error| {
        matches!(error, Error::Score { .. } | Error::TooLarge { .. })
    });
}

/// Why a small file with another header is refused.
fn refused(change: impl FnOnce(String) -> String) -> String {
    let model = random_banded(2, 8, 1, MultiBandSpec::of(500.0, |_| true));
    let good = model.to_bytes().unwrap();
    let end = 8 + usize::try_from(u64::from_le_bytes(*good.first_chunk().unwrap())).unwrap();
    let header = change(std::str::from_utf8(&good[8..end]).unwrap().to_owned());
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.bytes());
    bytes.extend(&good[end..]);
    Model::from_bytes(&sealed(&bytes), MAX_FILE_BYTES).unwrap_err().to_string()
}

#[test]
fn a_small_file_asks_for_no_large_recording() {
    let samples = ("\"n_samples\":\"8\"", "\"n_samples\":\"262144\"");
    let axes = |n: &'static str| ("\"n_axes\":\"1\"", n);
    let cases = [
        (vec![samples], "band_scales must have shape (17, 1)"),
        (
            vec![samples, axes("\"n_axes\":\"2\"")],
            "values of a recording of multi-band features must be from 1 to 262144",
        ),
        (vec![axes("\"n_axes\":\"200\"")], "n_axes of multi-band features must be from 1 to 32, got 200"),
        (vec![("blocks", "bricks")], "feature_spec: is no such JSON: unknown field `bricks`"),
        (vec![("coupling", "coupler")], "feature_spec: 'blocks' must be a list of blocks in the order"),
    ];
    for (changes, message) in cases {
        let error = refused(|mut header| {
            for (from, to) in changes {
                assert_eq!(header.matches(from).count(), 1, "{from} in {header}");
                header = header.replace(from, to);
            }
            header
        });
        assert!(error.starts_with(message), "{error}");
    }
}

#[test]
fn features_that_do_not_fit_are_errors() {
    let model = random_banded(2, 8, 1, MultiBandSpec::default());
    let coef: Vec<f64> = (0..model.n_features()).map(|feature| model.coef(0, feature)).collect();
    let n_bands = granular_id::multiband::n_bands(8);
    let ones = vec![1.0; n_bands + 1];
    let refused = |spec, bands: &[f64], levels: Option<&[f64]>| {
        let features = Features::MultiBand {
            spec,
            band_scales: Tensor::new(vec![bands.len(), 1], bands),
            level_scales: levels.map(|levels| Tensor::new(vec![levels.len()], levels)),
        };
        crate::twins::models::parts_of(features, &coef, 8, 1).unwrap_err()
    };
    let spec = MultiBandSpec::default();
    let level = MultiBandSpec::of(500.0, |_| true);
    let text = |spec, n_bands: usize, levels| refused(spec, &ones[..n_bands], levels).to_string();
    let error = text(spec, n_bands + 1, None);
    assert!(error.starts_with("band_scales must have shape"), "{error}");
    for (value, message) in [
        (0.0, "band_scales must be positive, got 0"),
        (-1.0, "band_scales must be positive, got -1"),
        (f64::NAN, "must be finite, got NaN"),
        (f64::INFINITY, "must be finite, got inf"),
        (1e-200, "must be from 1e-150 to 1e150, got 1e-200"),
    ] {
        let mut scales = vec![1.0; n_bands];
        scales[n_bands - 1] = value;
        let error = refused(spec, &scales, None).to_string();
        assert!(error.contains(message), "{error}");
    }
    for (spec, levels, message) in [
        (level, None, "tensor 'level_scales' is missing"),
        (spec, Some(&[1.0][..]), "level_scales is of no use without the block 'level'"),
        (level, Some(&[1.0, 1.0]), "level_scales must have shape (1,), one per axis, got [2]"),
        (level, Some(&[0.0]), "level_scales must be positive, got 0"),
    ] {
        assert_eq!(text(spec, n_bands, levels), message);
    }
    let none = MultiBandSpec::of(500.0, |_| false);
    assert!(matches!(
        refused(none, &ones[..n_bands], None),
        ModelError::Spec(Error::Argument { what: "blocks", .. })
    ));
    let slow = spec.with_rate_hz(-1.0);
    let slow = refused(slow, &ones[..n_bands], None);
    assert!(matches!(slow, ModelError::Spec(Error::Argument { what: "rate_hz", .. })));
}
