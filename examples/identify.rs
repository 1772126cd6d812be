//! Identifies recordings with the Rust crate alone: a model file and recordings in, answers and rankings of materials out.
//!
//! ```text
//! cargo run --example identify -- kitchen.safetensors kitchen/rice/*.npz
//! ```
//!
//! It reads the NPZ files that `granular-id record` and `granular-id data convert` write, and CSV files with a line of names,
//! then a sample per line: columns named as the axes of the model (`fx` ... `tz`, in newton and newton metre) may stand in
//! any order; a column `time` (seconds) is compared with the rate of the model.

use std::collections::HashMap;
use std::error::Error;
use std::fmt::Write;
use std::fs;
use std::process::ExitCode;

use granular_id::model::Answer;
use granular_id::Model;

/// By how much the mean step of a recording may differ from that of the model.
const RATE_TOLERANCE: f64 = 0.01;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((model, recordings)) = arguments.split_first().filter(|(_, recordings)| !recordings.is_empty())
    else {
        eprintln!("usage: identify MODEL.safetensors RECORDING.npz|RECORDING.csv ...");
        return ExitCode::from(2);
    };
    let model = match Model::read(model) {
        Ok(model) => model,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    };
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
    serde_json::from_str(&model.metadata().trained)
        .is_ok_and(|trained: serde_json::Value| trained["synthetic"] == serde_json::Value::Bool(true))
}

/// The answer for each recording of a file, then the ranking of the materials, a line each.
pub fn identified(model: &Model, path: &str) -> Result<String, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let pushes =
        if bytes.starts_with(b"PK") { archived(model, &bytes)? } else { vec![recording(model, &bytes)?] };
    let mut lines = String::new();
    for push in &pushes {
        let answer = model.identify(push)?;
        writeln!(lines, "{path}: {}", in_words(model, &answer))?;
        for class in answer.ranking() {
            writeln!(lines, "{:10.4}  {}", answer.losses[class], model.classes()[class])?;
        }
    }
    Ok(lines)
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
    let body = std::str::from_utf8(&text[end + 1..]).map_err(|_| "the numbers are not UTF-8 text")?;
    let cells = body.lines().filter(|line| !line.trim().is_empty()).flat_map(|line| line.split(','));
    let number = |cell: &str| cell.parse::<f64>().map_err(|_| format!("'{cell}' is not a number"));
    let values = cells.map(|cell| number(cell.trim())).collect::<Result<Vec<_>, _>>()?;
    if values.len() % names.len() != 0 {
        return Err(format!("wanted {} cells in each line, as in the line of names", names.len()).into());
    }
    let mut rows = values.chunks_exact(names.len());
    let step_s = match (names.iter().position(|name| name == "time"), rows.next(), rows.next_back()) {
        (Some(time), Some(first), Some(last)) => Some((last[time] - first[time]) / (rows.len() + 1) as f64),
        _ => None,
    };
    in_order(model, &names, &values, step_s)
}

/// Rows of named columns as the model wants them, or what they have otherwise.
fn in_order(
    model: &Model,
    names: &[String],
    values: &[f64],
    step_s: Option<f64>,
) -> Result<Vec<f64>, Box<dyn Error>> {
    let column = |axis: &String| {
        names
            .iter()
            .position(|name| *name == axis.to_lowercase())
            .ok_or_else(|| format!("wanted a column {axis}, got {}", names.join(", ")))
    };
    let axes = model.metadata().axes.iter().map(column).collect::<Result<Vec<_>, _>>()?;
    let rows = values.chunks_exact(names.len());
    if rows.len() != model.n_samples() {
        return Err(format!("wanted {} samples, got {}", model.n_samples(), rows.len()).into());
    }
    let wanted = 1.0 / model.rate_hz();
    match step_s {
        Some(step) if !step.is_finite() || (step / wanted - 1.0).abs() > RATE_TOLERANCE => {
            Err(format!("wanted a sample every {wanted} s, got one every {step} s: resample it first").into())
        }
        _ => Ok(rows.flat_map(|row| axes.iter().map(|axis| row[*axis])).collect()),
    }
}

/// The recordings of an NPZ file that this package wrote.
pub fn archived(model: &Model, zip: &[u8]) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    let foreign = "not an NPZ file as granular-id writes it";
    let arrays = arrays(zip).ok_or(foreign)?;
    let of = |name: &str, kind: &str| {
        arrays.get(name).filter(|array| array.0.starts_with(kind)).map(|array| array.1).ok_or(foreign)
    };
    let width = arrays
        .get("axes")
        .and_then(|array| array.0.strip_prefix("<U")?.parse::<usize>().ok().filter(|width| *width > 0))
        .ok_or(foreign)?;
    let letter = |four: &[u8; 4]| char::from_u32(u32::from_le_bytes(*four)).filter(|letter| *letter != '\0');
    let name = |text: &[u8]| text.as_chunks().0.iter().filter_map(letter).collect::<String>().to_lowercase();
    let names: Vec<String> = of("axes", "<U")?.chunks_exact(4 * width).map(name).collect();
    let floats =
        |bytes: &[u8]| bytes.as_chunks().0.iter().map(|eight| f64::from_le_bytes(*eight)).collect::<Vec<_>>();
    let wrench = floats(of("wrench", "<f8")?);
    let mut rest = &wrench[..];
    let mut pushes = Vec::new();
    let lengths = of("n_samples", "<i8")?.as_chunks().0.iter().map(|eight| u64::from_le_bytes(*eight));
    for (n, rate_hz) in lengths.zip(floats(of("rate_hz", "<f8")?)) {
        let n_values = usize::try_from(n)?.checked_mul(names.len()).ok_or(foreign)?;
        let (push, others) = rest.split_at_checked(n_values).ok_or(foreign)?;
        pushes.push(in_order(model, &names, push, Some(1.0 / rate_hz))?);
        rest = others;
    }
    Ok(pushes)
}

/// The arrays of an NPZ file by name, each as its type and its bytes; None where something is compressed or cut off.
fn arrays(zip: &[u8]) -> Option<HashMap<String, (String, &[u8])>> {
    let number = |at: usize, n: usize| {
        let bytes = zip.get(at..at.checked_add(n)?)?;
        Some(bytes.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte)))
    };
    let end = zip.len().checked_sub(22).filter(|end| zip[*end..].starts_with(b"PK\x05\x06"))?;
    let mut entry = number(end + 16, 4)?;
    let mut found = HashMap::new();
    for _ in 0..number(end + 10, 2)? {
        let (method, size, offset) = (number(entry + 10, 2)?, number(entry + 24, 4)?, number(entry + 42, 4)?);
        let lengths = [number(entry + 28, 2)?, number(entry + 30, 2)?, number(entry + 32, 2)?];
        let name = std::str::from_utf8(zip.get(entry + 46..entry + 46 + lengths[0])?).ok()?;
        let at = offset + 30 + number(offset + 26, 2)? + number(offset + 28, 2)?;
        let array =
            zip.get(at..at + size).filter(|array| method == 0 && array.starts_with(b"\x93NUMPY\x01"))?;
        let (header, values) = array.get(10..)?.split_at_checked(number(at + 8, 2)?)?;
        let kind = std::str::from_utf8(header).ok()?.split('\'').nth(3)?;
        found.insert(name.trim_end_matches(".npy").to_owned(), (kind.to_owned(), values));
        entry += 46 + lengths.iter().sum::<usize>();
    }
    Some(found)
}
