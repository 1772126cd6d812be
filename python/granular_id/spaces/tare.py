"""Removal of each recording's own offset."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from granular_id._numbers import positive_number
from granular_id.spaces.base import RecordingFilter, check_rate

__all__ = ["Tare"]

FloatArray = npt.NDArray[np.float64]


class Tare(RecordingFilter):
    """Subtract from each axis its mean over the rest before the motion.

    Sensors drift: the same force reads differently on another day, and what is read at rest tells the session
    rather than the material. To stand in front of any feature space.

    Parameters
    ----------
    tare_s : float, default 0.1
        Length of the rest at the start of each recording, in seconds. The paper's recordings start a fraction
        of a second before the motion. Rounded to whole samples.
    rate_hz : float, default 500.0
        Sampling rate of the recordings.

    Attributes
    ----------
    n_tare_ : int
        Samples taken for rest.
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.

    Raises
    ------
    ValueError
        From `fit`: the rest has no sample, or more than the recordings.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import Tare
    >>> Tare(tare_s=0.2, rate_hz=10).fit_transform(np.array([[1.0, 3.0, 2.0, 7.0]]))
    array([[-1.,  1.,  0.,  5.]])
    """

    n_tare_: int

    def __init__(self, tare_s: float = 0.1, *, rate_hz: float = 500.0) -> None:
        self.tare_s = tare_s
        self.rate_hz = rate_hz

    def _learn(self, recordings: FloatArray) -> None:
        check_rate(self.rate_hz, optional=False)
        tare_s = positive_number("tare_s", self.tare_s, "a number of seconds")
        n_samples = recordings.shape[1]
        n_tare = round(min(tare_s * float(self.rate_hz), 1e300))  # infinity has no whole number
        if not 1 <= n_tare <= n_samples:
            raise ValueError(
                f"tare_s={self.tare_s:g} at rate_hz={self.rate_hz:g} is {n_tare:g} samples, "
                f"must be from 1 to the {n_samples} of a recording"
            )
        self.n_tare_ = n_tare

    def _filtered(self, recordings: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", invalid="ignore"):
            level = recordings[:, : self.n_tare_].mean(axis=1, keepdims=True)
            tared: FloatArray = recordings - level
        if not np.isfinite(tared).all():
            raise ValueError("X must stay in the range of float64 when its mean at rest is subtracted")
        return tared
