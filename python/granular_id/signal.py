"""The Rust core's filter and histogram by themselves: what `extract_features` does to each axis.

Names and results are those of ``scipy.signal`` and ``numpy.histogram``, so that the core can be held against
them; everything is computed in float64. What is not here is in scipy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, SupportsIndex, TypeAlias, overload

import numpy as np

from granular_id import _core
from granular_id._checks import float_array, whole_number
from granular_id._core import GranularIdError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    FloatArray: TypeAlias = NDArray[np.float64]

__all__ = ["butter", "histogram", "sosfilt", "sosfilt_zi"]


def butter(
    N: int,
    Wn: float | ArrayLike,
    btype: Literal["lowpass", "highpass", "bandpass", "bandstop"] = "lowpass",
    *,
    fs: float = 2.0,
) -> FloatArray:
    """Design a digital Butterworth filter as second-order sections.

    Parameters
    ----------
    N : int
        Order, 1 to 32. A band-pass or band-stop filter has twice as many poles.
    Wn : float or pair of float
        Frequency, where the magnitude is down by 3 dB, in the unit of `fs`; two of them, ascending, for a band.
    btype : {"lowpass", "highpass", "bandpass", "bandstop"}, default "lowpass"
    fs : float, default 2
        Sampling rate. At 2, frequencies are fractions of the Nyquist frequency.

    Returns
    -------
    ndarray of float64, shape (n_sections, 6)
        Rows ``[b0, b1, b2, 1, a1, a2]``, those of ``scipy.signal.butter(..., output="sos")`` to about 1e-12.

    Raises
    ------
    ValueError
        If an argument is out of range, or if the filter does not fit into float64.

    Examples
    --------
    The high-pass of the paper, order 8 at 23 Hz:

    >>> from granular_id.signal import butter
    >>> butter(8, 23, "highpass", fs=500).shape
    (4, 6)
    """
    edges = float_array("Wn", Wn)
    if edges.size != (2 if btype in {"bandpass", "bandstop"} else 1):
        raise GranularIdError(f"Wn must be one frequency, or two for a band, got {Wn!r} for btype {btype!r}")
    return _core.butter(whole_number("N", N), btype, float(edges.flat[0]), float(edges.flat[-1]), fs)


@overload
def sosfilt(sos: ArrayLike, x: ArrayLike, axis: SupportsIndex = -1, *, zi: None = None) -> FloatArray: ...
@overload
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex = -1, *, zi: ArrayLike
) -> tuple[FloatArray, FloatArray]: ...
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex = -1, *, zi: ArrayLike | None = None
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Filter a signal along one axis with a cascade of second-order sections.

    Parameters
    ----------
    sos : array_like, shape (n_sections, 6)
        Rows ``[b0, b1, b2, a0, a1, a2]`` with ``a0 = 1``, finite and stable.
    x : array_like
        Signal of any rank from one. It is not modified. NaN and infinity spread to all later samples.
    axis : int, default -1
        Axis along which time runs.
    zi : array_like, optional
        State before the first sample: the shape of `x` with 2 in place of the length of `axis`, behind the number
        of sections. Default: rest.

    Returns
    -------
    y : ndarray of float64, the shape of `x`
        On x86-64 the bits of ``scipy.signal.sosfilt``.
    zf : ndarray of float64, the shape of `zi`
        State after the last sample, only if `zi` was given: filtering in pieces gives the bits of the whole.

    Raises
    ------
    ValueError, TypeError
        If a shape does not fit, sections are not finite or not stable, or an array does not hold real numbers.

    Examples
    --------
    >>> from granular_id.signal import sosfilt
    >>> sosfilt([[1, 0, 0, 1, -1, 0]], [1, 2, 3])     # the sum so far
    array([1., 3., 6.])
    """
    y, zf = _core.sosfilt(sos, x, axis, zi)
    return y if zf is None else (y, zf)


def sosfilt_zi(sos: ArrayLike) -> FloatArray:
    """State in which a filter rests under a constant input of one, for the `zi` of `sosfilt`.

    Parameters
    ----------
    sos : array_like, shape (n_sections, 6)
        As in `sosfilt`.

    Returns
    -------
    ndarray of float64, shape (n_sections, 2)

    Raises
    ------
    ValueError, TypeError
        As `sosfilt`, and for a section with a pole at z = 1, which has no such state.

    Examples
    --------
    >>> from granular_id.signal import butter, sosfilt, sosfilt_zi
    >>> sos = butter(2, 0.25)
    >>> sosfilt(sos, [5, 5, 5], zi=5 * sosfilt_zi(sos))[0].round(12)
    array([5., 5., 5.])
    """
    return _core.sosfilt_zi(sos)


def histogram(
    a: ArrayLike,
    bins: SupportsIndex,
    range: tuple[float, float],  # noqa: A002 - the name in numpy
) -> tuple[NDArray[np.int64], FloatArray]:
    """Count values into equal bins, by the rule of the high-frequency magnitude histogram.

    Parameters
    ----------
    a : array_like
        Values, of any shape. Those outside `range` and NaN are not counted.
    bins : int
        Number of bins, 1 to 32,768. Each holds ``edges[i] <= value < edges[i + 1]``, the last one its right edge too.
    range : pair of float
        Lower end of the first and upper end of the last bin.

    Returns
    -------
    counts : ndarray of int64, shape (bins,)
    edges : ndarray of float64, shape (bins + 1,)
        Both equal to those of ``numpy.histogram`` for float64 values.

    Raises
    ------
    ValueError, TypeError
        If `bins` is out of range, `range` is not finite, not ascending or too narrow for that many bins, or `a` does
        not hold real numbers.

    Examples
    --------
    >>> from granular_id.signal import histogram
    >>> histogram([0.0, 0.4, 0.5, 1.0, 7.0], bins=2, range=(0, 1))
    (array([2, 2]), array([0. , 0.5, 1. ]))
    """
    low, high = range
    counts, edges = _core.histogram(a, bins, low, high)
    return np.array(counts, np.int64), np.array(edges)
