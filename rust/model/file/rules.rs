//! The rules of a model as JSON: what `ConformalRule.to_dict` and `UnknownRule.to_dict` of the Python package give.

use super::json::{self, Json, Object};
use super::spec::{choice, count};
use crate::model::codes::Codes;
use crate::model::fault::Fault;
use crate::model::nearest::NearestMean;
use crate::model::rules::{Candidates, Misfit, Refusal, Rules, Strangeness};
use crate::names::listed;

/// Where they stand in what is known of a training.
const KEY: &str = "confidence";

const CANDIDATES: &str = "granular-id conformal rule 1";
const REFUSAL: &str = "granular-id unknown rule 1";

/// What a stored refusal goes by.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    HingeDistance,
    ValueDistance,
    LearnerDistance,
    Learners,
    Value,
    Margin,
}

const KINDS: [(&str, Kind); 6] = [
    ("hinge_distance", Kind::HingeDistance),
    ("value_distance", Kind::ValueDistance),
    ("learner_distance", Kind::LearnerDistance),
    ("learners", Kind::Learners),
    ("value", Kind::Value),
    ("margin", Kind::Margin),
];

/// The rules in what is known of a training, none where there are none; each must be whole, and for these classes and codes.
pub(in crate::model) fn read(trained: &str, classes: &[String], codes: &Codes) -> Result<Rules, Fault> {
    let Some(stored) = json::object("trained", trained)?.optional(KEY) else { return Ok(Rules::default()) };
    let mut stored = stored.object("trained.confidence")?;
    let mut rule = |name, what| stored.optional(name).map(|rule| rule.object(what)).transpose();
    let (conformal, unknown) =
        (rule("conformal", "trained.confidence.conformal")?, rule("unknown", "trained.confidence.unknown")?);
    stored.end()?;
    Ok(Rules {
        candidates: conformal.map(|rule| candidates(rule, classes)).transpose()?,
        refusal: unknown.map(|rule| refusal(rule, classes, codes)).transpose()?,
    })
}

fn candidates(mut rule: Object, classes: &[String]) -> Result<Candidates, Fault> {
    begin(&mut rule, CANDIDATES, classes)?;
    let misfit = rule.take("kind", &listed(&Misfit::NAMED), |value| choice(value, &Misfit::NAMED))?;
    let levels = rule.take("levels", "rising numbers between 0 and 1", |value| {
        let levels = value.list_of(Json::number)?;
        let within = levels.iter().all(|level| 0.0 < *level && *level < 1.0);
        (within && !levels.is_empty() && levels.is_sorted_by(|a, b| a < b)).then_some(levels)
    })?;
    let n_classes = classes.len();
    let wanted = format!("rows of 1 or {n_classes} numbers or null, one for each level");
    let mut rows = rule.take("thresholds", &wanted, |value| {
        let rows = value.list_of(|row| row.list_of(limit))?;
        let width = rows.first().map(Vec::len).filter(|width| *width == 1 || *width == n_classes)?;
        (rows.len() == levels.len() && rows.iter().all(|row| row.len() == width)).then_some(rows)
    })?;
    // The largest level is the one that is promised.
    let mut limits = rows.pop().unwrap_or_default();
    let wanted = format!("{} whole numbers, one for each threshold of a level", limits.len());
    rule.take("n_calibration", &wanted, |value| {
        value.list_of(count).filter(|counts| counts.len() == limits.len())
    })?;
    let temperature =
        rule.take("temperature", "a positive number", |value| value.number().filter(|number| *number > 0.0))?;
    rule.take("held_out", "a text", Json::text)?;
    rule.end()?;
    if let [alone] = limits[..] {
        limits = vec![alone; n_classes];
    }
    Ok(Candidates { misfit, temperature, limits })
}

fn refusal(mut rule: Object, classes: &[String], codes: &Codes) -> Result<Refusal, Fault> {
    begin(&mut rule, REFUSAL, classes)?;
    let (n_classes, n_learners) = (classes.len(), codes.n_learners());
    let kind = rule.take("kind", &listed(&KINDS), |value| choice(value, &KINDS))?;
    if kind == Kind::HingeDistance && !codes.is_of_pairs() {
        return Err(rule.fault("'hinge_distance' is for one learner for each pair of classes".to_owned()));
    }
    let threshold = rule.take("threshold", "a number or null", limit)?;
    rule.take("share_known", "a number between 0 and 1", |value| {
        value.number().filter(|share| 0.0 < *share && *share < 1.0)
    })?;
    rule.take("n_calibration", "a whole number", count)?;
    rule.take("held_out", "a text", Json::text)?;
    let width = match kind {
        Kind::HingeDistance | Kind::ValueDistance => n_classes,
        Kind::LearnerDistance => n_learners,
        Kind::Learners | Kind::Value | Kind::Margin => 0,
    };
    let means = matrix(&mut rule, "means", if width > 0 { n_classes } else { 0 }, width)?;
    let whitener = matrix(&mut rule, "whitener", width, width)?;
    let (rows, columns) = if kind == Kind::Learners { (n_classes, n_learners) } else { (0, 0) };
    let sides = matrix(&mut rule, "coding", rows, columns)?;
    let own = (0..sides.len()).map(|place| f64::from(codes.code(place / columns, place % columns)));
    if !sides.iter().copied().eq(own) {
        return Err(rule.fault("'coding' must be the coding matrix of the model".to_owned()));
    }
    let nearest = |make: fn(&[f64], &[f64]) -> crate::error::Result<NearestMean>| {
        make(&means, &whitener).map_err(|error| rule.fault(error.to_string()))
    };
    let strangeness = match kind {
        Kind::HingeDistance => Strangeness::OfScores(nearest(NearestMean::of_pairs)?),
        Kind::LearnerDistance => Strangeness::OfScores(nearest(NearestMean::new)?),
        Kind::ValueDistance => Strangeness::OfLosses(nearest(NearestMean::new)?),
        Kind::Learners => Strangeness::LeastClear,
        Kind::Value => Strangeness::LeastLoss,
        Kind::Margin => Strangeness::Margin,
    };
    rule.end()?;
    Ok(Refusal { strangeness, threshold })
}

/// Takes what both kinds of rules begin with.
fn begin(rule: &mut Object, format: &str, classes: &[String]) -> Result<(), Fault> {
    rule.take("format", &format!("'{format}'"), |value| value.text().filter(|text| text == format))?;
    rule.take("classes", "the labels of the model in their order", |value| {
        value.list_of(Json::text).filter(|labels| labels == classes)
    })
    .map(drop)
}

/// A number; null is without end.
fn limit(value: Json) -> Option<f64> {
    match value {
        Json::Null => Some(f64::INFINITY),
        other => other.number(),
    }
}

/// Takes rows of numbers, one after the other.
fn matrix(rule: &mut Object, name: &str, n_rows: usize, n_columns: usize) -> Result<Vec<f64>, Fault> {
    rule.take(name, &format!("{n_rows} rows of {n_columns} numbers"), |value| {
        let rows = value.list_of(|row| row.list_of(Json::number).filter(|row| row.len() == n_columns))?;
        (rows.len() == n_rows).then(|| rows.concat())
    })
}
