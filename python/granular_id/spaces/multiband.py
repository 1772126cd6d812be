"""Multi-band features: what a signal does in each octave, and how its axes move together there.

Sources: coupling, filter-bank covariances and their logarithms: Barachant, Bonnet, Congedo, Jutten, "Multiclass
brain-computer interface classification by Riemannian geometry" (2012); Arsigny, Fillard, Pennec, Ayache,
"Log-Euclidean metrics for fast and simple calculus on diffusion tensors" (2006). Quantiles continue the histogram of
Hynninen, Nguyen Le, Kyrki (arXiv 2403.17606).
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from sklearn.utils.validation import check_is_fitted

from granular_id._core import GranularIdError, MultiBandExtractor
from granular_id._text import counted, fixed, listed
from granular_id.spaces.base import (
    PAPER_RATE_HZ,
    FeatureBlock,
    RecordingTransformer,
    axis_names,
    steps_behind_filters,
)

FloatArray = npt.NDArray[np.float64]

USUAL_BLOCKS = ("coupling", "quantiles", "envelope", "spectrum")
"""Blocks that know as little as possible of the session."""

ALL_BLOCKS = (*USUAL_BLOCKS, "level")
"""Every block, in the order of the features."""

BAND_LOSS = "root"
"""Binary loss that models of these features decode with unless stated otherwise, those of the preset included."""

BAND_SHRINKAGE = 0.03
"""Of `WithinClassWhitening` in models of these features, unless stated otherwise: under other loads, speeds, sensors
and people it gains what it gains without a change, and 0.1 and 0.01 are alike."""

# Scales below these shares are rounding, not signal: of the whole signal with its offset, which is float64, and of the
# signal without it, which is split into bands in float32.
_ROUNDING = 1e-9
_BAND_ROUNDING = 1e-6

_LEVEL_STRETCHES = 16


class FrequencyBand(NamedTuple):
    """A band of frequencies, and how it is sampled; band 0 is the recording without its mean.

    Attributes
    ----------
    low_hz, high_hz : float
        Edges of the band, 3 dB down.
    rate_hz : float
        Rate at which the band is sampled.
    n_samples : int
        Samples of the band in one recording.
    """

    low_hz: float
    high_hz: float
    rate_hz: float
    n_samples: int

    def __str__(self) -> str:
        """Describe it, for instance ``61-122 Hz``."""
        return f"{_hertz(self.low_hz)}-{_hertz(self.high_hz)} Hz" if self.low_hz > 0 else "the whole signal"


def _hertz(value: float) -> str:
    return fixed(value, 0) if value >= 9.5 else f"{value:.2g}"


class MultiBand(RecordingTransformer):
    """Statistics of each octave of the signal: about 1,300 numbers of a recording of 1600 samples on six axes.

    A pyramid of Butterworth band-passes of second order splits the signal into octaves, from 98 % of the Nyquist
    frequency down to where an octave would see fewer than 1.5 cycles of a recording; the rate is halved on the way.
    Every band and axis is divided by its typical size, learned from the rows given to `fit`. Then up to five blocks of
    numbers, block after block:

    - ``coupling``, of each band: resolvents of the matrix of second moments of all axes, now and two samples earlier,
      much like its logarithm: energies, and how axes move together and ahead of each other. Only of bands with four
      samples per row of the matrix (and two for the lag), which are 50 for six axes: fewer leave little but chance.
    - ``quantiles``, of each band and axis: arcsinh of seven quantiles (2 % to 98 %), and the logarithm of the RMS.
    - ``envelope``, of each band and axis: logarithm of the energy in four stretches of time.
    - ``spectrum``, of each axis: logarithm of the power spectrum in at most 40 bins, narrow at low frequencies.
    - ``level``, of each axis: arcsinh of the mean of the signal itself over 16 stretches of time.

    Parameters
    ----------
    rate_hz : float or None, default None
        Sampling rate. None: that of a `Dataset`, and 500 Hz, the paper's, of arrays. Names the bands; changes no
        feature.
    blocks : sequence of str, default ("coupling", "quantiles", "envelope", "spectrum")
        Any of the five. Without the level, which knows the session (weight of the tool, zero of the sensor) as well
        as it knows the material. Their order does not matter.
    threads : int or None, default None
        Threads of a batch; None takes all cores.

    Attributes
    ----------
    bands_ : tuple of FrequencyBand
        Edges in Hz, rate and samples of each band; band 0 is the recording without its mean.
    block_sizes_ : dict of str to int
        Features of each block, in order.
    dropped_ : str
        What such short recordings leave out, in words; "" where nothing is left out.
    extractor_ : MultiBandExtractor
        What computes the features: shape, blocks and learned `scales` (n_bands, C) and `level_scales` (C,) in one.
        They are medians over the recordings, of the RMS of each band and of the magnitude of means over stretches of
        time, at least a billionth of the whole signal and a millionth of the signal without its mean; 1 for an axis
        without any.

    Raises
    ------
    TypeError, ValueError
        From `fit`: a parameter of another kind or out of range; no block that such short recordings have; recordings
        with NaN or infinity, or beyond 1e12 times the least scale of their axis.

    See Also
    --------
    BlockScaler : What should stand between these features and a linear model: the blocks have no common unit.

    Notes
    -----
    Filters start as if the first sample had lasted for ever, so an offset of the sensor leaves nothing behind. Nothing
    is ever NaN: energies and moments have floors, so that a silent axis gives constant features.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import MultiBand
    >>> X = np.random.default_rng(0).normal(size=(3, 1600, 6))
    >>> space = MultiBand().fit(X)
    >>> space.transform(X).shape, space.block_sizes_
    ((3, 1338), {'coupling': 456, 'quantiles': 480, 'envelope': 240, 'spectrum': 162})
    >>> [(band.low_hz, band.high_hz) for band in space.bands_[:3]]
    [(0.0, 250.0), (122.5, 245.0), (61.25, 122.5)]
    >>> space.get_feature_names_out()[[0, 456, 463, 936, 1176]].tolist()  # of a Dataset fx in place of axis0
    ['b0_coupling_axis0_axis0', 'b0_q02_axis0', 'b0_logrms_axis0', 'b0_envelope_axis0_0', 'spectrum_axis0_00']
    """

    _default_rate_hz = PAPER_RATE_HZ
    learns = True

    bands_: tuple[FrequencyBand, ...]
    extractor_: MultiBandExtractor
    block_sizes_: dict[str, int]
    dropped_: str

    def __init__(
        self,
        *,
        rate_hz: float | None = None,
        blocks: Sequence[str] = USUAL_BLOCKS,
        threads: int | None = None,
    ) -> None:
        self.rate_hz = rate_hz
        self.blocks = blocks
        self.threads = threads

    def describe(self) -> str:
        """Say in a few lines which bands and blocks a fitted space has, and what it leaves out."""
        check_is_fitted(self)
        n_octaves = len(self.bands_) - 1
        bands = "the whole signal"
        if n_octaves:
            high, low = self.bands_[1].high_hz, self.bands_[-1].low_hz
            bands += f" and {n_octaves} octaves from {high:.4g} Hz down to {low:.3g} Hz"
        sizes = ", ".join(f"{name} {size}" for name, size in self.block_sizes_.items())
        left_out = f"\n{self.dropped_}" if self.dropped_ else ""
        return f"bands: {bands}\nfeatures: {sizes}{left_out}"

    def _learn(self, recordings: FloatArray) -> None:
        n_samples, n_axes = recordings.shape[1:]
        settings: dict[str, Any] = {"rate_hz": self.rate_hz_ or PAPER_RATE_HZ, "blocks": self.blocks}
        plain = MultiBandExtractor(n_samples, n_axes, **settings)
        # Bands are in float32: sizes are measured in units of the whole signal, whatever its own unit.
        energies = np.einsum("ntc,ntc->nc", recordings, recordings) / n_samples
        # Medians, so that a few violent recordings do not make all others small.
        whole = np.median(np.sqrt(energies), axis=0)
        whole_scales = np.tile(_usable(whole, whole), (plain.n_bands, 1))
        whole_scaled = MultiBandExtractor(n_samples, n_axes, scales=whole_scales, **settings)
        typical = np.median(whole_scaled.band_rms(recordings, self.threads), axis=0)
        scales = _usable(np.maximum(typical, _BAND_ROUNDING * typical[0]), whole)
        level_scales = _usable(np.median(np.abs(_levels(recordings)), axis=(0, 1)), whole)
        self.extractor_ = MultiBandExtractor(
            n_samples, n_axes, scales=scales, level_scales=level_scales, **settings
        )
        self.bands_ = tuple(FrequencyBand(*band) for band in plain.bands)
        self.block_sizes_ = plain.block_sizes
        self.dropped_ = _dropped(plain)

    def _features(self, recordings: FloatArray) -> FloatArray:
        return self.extractor_.extract(recordings, self.threads)

    def _names(self) -> list[str]:
        return self.extractor_.names


def _levels(recordings: FloatArray) -> FloatArray:
    """Means (n, stretches, C) over stretches of time, as the level block has them."""
    n_samples = recordings.shape[1]
    stretches = min(_LEVEL_STRETCHES, n_samples)
    edges = [i * n_samples // stretches for i in range(stretches + 1)]
    means = [recordings[:, start:stop].mean(axis=1) for start, stop in itertools.pairwise(edges)]
    return np.stack(means, axis=1)


def _usable(sizes: FloatArray, whole: FloatArray) -> FloatArray:
    """Sizes (..., C) to divide by: nothing that is only rounding of the whole signal, 1 where there is none."""
    floored = np.maximum(sizes, _ROUNDING * whole)
    return np.where(floored > 0, floored, 1.0)


def _dropped(extractor: MultiBandExtractor) -> str:
    """Say what recordings of so few samples do not have."""
    sizes = extractor.block_sizes
    parts = [f"the {name}" for name in extractor.blocks if name not in sizes]
    if "coupling" in sizes:
        coupled = {name.partition("_")[0] for name in extractor.names[: sizes["coupling"]]}
        without = extractor.n_bands - len(coupled)
        if without:
            parts.append(f"couplings of axes in the lowest {f'{without} bands' if without > 1 else 'band'}")
    if extractor.n_bands == 1:
        parts.append("any octave")
    if not parts:
        return ""
    n_samples = extractor.n_samples
    return f"recordings of {counted(n_samples, 'sample')} are too short for {listed(parts)}"


# Names of columns, such as b0_coupling_fx_fy_lag2, b3_q98_fx, b3_envelope_fx_0, spectrum_fx_00.
_NAME = re.compile(
    r"(?:b(?P<band>\d+)_)?(?P<what>coupling|q\d+|logrms|envelope|spectrum|level)_(?P<first>[a-z]+\d*)"
    r"(?:_(?P<second>[a-z]+\d*)(?:_lag(?P<lag>\d+))?|_(?P<detail>\d+))?"
)


class BandColumn(NamedTuple):
    """One feature: its block, band, axes by number (the same one twice where there is but one), lag of the second."""

    block: str
    band: int | None  # of spectrum and level none
    first: int
    second: int
    lag: int  # samples of the band
    detail: str  # the rest of the name: "q98", "logrms", the number of a stretch or bin


@dataclass(frozen=True, eq=False)
class BandColumns:
    """The D columns of a fitted `MultiBand` one by one, with its axes (C), bands and bins of the spectrum."""

    names: tuple[str, ...]
    columns: tuple[BandColumn, ...] = field(repr=False)
    axes: tuple[str, ...]
    bands: tuple[FrequencyBand, ...]
    frequencies_hz: FloatArray = field(repr=False)
    duration_s: float
    units: tuple[str, ...]

    def of(self, block: str) -> npt.NDArray[np.intp]:
        """Numbers of the columns of a block."""
        return np.flatnonzero([column.block == block for column in self.columns])

    def over_axes(self, values: FloatArray) -> FloatArray:
        """Spread values (D,) over axes: (D, C); those of two axes count half for each, so that sums stay the same."""
        spread = np.zeros((len(self.columns), len(self.axes)))
        rows = np.arange(len(self.columns))
        spread[rows, [column.first for column in self.columns]] += 0.5 * values
        spread[rows, [column.second for column in self.columns]] += 0.5 * values
        return spread

    def stretch_s(self, block: str, detail: str) -> tuple[float, float]:
        """First and last instant of a stretch of the envelope or the level, as named."""
        n = 1 + max(int(column.detail) for column in self.columns if column.block == block)
        at = int(detail)
        return self.duration_s * at / n, self.duration_s * (at + 1) / n

    def read_along(self) -> tuple[FeatureBlock, ...]:
        """Return the blocks that are read along one coordinate: spectrum and level."""
        n_levels = self.of("level").size // len(self.axes)
        middles = (np.arange(n_levels) + 0.5) * self.duration_s / max(n_levels, 1)
        blocks = (
            FeatureBlock(
                "spectrum", "frequency", self.axes, self.frequencies_hz, "Hz", self._span("spectrum")
            ),
            FeatureBlock("level", "time", self.axes, middles, "s", self._span("level")),
        )
        return tuple(block for block in blocks if block.columns.stop)

    def _span(self, block: str) -> slice:
        own = self.of(block).tolist()
        return slice(own[0], own[-1] + 1) if own else slice(0, 0)


def band_columns(transformer: Any) -> BandColumns | None:
    """Read the columns of a fitted `MultiBand`, with or without filters in front that keep time; None for others."""
    steps = steps_behind_filters(transformer)
    if len(steps) != 1 or not isinstance(steps[0], MultiBand):
        return None
    (space,) = steps
    check_is_fitted(space)
    axes = axis_names(space.n_axes_in_)
    return BandColumns(
        names=tuple(map(str, space.get_feature_names_out())),
        columns=tuple(_column(name, axes) for name in space.extractor_.names),
        axes=space._axes,
        units=space.units_in_,
        bands=space.bands_,
        frequencies_hz=space.extractor_.frequencies_hz,
        duration_s=space.n_features_in_ / space.rate_hz_,
    )


def _column(name: str, axes: tuple[str, ...]) -> BandColumn:
    found = _NAME.fullmatch(name)
    if found is None:
        raise GranularIdError(f"no multi-band feature has the name {name!r}")
    what, first = found["what"], found["first"]
    block = what if what in ALL_BLOCKS else "quantiles"
    return BandColumn(
        block=block,
        band=None if found["band"] is None else int(found["band"]),
        first=axes.index(first),
        second=axes.index(found["second"] or first),
        lag=int(found["lag"] or 0),
        detail=what if block == "quantiles" else found["detail"] or "",
    )
