//! What samples that have not arrived yet can add to the scores.

use super::counts::Counts;
use crate::dsp::Outside;
use crate::error::Result;
use crate::kernel::SimdPath;
use crate::memory::filled;
use crate::model::{AddRows, Model};
use crate::Extractor;

/// Sums over the rest of a window, from every sample on, computed once per stream.
#[derive(Clone, Debug)]
pub(super) struct Outlook {
    lanes: usize,
    n_samples: usize,
    /// Row `t`: what samples from `t` on add if they are the mean of the training recordings. Empty without a mean.
    mean: Vec<f64>,
    /// `None` where forces may be anything.
    limits: Option<Limits>,
}

/// What the rest of a window adds at least and at most, to each learner.
#[derive(Clone, Debug)]
struct Limits {
    /// Row `t`: the least that raw samples from `t` on can add. Empty without raw features.
    raw_low: Vec<f64>,
    /// Row `t`: the most.
    raw_high: Vec<f64>,
    /// Row `axis`: the least that one more counted sample can add; with densities the least that the axis can.
    bin_low: Vec<f64>,
    /// Row `axis`: the most.
    bin_high: Vec<f64>,
    /// Bound of the sum of the magnitudes of everything that is added up.
    magnitude: Vec<f64>,
    /// Rounding of such a sum, per unit of its magnitudes.
    rounding: f64,
}

/// A window so far.
pub(super) struct SoFar<'a> {
    pub(super) n_seen: usize,
    /// Sums of the raw block.
    pub(super) raw: &'a [f64],
    /// Histograms, and the same as features.
    pub(super) histograms: Option<(&'a Counts, &'a [f64])>,
    /// What made them.
    pub(super) extractor: &'a Extractor,
}

impl Outlook {
    pub(super) fn new(model: &Model, extractor: &Extractor) -> Result<Self> {
        let mean = model.raw_mean().map_or(Ok(Vec::new()), |mean| {
            suffix_sums(model, |feature| {
                let mean = mean[feature];
                move |weight| weight * mean
            })
        })?;
        let limits = Limits::new(model, extractor)?;
        Ok(Self { lanes: model.lanes(), n_samples: model.n_samples(), mean, limits })
    }

    /// What samples from `n_seen` on are expected to add; nothing for a model that knows no mean.
    pub(super) fn expected(&self, n_seen: usize) -> Option<&[f64]> {
        self.mean.get(n_seen * self.lanes..)?.get(..self.lanes)
    }

    /// Bounds of the scores that a window can end with, whatever comes within the range of the training recordings,
    /// rounding included. False when there are none.
    pub(super) fn bound_scores(
        &self,
        path: SimdPath,
        model: &Model,
        so_far: &SoFar<'_>,
        sums: &mut [f64],
        low: &mut [f64],
        high: &mut [f64],
    ) -> bool {
        let Some(limits) = &self.limits else { return false };
        for (bounds, of_rest) in [(&mut *low, &limits.raw_low), (&mut *high, &limits.raw_high)] {
            let parts = model.intercept().iter().zip(so_far.raw);
            for (bound, (intercept, raw)) in bounds.iter_mut().zip(parts) {
                *bound = intercept + raw;
            }
            let of_rest = of_rest.get(so_far.n_seen * self.lanes..).unwrap_or_default();
            for (bound, rest) in bounds.iter_mut().zip(of_rest) {
                *bound += rest;
            }
        }
        if let Some((counts, values)) = so_far.histograms {
            let spec = so_far.extractor.spec();
            let unseen = (self.n_samples - so_far.n_seen) as f64;
            for (axis, values) in values.chunks_exact(spec.n_bins).enumerate() {
                sums.fill(0.0);
                path.run(AddRows { sums, rows: model.rows_from(axis * spec.n_bins), values, scale: 1.0 });
                let counted = counts.axis(axis).iter().map(|count| f64::from(*count)).sum();
                let future = Future { unseen, counted, density: spec.density, outside: spec.outside };
                let of_axis = axis * self.lanes..(axis + 1) * self.lanes;
                let ends = limits.bin_low[of_axis.clone()].iter().zip(&limits.bin_high[of_axis]);
                for (((low, high), sum), (least, most)) in
                    low.iter_mut().zip(high.iter_mut()).zip(sums.iter()).zip(ends)
                {
                    *low += future.extreme(*sum, *least, f64::min);
                    *high += future.extreme(*sum, *most, f64::max);
                }
            }
        }
        let parts = model.intercept().iter().zip(so_far.raw).zip(&limits.magnitude);
        for ((low, high), ((intercept, raw), magnitude)) in low.iter_mut().zip(high.iter_mut()).zip(parts) {
            let slack = limits.rounding * (intercept.abs() + raw.abs() + magnitude);
            *low -= slack;
            *high += slack;
        }
        low.iter().chain(high.iter()).all(|bound| bound.is_finite())
    }
}

