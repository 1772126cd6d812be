"""What the columns of the multi-band features stand for: a question, a band, one axis or two, and a lag."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id._words import fixed
from granular_id.spaces.base import RecordingFilter, real_steps
from granular_id.spaces.blocks import FeatureBlock

__all__ = ["Band", "BandColumn", "BandColumns", "band_columns"]

FloatArray = npt.NDArray[np.float64]

_AXIS = r"[a-z]+\d*"
_LAG = r"(?:_lag(?P<lag{0}>\d+))?"
_FORMS = tuple(
    re.compile(form)
    for form in (
        rf"b(?P<band>\d+)_(?P<block>coupling)_(?P<first>{_AXIS}){_LAG.format(1)}_(?P<second>{_AXIS}){_LAG.format(2)}",
        rf"b(?P<band>\d+)_(?P<detail>q\d+|logrms)_(?P<first>{_AXIS})",
        rf"b(?P<band>\d+)_(?P<block>envelope)_(?P<first>{_AXIS})_(?P<detail>\d+)",
        rf"(?P<block>spectrum|level)_(?P<first>{_AXIS})_(?P<detail>\d+)",
    )
)


class Band(NamedTuple):
    """One band of the bank; number 0 is the whole signal without its mean."""

    number: int
    low_hz: float
    high_hz: float
    rate_hz: float

    def __str__(self) -> str:
        """Describe it, for instance ``61-122 Hz``."""
        return "the whole signal" if self.number == 0 else f"{_hertz(self.low_hz)}-{_hertz(self.high_hz)} Hz"


class BandColumn(NamedTuple):
    """One feature.

    `block` is "coupling", "quantiles", "envelope", "spectrum" or "level"; `band` is None for the last two. `first`
    and `second` are numbers of axes, the same one twice where there is but one. `lag` is how many samples (of the
    band) the second axis is earlier than the first; with both earlier it is 0 again. `detail` is the rest of the
    name: "q98", "logrms", the number of a stretch or bin.
    """

    block: str
    band: int | None
    first: int
    second: int
    lag: int
    detail: str


@dataclass(frozen=True, eq=False)
class BandColumns:
    """Columns of a fitted `MultiBand`, one by one.

    Attributes
    ----------
    names : tuple of D str
    columns : tuple of D BandColumn
    axes : tuple of C str
    bands : tuple of Band
        From the whole signal and the highest octave down to the lowest.
    scales : ndarray, shape (n_bands, C)
        What the signal of each band and axis was divided by, N and N m.
    level_scales : ndarray, shape (C,)
        The same for the level.
    frequencies_hz : ndarray, shape (m,)
        Of the bins of the spectrum; empty without that block.
    duration_s : float
        Of a recording.
    """

    names: tuple[str, ...]
    columns: tuple[BandColumn, ...] = field(repr=False)
    axes: tuple[str, ...]
    bands: tuple[Band, ...]
    scales: FloatArray = field(repr=False)
    level_scales: FloatArray = field(repr=False)
    frequencies_hz: FloatArray = field(repr=False)
    duration_s: float

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the blocks, in the order of the columns."""
        return tuple(dict.fromkeys(column.block for column in self.columns))

    def of(self, *, block: str, band: int | None = None) -> npt.NDArray[np.intp]:
        """Numbers of the columns of a block, or of one band of it."""
        return np.array(
            [
                k
                for k, column in enumerate(self.columns)
                if column.block == block and (band is None or column.band == band)
            ],
            dtype=np.intp,
        )

    def over_axes(self, values: FloatArray) -> FloatArray:
        """Spread values (D,) over axes: (D, C); those of two axes count half for each, so that sums are kept."""
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
        found: list[FeatureBlock] = []
        for block in ("spectrum", "level"):
            own = self.of(block=block)
            if not own.size:
                continue
            columns = slice(int(own[0]), int(own[-1]) + 1)
            if block == "spectrum":
                found.append(FeatureBlock(block, "frequency", self.axes, self.frequencies_hz, "Hz", columns))
            else:
                n = own.size // len(self.axes)
                middles = (np.arange(n) + 0.5) * self.duration_s / n
                found.append(FeatureBlock(block, "time", self.axes, middles, "s", columns))
        return tuple(found)


def band_columns(transformer: Any) -> BandColumns | None:
    """Read the columns of a fitted multi-band space, or None for any other.

    Parameters
    ----------
    transformer : transformer or Pipeline
        A pipeline may have steps in front that keep time, as `Tare` does.

    Raises
    ------
    NotFittedError
    """
    steps = real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]
    while steps and isinstance(steps[0], RecordingFilter) and steps[0].keeps_time:
        steps = steps[1:]
    if len(steps) != 1 or not getattr(steps[0], "is_multiband", False):
        return None
    (space,) = steps
    check_is_fitted(space)
    names = tuple(map(str, space.get_feature_names_out()))
    read = [_read(name) for name in names]
    axes = tuple(dict.fromkeys(found["first"] for found in read))
    return BandColumns(
        names=names,
        columns=tuple(_column(found, axes) for found in read),
        axes=axes,
        bands=_bands(space.bands_),
        scales=np.asarray(space.scales_, dtype=np.float64),
        level_scales=np.asarray(space.level_scales_, dtype=np.float64),
        frequencies_hz=np.asarray(space.frequencies_hz_, dtype=np.float64),
        duration_s=space.n_features_in_ / space.rate_hz,
    )


def _read(name: str) -> dict[str, str]:
    for form in _FORMS:
        found = form.fullmatch(name)
        if found is not None:
            return {key: value for key, value in found.groupdict().items() if value is not None}
    raise ValueError(f"no multi-band feature has the name {name!r}")


def _column(found: dict[str, str], axes: Sequence[str]) -> BandColumn:
    lags = [int(found.get(f"lag{place}", 0)) for place in (1, 2)]
    return BandColumn(
        block=found.get("block", "quantiles"),
        band=int(found["band"]) if "band" in found else None,
        first=axes.index(found["first"]),
        second=axes.index(found.get("second", found["first"])),
        lag=lags[1] - lags[0],
        detail=found.get("detail", ""),
    )


def _bands(given: Sequence[Any]) -> tuple[Band, ...]:
    return tuple(
        Band(k, float(low), float(high), float(rate)) for k, (low, high, rate, *_) in enumerate(given)
    )


def _hertz(value: float) -> str:
    return fixed(value, 0) if value >= 9.5 else f"{value:.2g}"
