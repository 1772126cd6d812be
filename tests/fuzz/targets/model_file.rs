//! The reader of model files on damaged and on invented ones: a model or a fault. A model that was read writes itself, and
//! gives the same bits for a whole recording as sample by sample.

#![no_main]

use std::sync::Arc;

use granular_id::stream::StreamingIdentifier;
use granular_id::{Error, Model};
use libfuzzer_sys::fuzz_target;
use serde_json::Value;
use sha2::{Digest, Sha256};

/// Bytes of a file that are read here.
const MAX_BYTES: usize = 1 << 16;

/// Values of a recording that are worth identifying.
const MAX_VALUES: usize = 4096;

/// The longest message: the words, and a text of 40 characters, each escaped, or 160 of a parser's.
const LONGEST_MESSAGE: usize = 2200;

/// The file that is meant by a header, the numbers behind it, and two bytes with the length of the header. The hash of the
/// feature specification is made to fit, which no mutation would ever do.
fn framed(data: &[u8]) -> Option<Vec<u8>> {
    let (length, rest) = data.split_first_chunk::<2>()?;
    let (header, numbers) = rest.split_at_checked(usize::from(u16::from_le_bytes(*length)))?;
    let mut header = header.to_vec();
    if let Ok(Value::Object(entries)) = serde_json::from_slice(&header) {
        let metadata = &entries.get("__metadata__")?;
        let old = metadata.get("feature_spec_sha256").and_then(Value::as_str).filter(|old| old.len() == 64);
        let spec = metadata.get("feature_spec").and_then(Value::as_str);
        if let (Some(old), Some(spec)) = (old, spec) {
            let new: String = Sha256::digest(spec).iter().map(|byte| format!("{byte:02x}")).collect();
            let at = header.windows(64).position(|window| window == old.as_bytes());
            header[at?..][..64].copy_from_slice(new.as_bytes());
        }
    }
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header);
    file.extend(numbers);
    Some(file)
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn check(file: &[u8]) {
    let model = match Model::from_bytes(file, MAX_BYTES) {
        Ok(model) => model,
        Err(fault) => {
            let message = fault.to_string();
            assert!(message.len() < LONGEST_MESSAGE, "{} bytes", message.len());
            assert!(!message.chars().any(char::is_control), "{message:?}");
            return;
        }
    };
    let written = model.to_bytes();
    let again = Model::from_bytes(&written, written.len()).expect("what was written is read");
    assert!(again == model && again.to_bytes() == written);
    let len = model.n_samples().saturating_mul(model.n_axes());
    let n_bins = model.extractor().spec().n_bins;
    if len > MAX_VALUES || n_bins > MAX_VALUES {
        return;
    }
    let wrench: Vec<f64> = (0..len).map(|i| f64::from(file[i % file.len()]) / 64.0 - 2.0).collect();
    let mut stream = StreamingIdentifier::new(Arc::new(again), None).expect("a window of this size");
    match (model.identify(&wrench), streamed(&mut stream, &wrench, model.n_axes())) {
        (Ok(answer), Ok(scores)) => {
            assert_eq!(bits(&answer.scores), bits(&scores));
            assert!(answer.best < model.classes().len() && answer.ranking().len() == model.classes().len());
            assert!(!answer.losses.iter().any(|loss| loss.is_nan()));
        }
        (Err(_), _) => {}
        (Ok(_), Err(error)) => assert!(matches!(error, Error::Score { .. }), "{error}"), // of a provisional answer
    }
}

/// Final scores of a stream that is asked for its answer on the way.
fn streamed(stream: &mut StreamingIdentifier, wrench: &[f64], n_axes: usize) -> Result<Vec<f64>, Error> {
    for rows in wrench.chunks(7 * n_axes) {
        stream.push(rows)?;
        let standing = stream.standing()?;
        assert!(!standing.losses.iter().any(|loss| loss.is_nan()));
    }
    assert!(stream.standing()?.is_final);
    Ok(stream.scores()?.to_vec())
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
