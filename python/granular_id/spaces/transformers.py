"""Recordings to features: one scikit-learn transformer for each feature space.

Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
Measurements" (arXiv 2403.17606), section on features.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id.features import FeatureSpec, extract_features, feature_names
from granular_id.signal import butter, sosfilt, sosfilt_zi

__all__ = ["DEFAULT_RANGE", "HFMH", "BinRange", "RawHFMH", "RawSignal", "RecordingTransformer"]

FloatArray = npt.NDArray[np.float64]
BinRange = tuple[float, float] | npt.ArrayLike | str

DEFAULT_RANGE = (-1.5, 1.5)
"""Bins of the paper, N and N m."""

# This share of |high-passed| samples lies in the automatic range: a few impacts must not set the bin width.
_AUTO_QUANTILE = 0.995


class RecordingTransformer(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Recordings (n, T, C) to one row of features each; subclasses say what to extract."""

    n_features_in_: int
    n_axes_in_: int
    spec_: FeatureSpec
    threads: int | None

    @property
    def learns(self) -> bool:
        """Whether `fit` takes anything from the data but their shape."""
        return False

    def _spec(self, recordings: FloatArray) -> FeatureSpec:
        raise NotImplementedError

    def fit(self, X: npt.ArrayLike, y: object = None) -> Any:  # noqa: ARG002 - scikit-learn passes y
        """Check the parameters and remember the shape of a recording.

        Parameters
        ----------
        X : array-like, shape (n, T, C) or (n, T)
            Recordings: n of T samples on C axes, in N and N m. Two dimensions are n signals of one axis.
        y : ignored

        Returns
        -------
        self
        """
        recordings = self._recordings(X, reset=True)
        self.n_axes_in_ = recordings.shape[2]
        self.spec_ = self._spec(recordings)
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Features (n, D) of recordings of the shape given to `fit`.

        Raises
        ------
        ValueError
            Another shape, NaN or infinity.
        """
        check_is_fitted(self)
        recordings = self._recordings(X, reset=False)
        return np.asarray(
            extract_features(recordings, spec=self.spec_, threads=self.threads), dtype=np.float64
        )

    def get_feature_names_out(self, input_features: npt.ArrayLike | None = None) -> npt.NDArray[Any]:
        """Names (D,) of the features, for instance ``fx_0000`` or ``hfmh_tz_99``.

        Parameters
        ----------
        input_features : array-like of str, shape (T,), optional
            Must equal the names seen by `fit`, if there were any. The names given out do not depend on it.
        """
        check_is_fitted(self)
        if input_features is not None:
            given = np.asarray(input_features, dtype=object)
            if given.shape != (self.n_features_in_,):
                raise ValueError(
                    "input_features should have length equal to number of features "
                    f"({self.n_features_in_}), got shape {given.shape}"
                )
            seen = getattr(self, "feature_names_in_", None)
            if seen is not None and not np.array_equal(seen, given):
                raise ValueError("input_features is not equal to feature_names_in_")
        names = feature_names(self.spec_, n_samples=self.n_features_in_, n_axes=self.n_axes_in_)
        return np.asarray(names, dtype=object)

    def __sklearn_tags__(self) -> Tags:
        """Tags: recordings are three-dimensional, and two dimensions are welcome."""
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = True
        return tags

    def _recordings(self, X: npt.ArrayLike, *, reset: bool) -> FloatArray:
        rank = np.ndim(X) if hasattr(X, "ndim") or isinstance(X, (list, tuple)) else 2
        if rank > 3:
            raise ValueError(f"X must have shape (n, T, C) or (n, T), got {rank} dimensions")
        if not reset and self.n_axes_in_ > 1:
            self._same_shape(np.shape(X))
        # In transform extract_features looks for NaN anyway, and names the place.
        values = validate_data(self, X, reset=reset, dtype=np.float64, allow_nd=True, ensure_all_finite=reset)
        if values.ndim == 2:
            values = values[:, :, np.newaxis]
        if values.shape[2] == 0:
            raise ValueError(f"X must have at least one axis, got shape {values.shape}")
        if not reset and values.shape[2] != self.n_axes_in_:
            raise ValueError(f"X must have {self.n_axes_in_} axes as in fit, got {values.shape[2]}")
        recordings: FloatArray = values
        return recordings

    def _same_shape(self, shape: tuple[int, ...]) -> None:
        fitted = (self.n_features_in_, self.n_axes_in_)
        if shape == fitted:
            raise ValueError(f"X must be a batch, got one recording of shape {shape}: pass X[np.newaxis]")
        if len(shape) != 3 or shape[1:] != fitted:
            wanted = f"(n, {fitted[0]}, {fitted[1]})"
            raise ValueError(f"X must have shape {wanted} as in fit, with any n, got {shape}")


class RawSignal(RecordingTransformer):
    """The samples themselves, axis after axis: all of Fx, then all of Fy, ...

    Parameters
    ----------
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
    >>> from granular_id.spaces.transformers import RawSignal
    >>> X = np.arange(12.0).reshape(1, 2, 6)
    >>> RawSignal().fit_transform(X)
    array([[ 0.,  6.,  1.,  7.,  2.,  8.,  3.,  9.,  4., 10.,  5., 11.]])
    """

    def __init__(self, *, threads: int | None = None) -> None:
        self.threads = threads

    def _spec(self, recordings: FloatArray) -> FeatureSpec:  # noqa: ARG002
        return FeatureSpec(raw=True, hfmh=False)


class HFMH(RecordingTransformer):
    """High-frequency magnitude histogram of each axis: high-pass filter, then counts in equal bins.

    Parameters
    ----------
    rate_hz : float, default 500.0
        Sampling rate; the paper's sensor. Other rates need other cut-offs to see the same signal.
    cutoff_hz, order : float and int, default 23.0 and 8
        Butterworth high-pass of the paper.
    n_bins : int, default 100
        Bins per axis, of equal width.
    bin_range : (low, high), array of shape (C, 2), or "auto", default (-1.5, 1.5)
        Range of the bins, N and N m. The default is the paper's, one for every axis. Torques are much
        smaller than forces, and other sensors are quieter or louder: one fixed range then puts all counts of
        an axis in its middle bins, or drops most of them. "auto" learns one symmetric range per axis from the
        rows given to `fit`: +- the 99.5 % quantile of the high-passed magnitude. An axis
        without any signal keeps the paper's range.
    outside : {"drop", "clip"}, default "drop"
        What becomes of values outside the range; the paper does not count them.
    density : bool, default False
        Counts, as in the paper, or a density.
    initial : {"zero", "steady"}, default "zero"
        State of the filter before the first sample: at rest, as in the paper, so that an offset of the sensor
        makes a transient; or as if the first sample had lasted for ever.
    threads : int or None, default None
        Threads of a batch; None takes all cores.

    Attributes
    ----------
    bin_range_ : ndarray, shape (C, 2)
        Range of each axis.
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.
    spec_ : FeatureSpec
        What is extracted.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces.transformers import HFMH
    >>> X = np.random.default_rng(0).normal(scale=0.1, size=(3, 400, 6))
    >>> HFMH(n_bins=10).fit_transform(X).shape
    (3, 60)
    >>> HFMH(n_bins=10, bin_range="auto").fit(X).bin_range_.shape
    (6, 2)
    """

    _raw = False

    def __init__(
        self,
        *,
        rate_hz: float = 500.0,
        cutoff_hz: float = 23.0,
        order: int = 8,
        n_bins: int = 100,
        bin_range: BinRange = DEFAULT_RANGE,
        outside: str = "drop",
        density: bool = False,
        initial: str = "zero",
        threads: int | None = None,
    ) -> None:
        self.rate_hz = rate_hz
        self.cutoff_hz = cutoff_hz
        self.order = order
        self.n_bins = n_bins
        self.bin_range = bin_range
        self.outside = outside
        self.density = density
        self.initial = initial
        self.threads = threads

    @property
    def learns(self) -> bool:
        """True with ``bin_range="auto"``: the range then comes from the rows given to `fit`."""
        return isinstance(self.bin_range, str)

    def _spec(self, recordings: FloatArray) -> FeatureSpec:
        options: dict[str, Any] = {
            "rate_hz": self.rate_hz,
            "cutoff_hz": self.cutoff_hz,
            "order": self.order,
            "n_bins": self.n_bins,
            "outside": self.outside,
            "density": self.density,
            "initial": self.initial,
            "raw": self._raw,
            "hfmh": True,
        }
        if not isinstance(self.bin_range, str):
            spec = FeatureSpec(bin_range=self.bin_range, **options)
            bounds = np.asarray(self.bin_range, dtype=np.float64)
        elif self.bin_range == "auto":
            FeatureSpec(**options)  # checks the filter before it is used
            bounds = self._learned_range(recordings)
            spec = FeatureSpec(bin_range=tuple((low, high) for low, high in bounds.tolist()), **options)
        else:
            raise ValueError(
                f"bin_range must be (low, high), one such pair per axis, or 'auto', got {self.bin_range!r}"
            )
        n_axes = recordings.shape[2]
        if bounds.ndim == 2 and len(bounds) != n_axes:
            raise ValueError(f"bin_range has {len(bounds)} pairs, but X has {n_axes} axes")
        self.bin_range_ = np.broadcast_to(bounds, (n_axes, 2)).copy()
        return spec

    def _learned_range(self, recordings: FloatArray) -> FloatArray:
        sos = butter(self.order, self.cutoff_hz, "highpass", fs=self.rate_hz, output="sos")
        bounds = np.empty((recordings.shape[2], 2))
        for axis in range(recordings.shape[2]):  # one at a time: a copy of one axis, not of all
            signal = np.ascontiguousarray(recordings[:, :, axis])
            if self.initial == "steady":
                state = sosfilt_zi(sos)[:, np.newaxis, :] * signal[:, :1]
                high_passed, _ = sosfilt(sos, signal, axis=1, zi=state)
            else:
                high_passed = sosfilt(sos, signal, axis=1)
            reach = float(np.quantile(np.abs(high_passed), _AUTO_QUANTILE))
            bounds[axis] = (-reach, reach) if reach > 0 else DEFAULT_RANGE
        return bounds


class RawHFMH(HFMH):
    """`RawSignal` and `HFMH` side by side in one pass, the best feature space of the paper (0.9705).

    Plain newtons next to plain counts, as in the paper. Parameters and attributes are those of `HFMH`.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces.transformers import RawHFMH
    >>> X = np.random.default_rng(0).normal(size=(2, 1600, 6))
    >>> RawHFMH().fit_transform(X).shape
    (2, 10200)
    """

    _raw = True
