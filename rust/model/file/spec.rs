//! The feature specification as JSON.

use serde_json::{json, Value};

use super::json::{Json, Object};
use crate::dsp::Outside;
use crate::features::Initial;
use crate::model::fault::Fault;
use crate::multiband::{Block, MultiBandSpec};
use crate::names::listed;
use crate::FeatureSpec;

/// Which definition of bands and blocks is meant: a model of another one would see other numbers.
const DEFINITION: usize = 1;

/// The specification as one line, names in order.
pub(super) fn write(spec: &FeatureSpec) -> String {
    let ranges: Vec<Value> = spec.bin_ranges.iter().map(|(low, high)| json!([low, high])).collect();
    json!({
        "bin_range": ranges,
        "cutoff_hz": spec.cutoff_hz,
        "density": spec.density,
        "hfmh": spec.hfmh,
        "initial": spec.initial.name(),
        "n_bins": spec.n_bins,
        "order": spec.order,
        "outside": spec.outside.name(),
        "rate_hz": spec.rate_hz,
        "raw": spec.raw,
    })
    .to_string()
}

/// Whether multi-band features are described.
pub(super) fn is_multiband(object: &Object) -> bool {
    object.names().any(|name| name == "multiband")
}

/// The specification that is described, nothing left out and nothing added. Whether it makes sense is not asked here.
pub(super) fn read(mut object: Object) -> Result<FeatureSpec, Fault> {
    let spec = FeatureSpec {
        bin_ranges: object.take("bin_range", "a list of pairs of numbers", ranges)?,
        cutoff_hz: object.take("cutoff_hz", "a number", Json::number)?,
        density: object.take("density", "true or false", Json::flag)?,
        hfmh: object.take("hfmh", "true or false", Json::flag)?,
        initial: object.take("initial", &listed(&Initial::NAMED), |value| choice(value, &Initial::NAMED))?,
        n_bins: object.take("n_bins", "a whole number", count)?,
        order: object.take("order", "a whole number", count)?,
        outside: object.take("outside", &listed(&Outside::NAMED), |value| choice(value, &Outside::NAMED))?,
        rate_hz: object.take("rate_hz", "a number", Json::number)?,
        raw: object.take("raw", "true or false", Json::flag)?,
    };
    object.end()?;
    Ok(spec)
}

/// Multi-band features as one line, names in order.
pub(super) fn write_multiband(spec: &MultiBandSpec) -> String {
    let named = Block::NAMED.into_iter().filter(|(_, block)| spec.wants(*block));
    let blocks: Vec<_> = named.map(|(name, _)| name).collect();
    json!({ "blocks": blocks, "multiband": DEFINITION, "rate_hz": spec.rate_hz }).to_string()
}

/// The multi-band features that are described, nothing left out and nothing added.
pub(super) fn read_multiband(mut object: Object) -> Result<MultiBandSpec, Fault> {
    let wanted = format!("a list of blocks in the order {}", Block::NAMED.map(|(name, _)| name).join(", "));
    let [coupling, quantiles, envelope, spectrum, level] = object.take("blocks", &wanted, blocks)?;
    object.take("multiband", "1, the definition that is known here", |value| {
        count(value).filter(|definition| *definition == DEFINITION)
    })?;
    let rate_hz = object.take("rate_hz", "a number", Json::number)?;
    object.end()?;
    Ok(MultiBandSpec { rate_hz, coupling, quantiles, envelope, spectrum, level })
}

/// Which blocks a list names, if it does so once each and in order.
fn blocks(value: Json) -> Option<[bool; 5]> {
    let Json::List(list) = value else { return None };
    let names: Vec<_> = list.into_iter().map(Json::text).collect::<Option<_>>()?;
    let has = Block::NAMED.map(|(block, _)| names.iter().any(|name| name == block));
    let in_order = Block::NAMED.iter().zip(has).filter(|(_, has)| *has).map(|((name, _), _)| *name);
    names.iter().map(String::as_str).eq(in_order).then_some(has)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // whole and small enough to be exact
pub(super) fn count(value: Json) -> Option<usize> {
    value
        .number()
        .filter(|count| count.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(count))
        .map(|count| count as usize)
}

pub(super) fn choice<T: Copy>(value: Json, named: &[(&str, T)]) -> Option<T> {
    let text = value.text()?;
    named.iter().find(|(name, _)| *name == text).map(|(_, meaning)| *meaning)
}

fn ranges(value: Json) -> Option<Vec<(f64, f64)>> {
    let Json::List(list) = value else { return None };
    list.into_iter()
        .map(|pair| {
            let Json::List(pair) = pair else { return None };
            let [low, high]: [Json; 2] = pair.try_into().ok()?;
            Some((low.number()?, high.number()?))
        })
        .collect()
}
