//! Features and answers of a stream of rows against those of whole recordings: the same bits, however the rows come.

use std::sync::Arc;

use granular_id::dsp::Outside;
use granular_id::features::Initial;
use granular_id::stream::{Standing, StreamingExtractor, StreamingIdentifier, Windows};
use granular_id::{BatchShape, Error, Extractor, FeatureSpec, SosState};
use proptest::prelude::*;

use crate::twins::models::{random_model, stream_has_the_scores_of_the_batch};
use crate::twins::signals::{bits, noise, spec, uniform, value};

prop_compose! {
    /// Every option of a specification, with ranges for all axes or for each.
    fn extractor(n_axes: usize)(
        spec in spec(),
        density in any::<bool>(),
        ranges in prop::option::of(prop::collection::vec((-3.0..0.5_f64, 0.01..3.0_f64), n_axes)),
    ) -> Extractor {
        let bin_ranges = match ranges {
            Some(ranges) => ranges.into_iter().map(|(low, width)| (low, low + width)).collect(),
            None => spec.bin_ranges.clone(),
        };
        Extractor::new(spec.with_density(density).with_bin_ranges(bin_ranges)).unwrap()
    }
}

prop_compose! {
    /// Rows of a stream, and the sizes of the blocks in which they come.
    fn stream(longest: usize)(n_axes in prop_oneof![2 => Just(6_usize), 1 => 1..=12_usize], n_rows in 1..=longest)(
        extractor in extractor(n_axes),
        rows in prop::collection::vec(value(), n_axes * n_rows),
        blocks in prop::collection::vec(prop_oneof![0..=3_usize, 0..=100_usize], 1..20),
        n_axes in Just(n_axes),
    ) -> (Extractor, usize, Vec<f64>, Vec<usize>) {
        (extractor, n_axes, rows, blocks)
    }
}

/// Pushes blocks of some sizes, over and over, until the window is complete; returns how many rows it took.
fn fill(stream: &mut StreamingExtractor, rows: &[f64], blocks: &[usize]) -> usize {
    let n_axes = stream.windows().n_axes;
    let n_rows = rows.len() / n_axes;
    let mut taken = 0;
    for size in blocks.iter().copied().chain([1]).cycle() {
        if stream.is_complete() || taken == n_rows {
            break;
        }
        let end = n_rows.min(taken + size);
        taken += stream.push(&rows[taken * n_axes..end * n_axes]).unwrap();
    }
    taken
}

fn features(stream: &StreamingExtractor) -> Vec<f64> {
    let mut out = vec![f64::NAN; stream.n_features()];
    stream.features_into(&mut out).unwrap();
    out
}

/// The histograms of a stretch of a filtered stream, by comparison with the edges.
fn counted(extractor: &Extractor, n_axes: usize, filtered: &[f64]) -> Vec<f64> {
    let spec = extractor.spec();
    let mut block = Vec::new();
    for axis in 0..n_axes {
        let bins = extractor.bins(axis).unwrap();
        let clip = |value: &f64| match spec.outside {
            Outside::Clip => value.clamp(bins.low(), bins.high()),
            _ => *value,
        };
        let values: Vec<f64> = filtered.iter().skip(axis).step_by(n_axes).map(clip).collect();
        let mut counts = bins.count(&values);
        let total: f64 = counts.iter().sum();
        if spec.density && total > 0.0 {
            for (count, edges) in counts.iter_mut().zip(bins.edges().windows(2)) {
                *count = *count / (edges[1] - edges[0]) / total;
            }
        }
        block.extend(counts);
    }
    block
}

/// The whole stream through the filter.
fn filtered(extractor: &Extractor, n_axes: usize, rows: &[f64]) -> Vec<f64> {
    let mut state = match extractor.spec().initial {
        Initial::Zero => SosState::zero(extractor.sos(), n_axes).unwrap(),
        _ => SosState::steady(extractor.sos(), &rows[..n_axes]).unwrap(),
    };
    let mut filtered = rows.to_vec();
    state.filter(&mut filtered).unwrap();
    filtered
}

