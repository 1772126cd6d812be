//! The hot paths, each once, for callgrind to count the instructions of: see `counts.py`, which runs this.
//!
//! Prints the name of each path in the order in which it calls `measured`.

use std::hint::black_box;
use std::sync::Arc;

use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow, Row};
use granular_id::multiband::{n_bands, MultiBand, MultiBandSpec, Scales};
use granular_id::rdt::{Decoder, Record, Scale, Variant};
use granular_id::stream::{StreamingExtractor, StreamingIdentifier, Windows};
use granular_id::{butterworth, Band, BatchShape, Extractor, FeatureSpec, SosState};

#[allow(dead_code)] // not all of it
#[path = "../tests/core/twins/models.rs"]
mod models;
#[allow(dead_code)] // strategies
#[path = "../tests/core/twins/signals.rs"]
mod signals;

use models::{random_banded, random_model};
use signals::noise;

const ONE: BatchShape = BatchShape { n_recordings: 1, n_samples: 1600, n_axes: 6 };

/// What callgrind counts, found by its name.
#[inline(never)]
fn measured(work: &mut dyn FnMut()) {
    work();
}

/// Counts the second call: the first one designs, reserves and chooses.
fn count(name: &str, mut work: impl FnMut()) {
    count_after(name, &mut (), |()| (), |()| work());
}

/// The same for work that something not counted comes before.
fn count_after<S>(name: &str, state: &mut S, before: impl Fn(&mut S), mut work: impl FnMut(&mut S)) {
    before(state);
    work(state);
    before(state);
    measured(&mut || work(state));
    println!("{name}");
}

fn filters() {
    let sos = butterworth(8, Band::Highpass(23.0), 500.0).unwrap();
    for n_axes in [1, 6] {
        let mut rows = noise(1, 1600 * n_axes);
        let mut state = SosState::zero(&sos, n_axes).unwrap();
        count(&format!("filter 1600 x {n_axes}"), || state.filter(black_box(&mut rows)).unwrap());
    }
}

fn features() {
    let rows = noise(2, ONE.recording_len());
    let mut silent = rows.clone();
    for sample in silent.chunks_exact_mut(6) {
        sample[3..].fill(0.0);
    }
    let raw = FeatureSpec::default().with_hfmh(false);
    for (name, spec, rows) in [
        ("extract 1600 x 6", FeatureSpec::default(), &rows),
        ("extract 1600 x 6, three silent axes", FeatureSpec::default(), &silent),
        ("extract 1600 x 6, raw only", raw, &rows),
    ] {
        let extractor = Extractor::new(spec).unwrap();
        let mut out = vec![0.0; extractor.n_features(1600, 6).unwrap()];
        count(name, || extractor.extract_into(black_box(rows), ONE, 1, &mut out).unwrap());
    }
    let scales = Scales::unit(n_bands(1600), 6).unwrap();
    let multiband = MultiBand::new(MultiBandSpec::default(), 1600, 6, &scales).unwrap();
    let (mut work, mut out) = (multiband.workspace().unwrap(), vec![0.0; multiband.n_features()]);
    count("multi-band 1600 x 6", || multiband.extract_into(black_box(&rows), &mut work, &mut out).unwrap());
}

fn streams() {
    let rows = noise(3, ONE.recording_len());
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let mut stream = StreamingExtractor::new(&extractor, Windows::default()).unwrap();
    let mut places = rows.chunks_exact(6);
    count("stream, push of a row", || {
        stream.push(black_box(places.next().unwrap_or_default())).unwrap();
    });
    stream.push(&rows).unwrap();
    let mut out = vec![0.0; stream.n_features()];
    count("stream, features", || stream.features_into(black_box(&mut out)).unwrap());
}

fn models() {
    let rows = noise(4, ONE.recording_len());
    for (name, model) in [
        ("model", random_model(11, 1600, 6, FeatureSpec::default())),
        ("multi-band model", random_banded(11, 1600, 6, MultiBandSpec::default())),
    ] {
        let mut out = vec![0.0; model.n_learners()];
        count(&format!("{name}, scores"), || model.scores_into(black_box(&rows), 1, 1, &mut out).unwrap());
        let mut stream = StreamingIdentifier::new(Arc::new(model), None).unwrap();
        let mut places = rows.chunks_exact(6);
        count(&format!("{name}, push of a row"), || {
            stream.push(black_box(places.next().unwrap_or_default())).unwrap();
        });
        let all_but_one = |stream: &mut StreamingIdentifier| {
            stream.reset();
            stream.push(&rows[..9594]).unwrap();
        };
        count_after(&format!("{name}, last row and answer"), &mut stream, all_but_one, |stream| {
            stream.push(black_box(&rows[9594..])).unwrap();
            black_box(stream.standing().unwrap());
        });
    }
}

fn live() {
    let (mut writer, mut reader) = wrench_buffer(BufferSpec::default()).unwrap();
    let mut place = [BufferedRow::EMPTY];
    let mut n = 0;
    count("ring, a row pushed and read", || {
        n += 1;
        writer.push(&Row { ticks: 2_000_000 * n, host_ns: 2_000_000 * n, wrench: [0.25; 6], flags: 0 });
        reader.read(black_box(&mut place)).unwrap();
    });
    let scale = Scale::new(1e6, 1e6).unwrap();
    let mut decoder = Decoder::new(Variant::NetFt, scale, [2000.0; 6]);
    let mut number = 0;
    count("packet of a record", || {
        number += 1;
        let record =
            Record { rdt_sequence: number, ft_sequence: 14 * number, status: 0, counts: [250_000; 6] };
        decoder.datagram(&record.to_bytes(), u64::from(number), &mut |decoded| {
            black_box(decoded);
        });
    });
}

fn main() {
    filters();
    features();
    streams();
    models();
    live();
}
