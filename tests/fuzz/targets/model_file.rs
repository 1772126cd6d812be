//! The reader of model files on damaged and on invented ones: a model or an error. A model that was read
//! writes itself, and gives the same bits for a whole recording as sample by sample.
//!
//! cargo-fuzz sets `cfg(fuzzing)`, under which the reader lets wrong digests pass: no mutation would ever fit them.

#![no_main]

use std::sync::Arc;

use granular_id::stream::StreamingIdentifier;
use granular_id::{Error, Model};
use libfuzzer_sys::fuzz_target;

/// Bytes of a file that are read here.
const MAX_BYTES: usize = 1 << 16;

/// Values of a recording that are worth identifying.
const MAX_VALUES: usize = 4096;

/// The longest message: the words, and a text of 40 characters, each escaped, or 160 of a parser's.
const LONGEST_MESSAGE: usize = 2200;

/// The file that is meant by two bytes with the length of the header, the header, and the numbers behind it.
fn framed(data: &[u8]) -> Option<Vec<u8>> {
    let (length, rest) = data.split_first_chunk::<2>()?;
    let length = u16::from_le_bytes(*length);
    (rest.len() >= usize::from(length)).then(|| [&u64::from(length).to_le_bytes(), rest].concat())
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn check(file: &[u8]) {
    let model = match Model::from_bytes(file, MAX_BYTES) {
        Ok(model) => model,
        Err(error) => {
            let message = error.to_string();
            assert!(message.len() < LONGEST_MESSAGE, "{} bytes", message.len());
            assert!(!message.chars().any(char::is_control), "{message:?}");
            return;
        }
    };
    let written = model.to_bytes().unwrap();
    let again = Model::from_bytes(&written, written.len()).expect("what was written is read");
    assert!(again == model && again.to_bytes().unwrap() == written);
    let len = model.n_samples().saturating_mul(model.n_axes());
    let n_bins = model.extractor().map_or(0, |extractor| extractor.spec().n_bins);
    if len > MAX_VALUES || n_bins > MAX_VALUES {
        return;
    }
    let wrench: Vec<f64> = (0..len).map(|i| f64::from(file[i % file.len()]) / 64.0 - 2.0).collect();
    let mut stream = StreamingIdentifier::new(Arc::new(again), None).expect("a window of this size");
    match (model.identify(&wrench), streamed(&mut stream, &wrench, model.n_axes())) {
        (Ok(answer), Ok(())) => {
            let standing = stream.standing().expect("what it was a moment ago");
            assert_eq!(bits(&answer.scores), bits(standing.scores));
            assert_eq!((&answer.candidates[..], answer.unknown), (standing.candidates, standing.unknown));
            assert_eq!(answer.candidates.is_empty(), !model.rules().name_candidates());
            assert!(answer.best < model.classes().len() && answer.ranking().len() == model.classes().len());
            assert!(!answer.losses.iter().any(|loss| loss.is_nan()));
        }
        (Err(_), _) => {}
        (Ok(_), Err(error)) => assert!(matches!(error, Error::Score { .. }), "{error}"), // of a provisional answer
    }
}

/// Pushes a recording into a stream, and reads its answer on the way.
fn streamed(stream: &mut StreamingIdentifier, wrench: &[f64], n_axes: usize) -> Result<(), Error> {
    for rows in wrench.chunks(7 * n_axes) {
        stream.push(rows)?;
        let standing = stream.standing()?;
        assert!(!standing.losses.iter().any(|loss| loss.is_nan()));
    }
    assert!(stream.standing()?.is_final);
    Ok(())
}

// The first byte says how the rest is meant: a whole file, or parts of one.
fuzz_target!(|data: &[u8]| {
    match data.split_first() {
        Some((0, file)) => check(file),
        Some((_, parts)) => {
            if let Some(file) = framed(parts) {
                check(&file);
            }
        }
        None => {}
    }
});
