//! Features of a window while its samples arrive.

use super::{Position, Windows};
use crate::dsp::{Outside, SosState, UniformBins, MAX_BINS};
use crate::error::{Error, Result};
use crate::features::Extractor;
use crate::memory::filled;

/// Larger magnitudes are refused: what the filter remembers of them would come near the end of float64, and stay.
const LARGEST: f64 = 1e100;

/// Rows that are filtered before they are counted.
const CHUNK: usize = 64;

/// Extracts features from rows as they arrive, in pieces of any size.
///
/// The features of a complete window are those of [`Extractor::extract`], bit for bit. With a hop the filter never
/// stops: window `k` holds samples `k * hop..k * hop + n_samples` of the stream, and its histograms are those of the
/// filtered stream, not of a window filtered alone.
///
/// All memory is allocated at construction. [`push`](Self::push), [`next_window`](Self::next_window) and
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
    n_features: usize,
    /// `None` without raw features.
    raw: Option<RawSamples>,
    /// `None` without histograms; nothing is filtered then.
    histograms: Option<WindowHistograms>,
    filter: SosState,
    chunk: Vec<f64>,
    /// Slot of the first sample of the window.
    first: usize,
    position: Position,
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
            n_features,
            raw: spec.raw.then(|| RawSamples::new(n_samples, n_axes)).transpose()?,
            histograms: spec
                .hfmh
                .then(|| WindowHistograms::new(n_samples, n_axes, spec.n_bins))
                .transpose()?,
            filter,
            chunk: filled(0.0, CHUNK.min(n_samples) * n_axes)?,
            first: 0,
            position: Position::new(windows),
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
        self.position.windows
    }

    /// Number of features of a window.
    #[must_use]
    pub fn n_features(&self) -> usize {
        self.n_features
    }

    /// Rows of the current window so far.
    #[must_use]
    pub fn n_seen(&self) -> usize {
        self.position.n_seen
    }

    /// Whether all rows of the window are there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.position.is_complete()
    }

    /// Rows of the stream before the current window.
    #[must_use]
    pub fn first_row(&self) -> u64 {
        self.position.first_row
    }

    /// Takes rows of one value per axis, in N and N m, until the window is complete. Returns how many it took.
    ///
    /// On an error nothing has changed: no row was taken.
    ///
    /// # Errors
    /// - [`Error::Length`]: the values are not whole rows.
    /// - [`Error::NonFiniteRow`]: NaN or infinity in one of the rows that would have been taken.
    /// - [`Error::TooLargeRow`]: a magnitude above 1e100 in one of them.
    pub fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let rows = self.position.taken(rows)?;
        let n_axes = self.position.windows.n_axes;
        if let Some(place) = rows.iter().position(|value| value.abs() > LARGEST) {
            let (row, axis) = (place / n_axes, place % n_axes);
            return Err(Error::TooLargeRow { row, axis, value: rows[place], limit: "more than 1e100" });
        }
        for chunk in rows.chunks(self.chunk.len()) {
            self.take(chunk)?;
        }
        Ok(rows.len() / n_axes)
    }

    /// Goes on to the next window: rows that it shares with this one stay, the others are forgotten.
    ///
    /// # Errors
    /// [`Error::NoNextWindow`] without a hop, and while rows of this window are missing.
    pub fn next_window(&mut self) -> Result<()> {
        let leaving = self.position.next_window()?;
        let n_samples = self.position.windows.n_samples;
        if let Some(histograms) = &mut self.histograms {
            for t in 0..leaving {
                histograms.remove((self.first + t) % n_samples);
            }
        }
        self.first = (self.first + leaving) % n_samples;
        Ok(())
    }

    /// Back to the state before the first row.
    pub fn reset(&mut self) {
        self.filter.reset();
        if let Some(histograms) = &mut self.histograms {
            histograms.clear();
        }
        (self.first, self.position) = (0, Position::new(self.position.windows));
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
        let raw_len = if self.raw.is_some() {
            self.position.windows.n_samples * self.position.windows.n_axes
        } else {
            0
        };
        let (raw_out, histograms_out) = out.split_at_mut(raw_len);
        if let Some(raw) = &self.raw {
            raw.write(self.first, self.position.n_seen, raw_out);
        }
        if let Some(histograms) = &self.histograms {
            histograms.write(&self.extractor, histograms_out);
        }
        Ok(())
    }

    pub(super) fn position(&self) -> &Position {
        &self.position
    }

    /// The histograms so far; `None` where the specification has none.
    pub(super) fn histograms(&self) -> Option<&WindowHistograms> {
        self.histograms.as_ref()
    }

    /// Sample `t` of the window; false where the specification has no raw features.
    pub(super) fn raw_row(&self, t: usize, out: &mut [f64]) -> bool {
        if let Some(raw) = &self.raw {
            raw.read((self.first + t) % self.position.windows.n_samples, out);
        }
        self.raw.is_some()
    }

    /// Filters, counts and keeps at most a chunk of rows.
    fn take(&mut self, rows: &[f64]) -> Result<()> {
        let Windows { n_samples, n_axes, .. } = self.position.windows;
        let filtered = &mut self.chunk[..rows.len()];
        if self.histograms.is_some() {
            if self.position.n_seen == 0 && self.position.first_row == 0 {
                self.filter.set_steady(self.extractor.start(), rows);
            }
            filtered.copy_from_slice(rows);
            self.filter.filter(filtered)?;
        }
        for (row, filtered) in rows.chunks_exact(n_axes).zip(filtered.chunks_exact(n_axes)) {
            if self.position.ahead > 0 {
                self.position.ahead -= 1;
                continue;
            }
            let slot = (self.first + self.position.n_seen) % n_samples;
            if let Some(raw) = &mut self.raw {
                raw.set(slot, row);
            }
            if let Some(histograms) = &mut self.histograms {
                histograms.add(&self.extractor, slot, filtered);
            }
            self.position.n_seen += 1;
        }
        Ok(())
    }
}

