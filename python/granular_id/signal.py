"""Butterworth design and filtering by second-order sections, as in ``scipy.signal``.

Shapes, arguments and results are those of scipy for what is covered here: digital filters in the form of
second-order sections, real signals. Given the same sections, `sosfilt` returns the bits that
`scipy.signal.sosfilt` returns on x86-64. Where the two differ:

- Everything is computed and returned in float64. scipy returns float32 when `sos`, `x` and `zi` are all
  float32, and computes in long double when one of them is.
- Complex, object and masked arrays, text and dates raise TypeError.
- Sections must be finite and stable. A pole outside the unit circle makes any input grow without bound and
  raises ValueError, where scipy returns the growing numbers. Allowed are poles on the circle (integrators)
  and a section whose numerator equals its denominator, which passes samples through unchanged.
- `butter` designs digital filters as second-order sections; what it has no parameter for stays with scipy.
- An axis of no samples is returned as it is, and the states with it; scipy raises ValueError.

`histogram` counts what is left after filtering, as ``numpy.histogram`` does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, SupportsIndex, TypeAlias, overload

import numpy as np

from granular_id import _core
from granular_id._checks import argument_error, float_array, positive_number, whole_number
from granular_id._text import fixed

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    FloatArray: TypeAlias = NDArray[np.float64]

__all__ = ["butter", "histogram", "sosfilt", "sosfilt_zi"]

_MAX_ORDER = 32
_BANDS = {
    "lowpass": ("l", "low", "lp", "lowpass"),
    "highpass": ("h", "high", "hp", "highpass"),
    "bandpass": ("band", "pass", "bp", "bandpass"),
    "bandstop": ("bands", "stop", "bs", "bandstop"),
}


def butter(
    N: float,
    Wn: float | Sequence[float] | FloatArray,
    btype: str = "low",
    *,
    fs: float | None = None,
) -> FloatArray:
    """Design a digital Butterworth filter as second-order sections.

    Parameters
    ----------
    N : int
        Order, 1 to 32. A band-pass or band-stop filter has twice as many poles.
    Wn : float or sequence of two floats
        Critical frequency, where the magnitude is down by 3 dB; two of them, ascending, for a band. In the
        units of `fs` (hertz), or as a fraction of the Nyquist frequency when `fs` is None.
    btype : str, default "low"
        What passes: "lowpass", "highpass", "bandpass" or "bandstop", or one of scipy's short forms of these
        ("low", "lp", "high", "hp", "band", "bp", "stop", "bs", ...).
    fs : float, optional
        Sampling rate, in hertz. None is a rate of 2, of which the Nyquist frequency is 1.

    Returns
    -------
    ndarray of float64, shape (n_sections, 6)
        Rows ``[b0, b1, b2, 1, a1, a2]``, equal to ``scipy.signal.butter(N, Wn, btype, output="sos", fs=fs)``
        section by section, to about 1e-12. The same on every machine. In a band symmetric about ``fs / 4``,
        rounding decides which of two sections comes first, and scipy may decide otherwise.

    Raises
    ------
    ValueError
        If an argument is out of range, or if the filter does not fit into float64.
    TypeError
        If an argument is not of the type named above.

    References
    ----------
    S. Butterworth, "On the theory of filter amplifiers", Experimental Wireless 7, 1930.

    Examples
    --------
    The high-pass of the paper, order 8 at 23 Hz:

    >>> from granular_id.signal import butter
    >>> butter(8, 23, "highpass", fs=500).shape
    (4, 6)
    """
    order = whole_number("N", int(N) if isinstance(N, float) and N.is_integer() else N)
    if order > _MAX_ORDER:
        raise argument_error(ValueError, "N", f"must be at most {_MAX_ORDER}, got {fixed(order)}")
    short = btype.lower() if isinstance(btype, str) else None
    band = next((name for name, forms in _BANDS.items() if short in forms), None)
    if band is None:
        wanted = ", ".join(repr(name) for name in _BANDS)
        raise ValueError(f"btype must be one of {wanted} or a short form of these, got {btype!r}")
    rate = 2.0 if fs is None else positive_number("fs", fs)
    edges = float_array("Wn", Wn)
    n_edges = 1 if band in {"lowpass", "highpass"} else 2
    if edges.size != n_edges or edges.ndim > 1:
        count = "a single frequency" if n_edges == 1 else "two frequencies, low and high,"
        raise ValueError(f"Wn must be {count} for btype {band!r}, got {Wn!r}")
    return _core.butter(order, band, float(edges.flat[0]), float(edges.flat[-1]), rate)


@overload
def sosfilt(sos: ArrayLike, x: ArrayLike, axis: SupportsIndex = -1, zi: None = None) -> FloatArray: ...
@overload
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex = -1, *, zi: ArrayLike
) -> tuple[FloatArray, FloatArray]: ...
@overload
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex, zi: ArrayLike
) -> tuple[FloatArray, FloatArray]: ...
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex = -1, zi: ArrayLike | None = None
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Filter a signal along one axis with a cascade of second-order sections.

    Parameters
    ----------
    sos : array_like, shape (n_sections, 6)
        Rows ``[b0, b1, b2, a0, a1, a2]`` with ``a0 = 1``, as `butter` returns them.
    x : array_like
        Signal of any rank from one. It is not modified. NaN and infinity spread to all later samples.
    axis : int, default -1
        Axis along which time runs.
    zi : array_like, shape (n_sections, ..., 2, ...), optional
        State before the first sample: the shape of `x`, with 2 in place of the length of `axis`, behind the
        number of sections. None, the default, starts from rest.

    Returns
    -------
    y : ndarray of float64, the shape of `x`
        The filtered signal.
    zf : ndarray of float64, the shape of `zi`
        State after the last sample, only if `zi` was given. Pass it as `zi` for the next piece: filtering in
        pieces gives the same bits as filtering whole.

    Raises
    ------
    ValueError
        If a shape does not fit, or if the sections are not finite or not stable; for an axis that `x` does
        not have, numpy's AxisError, which is a ValueError and an IndexError.
    TypeError
        If an array is complex, of objects, masked, or not numeric.

    Notes
    -----
    Each section runs in transposed direct form II:
    ``y = b0 x + z0; z0 = b1 x - a1 y + z1; z1 = b2 x - a2 y``.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.signal import sosfilt
    >>> sum_of_all_so_far = [[1, 0, 0, 1, -1, 0]]
    >>> sosfilt(sum_of_all_so_far, [1, 2, 3])
    array([1., 3., 6.])
    """
    y, zf = _core.sosfilt(sos, x, axis, zi)
    return y if zf is None else (y, zf)