/// The samples of an axis that are still to be counted.
struct Future {
    unseen: f64,
    counted: f64,
    density: bool,
    outside: Outside,
}

impl Future {
    /// The extreme of what an axis can add in the end, from what it adds now and the extreme that a bin has.
    fn extreme(&self, now: f64, bin: f64, pick: fn(f64, f64) -> f64) -> f64 {
        // A sample that is dropped adds nothing; none is with `Clip`.
        let bin_or_nothing = if self.outside == Outside::Drop { pick(bin, 0.0) } else { bin };
        match (self.density, self.counted > 0.0) {
            (false, _) => now + self.unseen * bin_or_nothing,
            (true, false) => bin_or_nothing,
            // A weighted mean of what is there and what comes: extreme when all of it counts.
            (true, true) => (now * self.counted + bin * self.unseen) / (self.counted + self.unseen),
        }
    }
}

impl Limits {
    /// `None` for a model with raw features of unknown range.
    fn new(model: &Model, extractor: &Extractor) -> Result<Option<Self>> {
        let range = model.raw_range();
        if range.is_none() && model.n_raw() > 0 {
            return Ok(None);
        }
        let lanes = model.lanes();
        let spec = extractor.spec();
        let n_axes = if spec.hfmh { model.n_axes() } else { 0 };
        let (mut bin_low, mut bin_high) =
            (filled(f64::INFINITY, n_axes * lanes)?, filled(f64::NEG_INFINITY, n_axes * lanes)?);
        let (raw_low, raw_high, mut magnitude) = match range {
            Some((low, high)) => (
                suffix_sums(model, |i| move |weight| (weight * low[i]).min(weight * high[i]))?,
                suffix_sums(model, |i| move |weight| (weight * low[i]).max(weight * high[i]))?,
                suffix_sums(model, |i| move |weight: f64| weight.abs() * low[i].abs().max(high[i].abs()))?,
            ),
            None => (Vec::new(), Vec::new(), Vec::new()),
        };
        magnitude.resize(lanes, 0.0);
        magnitude.shrink_to_fit();
        for axis in 0..n_axes {
            let of_axis = axis * lanes..(axis + 1) * lanes;
            let (low, high) = (&mut bin_low[of_axis.clone()], &mut bin_high[of_axis]);
            for bin in 0..spec.n_bins {
                let edges = extractor.bins(axis).map(|bins| (bins.edges()[bin], bins.edges()[bin + 1]));
                let width = edges.filter(|_| spec.density).map_or(1.0, |(left, right)| right - left);
                let weights = model.rows_from(axis * spec.n_bins + bin);
                for ((low, high), weight) in low.iter_mut().zip(high.iter_mut()).zip(weights) {
                    *low = low.min(weight / width);
                    *high = high.max(weight / width);
                }
            }
            let most = if spec.density { 1.0 } else { model.n_samples() as f64 };
            for (magnitude, (low, high)) in magnitude.iter_mut().zip(low.iter().zip(high.iter())) {
                *magnitude += most * low.abs().max(high.abs());
            }
        }
        // Two roundings per feature in a score, as many in these bounds, and then some.
        let rounding = (4 * model.n_features() + 64) as f64 * f64::EPSILON;
        Ok(Some(Self { raw_low, raw_high, bin_low, bin_high, magnitude, rounding }))
    }
}

/// Row `t` of the result: the sum over raw samples from `t` on of a term for each weight, which `of` gives for a feature.
fn suffix_sums<T: Fn(f64) -> f64>(model: &Model, of: impl Fn(usize) -> T) -> Result<Vec<f64>> {
    let (lanes, n_samples) = (model.lanes(), model.n_samples());
    let mut sums = filled(0.0, (n_samples + 1).saturating_mul(lanes))?;
    for t in (0..n_samples).rev() {
        let (here, later) = sums[t * lanes..].split_at_mut(lanes);
        here.copy_from_slice(&later[..lanes]);
        for (axis, weights) in model.raw_rows(t).chunks_exact(lanes).take(model.n_axes()).enumerate() {
            let term = of(axis * n_samples + t);
            for (sum, weight) in here.iter_mut().zip(weights) {
                *sum += term(*weight);
            }
        }
    }
    Ok(sums)
}