/// The samples of a window, a ring per axis: `values[axis * n_slots + slot]`.
#[derive(Clone, Debug)]
struct RawSamples {
    n_slots: usize,
    values: Vec<f64>,
}

impl RawSamples {
    fn new(n_slots: usize, n_axes: usize) -> Result<Self> {
        Ok(Self { n_slots, values: filled(0.0, n_slots * n_axes)? })
    }

    /// Keeps a row under a slot.
    fn set(&mut self, slot: usize, row: &[f64]) {
        for (axis, value) in self.values.chunks_exact_mut(self.n_slots).zip(row) {
            axis[slot] = *value;
        }
    }

    /// The row of a slot.
    fn read(&self, slot: usize, out: &mut [f64]) {
        for (axis, value) in self.values.chunks_exact(self.n_slots).zip(out) {
            *value = axis[slot];
        }
    }

    /// The raw block of the features: `n_seen` samples from slot `first` on, round the end; zero where none was seen.
    fn write(&self, first: usize, n_seen: usize, out: &mut [f64]) {
        let axes = self.values.chunks_exact(self.n_slots).zip(out.chunks_exact_mut(self.n_slots));
        for (samples, out) in axes {
            let (seen, unseen) = out.split_at_mut(n_seen);
            let (until_end, from_start) = seen.split_at_mut(n_seen.min(self.n_slots - first));
            until_end.copy_from_slice(&samples[first..][..until_end.len()]);
            from_start.copy_from_slice(&samples[..from_start.len()]);
            unseen.fill(0.0);
        }
    }
}

/// The cell of a value that is not counted.
const NONE: u16 = u16::MAX;

/// Every bin has a number of its own beside [`NONE`].
const _: () = assert!(MAX_BINS <= NONE as usize);

/// One histogram per axis, and the cell of every counted row, so that any row can be taken out again.
#[derive(Clone, Debug)]
pub(super) struct WindowHistograms {
    n_axes: usize,
    n_bins: usize,
    /// `histograms[axis * n_bins + bin]`: counts.
    histograms: Vec<u32>,
    /// `cells[slot * n_axes + axis]`: the bin, or `NONE`.
    cells: Vec<u16>,
}

impl WindowHistograms {
    /// Empty histograms for rows in slots `0..n_slots`.
    fn new(n_slots: usize, n_axes: usize, n_bins: usize) -> Result<Self> {
        let (histograms, cells) = (filled(0, n_axes * n_bins)?, filled(NONE, n_slots * n_axes)?);
        Ok(Self { n_axes, n_bins, histograms, cells })
    }

    fn clear(&mut self) {
        self.histograms.fill(0);
    }

    /// Counts a filtered row and remembers it under a slot.
    fn add(&mut self, extractor: &Extractor, slot: usize, row: &[f64]) {
        let clip = extractor.spec().outside == Outside::Clip;
        let cells = &mut self.cells[slot * self.n_axes..][..self.n_axes];
        let histograms = self.histograms.chunks_exact_mut(self.n_bins);
        for (axis, ((value, cell), counts)) in row.iter().zip(cells).zip(histograms).enumerate() {
            *cell = extractor.bins(axis).map_or(NONE, |bins| cell_of(bins, *value, clip));
            if let Some(count) = counts.get_mut(usize::from(*cell)) {
                *count += 1;
            }
        }
    }

    /// Takes the row of a slot out again.
    fn remove(&mut self, slot: usize) {
        let cells = &self.cells[slot * self.n_axes..][..self.n_axes];
        for (cell, counts) in cells.iter().zip(self.histograms.chunks_exact_mut(self.n_bins)) {
            if let Some(count) = counts.get_mut(usize::from(*cell)) {
                *count -= 1;
            }
        }
    }

    /// The histogram block of the features.
    pub(super) fn write(&self, extractor: &Extractor, out: &mut [f64]) {
        for (value, count) in out.iter_mut().zip(&self.histograms) {
            *value = f64::from(*count);
        }
        if extractor.spec().density {
            for (axis, block) in out.chunks_exact_mut(self.n_bins).enumerate() {
                if let Some(bins) = extractor.bins(axis) {
                    bins.normalise(block);
                }
            }
        }
    }
}

fn cell_of(bins: &UniformBins, value: f64, clip: bool) -> u16 {
    let bin = match bins.locate(value) {
        None if clip && value < bins.low() => Some(0),
        None if clip => Some(bins.n_bins() - 1),
        found => found,
    };
    bin.and_then(|bin| u16::try_from(bin).ok()).unwrap_or(NONE)
}
