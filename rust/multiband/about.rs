//! What a [`MultiBand`] tells about itself.

use super::bands::FrequencyBand;
use super::coupling::Coupling;
use super::envelope::Envelope;
use super::extractor::MultiBand;
use super::level::Level;
use super::quantiles::Quantiles;
use super::scales::Scales;
use super::spec::{Block, MultiBandSpec};
use super::spectrum::Spectrum;

impl MultiBand {
    /// What is computed.
    #[must_use]
    pub fn spec(&self) -> &MultiBandSpec {
        &self.spec
    }

    /// The largest magnitude of each axis that can be worked with.
    pub(crate) fn limits(&self) -> &[f64] {
        &self.limits
    }

    /// Samples of a whole recording.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.n_samples
    }

    /// Axes of a recording.
    #[must_use]
    pub fn n_axes(&self) -> usize {
        self.n_axes
    }

    /// Bands, band 0 included.
    #[must_use]
    pub fn n_bands(&self) -> usize {
        self.bands.len()
    }

    /// The bands: band 0, which is the recording without its mean, then octave after octave downward.
    #[must_use]
    pub fn bands(&self) -> &[FrequencyBand] {
        &self.bands
    }

    /// Middle of each bin of the spectrum, in hertz; none without that block.
    #[must_use]
    pub fn frequencies_hz(&self) -> Vec<f64> {
        let step = self.spec.rate_hz / self.n_samples as f64;
        let edges = self.spectrum.as_ref().map_or(&[][..], Spectrum::edges);
        // From the first to the last frequency of a bin, both included.
        edges.windows(2).map(|bin| 0.5 * (bin[0] + bin[1] - 1) as f64 * step).collect()
    }

    /// The scales.
    #[must_use]
    pub fn scales(&self) -> &Scales {
        &self.scales
    }

    /// Features of a recording.
    #[must_use]
    pub fn n_features(&self) -> usize {
        self.n_features
    }

    /// The blocks that there are, in order, and how many features each has.
    #[must_use]
    pub fn block_sizes(&self) -> Vec<(Block, usize)> {
        let sizes = [
            (Block::Coupling, self.coupling.as_ref().map(Coupling::n_features)),
            (Block::Quantiles, self.quantiles.as_ref().map(Quantiles::n_features)),
            (Block::Envelope, self.envelope.map(Envelope::n_features)),
            (Block::Spectrum, self.spectrum.as_ref().map(Spectrum::n_features)),
            (Block::Level, self.level.as_ref().map(Level::n_features)),
        ];
        sizes.into_iter().filter_map(|(block, size)| size.map(|size| (block, size))).collect()
    }
}
