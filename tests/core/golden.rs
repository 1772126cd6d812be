//! Digests of designs, features, streams, scores and live rows over fixed inputs: the same on every processor and every
//! vector unit, in every release.
//!
//! `GRANULAR_ID_GOLDEN=write cargo test --test core golden` writes `tests/data/golden_bits.txt` anew: a change that the
//! changelog must name.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use granular_id::buffer::{wrench_buffer, BufferSpec, Fill, Row, WindowSpec};
use granular_id::dsp::{Outside, Section};
use granular_id::features::Initial;
use granular_id::multiband::{n_bands, Block, MultiBand, MultiBandSpec, Scales};
use granular_id::rdt::{Decoded, Decoder, Record, Scale, Variant};
use granular_id::stream::{StreamingExtractor, StreamingIdentifier, Windows};
use granular_id::{butterworth, Band, BatchShape, Extractor, FeatureSpec, Model, SimdPath, SosState};

use crate::twins::models::{random_banded, random_model};
use crate::twins::signals::{bits, uniform};

/// Samples of the longest recordings.
const N_SAMPLES: usize = if cfg!(miri) { 40 } else { 1600 };

/// Rows of the longest series, under Miri the beginning of them.
fn size(n: usize) -> usize {
    if cfg!(miri) {
        n.min(24)
    } else {
        n
    }
}

/// Noise on a random walk with an offset: sums and products of numbers that every processor rounds alike.
fn wrench(n_samples: usize, n_axes: usize) -> Vec<f64> {
    let mut noise = uniform(2403);
    let mut walk: Vec<f64> = (0..n_axes).map(|axis| 0.7 * axis as f64).collect();
    let mut values = Vec::with_capacity(n_samples * n_axes);
    for _ in 0..n_samples {
        for place in &mut walk {
            *place += 0.1 * noise();
            values.push(*place + 1.5 * noise());
        }
    }
    values
}

/// Digests by name, FNV-1a over the bytes of 64-bit words.
#[derive(Default)]
struct Digests(BTreeMap<String, u64>);

impl Digests {
    fn words(&mut self, name: impl Into<String>, words: impl IntoIterator<Item = u64>) {
        let bytes = words.into_iter().flat_map(u64::to_le_bytes);
        let digest = bytes.fold(0xcbf2_9ce4_8422_2325, |digest, byte| {
            (digest ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3_u64)
        });
        assert!(self.0.insert(name.into(), digest).is_none());
    }

    fn add(&mut self, name: impl Into<String>, values: &[f64]) {
        self.words(name, bits(values));
    }

    /// The same digest from every path that this machine has.
    fn on_every_path(&mut self, name: &str, mut values: impl FnMut(SimdPath) -> Vec<f64>) {
        let first = values(SimdPath::Baseline);
        for path in &SimdPath::available()[1..] {
            assert!(bits(&values(*path)) == bits(&first), "{name}: {path:?} differs from the baseline");
        }
        self.add(name, &first);
    }
}

fn designs(digests: &mut Digests) {
    for rate_hz in [48.5, 500.0, 7000.0] {
        let at = |part: f64| part * rate_hz;
        for (name, band) in [
            ("lowpass", Band::Lowpass(at(0.11))),
            ("highpass", Band::Highpass(at(0.046))),
            ("bandpass", Band::Bandpass(at(0.04), at(0.37))),
            ("bandstop", Band::Bandstop(at(0.09), at(0.12))),
        ] {
            let (mut rows, mut steady) = (Vec::new(), Vec::new());
            for order in 1..=size(16) {
                let sos = butterworth(order, band, rate_hz).unwrap();
                rows.extend(sos.sections().iter().flat_map(Section::row));
                steady.extend(sos.steady_state().unwrap().into_iter().flatten());
            }
            digests.add(format!("design {name} {rate_hz} Hz"), &rows);
            digests.add(format!("design {name} {rate_hz} Hz, steady state"), &steady);
        }
    }
}

fn filters(digests: &mut Digests) {
    for (order, n_axes) in [(8, 1), (8, 6), (3, 6), (8, 12)] {
        let sos = butterworth(order, Band::Highpass(23.0), 500.0).unwrap();
        let mut causal = wrench(N_SAMPLES, n_axes);
        let mut state = SosState::zero(&sos, n_axes).unwrap();
        state.filter(&mut causal).unwrap();
        causal.extend(state.values());
        digests.add(format!("filter of order {order}, {n_axes} axes"), &causal);
    }
}

