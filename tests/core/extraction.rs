//! Extraction against a plain twin: one lane at a time, comparisons instead of arithmetic.

use granular_id::dsp::Outside;
use granular_id::features::Initial;
use granular_id::{BatchShape, Error, Extractor, FeatureSpec, SimdPath, SosState, UniformBins};
use proptest::prelude::*;

use crate::twins::signals::{bits, spec, uniform, value};

/// What [`Extractor`] promises, written out without lanes, blocks or threads.
fn twin(extractor: &Extractor, wrench: &[f64], shape: BatchShape) -> Vec<f64> {
    let spec = extractor.spec();
    let mut features = Vec::new();
    for recording in wrench.chunks(shape.recording_len()) {
        let axis = |a: usize| recording.iter().skip(a).step_by(shape.n_axes).copied().collect::<Vec<_>>();
        if spec.raw {
            features.extend((0..shape.n_axes).flat_map(axis));
        }
        for a in (0..shape.n_axes).filter(|_| spec.hfmh) {
            let mut signal = axis(a);
            let mut state = match spec.initial {
                Initial::Zero => SosState::zero(extractor.sos(), 1).unwrap(),
                _ => SosState::steady(extractor.sos(), &signal[..1]).unwrap(),
            };
            state.filter(&mut signal).unwrap();
            features.extend(counts(extractor.bins(a).unwrap(), &signal, spec.outside));
        }
    }
    features
}

fn counts(bins: &UniformBins, signal: &[f64], outside: Outside) -> Vec<f64> {
    let edges = bins.edges();
    let last = bins.n_bins() - 1;
    let mut counts = vec![0.0; bins.n_bins()];
    for value in signal {
        let value = if outside == Outside::Clip { value.clamp(bins.low(), bins.high()) } else { *value };
        let inside =
            |i: &usize| edges[*i] <= value && (value < edges[i + 1] || *i == last && value <= edges[i + 1]);
        if let Some(bin) = (0..=last).find(inside) {
            counts[bin] += 1.0;
        }
    }
    counts
}

prop_compose! {
    fn batch()(n_axes in prop_oneof![3 => Just(6_usize), 1 => 1..=30_usize], n_recordings in 1..=11_usize, n_samples in 1..=40_usize)(
        wrench in prop::collection::vec(value(), n_axes * n_recordings * n_samples),
        shape in Just(BatchShape { n_recordings, n_samples, n_axes }),
    ) -> (Vec<f64>, BatchShape) {
        (wrench, shape)
    }
}

proptest! {
    #[test]
    fn every_path_and_thread_count_equals_the_twin(spec in spec(), (wrench, shape) in batch()) {
        let extractor = Extractor::new(spec).unwrap();
        let wanted = twin(&extractor, &wrench, shape);
        for path in SimdPath::available() {
            for threads in [1, 2, 3] {
                let mut out = vec![f64::NAN; wanted.len()];
                extractor.extract_on(path, &wrench, shape, threads, &mut out).unwrap();
                prop_assert_eq!(bits(&out), bits(&wanted), "{:?}, {} threads", path, threads);
            }
        }
    }

    #[test]
    fn the_first_bad_value_is_named(
        (mut wrench, shape) in batch(),
        at in any::<prop::sample::Index>(),
        bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        (raw, hfmh) in prop_oneof![Just((true, true)), Just((true, false)), Just((false, true))],
    ) {
        let at = at.index(wrench.len());
        wrench[at] = bad;
        let extractor = Extractor::new(FeatureSpec::default().with_raw(raw).with_hfmh(hfmh)).unwrap();
        for path in SimdPath::available() {
            let mut out = vec![0.0; shape.n_recordings * extractor.n_features(shape.n_samples, shape.n_axes).unwrap()];
            let error = extractor.extract_on(path, &wrench, shape, 2, &mut out).unwrap_err();
            let Error::NonFinite { recording, sample, axis, value } = error else {
                return Err(TestCaseError::fail(format!("{error}")));
            };
            let index = (recording * shape.n_samples + sample) * shape.n_axes + axis;
            prop_assert_eq!((index, value.to_bits()), (at, bad.to_bits()));
        }
    }
}

#[test]
fn millions_of_samples_are_the_same_on_every_path() {
    let shape = BatchShape { n_recordings: 260, n_samples: 1600, n_axes: 6 };
    let mut uniform = uniform(1);
    let wrench: Vec<f64> = (0..shape.n_recordings * shape.recording_len()).map(|_| 3.0 * uniform()).collect();
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let wanted = bits(&twin(&extractor, &wrench, shape));
    for path in SimdPath::available() {
        let mut out = vec![0.0; wanted.len()];
        extractor.extract_on(path, &wrench, shape, 2, &mut out).unwrap();
        assert!(bits(&out) == wanted, "{path:?}");
    }
}

