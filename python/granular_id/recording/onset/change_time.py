"""When a change that was found actually began."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granular_id.recording._values import FloatArray

__all__ = ["change_times"]

# Courses of a change, powers of the time since it began: a jump, a steady rise, the rise of what accelerates.
_POWERS = (0, 1, 2)
# Longest stretch that is fitted sample by sample; longer ones are averaged down to it.
_MOST_POINTS = 400

_Indices = NDArray[np.intp]


def change_times(
    samples: FloatArray, weights: FloatArray, first: _Indices, rest: int, window: int
) -> _Indices:
    """Estimate the sample at which each change began.

    Axes are added up with `weights` (the matched filter for their common change), and the stretch of `rest`
    samples before detection and two windows after it is fitted by a level that turns into a jump, a straight
    or a quadratic rise at sample k. The best k by least squares is the maximum likelihood estimate for white
    noise (D. V. Hinkley, "Inference about the change-point in a sequence of random variables", Biometrika 57,
    1970; for broken lines "Inference in two-phase regression", JASA 66, 1971).

    Parameters
    ----------
    samples : ndarray, shape (n, T, C)
    weights : ndarray, shape (n, C)
        Signed: the sum rises with the change.
    first : ndarray of int, shape (n,)
        Where the change was found, at least `rest`.
    rest, window : int
        In samples.
    """
    length = rest + 2 * window
    places = (first - rest)[:, np.newaxis] + np.arange(length)
    course = np.einsum("ntc,nc->nt", np.take_along_axis(samples, places[:, :, np.newaxis], axis=1), weights)
    stride = -(-length // _MOST_POINTS)
    kept = length // stride
    course = course[:, length - kept * stride :].reshape(len(course), kept, stride).mean(axis=2)
    shapes, begins = _shapes(kept, -(-window // stride))
    best = begins[((course - course.mean(axis=1, keepdims=True)) @ shapes.T).argmax(axis=1)]
    result: _Indices = first - rest + (length - kept * stride) + best * stride
    return result


@lru_cache(maxsize=64)
def _shapes(length: int, window: int) -> tuple[FloatArray, _Indices]:
    """Return the centred unit courses of changes, one a row, and the sample at which each begins."""
    time = np.arange(length)
    # a rise is at its old level at k, a jump at k has just left it; each leaves points to be seen by
    candidates = [
        (k, np.where(time >= k, 1.0, 0.0) if power == 0 else np.maximum(time - k, 0.0) ** power)
        for power in _POWERS
        for k in range(1, max(length - window, 2))
    ]
    shapes = np.array([course - course.mean() for _, course in candidates])
    norms = np.linalg.norm(shapes, axis=1, keepdims=True)
    return shapes / norms, np.array([k for k, _ in candidates], dtype=np.intp)
