//! The functions as C calls them.

use std::ffi::{CStr, CString};
use std::fs;
use std::path::{Path, PathBuf};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use allocation_counter::measure;
use granular_id::model::{Features, ModelParts, Tensor, MAX_FILE_BYTES};
use granular_id::multiband::{n_bands, MultiBand, MultiBandSpec, Scales};
use granular_id::{BatchShape, Extractor, FeatureSpec, Model};

use crate::extract::{gid_extract, gid_n_features, gid_spec, gid_spec_default};
use crate::gid_status::*;
use crate::model::{
    gid_model, gid_model_axis, gid_model_free, gid_model_get_info, gid_model_info, gid_model_label,
    gid_model_load, gid_model_load_bytes, gid_model_unit,
};
use crate::stream::{
    beside_a_call, gid_decision, gid_stream, gid_stream_decide, gid_stream_free, gid_stream_losses,
    gid_stream_new, gid_stream_push, gid_stream_reset,
};
use crate::{gid_last_error, gid_status, guarded, GID_CANDIDATE_BYTES, GID_MAX_STREAMS};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name)
}

/// Uniform numbers from -2 to 2: a congruential generator.
fn noise(n: usize) -> Vec<f64> {
    let mut state = 7_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 51) as f64 - 2.0
    };
    (0..n).map(|_| next()).collect()
}

/// Three classes of three axes by multi-band features, with probabilities.
fn banded() -> Model {
    let (spec, n_samples, n_axes) = (MultiBandSpec::default(), 100, 3);
    let scales = Scales::unit(n_bands(n_samples), n_axes).unwrap();
    let n_features = MultiBand::new(spec, n_samples, n_axes, &scales).unwrap().n_features();
    let (coef, codes) = (noise(3 * n_features), [1.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, -1.0]);
    let band_scales = Tensor::new(vec![n_bands(n_samples), n_axes], &scales.bands);
    let mut parts = ModelParts::new(
        Features::MultiBand { spec, band_scales, level_scales: None },
        n_samples,
        n_axes,
        Tensor::new(vec![3, n_features], &coef),
        Tensor::new(vec![3], &[0.5, 0.0, -0.5]),
        Tensor::new(vec![3, 3], &codes),
        ["rice", "salt", "süß"].map(str::to_owned).to_vec(),
    );
    parts.metadata.trained = r#"{"temperature": 0.125, "synthetic": true}"#.to_owned();
    parts.metadata.units = ["N", "m/s2", ""].map(str::to_owned).to_vec();
    parts.metadata.lead_s = Some(0.05);
    Model::new(parts).unwrap()
}

/// Samples and histograms; the same with rules; multi-band features.
fn models() -> [Model; 3] {
    let read = |name| Model::read(data(name)).unwrap();
    [read("model/model.safetensors"), read("rules/model.safetensors"), banded()]
}

fn load(model: &Model) -> gid_model {
    let bytes = model.to_bytes().unwrap();
    let mut handle = gid_model { id: 0 };
    assert_eq!(unsafe { gid_model_load_bytes(bytes.as_ptr(), bytes.len(), &raw mut handle) }, GID_OK);
    handle
}

fn stream_of(model: gid_model) -> gid_stream {
    let mut stream = gid_stream { id: 0 };
    loop {
        match unsafe { gid_stream_new(model, &raw mut stream) } {
            GID_MEMORY => thread::yield_now(), // the test of the limit has them all
            status => break assert_eq!(status, GID_OK),
        }
    }
    stream
}

fn push(stream: gid_stream, rows: &[f64]) -> gid_status {
    unsafe { gid_stream_push(stream, rows.as_ptr(), rows.len()) }
}

fn nothing() -> gid_decision {
    gid_decision {
        label: 0,
        loss: 0.0,
        margin: 0.0,
        probability: 0.0,
        n_seen: 0,
        candidates: [0; GID_CANDIDATE_BYTES],
        unknown: 0,
        is_final: false,
        is_sure: false,
    }
}

