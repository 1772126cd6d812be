"""The samples themselves as features."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from granular_id.features import FeatureSpec, extract_features
from granular_id.spaces.base import RecordingTransformer, axis_series, check_rate
from granular_id.spaces.blocks import FeatureBlock, time_block

__all__ = ["RangeNormalizer", "RawSignal"]

FloatArray = npt.NDArray[np.float64]


class RawSignal(RecordingTransformer):
    """The samples themselves, axis after axis: all of Fx, then all of Fy, ...

    Parameters
    ----------
    rate_hz : float or None, default None
        Sampling rate, with which `feature_blocks` tells instants in seconds; in samples without it. Changes no
        feature.
    threads : int or None, default None
        Threads of a batch; None takes all cores.

    Attributes
    ----------
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.
    spec_ : FeatureSpec
        What is extracted.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import RawSignal
    >>> X = np.arange(12.0).reshape(1, 2, 6)
    >>> RawSignal().fit_transform(X)
    array([[ 0.,  6.,  1.,  7.,  2.,  8.,  3.,  9.,  4., 10.,  5., 11.]])
    """

    spec_: FeatureSpec

    without_effect: ClassVar[frozenset[str]] = frozenset({"rate_hz", "threads"})

    def __init__(self, *, rate_hz: float | None = None, threads: int | None = None) -> None:
        self.rate_hz = rate_hz
        self.threads = threads

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """One block, "raw": instants in seconds, or in samples where the rate is not known."""
        return (time_block("raw", self.n_features_in_, self.n_axes_in_, self.rate_hz),)

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        check_rate(self.rate_hz)
        self.spec_ = FeatureSpec(raw=True, hfmh=False)

    def _features(self, recordings: FloatArray) -> FloatArray:
        return extract_features(recordings, spec=self.spec_, threads=self.threads)

    def _names(self) -> list[str]:
        return self.spec_.feature_names(self.n_features_in_, self.n_axes_in_)


class RangeNormalizer(RecordingTransformer):
    """The samples, each axis of each recording moved and stretched to [0, 1]: shape without level and strength.

    The smallest value of an axis becomes 0 and the largest 1, recording by recording, so that nothing is learned
    from other recordings. An axis that never changes becomes 0.

    Parameters
    ----------
    rate_hz : float or None, default None
        As in `RawSignal`.

    Attributes
    ----------
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.

    Notes
    -----
    The paper's normalised spaces ("norm. raw"): Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import RangeNormalizer
    >>> RangeNormalizer().fit_transform(np.array([[1.0, 5.0, 3.0], [7.0, 7.0, 7.0]]))
    array([[0. , 1. , 0.5],
           [0. , 0. , 0. ]])
    """

    without_effect: ClassVar[frozenset[str]] = frozenset({"rate_hz"})

    def __init__(self, *, rate_hz: float | None = None) -> None:
        self.rate_hz = rate_hz

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """One block, "norm_raw": instants in seconds, or in samples where the rate is not known."""
        return (time_block("norm_raw", self.n_features_in_, self.n_axes_in_, self.rate_hz),)

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        check_rate(self.rate_hz)

    def _features(self, recordings: FloatArray) -> FloatArray:
        series = axis_series(recordings)
        low = series.min(axis=2, keepdims=True)
        high = series.max(axis=2, keepdims=True)
        with np.errstate(over="ignore"):
            too_wide = np.isinf(high - low)
        if too_wide.any():  # from -1e308 to 1e308: halves fit, and halving such numbers is exact
            factor = np.where(too_wide, 0.5, 1.0)
            series, low, high = series * factor, low * factor, high * factor
        span = high - low
        span[span == 0.0] = 1.0
        series -= low
        series /= span
        return series.reshape(len(series), -1)

    def _names(self) -> list[str]:
        raw = FeatureSpec(raw=True, hfmh=False).feature_names(self.n_features_in_, self.n_axes_in_)
        return [f"norm_{name}" for name in raw]