/// Results above 8 MB are written past the caches, where they are whole lines; `offset` moves them off those.
#[test]
fn large_results_are_those_of_single_recordings() {
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    for (n_samples, offset, threads) in [(1600, 0, 1), (1600, 4, 2), (1600, 3, 1), (1608, 0, 2), (1003, 0, 1)]
    {
        let n_recordings = 1_300_000 / (n_samples * 6);
        let shape = BatchShape { n_recordings, n_samples, n_axes: 6 };
        let wrench: Vec<f64> = (0..n_recordings * n_samples * 6).map(|n| (0.37 * n as f64).sin()).collect();
        let n_features = extractor.n_features(n_samples, 6).unwrap();
        let mut all = vec![7.0; n_recordings * n_features + 8];
        let out = &mut all[offset..][..n_recordings * n_features];
        extractor.extract_into(&wrench, shape, threads, out).unwrap();
        let one = BatchShape { n_recordings: 1, ..shape };
        for (row, recording) in out.chunks_exact(n_features).zip(wrench.chunks_exact(n_samples * 6)) {
            assert_eq!(bits(row), bits(&extractor.extract(recording, one, 1).unwrap()));
        }
        let around = all[..offset].iter().chain(&all[offset + n_recordings * n_features..]);
        assert!(
            around.copied().all(|value| value.to_bits() == 7.0_f64.to_bits()),
            "{shape:?}, offset {offset}"
        );
    }
}

#[test]
fn silent_axes_and_useless_ranges_are_counted_exactly() {
    let shape = BatchShape { n_recordings: 5, n_samples: 200, n_axes: 6 };
    let noise = |i: i32| f64::from(i.wrapping_mul(7919) % 1000) / 400.0 - 1.2;
    let wrench: Vec<f64> = (0..6000).map(|i| if i % 6 == 2 || i > 4000 { 0.0 } else { noise(i) }).collect();
    for bin_ranges in [vec![(-1.5, 1.5)], vec![(1e15, 1e15 + 1024.0)], vec![(-1e-308, 2e-313)]] {
        for n_bins in [2, 100, 101] {
            let spec = FeatureSpec::default().with_n_bins(n_bins).with_bin_ranges(bin_ranges.clone());
            let extractor = Extractor::new(spec).unwrap();
            let wanted = twin(&extractor, &wrench, shape);
            for path in SimdPath::available() {
                let mut out = vec![0.0; wanted.len()];
                extractor.extract_on(path, &wrench, shape, 1, &mut out).unwrap();
                assert_eq!(bits(&out), bits(&wanted), "{path:?} {n_bins} {bin_ranges:?}");
            }
        }
    }
}

#[test]
fn unfiltered_histograms_are_exact_at_every_edge() {
    for (n_bins, low, high) in [(100, -1.5, 1.5), (7, -0.2, 0.5), (3, 1.0, 2.0), (4, -1e-300, 1e-300)] {
        let bins = UniformBins::new(n_bins, low, high).unwrap();
        let edges = bins.edges().iter().flat_map(|edge| [edge.next_down(), *edge, edge.next_up()]);
        let values: Vec<f64> =
            edges.chain([0.0, -0.0, 5e-324, -5e-324, 1e-12, -1e-12, 9.0, f64::MAX, f64::MIN]).collect();
        for outside in [Outside::Drop, Outside::Clip] {
            let bin_ranges = vec![(low, high)];
            let spec = FeatureSpec::default()
                .with_n_bins(n_bins)
                .with_bin_ranges(bin_ranges)
                .with_outside(outside)
                .with_raw(false);
            let extractor = Extractor::new(spec).unwrap().unfiltered();
            for n_axes in [5, 6, 12, 24] {
                let wanted = counts(&bins, &values, outside).repeat(n_axes);
                let wrench: Vec<f64> = values.iter().flat_map(|value| vec![*value; n_axes]).collect();
                let shape = BatchShape { n_recordings: 1, n_samples: values.len(), n_axes };
                for path in SimdPath::available() {
                    let mut out = vec![f64::NAN; wanted.len()];
                    extractor.extract_on(path, &wrench, shape, 1, &mut out).unwrap();
                    assert_eq!(bits(&out), bits(&wanted), "{path:?} {n_bins} {outside:?} {n_axes}");
                }
            }
        }
    }
}

