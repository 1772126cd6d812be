//! Features of a window while its samples arrive.

use super::counts::Counts;
use super::raw::RawSamples;
use super::windows::Windows;
use crate::dsp::SosState;
use crate::error::{Error, Result};
use crate::features::Extractor;
use crate::memory::filled;

/// Rows that are filtered before they are counted.
const CHUNK: usize = 64;

/// Extracts features from rows as they arrive, in pieces of any size.
///
/// The features of a complete window are those of [`Extractor::extract`], bit for bit. With a hop the filter never
/// stops: window `k` holds samples `k * hop..k * hop + n_samples` of the stream, and its histograms are those of the
/// filtered stream, not of a window filtered alone.
///
/// All memory is allocated at construction. [`push`](Self::push), [`advance`](Self::advance) and
/// [`features_into`](Self::features_into) allocate nothing and never block.
///
/// ```
/// use granular_id::stream::{StreamingExtractor, Windows};
/// use granular_id::{Extractor, FeatureSpec};
///
/// let extractor = Extractor::new(FeatureSpec::default())?;
/// let mut stream = StreamingExtractor::new(&extractor, Windows::default())?;
/// let mut features = vec![0.0; stream.n_features()];
/// assert_eq!(stream.push(&[0.5; 6])?, 1);
/// stream.features_into(&mut features)?; // so far: one sample, the others zero
/// assert_eq!(features.iter().filter(|value| **value == 0.5).count(), 6);
/// # Ok::<(), granular_id::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct StreamingExtractor {
    extractor: Extractor,
    windows: Windows,
    n_features: usize,
    /// `None` without raw features.
    raw: Option<RawSamples>,
    /// `None` without histograms; nothing is filtered then.
    counts: Option<Counts>,
    filter: SosState,
    /// The filter as it was before a push, should that fail.
    filter_before: SosState,
    chunk: Vec<f64>,
    /// Slot of the first sample of the window.
    first: usize,
    place: Place,
    first_row: u64,
}

/// How far a stream has come.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    /// Whether the filter has met its first row.
    started: bool,
    /// Rows before the next window, filtered only: a hop longer than a window.
    ahead: usize,
    /// Rows of the window.
    n_seen: usize,
}

impl StreamingExtractor {
    /// A stream before its first row.
    pub fn new(extractor: &Extractor, windows: Windows) -> Result<Self> {
        let Windows { n_samples, n_axes, .. } = windows;
        let spec = extractor.spec();
        windows.check(spec.n_bins)?;
        extractor.check_size(n_samples, n_axes)?;
        let n_features = extractor.n_features(n_samples, n_axes)?;
        let filter = SosState::zero(extractor.sos(), n_axes)?;
        Ok(Self {
            windows,
            n_features,
            raw: spec.raw.then(|| RawSamples::new(n_samples, n_axes)).transpose()?,
            counts: spec.hfmh.then(|| Counts::new(n_samples, n_axes, spec.n_bins)).transpose()?,
            filter_before: SosState::zero(extractor.sos(), n_axes)?,
            filter,
            chunk: filled(0.0, CHUNK.min(n_samples) * n_axes)?,
            first: 0,
            place: Place::default(),
            first_row: 0,
            extractor: extractor.clone(),
        })
    }

    /// What is extracted.
    #[must_use]
    pub fn extractor(&self) -> &Extractor {
        &self.extractor
    }

    /// The windows.
    #[must_use]
    pub fn windows(&self) -> Windows {
        self.windows
    }

    /// Number of features of a window.
    #[must_use]
    pub fn n_features(&self) -> usize {
        self.n_features
    }

    /// Rows of the current window so far.
    #[must_use]
    pub fn n_seen(&self) -> usize {
        self.place.n_seen
    }

