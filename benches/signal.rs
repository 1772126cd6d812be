//! Throughput of filters and features, stage by stage. Synthetic noise on a random walk, 1,600 samples a recording.
//!
//! Criterion prints elements per second; an element is one sample of one axis.

#![allow(missing_docs)] // the macros of criterion make functions without

use std::hint::black_box;
use std::time::Duration;

use biquad::{Biquad, Coefficients, DirectForm2Transposed};
use criterion::{criterion_group, criterion_main, BatchSize, BenchmarkId, Criterion, Throughput};
use granular_id::{butterworth, Band, BatchShape, Extractor, FeatureSpec, SimdPath, Sos, SosState};

const N_SAMPLES: usize = 1600;

/// Recordings that fit in the second-level cache with their features, and more than any cache holds.
const PLACES: [(&str, usize); 2] = [("in cache", 4), ("from memory", 682)];

/// Noise on a random walk, sample by sample.
fn recordings(n_recordings: usize, n_axes: usize) -> Vec<f64> {
    let mut seed = 1_u64;
    let mut uniform = || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let mut walk = vec![0.0; n_axes];
    let mut values = Vec::with_capacity(n_recordings * N_SAMPLES * n_axes);
    for _ in 0..n_recordings * N_SAMPLES {
        for position in &mut walk {
            *position += 0.1 * uniform();
            values.push(*position + 0.3 * uniform());
        }
    }
    values
}

fn high_pass(order: usize) -> Sos {
    butterworth(order, Band::Highpass(23.0), 500.0).expect("a filter")
}

