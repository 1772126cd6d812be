"""Features of a recording: the raw samples and the high-frequency magnitude histogram (HFMH)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np

from granular_id import _core
from granular_id._core import FeatureSpec, GranularIdError
from granular_id.recording import refuse_tables

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, DTypeLike, NDArray
    from typing_extensions import Unpack

__all__ = ["FeatureSpec", "extract_features", "feature_names"]


class SpecKeywords(TypedDict, total=False):
    """Keywords of `FeatureSpec`; `extract_features` and `feature_names` take them too."""

    rate_hz: float
    cutoff_hz: float
    order: int
    n_bins: int
    bin_range: ArrayLike
    raw: bool
    hfmh: bool
    outside: Literal["drop", "clip"]
    density: bool
    initial: Literal["zero", "steady"]


def extract_features(
    wrench: ArrayLike,
    *,
    spec: FeatureSpec | None = None,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    dtype: DTypeLike = np.float64,
    **keywords: Unpack[SpecKeywords],
) -> NDArray[Any]:
    """Extract the paper's features from one recording or from a batch.

    The raw block holds all samples of the first axis, then all of the second, and so on. The HFMH block holds,
    axis by axis, how many samples of the high-passed signal fall into each of `n_bins` equal bins: how rough the
    material is, whatever its mean drag.

    Parameters
    ----------
    wrench : array_like, shape (n_samples, n_axes) or (n_recordings, n_samples, n_axes)
        Force in newton and torque in newton metre, one row per instant. Six axes are the fast case, any number
        works. C-contiguous float64 is read in place; anything else is converted once. Never modified. Tables with
        named columns are refused: `Dataset.from_frames` reads them.
    spec : FeatureSpec, optional
        Everything below `dtype` as one checked value. Give this or the keywords, not both.
    threads : int, optional
        Threads for a batch; all cores by default, and never more than there are cores. One recording runs on the
        calling thread. The number of threads changes no bit of the result. The GIL is released for a batch.
    out : ndarray, shape (n_features,) or (n_recordings, n_features), optional
        Where to write: C-contiguous, float64, not overlapping `wrench`. Unspecified after an error.
    dtype : dtype, default float64
        Type of a new result: float64, or float32, to which a result in float64 is rounded.
    rate_hz : float, default 500
        Sampling rate in hertz; 500 is the paper's.
    cutoff_hz : float, default 23
        Cut-off of the high-pass in hertz, between 0 and half of `rate_hz`. The paper chose 23: below lies the
        drag profile, above the grain-scale events.
    order : int, default 8
        Order of the Butterworth high-pass, 1 to 32.
    n_bins : int, default 100
        Bins of each histogram.
    bin_range : pair of float, or array_like of shape (n_axes, 2), default (-1.5, 1.5)
        Range of the histograms in newton and newton metre, for all axes or one per axis. Torques are smaller
        than forces: their own ranges use the bins better.
    raw, hfmh : bool, default True
        Which blocks to compute.
    outside : {'drop', 'clip'}, default 'drop'
        Values outside the range are not counted (the paper), or counted in the first and last bin.
    density : bool, default False
        Densities that integrate to one instead of counts. An axis without a single counted value gives zeros.
    initial : {'zero', 'steady'}, default 'zero'
        State of the filter before the first sample. At rest is the paper; there an offset of the sensor starts
        a transient that leaks into the histogram. 'steady' starts as if the first sample had lasted for ever.

    Returns
    -------
    ndarray, shape (n_features,) or (n_recordings, n_features)
        10,200 features for 1,600 samples of six axes. `feature_names` names them.

    Raises
    ------
    TypeError
        If `wrench` is complex, masked, or does not hold numbers.
    ValueError
        If a shape does not fit, `wrench` is empty, NaN, infinite (the message says where) or so large that the
        filter or float32 overflows, `out` overlaps `wrench`, or a parameter is outside its range.

    Warns
    -----
    UserWarning
        If `wrench` has more axes than samples, and more than 32: most likely it is transposed.

    See Also
    --------
    granular_id.RawHFMH : the same as a scikit-learn transformer.

    Notes
    -----
    The same bits on every machine, with any number of threads and any vector unit; on x86-64 the bits of
    ``scipy.signal.sosfilt`` and ``numpy.histogram`` too.

    References
    ----------
    Hynninen, Nguyen Le, Kyrki: Interactive Identification of Granular Materials using Force Measurements,
    arXiv 2403.17606, section III.

    Examples
    --------
    >>> import numpy as np
    >>> import granular_id as gid
    >>> wrench = np.random.default_rng(0).normal(size=(1600, 6))
    >>> gid.extract_features(wrench).shape
    (10200,)
    >>> gid.extract_features(wrench, raw=False, n_bins=10).sum() <= 9600
    np.True_
    """
    if type(wrench).__module__.startswith("granular_id.recording"):
        raise TypeError(
            f"wrench must be an array, got a {type(wrench).__name__}: pass recording.wrench, or dataset.X for a batch"
        )
    try:
        narrow = {np.dtype(np.float64): False, np.dtype(np.float32): True}[np.dtype(dtype)]
    except (KeyError, TypeError):
        raise TypeError(f"dtype must be float64 or float32, got {dtype!r}") from None
    refuse_tables(wrench, "wrench")
    features = _core.extract_features(wrench, _spec(spec, keywords), threads, out)
    if out is not None or not narrow:
        return features
    with np.errstate(over="ignore"):
        rounded = features.astype(np.float32)
    if not np.isfinite(rounded).all():
        largest = np.abs(features).max()
        raise GranularIdError(f"features reach {largest:g}, which float32 cannot hold: use dtype float64")
    return rounded


def feature_names(
    spec: FeatureSpec | None = None,
    *,
    n_samples: int = 1600,
    n_axes: int = 6,
    **keywords: Unpack[SpecKeywords],
) -> list[str]:
    """Name the features that `extract_features` returns, in order.

    Parameters
    ----------
    spec : FeatureSpec, optional
        The specification; or give its keywords as in `extract_features`.
    n_samples, n_axes : int, default 1600 and 6
        Size of a recording; the defaults are the paper's.
    **keywords
        Keywords of `FeatureSpec`.

    Returns
    -------
    list of str
        ``fx_0000 ... tz_1599, hfmh_fx_00 ... hfmh_tz_99``. With other than six axes: ``axis0_0000 ...``.

    Examples
    --------
    >>> import granular_id as gid
    >>> names = gid.feature_names()
    >>> names[0], names[9600], names[-1], len(names)
    ('fx_0000', 'hfmh_fx_00', 'hfmh_tz_99', 10200)
    """
    return _spec(spec, keywords).feature_names(n_samples, n_axes)


def _spec(spec: FeatureSpec | None, keywords: SpecKeywords) -> FeatureSpec:
    if spec is None:
        return FeatureSpec(**keywords)
    if not isinstance(spec, FeatureSpec):
        raise TypeError(f"spec must be a FeatureSpec, got {type(spec).__name__}")
    if keywords:
        raise GranularIdError(
            f"give spec or its keywords, not both: got spec and {', '.join(sorted(keywords))}"
        )
    return spec
