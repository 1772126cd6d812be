"""Counting into uniform bins, as ``numpy.histogram`` does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

from granular_id import _core

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def histogram(
    a: ArrayLike,
    bins: SupportsIndex = 10,
    range: tuple[float, float] | None = None,  # noqa: A002 - the name in numpy
    density: bool | None = None,
    weights: None = None,
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
    weights : None
        There for numpy's sake: every value counts once.

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
    if weights is not None:
        raise ValueError("weights must be None: every value counts once")
    values = _values(a)
    low, high = _outer_edges(values, range)
    try:
        counted, edges = _core.histogram(values, bins, low, high)
    except ValueError as error:
        raise ValueError(f"bins and range do not fit together: {error}") from None
    counts = np.array(counted)
    total = counts.sum()
    if not density:
        return counts.astype(np.int64), np.array(edges)
    return counts / np.diff(edges) / max(total, 1.0), np.array(edges)


def _values(a: Any) -> NDArray[Any]:
    try:
        return np.asanyarray(a)
    except (TypeError, ValueError) as error:
        raise type(error)(f"a must be an array of real numbers, got {type(a).__name__}: {error}") from error


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