fn decide(stream: gid_stream) -> gid_decision {
    let mut decision = nothing();
    assert_eq!(unsafe { gid_stream_decide(stream, &raw mut decision) }, GID_OK);
    decision
}

fn sentence() -> String {
    let mut text = [1; 1025];
    unsafe { gid_last_error(text.as_mut_ptr(), text.len()) };
    unsafe { CStr::from_ptr(text.as_ptr()) }.to_str().unwrap().to_owned()
}

#[test]
fn header_is_that_of_the_functions() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).unwrap();
    let builder = cbindgen::Builder::new().with_config(config).with_src(folder.join("lib.rs"));
    let mut made = Vec::new();
    builder.generate().unwrap().write(&mut made);
    let path = folder.join("include/granular_id.h");
    if std::env::var_os("GRANULAR_ID_WRITE_HEADER").is_some() {
        fs::write(&path, &made).unwrap();
    }
    let is_same = fs::read(&path).unwrap() == made;
    assert!(is_same, "GRANULAR_ID_WRITE_HEADER=1 cargo test --package granular-id-c writes it anew");
}

#[test]
fn decisions_have_the_bits_of_the_core() {
    for model in models() {
        let (n_axes, n_values) = (model.n_axes(), model.n_samples() * model.n_axes());
        let handle = load(&model);
        let stream = stream_of(handle);
        assert_eq!(gid_model_free(handle), GID_OK); // the stream goes on
        let mut losses = vec![0.0; model.classes().len()];
        for (k, recording) in noise(100 * n_values).chunks_exact(n_values).enumerate() {
            let statuses: Vec<_> =
                recording.chunks((1 + k % 40) * n_axes).map(|rows| push(stream, rows)).collect();
            assert!(statuses.iter().all(|status| *status == GID_OK));
            let (decision, answer) = (decide(stream), model.identify(recording).unwrap());
            assert_eq!(unsafe { gid_stream_losses(stream, losses.as_mut_ptr(), losses.len()) }, GID_OK);
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&losses), bits(&answer.losses));
            assert_eq!(decision.label, answer.best);
            let numbers = [decision.loss, decision.margin];
            assert_eq!(bits(&numbers), bits(&[answer.losses[answer.best], answer.margin()]));
            let is_candidate = |class: &usize| decision.candidates[class / 8] >> (class % 8) & 1 == 1;
            let mut wanted = answer.candidates.clone();
            wanted.sort_unstable();
            assert_eq!((0..8 * GID_CANDIDATE_BYTES).filter(is_candidate).collect::<Vec<_>>(), wanted);
            assert_eq!(decision.unknown, answer.unknown.map_or(-1, i8::from));
            assert_eq!((decision.is_final, decision.n_seen), (true, model.n_samples()));
            let has_probabilities = model.metadata().trained.contains("\"temperature\"");
            assert_eq!((0.0..=1.0).contains(&decision.probability), has_probabilities);
            assert_eq!(push(stream, &recording[..n_axes]), GID_FULL);
            assert_eq!(gid_stream_reset(stream), GID_OK);
        }
        assert_eq!(gid_stream_free(stream), GID_OK);
    }
}

