"""The samples themselves: raw, stretched to [0, 1], without their level at rest (tare), or in random order."""

from __future__ import annotations

import hashlib
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from sklearn.utils import check_random_state

from granular_id._checks import argument_error, positive_number
from granular_id._core import GranularIdError
from granular_id.features import FeatureSpec, feature_names
from granular_id.spaces.base import (
    PAPER_RATE_HZ,
    CoreTransformer,
    FeatureBlock,
    RecordingFilter,
    RecordingTransformer,
    axis_series,
    time_block,
)

FloatArray = npt.NDArray[np.float64]


class RawSignal(CoreTransformer):
    """The samples themselves, axis after axis: all of Fx, then all of Fy, ...

    Parameters
    ----------
    rate_hz : float or None, default None
        Sampling rate, with which `feature_blocks` gives instants in seconds. None: that of a `Dataset`; of arrays it
        is not known, and instants are in samples. Changes no feature.
    threads : int or None, default None
        Threads of a batch; None takes all cores.

    Attributes
    ----------
    spec_ : FeatureSpec
        What is extracted.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import RawSignal
    >>> X = np.arange(12.0).reshape(1, 2, 6)
    >>> RawSignal().fit_transform(X)
    array([[ 0.,  6.,  1.,  7.,  2.,  8.,  3.,  9.,  4., 10.,  5., 11.]])
    """

    def __init__(self, *, rate_hz: float | None = None, threads: int | None = None) -> None:
        self.rate_hz = rate_hz
        self.threads = threads

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """One block, "raw": instants in seconds, or in samples where the rate is not known."""
        return (time_block("raw", self.n_features_in_, self._axes, self.rate_hz_),)

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        self.spec_ = FeatureSpec(raw=True, hfmh=False)


class RangeNormalizer(RecordingTransformer):
    """The samples, each axis of each recording moved and stretched to [0, 1]: shape without level and strength.

    The smallest value of an axis becomes 0 and the largest 1, recording by recording, so that nothing is learned
    from other recordings. An axis that never changes becomes 0.

    Parameters
    ----------
    rate_hz : float or None, default None
        As in `RawSignal`.

    Notes
    -----
    The paper's normalised spaces ("norm. raw"): Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import RangeNormalizer
    >>> RangeNormalizer().fit_transform(np.array([[1.0, 5.0, 3.0], [7.0, 7.0, 7.0]]))
    array([[0. , 1. , 0.5],
           [0. , 0. , 0. ]])
    """

    def __init__(self, *, rate_hz: float | None = None) -> None:
        self.rate_hz = rate_hz

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """One block, "norm_raw": instants in seconds, or in samples where the rate is not known."""
        return (time_block("norm_raw", self.n_features_in_, self._axes, self.rate_hz_),)

    def _features(self, recordings: FloatArray) -> FloatArray:
        series = axis_series(recordings)
        low = series.min(axis=2, keepdims=True)
        high = series.max(axis=2, keepdims=True)
        span = high - low
        span[span == 0.0] = 1.0
        series -= low
        series /= span
        return series.reshape(len(series), -1)

    def _names(self) -> list[str]:
        raw = feature_names(n_samples=self.n_features_in_, n_axes=self.n_axes_in_, hfmh=False)
        return [f"norm_{name}" for name in raw]


class Tare(RecordingFilter):
    """Subtract from each axis its mean over the rest before the motion.

    Sensors drift: the same force reads differently on another day, and what is read at rest tells the session
    rather than the material. To stand in front of any feature space.

    Parameters
    ----------
    tare_s : float, default 0.1
        Length of the rest at the start of each recording, in seconds. The paper's recordings start a fraction
        of a second before the motion. Rounded to whole samples.
    rate_hz : float or None, default None
        Sampling rate of the recordings. None: that of a `Dataset`, and 500 Hz, the paper's, of arrays.

    Attributes
    ----------
    n_tare_ : int
        Samples taken for rest.

    Raises
    ------
    ValueError
        From `fit`: the rest has no sample, or more than the recordings.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import Tare
    >>> Tare(tare_s=0.2, rate_hz=10).fit_transform(np.array([[1.0, 3.0, 2.0, 7.0]]))
    array([[-1.,  1.,  0.,  5.]])
    """

    n_tare_: int

    _default_rate_hz = PAPER_RATE_HZ

    def __init__(self, tare_s: float = 0.1, *, rate_hz: float | None = None) -> None:
        self.tare_s = tare_s
        self.rate_hz = rate_hz

    def _learn(self, recordings: FloatArray) -> None:
        tare_s = positive_number("tare_s", self.tare_s, "a number of seconds")
        n_samples = recordings.shape[1]
        n_tare = tare_s * float(self.rate_hz_ or PAPER_RATE_HZ)
        if not 0.5 < n_tare < n_samples + 0.5:
            raise argument_error(
                GranularIdError,
                "tare_s",
                f"={tare_s:g} at rate_hz={self.rate_hz_:g} is {n_tare:.0f} samples, "
                f"must be from 1 to the {n_samples} of a recording",
            )
        self.n_tare_ = round(n_tare)

    def _filtered(self, recordings: FloatArray) -> FloatArray:
        tared: FloatArray = recordings - recordings[:, : self.n_tare_].mean(axis=1, keepdims=True)
        return tared


class TimePermutation(RecordingFilter):
    """Put the instants of each recording into a random order of its own, all axes together.

    A control, to stand in front of `RawSignal`: what is still distinguished does not come from the course in time.
    One order for all recordings would be no control: to a linear classifier of raw samples it is a renaming of
    columns. So each recording has its own, drawn from the seed and from its samples. The same recording is
    shuffled in the same way whatever batch it comes in, in training and in testing, in any process
    and on any machine.

    Parameters
    ----------
    random_state : int, RandomState or None, default 0
        Seed of the orders. A control must repeat, hence the fixed default; None draws a new seed at each `fit`.

    Attributes
    ----------
    seed_ : int
        The seed in use.

    Notes
    -----
    The paper reports about 20 % for permuted signals. What a linear classifier of permuted raw samples still has
    are the mean levels of the axes, and how far it falls depends on what those tell: `Tare` in front takes them away.
    In front of `HFMH` it is another experiment: noise in random order has all its variance in the pass band, so that
    the histogram of a permuted recording tells how its forces are distributed, which is a lot.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import TimePermutation
    >>> X = np.arange(12.0).reshape(2, 3, 2)
    >>> shuffled = TimePermutation().fit_transform(X)
    >>> bool((np.sort(shuffled, axis=1) == X).all())  # the same instants
    True
    """

    keeps_time: ClassVar[bool] = False

    seed_: int

    def __init__(self, random_state: int | np.random.RandomState | None = 0) -> None:
        self.random_state = random_state

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        self.seed_ = int(check_random_state(self.random_state).randint(2**31 - 1))

    def _filtered(self, recordings: FloatArray) -> FloatArray:
        key = self.seed_.to_bytes(8, "little")
        shuffled = np.empty_like(recordings, order="C")
        for one, target in zip(recordings, shuffled, strict=True):
            # Adding zero turns -0.0 into 0.0: equal recordings have equal digests on every machine.
            content = np.ascontiguousarray(one + 0.0, dtype="<f8")
            digest = hashlib.blake2b(content.data, digest_size=16, key=key).digest()
            # RandomState: its streams are frozen, those of newer generators may change with numpy.
            order = np.random.RandomState(np.frombuffer(digest, dtype="<u4")).permutation(len(one))
            target[...] = one[order]
        return shuffled
