//! Scores of samples and histograms, which grow with each sample: their bounds before the last, and whether one class is
//! sure to win.

use super::extractor::StreamingExtractor;
use super::{Position, Windows};
use crate::dsp::Outside;
use crate::error::Result;
use crate::kernel::SimdPath;
use crate::memory::filled;
use crate::model::{AddRows, Model};
use crate::Extractor;

/// Sums over the samples so far, and what the rest may add.
#[derive(Clone, Debug)]
pub(super) struct AdditiveStream {
    pub(super) stream: StreamingExtractor,
    bounds: ScoreBounds,
    path: SimdPath,
    /// Sums of the raw block so far.
    raw: Vec<f64>,
    /// Room for a row, histogram features, sums over them, bounds of scores.
    row: Vec<f64>,
    values: Vec<f64>,
    sums: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    dominance: Dominance,
}

impl AdditiveStream {
    pub(super) fn new(model: &Model, extractor: &Extractor, windows: Windows) -> Result<Self> {
        let lanes = model.lanes();
        Ok(Self {
            stream: StreamingExtractor::new(extractor, windows)?,
            bounds: ScoreBounds::new(model, extractor)?,
            path: SimdPath::detect()?,
            raw: filled(0.0, lanes)?,
            row: filled(0.0, model.n_axes())?,
            values: filled(0.0, model.n_features() - model.n_raw())?,
            sums: filled(0.0, lanes)?,
            low: filled(0.0, lanes)?,
            high: filled(0.0, lanes)?,
            dominance: Dominance::new(model),
        })
    }

    pub(super) fn push(&mut self, model: &Model, rows: &[f64]) -> Result<usize> {
        let Position { n_seen: first, ahead, .. } = *self.stream.position();
        let n_taken = self.stream.push(rows)?;
        let n_axes = model.n_axes();
        let of_window = rows[..n_taken * n_axes].get(ahead.saturating_mul(n_axes)..).unwrap_or_default();
        self.add_raw(model, first, of_window);
        Ok(n_taken)
    }

    /// Adds up the samples that windows share once more, in their new places.
    pub(super) fn advance(&mut self, model: &Model) -> Result<()> {
        self.stream.advance()?;
        self.raw.fill(0.0);
        let mut row = std::mem::take(&mut self.row);
        for t in 0..self.stream.n_seen() {
            if self.stream.raw_row(t, &mut row) {
                self.add_raw(model, t, &row);
            }
        }
        self.row = row;
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.stream.reset();
        self.raw.fill(0.0);
    }

    /// Scores of the learners from the samples so far, and what is expected of the others.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) {
        let (n_seen, n_samples) = (self.stream.n_seen(), model.n_samples());
        self.sums.fill(0.0);
        if let Some(histograms) = self.stream.histograms() {
            let extractor = self.stream.extractor();
            histograms.write(extractor, &mut self.values);
            // Of a whole window exactly 1; densities are those of a whole window already.
            let scale = if extractor.spec().density { 1.0 } else { n_samples as f64 / n_seen.max(1) as f64 };
            let (rows, values) = (model.rows_from(0), &self.values);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale });
        }
        let expected = if n_seen < n_samples { self.bounds.expected(n_seen) } else { None };
        for (learner, (score, hist)) in out.iter_mut().zip(&self.sums).enumerate() {
            let mut raw = self.raw[learner];
            if let Some(expected) = expected {
                raw += expected[learner];
            }
            *score = (model.intercept()[learner] + raw) + hist;
        }
    }

    /// Whether class `best` wins wherever the rest of the samples lies; after [`scores`](Self::scores).
    pub(super) fn is_settled(&mut self, model: &Model, best: usize) -> bool {
        self.bound_scores(model) && self.dominance.holds(model, best, &self.low, &self.high)
    }

    /// Bounds of the scores that a window can end with, whatever comes within the range of the training recordings,
    /// rounding included. False when there are none.
    fn bound_scores(&mut self, model: &Model) -> bool {
        let Self { stream, bounds, raw, values, sums, low, high, path, .. } = self;
        let Some(limits) = &bounds.limits else { return false };
        let (n_seen, lanes) = (stream.n_seen(), model.lanes());
        for (ends, of_rest) in [(&mut *low, &limits.raw_low), (&mut *high, &limits.raw_high)] {
            let parts = model.intercept().iter().zip(&*raw);
            for (bound, (intercept, raw)) in ends.iter_mut().zip(parts) {
                *bound = intercept + raw;
            }
            let of_rest = of_rest.get(n_seen * lanes..).unwrap_or_default();
            for (bound, rest) in ends.iter_mut().zip(of_rest) {
                *bound += rest;
            }
        }
        if let Some(histograms) = stream.histograms() {
            let spec = stream.extractor().spec();
            let unseen = (model.n_samples() - n_seen) as f64;
            for (axis, values) in values.chunks_exact(spec.n_bins).enumerate() {
                sums.fill(0.0);
                path.run(AddRows { sums, rows: model.rows_from(axis * spec.n_bins), values, scale: 1.0 });
                let counted = histograms.axis(axis).iter().map(|count| f64::from(*count)).sum();
                let future = Future { unseen, counted, density: spec.density, outside: spec.outside };
                let of_axis = axis * lanes..(axis + 1) * lanes;
                let ends = limits.bin_low[of_axis.clone()].iter().zip(&limits.bin_high[of_axis]);
                for (((low, high), sum), (least, most)) in
                    low.iter_mut().zip(high.iter_mut()).zip(sums.iter()).zip(ends)
                {
                    *low += future.extreme(*sum, *least, f64::min);
                    *high += future.extreme(*sum, *most, f64::max);
                }
            }
        }
        let parts = model.intercept().iter().zip(&*raw).zip(&limits.magnitude);
        for ((low, high), ((intercept, raw), magnitude)) in low.iter_mut().zip(high.iter_mut()).zip(parts) {
            let slack = limits.rounding * (intercept.abs() + raw.abs() + magnitude);
            *low -= slack;
            *high += slack;
        }
        low.iter().chain(high.iter()).all(|bound| bound.is_finite())
    }

    /// Adds rows of samples from `first` on to the sums of the raw block.
    fn add_raw(&mut self, model: &Model, first: usize, values: &[f64]) {
        let rows = model.raw_rows(first);
        self.path.run(AddRows { sums: &mut self.raw, rows, values, scale: 1.0 });
    }
}