#[test]
fn ranges_may_differ_by_axis() {
    let bin_ranges = (1..=6).map(|axis| (-0.3 * f64::from(axis), 0.2 * f64::from(axis))).collect();
    let spec = FeatureSpec::default().with_bin_ranges(bin_ranges);
    let extractor = Extractor::new(spec).unwrap();
    let shape = BatchShape { n_recordings: 5, n_samples: 64, n_axes: 6 };
    let wrench: Vec<f64> = (0..5 * 64 * 6).map(|i| f64::from(i % 97) / 40.0 - 1.0).collect();
    let wanted = twin(&extractor, &wrench, shape);
    assert_eq!(extractor.extract(&wrench, shape, 1).unwrap(), wanted);
    let shape = BatchShape { n_recordings: 10, n_samples: 64, n_axes: 3 };
    let error = extractor.extract(&wrench, shape, 1).unwrap_err().to_string();
    assert_eq!(error, "bin_range must hold one range, or one per axis, got 6 ranges for 3 axes");
}

#[test]
fn values_too_large_to_filter_are_refused() {
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let shape = BatchShape { n_recordings: 2, n_samples: 10, n_axes: 6 };
    let mut wrench = vec![0.0; 120];
    wrench[60..].fill(f64::MAX);
    let error = extractor.extract(&wrench, shape, 1).unwrap_err();
    assert!(matches!(error, Error::TooLarge { recording: 1, largest: f64::MAX, .. }), "{error}");
}

#[test]
fn wrong_sizes_are_refused() {
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let shape = BatchShape { n_recordings: 1, n_samples: 4, n_axes: 6 };
    let wrench = [0.0; 24];
    let length = |what, expected, got| Err(Error::Length { what, expected, got });
    assert_eq!(extractor.extract(&wrench[1..], shape, 1).map(drop), length("wrench", 24, 23));
    assert_eq!(extractor.extract_into(&wrench, shape, 1, &mut [0.0; 3]), length("out", 624, 3));
    let no_threads = Error::Range { what: "threads", got: 0, min: 1, max: usize::MAX };
    assert_eq!(extractor.extract(&wrench, shape, 0), Err(no_threads));
    for absurd in [
        BatchShape { n_recordings: 1 << 40, n_samples: 1 << 31, n_axes: 1 },
        BatchShape { n_recordings: 1, n_samples: 1 << 31, n_axes: 1 << 40 },
    ] {
        assert_eq!(extractor.extract(&[], absurd, 1).map(drop), length("wrench", usize::MAX, 0));
    }
    for empty in [
        BatchShape { n_recordings: 0, ..shape },
        BatchShape { n_samples: 0, ..shape },
        BatchShape { n_axes: 0, ..shape },
    ] {
        let BatchShape { n_recordings, n_samples, n_axes } = empty;
        let error = Error::Empty { what: "wrench", shape: vec![n_recordings, n_samples, n_axes] };
        assert_eq!(extractor.extract(&[], empty, 1), Err(error));
    }
}

#[test]
fn a_specification_is_checked_once() {
    let default = FeatureSpec::default;
    for (spec, argument) in [
        (default().with_raw(false).with_hfmh(false), "raw or hfmh"),
        (default().with_cutoff_hz(250.0), "cutoff_hz"),
        (default().with_order(0), "order"),
        (default().with_n_bins(0), "n_bins"),
        (default().with_bin_ranges(vec![(1.0, -1.0)]), "bin_range"),
        (default().with_bin_ranges(vec![]), "bin_range"),
    ] {
        let error = Extractor::new(spec).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{argument} must ")), "{error}");
    }
}

#[test]
fn there_is_a_name_for_every_feature() {
    for (raw, hfmh) in [(true, true), (true, false), (false, true)] {
        for (n_samples, n_axes, n_bins) in [(1600, 6, 100), (12_345, 1, 1), (3, 13, 1001)] {
            let spec = FeatureSpec::default().with_raw(raw).with_hfmh(hfmh).with_n_bins(n_bins);
            let extractor = Extractor::new(spec).unwrap();
            let mut names = extractor.feature_names(n_samples, n_axes).unwrap();
            assert_eq!(names.len(), extractor.n_features(n_samples, n_axes).unwrap());
            names.sort();
            names.dedup();
            assert_eq!(names.len(), extractor.n_features(n_samples, n_axes).unwrap());
        }
    }
}
