"""When a change that was found actually began."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granular_id.recording._values import FloatArray
from granular_id.recording.onset.noise import windows_of

__all__ = ["change_times"]

# Courses of a change, powers of the time since it began: a jump, a steady rise, the rise of what accelerates.
_POWERS = (0, 1, 2)
# Longest stretch that is fitted sample by sample; longer ones are averaged down to it.
_MOST_POINTS = 400
# How many rests to look back from where a change was found, and how many typical differences of windows are no move.
_LOOK_BACK = 5
_AT_LEVEL = 6.0
# Half windows fitted after that. Synthetic pushes: with 2 the curve's bend is taken for its beginning (10 ms late),
# with 6 it mostly is (12 ms late), with 3 the middle of all errors is 3 ms.
_AFTER = 3

_Indices = NDArray[np.intp]


def change_times(
    samples: FloatArray, weights: FloatArray, first: _Indices, rest: int, window: int
) -> _Indices:
    """Estimate the sample at which each change began.

    Axes are added up with `weights` (the matched filter for their common change). From where this sum left
    its former level, the stretch of `rest` samples before and one and a half windows after is fitted by a level
    that turns into a jump, a straight or a quadratic rise at sample k. The best k by least squares is the maximum
    likelihood estimate for white noise (D. V. Hinkley, "Inference about the change-point in a sequence of random
    variables", Biometrika 57, 1970; for broken lines "Inference in two-phase regression", JASA 66, 1971).

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
    length = rest + _AFTER * window // 2
    course = np.einsum("ntc,nc->nt", samples, weights)
    left = np.array([_leaves(*one, rest, window) for one in zip(course, first, strict=True)], dtype=np.intp)
    course = np.take_along_axis(course, (left - rest)[:, np.newaxis] + np.arange(length), axis=1)
    stride = -(-length // _MOST_POINTS)
    kept = length // stride
    course = course[:, length - kept * stride :].reshape(len(course), kept, stride).mean(axis=2)
    shapes, begins = _shapes(kept, -(-window // stride))
    best = begins[((course - course.mean(axis=1, keepdims=True)) @ shapes.T).argmax(axis=1)]
    result: _Indices = left - rest + (length - kept * stride) + best * stride
    return result


def _leaves(course: FloatArray, first: int, rest: int, window: int) -> int:
    """Return the last sample before `first` at which the windows of the course were at their former level.

    A slow rise may be well under way before it is certain. The former level is that of some rests ago, not
    that of the first samples: drift since then is no motion.
    """
    begin = max(0, int(first) - (_LOOK_BACK + 1) * rest)
    means = windows_of(course[np.newaxis, begin:first, np.newaxis], window)[0, :, 0]
    calm = windows_of(course[np.newaxis, :rest, np.newaxis], window)[0, :, 0]
    usual = np.sqrt(np.square(calm[window:] - calm[:-window]).mean())
    level = course[begin : begin + rest].mean()
    at_level = np.flatnonzero(np.abs(means - level) <= _AT_LEVEL * usual)
    last = int(at_level[-1]) + window if len(at_level) else rest
    return begin + max(last, rest)


@lru_cache(maxsize=64)
def _shapes(length: int, window: int) -> tuple[FloatArray, _Indices]:
    """Return the centred unit courses of changes, one a row, and the sample at which each begins."""
    time = np.arange(length)
    # a rise is at its old level at k, a jump at k has just left it; each leaves points to be seen by
    candidates = [
        (k, np.where(time >= k, 1.0, 0.0) if power == 0 else np.maximum(time - k, 0.0) ** power)
        for power in _POWERS
        for k in range(1, length - max(window // 4, 1))
    ]
    shapes = np.array([course - course.mean() for _, course in candidates])
    norms = np.linalg.norm(shapes, axis=1, keepdims=True)
    return shapes / norms, np.array([k for k, _ in candidates], dtype=np.intp)