#[test]
fn real_time_calls_allocate_nothing_also_when_they_fail() {
    for model in models() {
        let (n_axes, n_samples) = (model.n_axes(), model.n_samples());
        let rows = noise(n_axes * n_samples);
        let (handle, mut losses) = (load(&model), vec![0.0; model.classes().len()]);
        let (stream, mut text) = (stream_of(handle), [0; 64]);
        let counted = measure(|| {
            for _ in 0..3 {
                for row in rows.chunks_exact(n_axes) {
                    assert_eq!(push(stream, row), GID_OK);
                    decide(stream);
                    unsafe { gid_stream_losses(stream, losses.as_mut_ptr(), losses.len()) };
                }
                assert_eq!(push(stream, &rows), GID_FULL);
                gid_stream_reset(stream);
                assert_eq!(push(stream, &[f64::NAN; 6][..n_axes]), GID_VALUE);
                assert_eq!(push(stream, &[1e300; 6][..n_axes]), GID_VALUE);
                assert_eq!(push(stream, &rows[1..]), GID_SIZE);
                assert_eq!(unsafe { gid_stream_push(stream, null(), 6) }, GID_NULL);
                assert_eq!(unsafe { gid_stream_losses(stream, losses.as_mut_ptr(), 1) }, GID_SIZE);
                assert_eq!(push(gid_stream { id: 5 }, &rows), GID_HANDLE);
                assert!(unsafe { gid_last_error(text.as_mut_ptr(), text.len()) } > 0);
            }
        });
        assert_eq!((counted.count_total, counted.bytes_total, counted.count_current), (0, 0, 0));
        assert_eq!((gid_stream_free(stream), gid_model_free(handle)), (GID_OK, GID_OK));
    }
}

#[test]
fn rows_that_are_not_whole_are_refused_with_the_width() {
    let model = load(&banded());
    let stream = stream_of(model);
    assert_eq!(push(stream, &[0.5; 5]), GID_SIZE);
    assert_eq!(sentence(), "rows must hold a multiple of 3 values, one for each axis, got 5");
    assert_eq!((decide(stream).n_seen, push(stream, &[0.5; 6]), decide(stream).n_seen), (0, GID_OK, 2));
    assert_eq!((gid_stream_free(stream), gid_model_free(model)), (GID_OK, GID_OK));
}

#[test]
fn model_says_its_labels_axes_and_rate() {
    let info = |handle| {
        let mut info = std::mem::MaybeUninit::<gid_model_info>::uninit();
        assert_eq!(unsafe { gid_model_get_info(handle, info.as_mut_ptr()) }, GID_OK);
        unsafe { info.assume_init() }
    };
    let (handle, [no_lead, ..]) = (load(&banded()), models());
    let wanted = gid_model_info {
        n_classes: 3,
        n_axes: 3,
        n_samples: 100,
        rate_hz: 500.0,
        lead_s: 0.05,
        synthetic: true,
    };
    assert_eq!(info(handle), wanted);
    let no_lead = load(&no_lead);
    assert!(info(no_lead).lead_s.is_nan());
    assert_eq!(gid_model_free(no_lead), GID_OK);
    let text = |pointer| unsafe { CStr::from_ptr(pointer) }.to_str().unwrap();
    assert_eq!(text(gid_model_label(handle, 2)), "süß");
    assert_eq!(text(gid_model_axis(handle, 0)), banded().metadata().axes[0]);
    assert_eq!([0, 1, 2].map(|k| text(gid_model_unit(handle, k))), ["N", "m/s2", ""]);
    assert!(gid_model_label(handle, 3).is_null());
    assert_eq!(sentence(), "label 3 is not one of 0 to 2");
    assert_eq!(gid_model_free(handle), GID_OK);
    assert!(gid_model_axis(handle, 0).is_null());
}

#[test]
fn bad_files_are_refused_with_a_sentence() {
    let (good, mut handle) = (fs::read(data("rules/model.safetensors")).unwrap(), gid_model { id: 0 });
    let out = &raw mut handle;
    for place in (0..good.len()).step_by(997) {
        let mut bad = good.clone();
        bad[place] ^= 1;
        assert_eq!(unsafe { gid_model_load_bytes(bad.as_ptr(), bad.len(), out) }, GID_MODEL);
        assert_eq!(unsafe { gid_model_load_bytes(good.as_ptr(), place, out) }, GID_MODEL);
    }
    let read = |path: &Path| {
        let path = CString::new(path.to_str().unwrap()).unwrap();
        unsafe { gid_model_load(path.as_ptr(), out) }
    };
    let large = vec![0; MAX_FILE_BYTES + 1];
    assert_eq!(unsafe { gid_model_load_bytes(large.as_ptr(), large.len(), out) }, GID_MODEL);
    assert_eq!(sentence(), "the file has 33554433 bytes; at most 33554432 are read");
    assert_eq!(read(&data("rules/answers.txt")), GID_MODEL);
    assert!(sentence().contains("answers.txt: "), "{}", sentence());
    assert_eq!(read(&data("nowhere")), GID_FILE);
    assert!(sentence().contains("nowhere: "), "{}", sentence());
    assert_eq!(read(&data("rules/model.safetensors")), GID_OK);
    assert_eq!(gid_model_free(handle), GID_OK);
}