proptest! {
    #[test]
    fn a_window_equals_the_recording((extractor, n_axes, rows, blocks) in stream(90)) {
        let n_samples = rows.len() / n_axes;
        let shape = BatchShape { n_recordings: 1, n_samples, n_axes };
        let wanted = extractor.extract(&rows, shape, 1).unwrap();
        let mut stream = StreamingExtractor::new(&extractor, Windows::new(n_samples, n_axes)).unwrap();
        for _ in 0..2 {
            prop_assert_eq!(fill(&mut stream, &rows, &blocks), n_samples);
            prop_assert_eq!(stream.push(&rows), Ok(0), "a complete window takes nothing");
            prop_assert_eq!(bits(&features(&stream)), bits(&wanted));
            let no_next = matches!(stream.next_window(), Err(Error::NoNextWindow { .. }));
            prop_assert!(no_next);
            stream.reset();
        }
    }

    #[test]
    fn features_so_far_are_those_of_a_shorter_recording((extractor, n_axes, rows, blocks) in stream(60), more in 1..50_usize) {
        let n_seen = rows.len() / n_axes;
        let n_samples = n_seen + more;
        let shape = BatchShape { n_recordings: 1, n_samples: n_seen, n_axes };
        let seen = extractor.extract(&rows, shape, 1).unwrap();
        let mut stream = StreamingExtractor::new(&extractor, Windows::new(n_samples, n_axes)).unwrap();
        fill(&mut stream, &rows, &blocks);
        prop_assert!(!stream.is_complete());
        let raw_len = |n: usize| if extractor.spec().raw { n * n_axes } else { 0 };
        let got = features(&stream);
        let (raw, counts) = got.split_at(raw_len(n_samples));
        let (raw_seen, counts_seen) = seen.split_at(raw_len(n_seen));
        prop_assert_eq!(bits(counts), bits(counts_seen));
        for (raw, raw_seen) in raw.chunks(n_samples).zip(raw_seen.chunks(n_seen)) {
            prop_assert_eq!(bits(&raw[..n_seen]), bits(raw_seen));
            prop_assert!(raw[n_seen..].iter().all(|value| value.to_bits() == 0));
        }
    }

    #[test]
    fn sliding_windows_are_stretches_of_one_filtered_stream(
        (extractor, n_axes, rows, blocks) in stream(200),
        n_samples in 1..=40_usize,
        hop in 1..=60_usize,
    ) {
        let windows = Windows::new(n_samples, n_axes).with_hop(Some(hop));
        let mut stream = StreamingExtractor::new(&extractor, windows).unwrap();
        let filtered = filtered(&extractor, n_axes, &rows);
        let n_rows = rows.len() / n_axes;
        let mut taken = 0;
        for first in (0..).step_by(hop) {
            taken += fill(&mut stream, &rows[taken * n_axes..], &blocks);
            if first + n_samples > n_rows {
                prop_assert!(!stream.is_complete());
                break;
            }
            prop_assert_eq!((taken, stream.first_row()), (first + n_samples, first as u64));
            let stretch = first * n_axes..(first + n_samples) * n_axes;
            let mut wanted = Vec::new();
            if extractor.spec().raw {
                for axis in 0..n_axes {
                    wanted.extend(rows[stretch.clone()].iter().skip(axis).step_by(n_axes));
                }
            }
            if extractor.spec().hfmh {
                wanted.extend(counted(&extractor, n_axes, &filtered[stretch]));
            }
            prop_assert_eq!(bits(&features(&stream)), bits(&wanted), "window from row {}", first);
            stream.next_window().unwrap();
        }
    }

    #[test]
    fn a_refused_block_changes_nothing(
        (extractor, n_axes, rows, blocks) in stream(400),
        at in any::<prop::sample::Index>(),
        bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-f64::MAX), Just(1e100_f64.next_up())],
        before in any::<prop::sample::Index>(),
    ) {
        let n_samples = rows.len() / n_axes;
        let mut stream = StreamingExtractor::new(&extractor, Windows::new(n_samples, n_axes)).unwrap();
        let before = before.index(n_samples);
        stream.push(&rows[..before * n_axes]).unwrap();
        let clean = features(&stream);
        let mut poisoned = rows[before * n_axes..].to_vec();
        let at = at.index(poisoned.len());
        poisoned[at] = bad;
        match stream.push(&poisoned) {
            Err(Error::NonFiniteRow { row, axis, value } | Error::TooLargeRow { row, axis, value, .. }) => {
                prop_assert_eq!((row * n_axes + axis, value.to_bits()), (at, bad.to_bits()));
            }
            other => prop_assert!(false, "{:?}", other),
        }
        prop_assert_eq!(stream.n_seen(), before);
        prop_assert_eq!(bits(&features(&stream)), bits(&clean));
        fill(&mut stream, &rows[before * n_axes..], &blocks);
        let shape = BatchShape { n_recordings: 1, n_samples, n_axes };
        prop_assert_eq!(bits(&features(&stream)), bits(&extractor.extract(&rows, shape, 1).unwrap()));
    }
}

