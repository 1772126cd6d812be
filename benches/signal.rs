//! Throughput of filter, histogram and extraction. Synthetic noise on a random walk, 1,600 samples a recording.
//!
//! `cargo bench` prints elements per second; an element is one sample of one axis.

#![allow(missing_docs)] // the macros of criterion make functions without

use std::hint::black_box;

use criterion::{criterion_group, criterion_main, BenchmarkId, Criterion, Throughput};
use granular_id::{butterworth, Band, BatchShape, Extractor, FeatureSpec, SimdPath, SosState};

const N_SAMPLES: usize = 1600;

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

/// Filtering one recording with a state, by order and number of axes.
fn filter(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("filter");
    for order in [2, 4, 8, 16] {
        let Ok(sos) = butterworth(order, Band::Highpass(23.0), 500.0) else { continue };
        for n_axes in [1, 3, 6, 12] {
            let recording = recordings(1, n_axes);
            group.throughput(Throughput::Elements(recording.len() as u64));
            group.bench_function(
                BenchmarkId::new(format!("order {order}"), format!("{n_axes} axes")),
                |bencher| {
                    let mut state = SosState::zero(&sos, n_axes).expect("memory");
                    let mut chunk = recording.clone();
                    bencher.iter(|| {
                        chunk.copy_from_slice(&recording);
                        state.reset();
                        black_box(state.filter(&sos, black_box(&mut chunk)))
                    });
                },
            );
        }
    }
    group.finish();
}

/// Filter and histogram of a batch, by order, axes and path: the kernel of the extraction. Order 0 counts alone.
fn kernel(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kernel");
    group.sample_size(20);
    for (order, n_axes, n_silent) in [
        (0, 6, 0),
        (2, 6, 0),
        (4, 6, 0),
        (8, 6, 0),
        (8, 6, 1),
        (8, 6, 3),
        (16, 6, 0),
        (8, 1, 0),
        (8, 3, 0),
        (8, 12, 0),
    ] {
        let spec = FeatureSpec { order: order.max(1), raw: false, ..FeatureSpec::default() };
        let Ok(extractor) = Extractor::new(spec) else { continue };
        let extractor = if order == 0 { extractor.unfiltered() } else { extractor };
        let shape = BatchShape { n_recordings: 24, n_samples: N_SAMPLES, n_axes };
        let mut wrench = recordings(shape.n_recordings, n_axes);
        for sample in wrench.chunks_exact_mut(n_axes) {
            sample[..n_silent].fill(0.0);
        }
        let mut out = vec![0.0; shape.n_recordings * n_axes * 100];
        group.throughput(Throughput::Elements(wrench.len() as u64));
        for path in SimdPath::available() {
            let id =
                BenchmarkId::new(format!("order {order}, {n_axes} axes, {n_silent} silent"), path.name());
            group.bench_function(id, |bencher| {
                bencher.iter(|| extractor.extract_on(path, black_box(&wrench), shape, 1, &mut out));
            });
        }
    }
    group.finish();
}

/// The whole extraction, by path and threads, on more data than the caches hold.
fn extraction(criterion: &mut Criterion) {
    let n_recordings = 682;
    let wrench = recordings(n_recordings, 6);
    let shape = BatchShape { n_recordings, n_samples: N_SAMPLES, n_axes: 6 };
    let specs = [
        ("raw+hfmh", FeatureSpec::default()),
        ("raw", FeatureSpec { hfmh: false, ..FeatureSpec::default() }),
        ("hfmh", FeatureSpec { raw: false, ..FeatureSpec::default() }),
    ];
    let mut group = criterion.benchmark_group("extraction");
    group.sample_size(20).throughput(Throughput::Elements(wrench.len() as u64));
    for (name, spec) in specs {
        let Ok(extractor) = Extractor::new(spec) else { continue };
        let Ok(n_features) = extractor.n_features(N_SAMPLES, 6) else { continue };
        let mut out = vec![0.0; n_recordings * n_features];
        for path in SimdPath::available() {
            for threads in [1, 2] {
                let id = BenchmarkId::new(format!("{name} {}", path.name()), format!("{threads} threads"));
                group.bench_function(id, |bencher| {
                    bencher.iter(|| extractor.extract_on(path, black_box(&wrench), shape, threads, &mut out));
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, filter, kernel, extraction);
criterion_main!(benches);