#[test]
fn null_and_misaligned_pointers_are_refused() {
    let model = load(&banded());
    let stream = stream_of(model);
    let (odd, mut unused) = (9 as *const f64, gid_model { id: 0 });
    let statuses = unsafe {
        [
            gid_model_load(null(), null_mut()),
            gid_model_load_bytes(null(), 3, &raw mut unused),
            gid_model_load_bytes([1].as_ptr(), 1, null_mut()),
            gid_model_get_info(model, null_mut()),
            gid_stream_new(model, null_mut()),
            gid_stream_push(stream, null(), 3),
            gid_stream_push(stream, odd, 3),
            gid_stream_decide(stream, null_mut()),
            gid_stream_losses(stream, null_mut(), 3),
            gid_n_features(null(), 6, null_mut()),
            gid_n_features(&raw const *Box::new(gid_spec_default()), 6, null_mut()),
            gid_extract(null(), null(), 0, null_mut(), 0),
        ]
    };
    assert_eq!(statuses, [GID_NULL; 12]);
    assert_eq!(unsafe { gid_stream_push(stream, std::ptr::dangling(), usize::MAX) }, GID_SIZE);
    assert_eq!(unsafe { gid_stream_push(stream, null(), 0) }, GID_OK);
    assert_eq!(unsafe { gid_last_error(null_mut(), 0) }, sentence().len());
    assert_eq!((gid_stream_free(stream), gid_model_free(model)), (GID_OK, GID_OK));
}

#[test]
fn freed_and_invented_handles_are_refused() {
    let model = load(&banded());
    let (stream, mut unused) = (stream_of(model), gid_stream { id: 0 });
    assert_eq!((gid_stream_free(stream), gid_stream_free(stream)), (GID_OK, GID_HANDLE));
    let other = stream_of(model); // perhaps in the same place
    assert_eq!(push(stream, &[0.0; 3]), GID_HANDLE);
    assert_eq!(sentence(), format!("stream {} was freed or never made", stream.id));
    assert_eq!(gid_stream_free(other), GID_OK);
    assert_eq!((gid_model_free(model), gid_model_free(model)), (GID_OK, GID_HANDLE));
    assert_eq!(unsafe { gid_stream_new(model, &raw mut unused) }, GID_HANDLE);
    for id in [0, 1, 255, u64::MAX] {
        assert_eq!(gid_stream_reset(gid_stream { id }), GID_HANDLE);
        assert_eq!(gid_model_free(gid_model { id: id << 32 }), GID_HANDLE);
    }
}

#[test]
fn calls_on_a_stream_that_another_thread_is_in_are_busy() {
    let model = load(&banded());
    let stream = stream_of(model);
    let (mut decision, mut losses) = (nothing(), [0.0; 3]);
    let calls = |decision: &mut gid_decision, losses: &mut [f64; 3]| unsafe {
        [
            push(stream, &[0.5; 3]),
            gid_stream_decide(stream, decision),
            gid_stream_losses(stream, losses.as_mut_ptr(), 3),
            gid_stream_reset(stream),
            gid_stream_free(stream),
        ]
    };
    let other_call = beside_a_call(stream);
    assert_eq!(calls(&mut decision, &mut losses), [GID_BUSY; 5]);
    assert_eq!(sentence(), format!("another thread is in a call on stream {}", stream.id));
    drop(other_call);
    assert_eq!(calls(&mut decision, &mut losses), [GID_OK; 5]);
    assert_eq!((decision.n_seen, gid_model_free(model)), (1, GID_OK));
}

