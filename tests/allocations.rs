//! What runs for every sample allocates nothing: counted by an allocator.

use std::sync::Arc;

use allocation_counter::measure;
use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow, Row};
use granular_id::multiband::MultiBandSpec;
use granular_id::stream::{StreamingExtractor, StreamingIdentifier, Windows};
use granular_id::{Extractor, FeatureSpec, Model};

#[allow(dead_code)] // not all of it
#[path = "core/twins/models.rs"]
mod models;
#[allow(dead_code)] // strategies
#[path = "core/twins/signals.rs"]
mod signals;

/// Runs something often and asserts that memory was neither taken nor given back.
fn allocates_nothing(what: &str, run: impl FnOnce()) {
    let counted = measure(run);
    assert_eq!((counted.count_total, counted.bytes_total, counted.count_current), (0, 0, 0), "{what}");
}

#[test]
fn the_counter_counts() {
    assert_eq!(measure(|| drop(std::hint::black_box(vec![0_u8; 100]))).count_total, 1);
}

#[test]
fn buffer() {
    for reorder_depth in [0, 8] {
        let spec =
            BufferSpec::default().with_seconds(0.5).with_tick_hz(5000.0).with_reorder_depth(reorder_depth);
        let (mut writer, mut reader) = wrench_buffer(spec).unwrap();
        let mut rows = [BufferedRow::EMPTY; 64];
        let what = format!("reorder_depth = {reorder_depth}");
        let mut seen = 0;
        allocates_nothing(&what, || {
            for n in 0..20_000_u64 {
                // Gaps, rows out of order, duplicates, NaN, drift of the clocks, a restart: every way through the writer.
                let ticks = match n % 100 {
                    30 | 60 => n - 3,
                    31 => n - 2,
                    70 => n + 5,
                    90 => n - 60,
                    _ => n,
                } % 9000;
                let value = if n % 77 == 7 { f64::NAN } else { 1.0 };
                let row = Row {
                    ticks: 10 * ticks,
                    host_ns: 2_000_100 * n + n * n % 1013,
                    wrench: [value; 6],
                    flags: 0,
                };
                writer.push(&row);
                if n % 50 == 0 {
                    let taken = reader.read(&mut rows).unwrap();
                    seen += taken.n_rows;
                    assert!(reader.latest().is_some() && reader.lag_ns(row.host_ns).is_some());
                }
            }
            writer.new_epoch();
            writer.flush();
        });
        let stats = reader.stats();
        assert!(seen > 10_000, "{seen}");
        assert!(stats.gaps > 100 && stats.epochs >= 2 && stats.non_finite > 100, "{stats:?}");
        assert!(stats.late > 100 && stats.duplicates > 100, "{stats:?}");
        assert_eq!(stats.reordered > 100, reorder_depth > 0, "{stats:?}");
    }
}

fn noisy_rows(n_rows: usize) -> Vec<f64> {
    let mut noise = signals::uniform(5);
    (0..6 * n_rows).map(|_| 3.0 * noise()).collect()
}

#[test]
fn streaming_extraction() {
    let (spec, rows) = (FeatureSpec::default().with_density(true), noisy_rows(4000));
    let windows = Windows::default().with_hop(Some(250));
    let mut stream = StreamingExtractor::new(&Extractor::new(spec).unwrap(), windows).unwrap();
    let mut features = vec![0.0; stream.n_features()];
    let mut finished = 0;
    allocates_nothing("push, features, next window, refusals", || {
        let mut taken = 0;
        while taken < 4000 {
            taken += stream.push(&rows[6 * taken..(6 * taken + 6 * 97).min(rows.len())]).unwrap();
            stream.features_into(&mut features).unwrap();
            if stream.is_complete() {
                finished += 1;
                stream.next_window().unwrap();
            }
        }
        stream.reset();
        assert!(stream.push(&[f64::NAN; 6]).is_err());
        assert!(stream.push(&[f64::MAX; 60]).is_err());
    });
    assert_eq!(finished, 10);
}

#[test]
fn streaming_identification() {
    let rows = noisy_rows(3000);
    let model = Arc::new(models::random_model(11, 1600, 6, FeatureSpec::default()));
    let mut stream = StreamingIdentifier::new(model, Some(400)).unwrap();
    let mut finished = 0;
    allocates_nothing("push, standing, next window", || {
        for row in rows.chunks_exact(6) {
            stream.push(row).unwrap();
            if stream.standing().unwrap().is_final {
                finished += 1;
                stream.next_window().unwrap();
            }
        }
        stream.reset();
    });
    assert_eq!(finished, 4);
}

#[test]
fn streaming_identification_with_rules() {
    let rows = noisy_rows(500);
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/rules/model.safetensors");
    let model = Arc::new(Model::read(file).unwrap());
    let mut stream = StreamingIdentifier::new(model, Some(20)).unwrap().clone();
    let mut finished = 0;
    allocates_nothing("push, standing, next window", || {
        for row in rows.chunks_exact(6) {
            stream.push(row).unwrap();
            let standing = stream.standing().unwrap();
            if standing.is_final {
                assert!(!standing.candidates.is_empty() && standing.unknown == Some(true));
                finished += 1;
                stream.next_window().unwrap();
            }
        }
    });
    assert_eq!(finished, 23);
}

#[test]
fn streaming_identification_by_bands() {
    let rows = noisy_rows(4100);
    let model = Arc::new(models::random_banded(11, 1600, 6, MultiBandSpec::of(500.0, |_| true)));
    let mut stream = StreamingIdentifier::new(model, Some(400)).unwrap();
    let mut finished = 0;
    allocates_nothing("push, standing, next window, refusals", || {
        for block in rows.chunks(6 * 50) {
            stream.push(block).unwrap();
            if stream.standing().unwrap().is_final {
                finished += 1;
                stream.next_window().unwrap();
            }
        }
        stream.reset();
        assert!(stream.push(&[f64::NAN; 6]).is_err());
        assert!(stream.push(&[1e200; 60]).is_err());
    });
    assert_eq!(finished, 7);
}
