//! The signals of all bands of one recording, side by side.

/// Where the signal of one band lies: `n_axes` stretches of `len` samples, axis after axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Index of the first sample of the first axis.
    pub(super) start: usize,
    /// From the first sample of one axis to that of the next.
    pub(super) stride: usize,
    /// Samples of each axis.
    pub(super) len: usize,
}

/// The signals of all bands of one recording, divided by their scales: band 0 is the recording without its mean, then
/// octave after octave downward, each at a rate of its own. While a recording arrives they end where its bands do.
#[derive(Clone, Copy, Debug)]
pub(super) struct BandSignals<'a> {
    values: &'a [f64],
    places: &'a [Place],
    n_axes: usize,
}

impl<'a> BandSignals<'a> {
    /// Signals of `n_axes` axes, those of band `b` at `places[b]` of `values`.
    pub(super) fn new(values: &'a [f64], places: &'a [Place], n_axes: usize) -> Self {
        Self { values, places, n_axes }
    }

    /// Samples of a band.
    #[inline(always)]
    pub(super) fn len(&self, band: usize) -> usize {
        self.places[band].len
    }

    /// Axes of each band.
    #[inline(always)]
    pub(super) fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// Signals in the order of bands, then of axes.
    #[inline(always)]
    pub(super) fn numbered(&self, index: usize) -> &'a [f64] {
        self.axis(index / self.n_axes, index % self.n_axes)
    }

    /// One axis of a band, in time order.
    #[inline(always)]
    pub(super) fn axis(&self, band: usize, axis: usize) -> &'a [f64] {
        let Place { start, stride, len } = self.places[band];
        &self.values[start + axis * stride..][..len]
    }
}
