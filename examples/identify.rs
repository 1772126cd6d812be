//! Identifies recordings with the Rust crate alone: a model file and CSV files in, an answer and a ranking of materials out.
//!
//! ```text
//! cargo run --release --example identify -- model.safetensors push.csv
//! ```
//!
//! A CSV file has a line of names, then a sample per line. Columns named as the axes of the model (`fx` ... `tz`, in newton
//! and newton metre) may stand in any order; a column `time` (seconds) is compared with the rate of the model.

use std::error::Error;
use std::fs;
use std::process::ExitCode;

use granular_id::model::Answer;
use granular_id::number_table;
use granular_id::Model;

/// By how much the mean step of a recording may differ from that of the model.
const RATE_TOLERANCE: f64 = 0.01;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((model, recordings)) = arguments.split_first().filter(|(_, recordings)| !recordings.is_empty())
    else {
        eprintln!("usage: identify MODEL.safetensors RECORDING.csv ...");
        return ExitCode::from(2);
    };
    let model = match Model::read(model) {
        Ok(model) => model,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    };
    if model.lacks_digest() {
        eprintln!(
            "warning: the model file has no digest, an earlier version wrote it: damage would go unnoticed"
        );
    }
    if is_synthetic(&model) {
        println!("SYNTHETIC: trained on simulated recordings; its answers say nothing about real materials");
    }
    let mut code = ExitCode::SUCCESS;
    for path in recordings {
        match identified(&model, path) {
            Ok(lines) => print!("{lines}"),
            Err(error) => {
                eprintln!("{path}: {error}");
                code = ExitCode::FAILURE;
            }
        }
    }
    code
}

/// Whether the model says of itself that simulated recordings trained it.
#[must_use]
pub fn is_synthetic(model: &Model) -> bool {
    serde_json::from_str(&model.notes().trained)
        .is_ok_and(|trained: serde_json::Value| trained["synthetic"] == serde_json::Value::Bool(true))
}

/// The answer for one recording, then the ranking of the materials, a line each.
pub fn identified(model: &Model, path: &str) -> Result<String, Box<dyn Error>> {
    let text = fs::read(path)?;
    let answer = model.identify(&recording(model, &text)?)?;
    let first = format!("{path}: {}\n", in_words(model, &answer));
    let line = |class: usize| format!("{:10.4}  {}\n", answer.losses[class], model.classes()[class]);
    Ok(std::iter::once(first).chain(answer.ranking().into_iter().map(line)).collect())
}

/// The best material, or that it is like none; and which it may be, where that is not the best alone.
pub fn in_words(model: &Model, answer: &Answer) -> String {
    let label = |class: &usize| model.classes()[*class].as_str();
    let best = label(&answer.best);
    let named = match answer.unknown {
        Some(true) => format!("like no known material (nearest: {best})"),
        _ => best.to_owned(),
    };
    let others = answer.candidates.iter().any(|class| *class != answer.best);
    let candidates: Vec<_> = answer.candidates.iter().map(label).collect();
    let may_be = if others { format!("; may be {}", candidates.join(" or ")) } else { String::new() };
    format!("{named}, by a margin of {:.4}{may_be}", answer.margin())
}

/// Samples of a CSV text, with the axes of the model in its order.
pub fn recording(model: &Model, text: &[u8]) -> Result<Vec<f64>, Box<dyn Error>> {
    let end = text.iter().position(|byte| *byte == b'\n').ok_or("there is no line of names, then numbers")?;
    let names = std::str::from_utf8(&text[..end]).map_err(|_| "the line of names is not UTF-8 text")?;
    let names: Vec<String> = names.split(',').map(|name| name.trim().to_lowercase()).collect();
    let column = |wanted: &str| names.iter().position(|name| name == wanted);
    let axes: Vec<usize> = model
        .notes()
        .axes
        .iter()
        .map(|axis| {
            column(&axis.to_lowercase())
                .ok_or_else(|| format!("wanted a column {axis}, got {}", names.join(", ")))
        })
        .collect::<Result<_, _>>()?;
    let values = number_table::parse(&text[end + 1..], names.len())?;
    let rows: Vec<&[f64]> = values.chunks_exact(names.len()).collect();
    if rows.len() != model.n_samples() {
        return Err(format!("wanted {} samples, got {}", model.n_samples(), rows.len()).into());
    }
    if let (Some(time), [first, .., last]) = (column("time"), &rows[..]) {
        let (step, wanted) = ((last[time] - first[time]) / (rows.len() - 1) as f64, 1.0 / model.rate_hz());
        if (step / wanted - 1.0).abs() > RATE_TOLERANCE {
            return Err(format!(
                "wanted a sample every {wanted} s, got one every {step} s: resample it first"
            )
            .into());
        }
    }
    Ok(rows.iter().flat_map(|row| axes.iter().map(|axis| row[*axis])).collect())
}
