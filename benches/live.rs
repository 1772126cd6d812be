//! What a live run does for every sample, in nanoseconds. Synthetic rows at 500 Hz, arrivals up to 0.1 ms late.

#![allow(missing_docs)] // the macros of criterion make functions without

use std::hint::black_box;

use criterion::{criterion_group, criterion_main, BenchmarkId, Criterion, Throughput};
use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow, Row, WindowSpec};

fn row(n: u64) -> Row {
    let late_ns = n.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40 & 0xffff;
    Row { ticks: 2_000_000 * n, host_ns: 2_000_000 * n + late_ns, wrench: [0.25; 6], flags: 0 }
}

/// Pushing rows one by one, in order and with every tenth row late.
fn push(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("buffer push");
    group.throughput(Throughput::Elements(1));
    for (name, reorder_depth, swapped) in [("in order", 0, 0), ("every tenth pair swapped", 4, 10)] {
        let Ok((mut writer, _)) = wrench_buffer(BufferSpec::default().with_reorder_depth(reorder_depth))
        else {
            continue;
        };
        let mut n = 0_u64;
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                n += 1;
                let place = match n.checked_rem(swapped) {
                    Some(4) => n + 1,
                    Some(5) => n - 1,
                    _ => n,
                };
                writer.push(black_box(&row(place)))
            });
        });
    }
    group.finish();
}

/// Reading rows into an array, per row, and copying a window.
fn read(criterion: &mut Criterion) {
    let Ok((mut writer, reader)) = wrench_buffer(BufferSpec::default()) else { return };
    for n in 0..5000 {
        writer.push(&row(n));
    }
    let mut group = criterion.benchmark_group("buffer read");
    for n_rows in [1, 10, 1600] {
        let mut rows = vec![BufferedRow::EMPTY; n_rows];
        group.throughput(Throughput::Elements(n_rows as u64));
        group.bench_function(BenchmarkId::new("rows", n_rows), |bencher| {
            bencher.iter(|| reader.clone().read(black_box(&mut rows)));
        });
    }
    group.throughput(Throughput::Elements(1600));
    group.bench_function("window of 1600", |bencher| {
        bencher.iter(|| reader.window(black_box(&WindowSpec::whole(1600))));
    });
    group.finish();
}

criterion_group!(benches, push, read);
criterion_main!(benches);
