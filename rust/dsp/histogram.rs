//! Uniform bins with the counting rule of `numpy.histogram`.

use crate::error::{Error, Result};
use crate::specs::choices;

/// The largest number of bins: the cells of 24 such histograms still fit in twenty bits (see `kernel::count`).
pub const MAX_BINS: usize = 32_768;

/// Equal bins on `[low, high]`: left-closed, the last one closed, values outside dropped.
///
/// Edges are those of `numpy.linspace(low, high, n_bins + 1)`, and a value belongs to bin `i` exactly when
/// `edges[i] <= value < edges[i + 1]` (`<=` for the last bin), compared as float64.
///
/// ```
/// let bins = granular_id::UniformBins::new(3, 0.0, 3.0)?;
/// assert_eq!(bins.count(&[0.0, 1.0, 2.9, 3.0, 3.1, f64::NAN]), [1.0, 1.0, 2.0]);
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct UniformBins {
    edges: Vec<f64>,
}

impl UniformBins {
    /// Bins with `n_bins` in 1..=[`MAX_BINS`] and finite `low < high` far enough apart to have that many bins.
    pub fn new(n_bins: usize, low: f64, high: f64) -> Result<Self> {
        Error::check_range("n_bins", n_bins, 1..=MAX_BINS)?;
        let width = high - low;
        if !(low.is_finite() && high.is_finite() && width.is_finite() && low < high) {
            let got = format_args!("({low:?}, {high:?})");
            return Err(Error::argument("bin_range", "be finite with low < high", got));
        }
        let step = width / n_bins as f64;
        let mut edges: Vec<f64> = (0..=n_bins).map(|i| i as f64 * step + low).collect();
        edges[n_bins] = high;
        // Too many bins for float64 between low and high: numpy refuses these as well.
        if edges.windows(2).any(|pair| pair[0] >= pair[1]) {
            let wanted = format_args!("hold {n_bins} bins of finite size");
            return Err(Error::argument("bin_range", wanted, format_args!("({low:?}, {high:?})")));
        }
        Ok(Self { edges })
    }

    /// The number of bins.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.edges.len() - 1
    }

    /// The lower end of the range.
    #[must_use]
    pub fn low(&self) -> f64 {
        self.edges[0]
    }

    /// The upper end of the range, which belongs to the last bin.
    #[must_use]
    pub fn high(&self) -> f64 {
        self.edges[self.n_bins()]
    }

    /// The `n_bins + 1` edges.
    #[must_use]
    pub fn edges(&self) -> &[f64] {
        &self.edges
    }

    /// Bins per unit of the value; infinite for the narrowest of ranges.
    pub(crate) fn scale(&self) -> f64 {
        self.n_bins() as f64 / (self.high() - self.low())
    }

    /// The bin of a value, or `None` for a value outside the range and for NaN.
    #[must_use]
    pub fn locate(&self, value: f64) -> Option<usize> {
        if !(value >= self.low() && value <= self.high()) {
            return None;
        }
        // The estimate is off by rounding at most; the edges decide.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 <= estimate <= n_bins
        let estimate = ((value - self.low()) * self.scale()) as usize;
        let mut bin = estimate.min(self.n_bins() - 1);
        while value < self.edges[bin] {
            bin -= 1;
        }
        while bin + 1 < self.n_bins() && value >= self.edges[bin + 1] {
            bin += 1;
        }
        Some(bin)
    }

    /// Counts per bin, as float64.
    #[must_use]
    pub fn count(&self, values: &[f64]) -> Vec<f64> {
        let mut counts = vec![0.0; self.n_bins()];
        for bin in values.iter().filter_map(|value| self.locate(*value)) {
            counts[bin] += 1.0;
        }
        counts
    }

    /// Turns counts into a density that integrates to one, as `numpy.histogram(density=True)` does. Where
    /// nothing was counted the density is zero (numpy: NaN).
    pub(crate) fn normalise(&self, counts: &mut [f64]) {
        let total: f64 = counts.iter().sum();
        if total > 0.0 {
            for (count, pair) in counts.iter_mut().zip(self.edges.windows(2)) {
                *count = *count / (pair[1] - pair[0]) / total;
            }
        }
    }
}

/// What happens to values outside the range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Outside {
    /// They are not counted: the paper, and `numpy.histogram`.
    #[default]
    Drop,
    /// They are counted in the first and last bin, as if clipped to the range.
    Clip,
}

choices! { Outside: "drop" Drop, "clip" Clip, }
