//! What to compute.

/// One kind of numbers about a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Block {
    /// How axes move together in a band, now and two samples earlier.
    Coupling,
    /// Quantiles and root mean square of a band.
    Quantiles,
    /// Energy of a band in four stretches of time.
    Envelope,
    /// Power over frequency, pooled.
    Spectrum,
    /// Means over sixteen stretches of time.
    Level,
}

impl Block {
    /// Each with its name, in the order of the features.
    pub const NAMED: [(&str, Self); 5] = [
        ("coupling", Self::Coupling),
        ("quantiles", Self::Quantiles),
        ("envelope", Self::Envelope),
        ("spectrum", Self::Spectrum),
        ("level", Self::Level),
    ];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        crate::names::of(self, &Self::NAMED)
    }

    /// Samples of the shortest recording of `n_axes` axes that has the block. Of a longer one, couplings are those of the
    /// bands with so many samples.
    #[must_use]
    pub const fn least_samples(self, n_axes: usize) -> usize {
        match self {
            Self::Coupling => super::coupling::least_samples(n_axes),
            Self::Envelope => 4,
            Self::Spectrum => super::spectrum::LEAST_SAMPLES,
            Self::Quantiles | Self::Level => 1,
        }
    }
}

/// What to compute from a recording. The default is all blocks but the level, which tells sessions apart as readily as
/// materials.
#[allow(clippy::struct_excessive_bools)] // each is a choice of its own
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultiBandSpec {
    /// Sampling rate in hertz. It names the bands; no feature depends on it.
    pub rate_hz: f64,
    /// Include [`Block::Coupling`].
    pub coupling: bool,
    /// Include [`Block::Quantiles`].
    pub quantiles: bool,
    /// Include [`Block::Envelope`].
    pub envelope: bool,
    /// Include [`Block::Spectrum`].
    pub spectrum: bool,
    /// Include [`Block::Level`].
    pub level: bool,
}

impl Default for MultiBandSpec {
    fn default() -> Self {
        Self { rate_hz: 500.0, coupling: true, quantiles: true, envelope: true, spectrum: true, level: false }
    }
}

impl MultiBandSpec {
    /// The blocks for which `wants` is true.
    pub fn of(rate_hz: f64, wants: impl Fn(Block) -> bool) -> Self {
        let [coupling, quantiles, envelope, spectrum, level] = Block::NAMED.map(|(_, block)| wants(block));
        Self { rate_hz, coupling, quantiles, envelope, spectrum, level }
    }

    /// Whether a block is asked for.
    #[must_use]
    pub const fn wants(&self, block: Block) -> bool {
        match block {
            Block::Coupling => self.coupling,
            Block::Quantiles => self.quantiles,
            Block::Envelope => self.envelope,
            Block::Spectrum => self.spectrum,
            Block::Level => self.level,
        }
    }

    /// Blocks asked for that recordings of so many samples have.
    pub(super) fn has(&self, block: Block, n_samples: usize, n_axes: usize) -> bool {
        self.wants(block) && n_samples >= block.least_samples(n_axes)
    }
}