/// One recording after the other through a filter that goes on; neither copies nor resets are timed.
fn stream(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("stream");
    for (order, n_axes, tail) in
        [(2, 6, ""), (8, 1, ""), (8, 3, ""), (8, 6, ""), (8, 6, ", subnormal tail"), (8, 12, ""), (16, 6, "")]
    {
        let sos = high_pass(order);
        let mut state = SosState::zero(&sos, n_axes).expect("memory");
        let mut recording = recordings(1, n_axes);
        if !tail.is_empty() {
            // What is left of noise after 30 recordings of silence.
            state.filter(&mut recording).expect("whole rows");
            for _ in 0..30 {
                recording.fill(0.0);
                state.filter(&mut recording).expect("whole rows");
            }
            assert!(recording.iter().all(|value| value.abs() < f64::MIN_POSITIVE));
            recording.fill(0.0);
        }
        group.throughput(Throughput::Elements(recording.len() as u64));
        group.bench_function(format!("order {order}, {n_axes} axes{tail}"), |bencher| {
            bencher.iter_batched_ref(
                || recording.clone(),
                |chunk| state.filter(chunk),
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

/// The same filter by another crate, sample by sample, and by this one.
fn peers(criterion: &mut Criterion) {
    let sos = high_pass(8);
    let mut group = criterion.benchmark_group("peers, order 8");
    for n_axes in [1, 6] {
        let recording = recordings(1, n_axes);
        group.throughput(Throughput::Elements(recording.len() as u64));
        let mut state = SosState::zero(&sos, n_axes).expect("memory");
        group.bench_function(BenchmarkId::new("granular-id", format!("{n_axes} axes")), |bencher| {
            bencher.iter_batched_ref(
                || recording.clone(),
                |chunk| state.filter(chunk),
                BatchSize::PerIteration,
            );
        });
        let section = |s: &granular_id::dsp::Section| {
            DirectForm2Transposed::new(Coefficients { b0: s.b0, b1: s.b1, b2: s.b2, a1: s.a1, a2: s.a2 })
        };
        let cascade: Vec<_> = sos.sections().iter().map(section).collect();
        let mut cascades = vec![<[_; 4]>::try_from(cascade).expect("four sections"); n_axes];
        group.bench_function(BenchmarkId::new("biquad", format!("{n_axes} axes")), |bencher| {
            bencher.iter_batched_ref(
                || recording.clone(),
                |chunk| {
                    for (axis, cascade) in cascades.iter_mut().enumerate() {
                        let mut copy = *cascade; // stays in registers
                        for value in chunk.iter_mut().skip(axis).step_by(n_axes) {
                            *value = copy.iter_mut().fold(*value, |x, section| section.run(x));
                        }
                        *cascade = copy;
                    }
                },
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

/// Features of a batch on one thread into memory that is there.
fn features(
    criterion: &mut Criterion,
    group: &str,
    id: BenchmarkId,
    (extractor, path): (&Extractor, SimdPath),
    (wrench, n_axes): (&[f64], usize),
) {
    let shape =
        BatchShape { n_recordings: wrench.len() / (N_SAMPLES * n_axes), n_samples: N_SAMPLES, n_axes };
    let mut out = vec![0.0; shape.n_recordings * extractor.n_features(N_SAMPLES, n_axes).expect("a number")];
    let mut group = criterion.benchmark_group(group);
    group.throughput(Throughput::Elements(wrench.len() as u64));
    group.bench_function(id, |bencher| {
        bencher.iter(|| extractor.extract_on(path, black_box(wrench), shape, 1, &mut out).expect("finite"));
    });
    group.finish();
}

/// What the kernel does to a team of four recordings: each stage alone, then together.
fn stages(criterion: &mut Criterion) {
    let whole = Extractor::new(FeatureSpec::default()).expect("a specification");
    let hfmh = Extractor::new(FeatureSpec::default().with_raw(false)).expect("one");
    let raw = Extractor::new(FeatureSpec::default().with_hfmh(false)).expect("one");
    for (place, n_recordings) in PLACES {
        let wrench = recordings(n_recordings, 6);
        for path in SimdPath::available() {
            let id = |stage: &str| BenchmarkId::new(format!("{stage}, {place}"), path.name());
            for (stage, extractor) in [
                ("transpose", &raw),
                ("transpose and count", &hfmh.unfiltered()),
                ("transpose, filter, count", &hfmh),
                ("transpose, filter, count, write samples", &whole),
            ] {
                features(criterion, "stages", id(stage), (extractor, path), (&wrench, 6));
            }
        }
    }
}

/// Histograms of filtered samples, by order, axes, and axes that are silent.
fn kernel(criterion: &mut Criterion) {
    let path = SimdPath::detect().expect("a vector unit");
    for (order, n_axes, n_silent) in [(2, 6, 0), (16, 6, 0), (8, 1, 0), (8, 12, 0), (8, 6, 0), (8, 6, 3)] {
        let spec = FeatureSpec::default().with_order(order).with_raw(false);
        let extractor = Extractor::new(spec).expect("a specification");
        let mut wrench = recordings(24, n_axes);
        for sample in wrench.chunks_exact_mut(n_axes) {
            sample[..n_silent].fill(0.0);
        }
        let id = BenchmarkId::new(format!("order {order}, {n_axes} axes"), format!("{n_silent} silent"));
        features(criterion, "kernel", id, (&extractor, path), (&wrench, n_axes));
    }
}

/// The whole extraction by threads.
fn extraction(criterion: &mut Criterion) {
    let extractor = Extractor::new(FeatureSpec::default()).expect("a specification");
    let n_features = extractor.n_features(N_SAMPLES, 6).expect("a number");
    let mut group = criterion.benchmark_group("extraction");
    for (place, n_recordings) in PLACES {
        let wrench = recordings(n_recordings, 6);
        let shape = BatchShape { n_recordings, n_samples: N_SAMPLES, n_axes: 6 };
        let mut wide = vec![0.0; n_recordings * n_features];
        group.throughput(Throughput::Elements(wrench.len() as u64));
        for threads in [1, 2] {
            group.bench_function(BenchmarkId::new(place, format!("{threads} threads")), |bencher| {
                bencher.iter(|| extractor.extract_into(black_box(&wrench), shape, threads, &mut wide));
            });
        }
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .sample_size(20);
    targets = stream, peers, stages, kernel, extraction
}
criterion_main!(benches);
