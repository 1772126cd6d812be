//! What a model extracts, as JSON of a file: one line, names in order.

use serde::{Deserialize, Serialize};

use super::json::parsed_object;
use super::ModelError;
use crate::dsp::Outside;
use crate::features::{FeatureSpec, Initial};
use crate::multiband::{Block, MultiBandSpec};
use crate::specs::listed;

const WHAT: &str = "feature_spec";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PaperJson {
    bin_range: Vec<(f64, f64)>,
    cutoff_hz: f64,
    density: bool,
    hfmh: bool,
    initial: String,
    n_bins: usize,
    order: usize,
    outside: String,
    rate_hz: f64,
    raw: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MultiBandJson {
    blocks: Vec<String>,
    rate_hz: f64,
}

/// Text of samples and histograms.
pub(super) fn write_paper(spec: &FeatureSpec) -> String {
    text(&PaperJson {
        bin_range: spec.bin_ranges.clone(),
        cutoff_hz: spec.cutoff_hz,
        density: spec.density,
        hfmh: spec.hfmh,
        initial: spec.initial.name().to_owned(),
        n_bins: spec.n_bins,
        order: spec.order,
        outside: spec.outside.name().to_owned(),
        rate_hz: spec.rate_hz,
        raw: spec.raw,
    })
}

/// Text of multi-band features.
pub(super) fn write_multiband(spec: &MultiBandSpec) -> String {
    let named = Block::NAMED.into_iter().filter(|(_, block)| spec.wants(*block));
    text(&MultiBandJson { blocks: named.map(|(name, _)| name.to_owned()).collect(), rate_hz: spec.rate_hz })
}

fn text(spec: &impl Serialize) -> String {
    // Numbers and texts alone: nothing that serde_json refuses.
    serde_json::to_string(spec).unwrap_or_default()
}

/// Samples and histograms. Values outside their range are found later.
pub(super) fn read_paper(text: &str) -> Result<FeatureSpec, ModelError> {
    let json: PaperJson = parsed_object(WHAT, text)?;
    Ok(FeatureSpec {
        bin_ranges: json.bin_range,
        cutoff_hz: json.cutoff_hz,
        density: json.density,
        hfmh: json.hfmh,
        initial: choice("initial", &json.initial, &Initial::NAMED)?,
        n_bins: json.n_bins,
        order: json.order,
        outside: choice("outside", &json.outside, &Outside::NAMED)?,
        rate_hz: json.rate_hz,
        raw: json.raw,
    })
}

/// Multi-band features, whose blocks are named once each and in order.
pub(super) fn read_multiband(text: &str) -> Result<MultiBandSpec, ModelError> {
    let MultiBandJson { blocks, rate_hz } = parsed_object(WHAT, text)?;
    let has = Block::NAMED.map(|(name, _)| blocks.iter().any(|block| block == name));
    let in_order = Block::NAMED.iter().zip(has).filter(|(_, has)| *has).map(|((name, _), _)| *name);
    if !blocks.iter().map(String::as_str).eq(in_order) {
        let names = Block::NAMED.map(|(name, _)| name).join(", ");
        let problem = format!("'blocks' must be a list of blocks in the order {names}");
        return Err(ModelError::Json { what: WHAT, problem });
    }
    let [coupling, quantiles, envelope, spectrum, level] = has;
    Ok(MultiBandSpec { rate_hz, coupling, quantiles, envelope, spectrum, level })
}

fn choice<T: Copy>(name: &str, text: &str, named: &[(&str, T)]) -> Result<T, ModelError> {
    let found = named.iter().find(|(known, _)| *known == text).map(|(_, meaning)| *meaning);
    let problem = || format!("'{name}' must be {}", listed(named));
    found.ok_or_else(|| ModelError::Json { what: WHAT, problem: problem() })
}