/// Specifications with the axes of their recordings.
fn specs() -> [(&'static str, usize, FeatureSpec); 7] {
    let paper = FeatureSpec::default;
    let bin_ranges = (1..=6).map(|axis| (-0.3 * f64::from(axis), 0.2 * f64::from(axis))).collect();
    let clipped = paper().with_outside(Outside::Clip).with_density(true).with_n_bins(33);
    [
        ("paper", 6, paper()),
        ("raw", 6, paper().with_hfmh(false)),
        ("three axes", 3, paper().with_raw(false)),
        ("twelve axes", 12, paper().with_raw(false)),
        ("steady start", 6, paper().with_initial(Initial::Steady).with_raw(false)),
        ("ranges by axis", 6, paper().with_bin_ranges(bin_ranges).with_order(5).with_raw(false)),
        ("clipped densities", 6, clipped.with_raw(false)),
    ]
}

fn features(digests: &mut Digests) {
    let n_recordings = if cfg!(miri) { 2 } else { 9 };
    for (name, n_axes, spec) in specs() {
        let extractor = Extractor::new(spec).unwrap();
        let shape = BatchShape { n_recordings, n_samples: N_SAMPLES, n_axes };
        let rows = wrench(n_recordings * N_SAMPLES, n_axes);
        let n_features = extractor.n_features(N_SAMPLES, n_axes).unwrap();
        digests.on_every_path(&format!("features, {name}"), |path| {
            let mut out = vec![f64::NAN; n_recordings * n_features];
            extractor.extract_on(path, &rows, shape, 1, &mut out).unwrap();
            out
        });
    }
    let extractor = Extractor::new(FeatureSpec::default()).unwrap();
    let shape = BatchShape { n_recordings, n_samples: N_SAMPLES, n_axes: 6 };
    let mut rows = wrench(n_recordings * N_SAMPLES, 6);
    for sample in rows.chunks_exact_mut(6) {
        sample[1..4].fill(0.0);
    }
    digests.add("features, three silent axes", &extractor.extract(&rows, shape, 1).unwrap());
}

fn multiband(digests: &mut Digests) {
    for (n_samples, n_axes) in [(N_SAMPLES, 6), (777, 3), (64, 1)] {
        let n_samples = n_samples.min(N_SAMPLES);
        let mut noise = uniform(7);
        let mut scales = |n: usize| (0..n).map(|_| 0.75 + noise()).collect::<Vec<_>>();
        let scales = Scales { bands: scales(n_bands(n_samples) * n_axes), level: scales(n_axes) };
        let rows = wrench(n_samples, n_axes);
        for (name, block) in Block::NAMED {
            let spec = MultiBandSpec::of(500.0, |wanted| wanted == block);
            let Ok(design) = MultiBand::new(spec, n_samples, n_axes, &scales) else { continue };
            digests.on_every_path(
                &format!("multi-band {name}, {n_samples} samples, {n_axes} axes"),
                |path| {
                    let (mut work, mut out) =
                        (design.workspace().unwrap(), vec![f64::NAN; design.n_features()]);
                    design.extract_on(path, &rows, &mut work, &mut out).unwrap();
                    out
                },
            );
        }
    }
}

fn streams(digests: &mut Digests) {
    let rows = wrench(2 * N_SAMPLES, 6);
    for (name, n_axes, spec) in specs().into_iter().filter(|(_, n_axes, _)| *n_axes == 6) {
        let extractor = Extractor::new(spec).unwrap();
        let windows = Windows::new(N_SAMPLES, n_axes).with_hop(Some(N_SAMPLES / 3));
        let mut stream = StreamingExtractor::new(&extractor, windows).unwrap();
        let (mut taken, mut all) = (0, Vec::new());
        let mut out = vec![f64::NAN; stream.n_features()];
        for n_rows in [1, 17, 400, 3].into_iter().cycle() {
            if taken == 2 * N_SAMPLES {
                break;
            }
            taken += stream.push(&rows[6 * taken..6 * (taken + n_rows).min(2 * N_SAMPLES)]).unwrap();
            if n_rows == 400 || stream.is_complete() {
                stream.features_into(&mut out).unwrap();
                all.extend_from_slice(&out);
            }
            if stream.is_complete() {
                stream.next_window().unwrap();
            }
        }
        digests.add(format!("stream, {name}"), &all);
    }
}

fn models(digests: &mut Digests) {
    let rows = wrench(3 * N_SAMPLES, 6);
    let (n_classes, n_samples) = (if cfg!(miri) { 3 } else { 11 }, N_SAMPLES);
    let paper = random_model(n_classes, n_samples, 6, FeatureSpec::default());
    let banded = random_banded(n_classes, n_samples, 6, MultiBandSpec::of(500.0, |_| true));
    for (name, model) in [("paper", paper), ("multi-band", banded)] {
        digests.words(format!("model {name}, file"), model.to_bytes().unwrap().into_iter().map(u64::from));
        answers(digests, name, &Arc::new(model), &rows);
    }
}

/// Answers of a batch, and of a stream halfway and at its end.
fn answers(digests: &mut Digests, name: &str, model: &Arc<Model>, rows: &[f64]) {
    let answers = model.identify_batch(rows, 3, 1).unwrap();
    for (n, answer) in answers.iter().enumerate() {
        digests.add(format!("model {name}, scores {n}"), &answer.scores);
        digests.add(format!("model {name}, losses {n}"), &answer.losses);
    }
    let mut stream = StreamingIdentifier::new(model.clone(), None).unwrap();
    let (first, second) = rows[..6 * N_SAMPLES].split_at(3 * N_SAMPLES);
    stream.push(first).unwrap();
    digests.add(format!("model {name}, scores halfway"), stream.scores().unwrap());
    digests.add(format!("model {name}, losses halfway"), stream.losses().unwrap());
    stream.push(second).unwrap();
    assert_eq!(bits(stream.scores().unwrap()), bits(&answers[0].scores));
}

fn buffer(digests: &mut Digests) {
    let spec = BufferSpec::default().with_reorder_depth(4).with_seconds(2.0);
    let (mut writer, mut reader) = wrench_buffer(spec).unwrap();
    let (mut noise, mut words) = (uniform(11), Vec::new());
    for n in 0..size(2000) as u64 {
        let place = if n % 10 == 4 { n + 1 } else { n - u64::from(n % 10 == 5) };
        if n % 97 == 40 {
            continue;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // up to 0.2 ms
        let late_ns = (2e5 * (noise() + 0.5)) as u64;
        let wrench: [f64; 6] = std::array::from_fn(|_| noise());
        writer.push(&Row {
            ticks: 2_000_000 * place,
            host_ns: 2_001_000 * place + late_ns,
            wrench,
            flags: 0,
        });
        reader.read_each(usize::MAX, |row| {
            words.extend([row.row.ticks, row.row.host_ns, u64::from(row.missing_before)]);
            words.extend(bits(row.row.wrench));
        });
        if n % 50 == 49 {
            let line = [reader.lag_ns(2_001_000 * n), reader.host_ns_at(2_000_000 * n)];
            words.extend(line.map(|value| value.unwrap().to_bits()));
        }
    }
    writer.flush();
    digests.words("ring, rows and clock", words);
    let spec = WindowSpec::whole(size(900) - 4).with_fill(Fill::Linear).with_max_gap(3);
    let window = reader.window(&spec).unwrap();
    digests.add("ring, window with filled gaps", &window.wrench);
}

fn packets(digests: &mut Digests) {
    let mut noise = uniform(5);
    let scale = Scale::new(1e6, 999_983.0).unwrap();
    let mut decoder = Decoder::new(Variant::Axia, scale, [2000.0; 6]);
    let mut words = Vec::new();
    for n in (0..500_u32).take(size(500)) {
        #[allow(clippy::cast_possible_truncation)] // +-1e9
        let counts = std::array::from_fn(|_| (2e9 * noise()) as i32);
        let number = if n % 50 == 20 { n + 3 } else { n + 1 };
        let status = if n % 60 == 30 { 1 << 27 } else { 0 };
        let record = Record { rdt_sequence: number, ft_sequence: 14 * number, status, counts };
        decoder.datagram(&record.to_bytes(), u64::from(n), &mut |decoded| {
            if let Decoded::Row(row) = decoded {
                words.extend([row.ticks, row.host_ns, u64::from(row.flags)]);
                words.extend(bits(&row.wrench));
            }
        });
    }
    digests.words("packets", words);
}

fn all() -> Digests {
    let mut digests = Digests::default();
    for add in [designs, filters, features, multiband, streams, models, buffer, packets] {
        add(&mut digests);
    }
    digests
}

/// Under Miri the sizes are others: what counts there is that nothing undefined is done.
#[test]
fn bits_are_the_golden_ones() {
    let got = all().0;
    if cfg!(miri) {
        return;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/golden_bits.txt");
    if std::env::var_os("GRANULAR_ID_GOLDEN").is_some_and(|value| value == "write") {
        let mut text = format!(
            "# granular-id {}: digests of tests/core/golden.rs, which says how to write them\n",
            env!("CARGO_PKG_VERSION")
        );
        for (name, digest) in &got {
            writeln!(text, "{digest:016x} {name}").unwrap();
        }
        std::fs::write(&path, text).unwrap();
    }
    let text = std::fs::read_to_string(&path).unwrap();
    let golden: BTreeMap<String, u64> = text
        .lines()
        .skip(1)
        .map(|line| line.split_once(' ').unwrap())
        .map(|(digest, name)| (name.to_owned(), u64::from_str_radix(digest, 16).unwrap()))
        .collect();
    let names: Vec<_> = got.iter().filter(|(name, digest)| golden.get(*name) != Some(digest)).collect();
    assert!(names.is_empty(), "{} of {} digests differ: {names:#?}", names.len(), got.len());
    assert!(got.len() == golden.len(), "the file has digests of {} more", golden.len() - got.len());
}

/// What chooses its path once per process, as scores and streams do, on each path in a process of its own.
#[test]
#[cfg(not(miri))]
fn every_path_has_the_golden_bits() {
    if std::env::var_os("GRANULAR_ID_SIMD").is_some() {
        return;
    }
    for path in SimdPath::available().split_last().unwrap().1 {
        let status = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--quiet", "golden::bits_are_the_golden_ones"])
            .env("GRANULAR_ID_SIMD", path.name())
            .env_remove("GRANULAR_ID_GOLDEN")
            .status();
        assert!(status.unwrap().success(), "{path:?}");
    }
}