/// What samples that have not arrived yet can add to the scores: sums over the rest of a window, from every sample on,
/// computed once per stream.
#[derive(Clone, Debug)]
struct ScoreBounds {
    lanes: usize,
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

impl ScoreBounds {
    fn new(model: &Model, extractor: &Extractor) -> Result<Self> {
        let mean = model.raw_mean().map_or(Ok(Vec::new()), |mean| {
            suffix_sums(model, |feature| {
                let mean = mean[feature];
                move |weight| weight * mean
            })
        })?;
        let limits = Limits::new(model, extractor)?;
        Ok(Self { lanes: model.lanes(), mean, limits })
    }

    /// What samples from `n_seen` on are expected to add; nothing for a model that knows no mean.
    fn expected(&self, n_seen: usize) -> Option<&[f64]> {
        self.mean.get(n_seen * self.lanes..)?.get(..self.lanes)
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

/// Whether a class wins whatever comes: the classes' room to differ, and memory for it.
#[derive(Clone, Debug)]
struct Dominance {
    /// One over what the sum of the losses of each class is divided by.
    shares: Vec<f64>,
    /// Per class: by how much more than the best it loses at least.
    gaps: Vec<f64>,
    /// Per class: the magnitudes that were added up.
    sizes: Vec<f64>,
}

impl Dominance {
    fn new(model: &Model) -> Self {
        let n_classes = model.classes().len();
        let shares = (0..n_classes).map(|class| 1.0 / model.divisor(class)).collect();
        Self { shares, gaps: vec![0.0; n_classes], sizes: vec![0.0; n_classes] }
    }

    /// True when the mean loss of class `best` stays below that of every other, wherever the scores end within their
    /// bounds.
    ///
    /// Learners are taken one by one. The difference of what a score costs two classes is a monotone function of it, for
    /// every loss and any codes, so its least value lies at one of the bounds.
    fn holds(&mut self, model: &Model, best: usize, low: &[f64], high: &[f64]) -> bool {
        let n_learners = model.n_learners();
        let costs = |score: f64| [model.loss().of_agreement(-score), 0.0, model.loss().of_agreement(score)];
        self.gaps.fill(0.0);
        self.sizes.fill(0.0);
        for (learner, (low, high)) in low.iter().zip(high).enumerate().take(n_learners) {
            let codes = model.codes_of(learner);
            let (at_low, at_high) = (costs(*low), costs(*high));
            let of = |class: usize| {
                let code = codes.get(class).map_or(1, |code| usize::from(*code));
                (at_low[code] * self.shares[class], at_high[code] * self.shares[class])
            };
            let own = of(best);
            for (class, (gap, size)) in self.gaps.iter_mut().zip(&mut self.sizes).enumerate() {
                let other = of(class);
                *gap += (other.0 - own.0).min(other.1 - own.1);
                *size += other.0.abs() + other.1.abs() + own.0.abs() + own.1.abs();
            }
        }
        // Some roundings per learner, here and in the losses that will be compared, and then some.
        let rounding = (4 * n_learners + 64) as f64 * f64::EPSILON;
        let mut others = self.gaps.iter().zip(&self.sizes).enumerate().filter(|(class, _)| *class != best);
        others.all(|(_, (gap, size))| *gap > rounding * size)
    }
}
