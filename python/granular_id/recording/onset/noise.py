"""What an axis does while nothing moves, measured on the few samples before the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_id.recording._values import FloatArray

__all__ = ["WINDOWS_IN_REST", "RestNoise", "rest_noise", "windows_of"]

WINDOWS_IN_REST = 5
"""Windows that fit into the rest: fewer would not show how windows differ, more would not average the noise."""

# An axis whose noise is this much slower than that of the others is judged by itself (an F statistic of some 3 and
# 15 degrees of freedom exceeds it in one axis of twenty by chance, which costs sensitivity, not certainty).
_OTHER_COLOUR = 3.0


@dataclass(frozen=True)
class RestNoise:
    """Noise at rest of n recordings of C axes.

    Attributes
    ----------
    level, sd : ndarray, shape (n, C)
        Mean and standard deviation of the samples.
    shift_variance : ndarray, shape (n, C)
        Variance of the difference between the means of two neighbouring windows.
    dof : ndarray, shape (n, C)
        Degrees of freedom of that variance.
    count : ndarray, shape (n, C)
        One count of the sensor: by this much a level may seem to differ though it does not.
    """

    level: FloatArray
    sd: FloatArray
    shift_variance: FloatArray
    dof: FloatArray
    count: FloatArray


def windows_of(samples: FloatArray, window: int) -> FloatArray:
    """Return the means of all windows of this many samples: (n, T, C) gives (n, T - window + 1, C).

    `samples` should be near zero: the means come from running sums.
    """
    sums = np.cumsum(samples, axis=1)
    sums[:, window:] -= sums[:, :-window].copy()
    return sums[:, window - 1 :] / window


def rest_noise(samples: FloatArray, rest: int, window: int) -> RestNoise:
    """Measure the noise of the first `rest` samples of recordings of shape (n, T, C).

    What has to be known is how much the means of neighbouring windows differ when nothing moves, and this is
    measured as just that: on neighbouring windows at rest. So noise may have any colour (filtered by the sensor,
    autocorrelated, drifting) without a model of it. One axis offers about three independent such differences,
    too few to be sure of anything; but the axes come from one sensor, through one filter. How much larger the
    differences are than those of single samples is therefore pooled over the axes, and only the size is each
    axis's own. Axes that move together count once (participation ratio of their correlations), and an axis
    that is slower than the others stands alone.
    """
    n, _, n_axes = samples.shape
    at_rest = samples[:, :rest]
    level = at_rest.mean(axis=1)
    centred = at_rest - level[:, np.newaxis]
    step = np.abs(np.diff(samples, axis=1))
    count = _one_count(step, rest)
    fast = np.square(step[:, : rest - 1]).mean(axis=1)
    own_dof = np.full((n, n_axes), 0.75 * (rest / window - 1))
    size_dof = 2 / 3 * (rest - 1)  # of the mean square of differences between independent samples
    means = windows_of(centred, window)
    slow = np.square(means[:, window:] - means[:, :-window]).mean(axis=1)
    if window == 1:  # the same thing twice
        variance, dof = fast, np.full((n, n_axes), size_dof)
    else:
        live = fast > 0
        colour = np.where(live, slow / np.where(live, fast, 1.0), np.nan)
        usual = np.full((n, 1), np.nan)
        some = live.any(axis=1)
        usual[some] = np.nanmedian(colour[some], axis=1, keepdims=True)
        alone = colour > _OTHER_COLOUR * usual
        shared = live & ~alone
        pooled = np.where(shared, colour, 0.0).sum(axis=1, keepdims=True) / np.maximum(
            shared.sum(axis=1, keepdims=True), 1
        )
        pooled_dof = own_dof * _independent(centred, shared)[:, np.newaxis]
        variance = np.where(alone, slow, np.maximum(slow, pooled * fast))
        dof = np.where(alone, own_dof, 1 / (1 / pooled_dof + 1 / size_dof))
    # reading is exact to half a count at best, evenly spread: a variance of one count squared over twelve
    variance = np.maximum(variance, 2 / window * np.square(count) / 12)
    return RestNoise(level, centred.std(axis=1), variance, dof, count)


def _one_count(step: FloatArray, rest: int) -> FloatArray:
    """Find the resolution of each axis: the smallest change between neighbouring samples.

    For an axis that stands still at rest the usual change is taken instead: interpolation may have divided one
    count into small steps, and nothing else would keep such an axis from answering to a single count.
    """
    changed = np.where(step > 0, step, np.inf)
    count: FloatArray = changed.min(axis=1)
    count[np.isinf(count)] = 0.0
    still = (step[:, : rest - 1] == 0).all(axis=1) & (count > 0)
    for i, axis in np.argwhere(still):
        one = step[i, :, axis]
        count[i, axis] = np.median(one[one > 0])
    return count


def _independent(centred: FloatArray, shared: NDArray[np.bool_]) -> FloatArray:
    """Count how many independent axes the shared ones are worth, shape (n,), between 1 and their number."""
    size = np.sqrt(np.square(centred).sum(axis=1))
    unit = np.where(shared & (size > 0), 1 / np.where(size > 0, size, 1.0), 0.0)
    scaled = centred * unit[:, np.newaxis]
    correlation = np.matmul(scaled.transpose(0, 2, 1), scaled)
    total = np.square(correlation).sum(axis=(1, 2))
    trace = np.trace(correlation, axis1=1, axis2=2)
    independent: FloatArray = np.maximum(np.square(trace) / np.where(total > 0, total, 1.0), 1.0)
    return independent