    /// Whether all rows of the window are there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.place.n_seen == self.windows.n_samples
    }

    /// Rows of the stream before the current window.
    #[must_use]
    pub fn first_row(&self) -> u64 {
        self.first_row
    }

    /// Takes rows of one value per axis, in N and N m, until the window is complete. Returns how many it took.
    ///
    /// On an error nothing has changed: no row was taken.
    ///
    /// # Errors
    /// - [`Error::Length`]: the values are not whole rows.
    /// - [`Error::NonFiniteRow`]: NaN or infinity in one of the rows that would have been taken.
    /// - [`Error::FilterOverflow`]: finite rows so large that the filter leaves float64.
    pub fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let room = self.place.ahead.saturating_add(self.windows.n_samples - self.place.n_seen);
        let rows = self.windows.taken(rows, room)?;
        let before = self.place;
        self.filter_before.values_mut().copy_from_slice(self.filter.values());
        for chunk in rows.chunks(self.chunk.len()) {
            if let Err(error) = self.take(chunk) {
                self.undo(before);
                return Err(error);
            }
        }
        Ok(rows.len() / self.windows.n_axes)
    }

    /// Goes on to the next window: rows that it shares with this one stay, the others are forgotten.
    ///
    /// # Errors
    /// [`Error::NoHop`] without a hop; [`Error::Unfinished`] while rows of this window are missing.
    pub fn advance(&mut self) -> Result<()> {
        let Windows { n_samples, hop, .. } = self.windows;
        let hop = hop.ok_or(Error::NoHop)?;
        if !self.is_complete() {
            return Err(Error::Unfinished { n_seen: self.place.n_seen, n_samples });
        }
        let leaving = hop.min(n_samples);
        if let Some(counts) = &mut self.counts {
            for t in 0..leaving {
                counts.remove((self.first + t) % n_samples);
            }
        }
        self.first = (self.first + leaving) % n_samples;
        self.first_row = self.first_row.saturating_add(hop as u64);
        self.place.n_seen = n_samples - leaving;
        self.place.ahead = hop - leaving;
        Ok(())
    }

    /// Back to the state before the first row.
    pub fn reset(&mut self) {
        self.filter.reset();
        if let Some(counts) = &mut self.counts {
            counts.clear();
        }
        (self.first, self.first_row, self.place) = (0, 0, Place::default());
    }

    /// The features of the window so far, in the order of [`Extractor::feature_names`]. Raw samples that have not
    /// arrived are zero; histograms hold what has.
    ///
    /// # Errors
    /// [`Error::Length`] when `out` does not hold [`n_features`](Self::n_features) values.
    pub fn features_into(&self, out: &mut [f64]) -> Result<()> {
        if out.len() != self.n_features {
            return Err(Error::Length { what: "out", expected: self.n_features, got: out.len() });
        }
        let raw_len = if self.raw.is_some() { self.windows.n_samples * self.windows.n_axes } else { 0 };
        let (raw_out, counts_out) = out.split_at_mut(raw_len);
        if let Some(raw) = &self.raw {
            raw.write(self.first, self.place.n_seen, raw_out);
        }
        if let Some(counts) = &self.counts {
            counts.write(&self.extractor, counts_out);
        }
        Ok(())
    }

    /// Rows before the next window begins.
    pub(super) fn ahead(&self) -> usize {
        self.place.ahead
    }

    /// The histograms so far; `None` where the specification has none.
    pub(super) fn counts(&self) -> Option<&Counts> {
        self.counts.as_ref()
    }

    /// Sample `t` of the window; false where the specification has no raw features.
    pub(super) fn raw_row(&self, t: usize, out: &mut [f64]) -> bool {
        if let Some(raw) = &self.raw {
            raw.read((self.first + t) % self.windows.n_samples, out);
        }
        self.raw.is_some()
    }

    /// Filters, counts and keeps at most a chunk of rows.
    fn take(&mut self, rows: &[f64]) -> Result<()> {
        let Windows { n_samples, n_axes, .. } = self.windows;
        let filtered = &mut self.chunk[..rows.len()];
        if self.counts.is_some() {
            if !self.place.started {
                self.filter.settle(self.extractor.start(), rows);
                self.place.started = true;
            }
            filtered.copy_from_slice(rows);
            self.filter.filter(self.extractor.sos(), filtered)?;
            // A value that is not finite would never leave the filter again.
            if !self.filter.values().iter().all(|value| value.is_finite()) {
                return Err(Error::FilterOverflow { largest: largest(rows) });
            }
        }
        for (row, filtered) in rows.chunks_exact(n_axes).zip(filtered.chunks_exact(n_axes)) {
            if self.place.ahead > 0 {
                self.place.ahead -= 1;
                continue;
            }
            let slot = (self.first + self.place.n_seen) % n_samples;
            if let Some(raw) = &mut self.raw {
                raw.set(slot, row);
            }
            if let Some(counts) = &mut self.counts {
                counts.add(&self.extractor, slot, filtered);
            }
            self.place.n_seen += 1;
        }
        Ok(())
    }

    /// As it was before a push: no row of it is counted, the filter has not met it.
    fn undo(&mut self, before: Place) {
        if let Some(counts) = &mut self.counts {
            for t in before.n_seen..self.place.n_seen {
                counts.remove((self.first + t) % self.windows.n_samples);
            }
        }
        self.filter.values_mut().copy_from_slice(self.filter_before.values());
        self.place = before;
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}