/// 625 recordings of 1600 samples, and the same million samples as one stream in sliding windows.
#[test]
fn a_million_samples_differ_in_no_bit() {
    let shape = BatchShape { n_recordings: 625, n_samples: 1600, n_axes: 6 };
    let mut noise = uniform(1);
    let wrench: Vec<f64> = (0..shape.n_recordings * shape.recording_len()).map(|_| 3.0 * noise()).collect();
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let mut wanted = vec![0.0; shape.n_recordings * 10_200];
    extractor.extract_into(&wrench, shape, 2, &mut wanted).unwrap();
    let mut stream = StreamingExtractor::new(&extractor, Windows::default()).unwrap();
    let blocks: Vec<usize> = (0..997).map(|_| size_of_block(noise())).collect();
    let recordings = wrench.chunks(shape.recording_len()).zip(wanted.chunks(10_200));
    for (k, (recording, wanted)) in recordings.enumerate() {
        assert_eq!(fill(&mut stream, recording, &blocks[k..]), 1600);
        assert!(bits(&features(&stream)) == bits(wanted), "recording {k}");
        stream.reset();
    }

    let filtered = filtered(&extractor, 6, &wrench);
    let windows = Windows::default().with_hop(Some(1000));
    let mut stream = StreamingExtractor::new(&extractor, windows).unwrap();
    let mut taken = 0;
    for first in (0..=1_000_000 - 1600).step_by(1000) {
        taken += fill(&mut stream, &wrench[taken * 6..], &blocks[first / 1000 % 900..]);
        let counts = counted(&extractor, 6, &filtered[first * 6..(first + 1600) * 6]);
        assert!(bits(&features(&stream)[9600..]) == bits(&counts), "window from row {first}");
        stream.next_window().unwrap();
    }
}

/// From a number in [-1/2, 1/2) a block of 1 to 300 rows, mostly small.
fn size_of_block(uniform: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 1 <= size <= 300
    let size = (300.0_f64).powf(uniform + 0.5) as usize;
    size
}

#[test]
fn impossible_windows_are_refused() {
    let new =
        |extractor: &Extractor, windows| StreamingExtractor::new(extractor, windows).map(drop).unwrap_err();
    let paper = Extractor::new(FeatureSpec::default()).unwrap();
    let windows = Windows::default();
    let no_hop = new(&paper, windows.with_hop(Some(0)));
    assert_eq!(no_hop, Error::Range { what: "hop", got: 0, min: 1, max: usize::MAX });
    let empty = Error::Empty { what: "a window", shape: vec![0, 6] };
    assert_eq!(new(&paper, Windows::new(0, 6)), empty);
    let empty = Error::Empty { what: "a window", shape: vec![1600, 0] };
    assert_eq!(new(&paper, Windows::new(1600, 0)), empty);
    for large in [Windows::new(1 << 23, 6), Windows::new(1, 1 << 20)] {
        assert!(matches!(new(&paper, large), Error::Argument { what: "a window", .. }));
    }
    let bin_ranges = vec![(-1.0, 1.0); 3];
    let three = Extractor::new(FeatureSpec::default().with_bin_ranges(bin_ranges)).unwrap();
    assert!(matches!(new(&three, windows), Error::Argument { what: "bin_range", .. }));
}

#[test]
fn wrong_lengths_and_early_steps_are_refused() {
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let windows = Windows::new(4, 6).with_hop(Some(2));
    let mut stream = StreamingExtractor::new(&extractor, windows).unwrap();
    assert_eq!(stream.push(&[0.0; 13]), Err(Error::Length { what: "wrench", expected: 12, got: 13 }));
    assert_eq!(stream.push(&[]), Ok(0));
    assert_eq!(stream.push(&[1.0; 18]), Ok(3));
    assert!(matches!(stream.next_window(), Err(Error::NoNextWindow { .. })));
    assert_eq!(
        stream.features_into(&mut [0.0; 5]),
        Err(Error::Length { what: "out", expected: 624, got: 5 })
    );
    assert_eq!(stream.n_seen(), 3);
    // Only what is taken is looked at: NaN in the row after the window waits for the next one.
    let mut rows = [1.0; 12];
    rows[11] = f64::NAN;
    assert_eq!(stream.push(&rows), Ok(1));
    stream.next_window().unwrap();
    assert_eq!(stream.n_seen(), 2);
    assert!(matches!(stream.push(&rows), Err(Error::NonFiniteRow { row: 1, axis: 5, .. })));
}

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
        let Standing { n_seen, best, margin, is_final, .. } = stream.standing().unwrap();
        prop_assert_eq!((n_seen, best, is_final), (n_samples, wanted.best, true));
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
    stream.next_window().unwrap();
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
fn early_rule_is_that_of_the_latest_moment_reached() {
    let model = random_model(2, 4, 1, FeatureSpec::default().with_hfmh(false));
    assert_eq!(
        (model.margin_needed(0), model.margin_needed(1), model.margin_needed(4)),
        (None, Some(0.5), Some(0.5))
    );
    let mut stream = StreamingIdentifier::new(Arc::new(model), None).unwrap();
    assert!(!stream.standing().unwrap().is_sure);
    stream.push(&[1e3]).unwrap();
    assert!(stream.standing().unwrap().is_sure);
}