def sosfilt_zi(sos: ArrayLike) -> FloatArray:
    """State in which a filter rests under a constant input of one.

    Multiplied by the first sample and passed to `sosfilt` as `zi`, it keeps the step from zero to that sample
    from ringing in the output.

    Parameters
    ----------
    sos : array_like, shape (n_sections, 6)
        Rows ``[b0, b1, b2, a0, a1, a2]`` with ``a0 = 1``.

    Returns
    -------
    ndarray of float64, shape (n_sections, 2)
        The two state values of each section.

    Raises
    ------
    ValueError
        If the sections are malformed, not finite or not stable, or if one has a pole at z = 1: its output
        grows for as long as a constant input lasts, so that there is no such state.
    TypeError
        If `sos` is not an array of real numbers.

    Examples
    --------
    >>> from granular_id.signal import butter, sosfilt, sosfilt_zi
    >>> sos = butter(2, 0.25)
    >>> y, _ = sosfilt(sos, [5, 5, 5, 5], zi=5 * sosfilt_zi(sos))
    >>> y.round(12)
    array([5., 5., 5., 5.])
    """
    return _core.sosfilt_zi(sos)


def histogram(
    a: ArrayLike,
    bins: SupportsIndex = 10,
    range: tuple[float, float] | None = None,  # noqa: A002 - the name in numpy
    density: bool | None = None,
) -> tuple[NDArray[np.int64] | NDArray[np.float64], NDArray[np.float64]]:
    """Count values into equal bins.

    The counting rule of the high-frequency magnitude histogram: a value belongs to bin i when
    ``edges[i] <= value < edges[i + 1]``, the last bin includes its right edge, and values outside `range` and
    NaN are not counted. The edges are those of ``numpy.linspace``, and the comparison with them is exact.

    Parameters
    ----------
    a : array_like
        Values, of any shape.
    bins : int, default 10
        Number of bins, 1 to 32,768.
    range : pair of float, optional
        Lower end of the first and upper end of the last bin. By default the smallest and the largest value;
        (0, 1) without values. Where both ends are equal, they move half a unit apart on either side.
    density : bool, optional
        Densities that integrate to one instead of counts; zeros where nothing was counted (numpy: NaN).

    Returns
    -------
    counts : ndarray, shape (bins,)
        int64, or float64 with `density`.
    edges : ndarray of float64, shape (bins + 1,)
        Ends of the bins, in the unit of the values.

    Raises
    ------
    ValueError
        If `bins` is out of range, if `range` is not finite or its ends are not in order, or if it is too
        narrow to hold that many bins.
    TypeError
        If `a` is complex, masked, or does not hold numbers; if `bins` is not an integer.

    See Also
    --------
    granular_id.extract_features : high-pass and count in one pass over the samples.

    Notes
    -----
    Equal to ``numpy.histogram(a, bins, range)`` for float64 values. Everything is computed in float64, where
    numpy rounds the edges to float32 or float16 when all of `a` is.

    Examples
    --------
    >>> from granular_id.signal import histogram
    >>> histogram([0.0, 0.4, 0.5, 1.0, 7.0], bins=2, range=(0, 1))
    (array([2, 2]), array([0. , 0.5, 1. ]))
    """
    try:
        values = np.asanyarray(a)
    except (TypeError, ValueError) as error:
        raise type(error)(f"a must be an array of real numbers, got {type(a).__name__}: {error}") from error
    low, high = _outer_edges(values, range)
    try:
        counted, edges = _core.histogram(values, bins, low, high)
    except ValueError as error:
        raise ValueError(f"bins and range do not fit together: {error}") from None
    counts = np.array(counted)
    if not density:
        return counts.astype(np.int64), np.array(edges)
    return counts / np.diff(edges) / max(counts.sum(), 1.0), np.array(edges)


def _outer_edges(values: NDArray[Any], given: Any) -> tuple[float, float]:
    if given is None:
        # What else an array may hold is refused, by its dtype, when it comes to counting.
        known = values.size > 0 and values.dtype.kind in "fiub"
        low, high = (float(values.min()), float(values.max())) if known else (0.0, 1.0)
        origin = "the values of a span"
    else:
        try:
            low, high = (float(end) for end in given)
        except (TypeError, ValueError):
            raise TypeError(f"range must be a pair of numbers (min, max), got {given!r}") from None
        except OverflowError:
            raise ValueError(f"range must fit into float64, got {given!r}") from None
        origin = "range is"
    if not (math.isfinite(low) and math.isfinite(high)):
        raise ValueError(f"range must be finite: {origin} ({low}, {high})")
    if high < low:
        raise ValueError(f"max must be larger than min in range, got ({low}, {high})")
    return (low - 0.5, high + 0.5) if low == high else (low, high)
