//! Answers of a stream of rows against those of whole recordings.

use std::sync::Arc;

use granular_id::stream::{Standing, StreamingIdentifier};
use granular_id::{Error, FeatureSpec};
use proptest::prelude::*;

use crate::twins::models::{random_model, stream_has_the_scores_of_the_batch};
use crate::twins::signals::{bits, noise, spec, uniform, value};

proptest! {
    #[test]
    fn the_final_answer_is_that_of_the_recording(
        spec in spec(),
        n_classes in 2..6_usize,
        (n_axes, rows) in (1..=7_usize).prop_flat_map(|n| (Just(n), prop::collection::vec(value(), n..60 * n))),
        blocks in prop::collection::vec(0..20_usize, 1..9),
        ask in any::<bool>(),
    ) {
        let n_samples = rows.len() / n_axes;
        let rows = &rows[..n_samples * n_axes];
        let model = Arc::new(random_model(n_classes, n_samples, n_axes, spec));
        let wanted = model.identify(rows).unwrap();
        let mut stream = StreamingIdentifier::new(model, None).unwrap();
        let mut taken = 0;
        for size in blocks.iter().copied().chain([1]).cycle() {
            taken += stream.push(&rows[taken * n_axes..(taken + size).min(n_samples) * n_axes]).unwrap();
            if taken == n_samples {
                break;
            }
            if ask {
                prop_assert!(!stream.standing().unwrap().is_final);
            }
        }
        prop_assert_eq!(bits(stream.scores().unwrap()), bits(&wanted.scores));
        prop_assert_eq!(bits(stream.losses().unwrap()), bits(&wanted.losses));
        let Standing { n_seen, best, margin, is_final, is_settled, .. } = stream.standing().unwrap();
        prop_assert_eq!((n_seen, best, is_final, is_settled), (n_samples, wanted.best, true, true));
        prop_assert_eq!(margin.to_bits(), wanted.margin().to_bits());
    }
}

/// 625 recordings of the paper's size and model, in rows and blocks: a million samples.
#[test]
fn a_million_samples_give_the_scores_of_the_batch() {
    let model = random_model(11, 1600, 6, FeatureSpec::default());
    stream_has_the_scores_of_the_batch(model, &noise(1, 625 * 9600));
}

/// 2^63 rows to skip of two axes each: their number of values is no number of 64 bits.
#[test]
fn rows_before_a_window_are_no_part_of_it_however_far_it_is() {
    let model = Arc::new(random_model(3, 4, 2, FeatureSpec::default()));
    let mut stream = StreamingIdentifier::new(model, Some((1 << 63) + 4)).unwrap();
    stream.push(&[0.5; 8]).unwrap();
    stream.advance().unwrap();
    let before = bits(stream.scores().unwrap());
    assert_eq!(stream.push(&[0.5; 8]).unwrap(), 4);
    assert_eq!((stream.n_seen(), bits(stream.scores().unwrap())), (0, before));
}

#[test]
fn a_refused_row_changes_nothing() {
    let model = Arc::new(random_model(3, 8, 2, FeatureSpec::default()));
    let mut noise = uniform(4);
    let rows: Vec<f64> = (0..16).map(|_| noise()).collect();
    let mut stream = StreamingIdentifier::new(model.clone(), None).unwrap();
    stream.push(&rows[..6]).unwrap();
    let before = stream.scores().unwrap().to_vec();
    let error = stream.push(&[0.0, 0.0, 0.0, f64::INFINITY]).unwrap_err();
    assert_eq!(error, Error::NonFiniteRow { row: 1, axis: 1, value: f64::INFINITY });
    assert_eq!(stream.scores().unwrap(), before);
    stream.push(&rows[6..]).unwrap();
    assert_eq!(stream.scores().unwrap(), model.identify(&rows).unwrap().scores);
}

#[test]
fn the_rule_for_early_answers_is_that_of_the_latest_moment_reached() {
    let model = random_model(2, 4, 1, FeatureSpec { hfmh: false, ..FeatureSpec::default() });
    assert_eq!(
        (model.margin_needed(0), model.margin_needed(1), model.margin_needed(4)),
        (None, Some(0.5), Some(0.5))
    );
    let mut stream = StreamingIdentifier::new(Arc::new(model), None).unwrap();
    assert!(!stream.standing().unwrap().is_sure);
    stream.push(&[1e3]).unwrap();
    assert!(stream.standing().unwrap().is_sure);
}
