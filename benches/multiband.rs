//! Multi-band features of one recording of 1600 samples on six axes: the whole, the filter bank, and each block.

#![allow(missing_docs)] // the macros of criterion make functions without

use std::hint::black_box;

use criterion::{criterion_group, criterion_main, Criterion};
use granular_id::multiband::{n_bands, Block, MultiBand, MultiBandSpec, Scales};
use granular_id::{BatchShape, SimdPath};

const N_SAMPLES: usize = 1600;
const N_AXES: usize = 6;
const N_RECORDINGS: usize = 64;

fn design(spec: MultiBandSpec) -> MultiBand {
    MultiBand::new(spec, N_SAMPLES, N_AXES, &Scales::unit(n_bands(N_SAMPLES), N_AXES).expect("memory"))
        .expect("a design")
}

/// Numbers that look random, around an offset.
fn noise(len: usize) -> Vec<f64> {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..len).map(|_| 4.0 * next() + 1.0).collect()
}

fn one_recording(c: &mut Criterion) {
    let mut group = c.benchmark_group("multiband");
    let rows = noise(N_SAMPLES * N_AXES);
    let mut measure = |name: String, spec: MultiBandSpec, path: SimdPath| {
        let design = design(spec);
        let (mut work, mut out) = (design.workspace().expect("memory"), vec![0.0; design.n_features()]);
        group.bench_function(name, |b| {
            b.iter(|| design.extract_on(path, black_box(&rows), &mut work, &mut out).expect("finite"));
        });
    };
    for path in SimdPath::available() {
        measure(format!("whole/{}", path.name()), MultiBandSpec::default(), path);
    }
    // The level costs next to nothing: its time is that of the filter bank, which every block needs.
    for (name, block) in Block::NAMED {
        let path = SimdPath::detect().expect("a vector unit");
        measure(format!("bank and {name}"), MultiBandSpec::of(500.0, |wanted| wanted == block), path);
    }
    group.finish();
}

fn batch(c: &mut Criterion) {
    let design = design(MultiBandSpec::default());
    let wrench = noise(N_RECORDINGS * N_SAMPLES * N_AXES);
    let shape = BatchShape { n_recordings: N_RECORDINGS, n_samples: N_SAMPLES, n_axes: N_AXES };
    let mut out = vec![0.0; N_RECORDINGS * design.n_features()];
    let mut group = c.benchmark_group("multiband batch of 64");
    for threads in [1, 2] {
        group.bench_function(format!("{threads} threads"), |b| {
            b.iter(|| design.extract_batch(black_box(&wrench), shape, threads, &mut out).expect("finite"));
        });
    }
    group.finish();
}

criterion_group!(benches, one_recording, batch);
criterion_main!(benches);