#[test]
fn two_threads_on_a_stream_end_in_statuses() {
    let model = load(&banded());
    let (stream, end) = (stream_of(model), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| {
            while !end.load(Ordering::Relaxed) {
                let status = push(stream, &[0.5; 30]);
                assert!([GID_OK, GID_FULL, GID_BUSY].contains(&status), "{status:?}");
            }
        });
        let mut decision = nothing();
        for _ in 0..2000 {
            let statuses =
                [gid_stream_reset(stream), unsafe { gid_stream_decide(stream, &raw mut decision) }];
            assert!(statuses.iter().all(|status| [GID_OK, GID_BUSY].contains(status)), "{statuses:?}");
        }
        end.store(true, Ordering::Relaxed);
    });
    assert_eq!((gid_stream_free(stream), gid_model_free(model)), (GID_OK, GID_OK));
}

#[test]
fn features_have_the_bits_of_the_core() {
    let ranges = [-1.0, 1.0, -2.0, 2.0];
    let own = gid_spec {
        n_axes: 2,
        n_bins: 7,
        bin_ranges: ranges.as_ptr(),
        n_bin_ranges: 2,
        clip: 1,
        steady: 3,
        ..gid_spec_default()
    };
    let spec = FeatureSpec::default().with_n_bins(7).with_bin_ranges(vec![(-1.0, 1.0), (-2.0, 2.0)]);
    let spec = spec
        .with_outside(granular_id::dsp::Outside::Clip)
        .with_initial(granular_id::features::Initial::Steady);
    for (given, spec, n_axes) in [(gid_spec_default(), FeatureSpec::default(), 6), (own, spec, 2)] {
        let (rows, mut n_features) = (noise(100 * n_axes), 0);
        assert_eq!(unsafe { gid_n_features(&raw const given, rows.len(), &raw mut n_features) }, GID_OK);
        let mut out = vec![0.0; n_features];
        let extract = |rows: &[f64], out: &mut [f64]| unsafe {
            gid_extract(&raw const given, rows.as_ptr(), rows.len(), out.as_mut_ptr(), out.len())
        };
        assert_eq!(extract(&rows, &mut out), GID_OK);
        let shape = BatchShape { n_recordings: 1, n_samples: 100, n_axes };
        assert_eq!(out, Extractor::new(spec).unwrap().extract(&rows, shape, 1).unwrap());
        assert_eq!(extract(&rows[1..], &mut out), GID_SIZE);
        assert_eq!(extract(&rows, &mut out[1..]), GID_SIZE);
        assert_eq!(extract(&vec![f64::NAN; rows.len()], &mut out), GID_VALUE);
        let bad = gid_spec { order: 99, ..given };
        assert_eq!(unsafe { gid_n_features(&raw const bad, 60, &raw mut n_features) }, GID_VALUE);
        assert_eq!(sentence(), "order must be from 1 to 32, got 99");
    }
}

#[test]
fn no_more_streams_than_there_are_places() {
    let model = load(&banded());
    let mut streams = vec![];
    let mut stream = gid_stream { id: 0 };
    while unsafe { gid_stream_new(model, &raw mut stream) } == GID_OK {
        streams.push(stream);
    }
    assert!(streams.len() > GID_MAX_STREAMS / 2, "{}", streams.len()); // other tests have some
    assert!(streams.iter().all(|stream| gid_stream_free(*stream) == GID_OK));
    assert_eq!(gid_model_free(model), GID_OK);
}

#[test]
fn no_panic_leaves_a_call() {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let status = guarded(|| panic!("for the test"));
    std::panic::set_hook(hook);
    assert_eq!(status, GID_PANIC);
    assert_eq!(sentence(), "a bug in granular_id: please report it");
}
