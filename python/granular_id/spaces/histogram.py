"""Histogram of the samples themselves, without any filter."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id.features import FeatureSpec
from granular_id.spaces.base import RecordingTransformer, axis_series
from granular_id.spaces.blocks import FeatureBlock, range_blocks
from granular_id.spaces.hfmh import BinRange, per_axis

__all__ = ["RawHistogram"]

FloatArray = npt.NDArray[np.float64]


class RawHistogram(RecordingTransformer):
    """How often each force occurs, whatever the order: counts of the raw samples in equal bins, axis by axis.

    Parameters
    ----------
    n_bins : int, default 100
        Bins per axis, of equal width.
    bin_range : "auto", (low, high) or array of shape (C, 2), default "auto"
        Range of the bins, N and N m. "auto" learns the smallest and the largest value of each axis from the rows
        given to `fit`: forces under load have no natural range as high-passed ones have, and the paper states
        none. An axis that never changes gets the range of numpy: half a unit to either side.
    outside : {"drop", "clip"}, default "drop"
        What becomes of values outside the range, which later rows may well have: they are not counted, as in
        `HFMH`, so that a row of strange values has few counts; or they are counted in the first and last bin.

    Attributes
    ----------
    bin_range_ : ndarray, shape (C, 2)
        Range of each axis.
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import RawHistogram
    >>> histogram = RawHistogram(n_bins=2).fit(np.array([[0.0, 1.0, 1.5, 2.0]]))
    >>> histogram.bin_range_.tolist()
    [[0.0, 2.0]]
    >>> histogram.transform(np.array([[0.5, 0.5, 2.0, 7.0]]))
    array([[2., 1.]])
    """

    bin_range_: FloatArray

    def __init__(self, *, n_bins: int = 100, bin_range: BinRange = "auto", outside: str = "drop") -> None:
        self.n_bins = n_bins
        self.bin_range = bin_range
        self.outside = outside

    @property
    def learns(self) -> bool:
        """True with ``bin_range="auto"``: the range then comes from the rows given to `fit`."""
        return isinstance(self.bin_range, str)

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """One block, "hist", over the centres of the bins; one for each axis, "hist_fx", where ranges differ."""
        return range_blocks("hist", self.bin_range_, operator.index(self.n_bins))

    def _learn(self, recordings: FloatArray) -> None:
        if isinstance(self.bin_range, str) and self.bin_range != "auto":
            raise ValueError(
                f"bin_range must be 'auto', (low, high), or one such pair per axis, got {self.bin_range!r}"
            )
        learned = isinstance(self.bin_range, str)
        FeatureSpec(n_bins=self.n_bins, outside=self.outside)  # type: ignore[arg-type]  # checks both
        bounds = _extremes(recordings, self.n_bins) if learned else self.bin_range
        FeatureSpec(n_bins=self.n_bins, bin_range=bounds)
        self.bin_range_ = per_axis(np.asarray(bounds, dtype=np.float64), recordings.shape[2])

    def _features(self, recordings: FloatArray) -> FloatArray:
        n, _, n_axes = recordings.shape
        n_bins = operator.index(self.n_bins)
        features = np.empty((n, n_axes, n_bins))
        series = axis_series(recordings)
        for axis, (low, high) in enumerate(self.bin_range_.tolist()):
            if self.outside == "clip":
                np.clip(series[:, axis], low, high, out=series[:, axis])
            for row in range(n):
                features[row, axis], _ = _core.histogram(series[row, axis], n_bins, low, high)
        return features.reshape(n, -1)

    def _names(self) -> list[str]:
        spec = FeatureSpec(raw=False, hfmh=True, n_bins=self.n_bins)
        names = spec.feature_names(self.n_features_in_, self.n_axes_in_)
        return [name.replace("hfmh_", "hist_", 1) for name in names]


def _extremes(recordings: FloatArray, n_bins: Any) -> FloatArray:
    """Smallest and largest value of each axis, moved apart where there is no room for bins between them."""
    # Over recordings first: long contiguous rows, ten times as fast as both at once.
    low, high = recordings.min(axis=0).min(axis=0), recordings.max(axis=0).max(axis=0)
    with np.errstate(over="ignore"):
        if not np.isfinite(high - low).all():
            raise ValueError("X must span a range that float64 can hold on each axis")
    for axis in range(len(low)):
        edges = np.linspace(low[axis], high[axis], operator.index(n_bins) + 1)
        if not (np.diff(edges) > 0).all():
            # Half a unit is nothing beside 1e12: a millionth of the value leaves room for any number of bins.
            reach = max(0.5, 1e-6 * max(abs(low[axis]), abs(high[axis])))
            low[axis], high[axis] = low[axis] - reach, high[axis] + reach
    return np.column_stack([low, high])
