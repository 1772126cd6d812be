"""What an axis does while nothing moves, measured on the few samples before the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granular_id.recording._values import FloatArray

__all__ = ["WINDOWS_IN_REST", "RestNoise", "rest_noise", "windows_of"]

WINDOWS_IN_REST = 5
"""Windows that fit into the rest: fewer would not show how windows differ, more would not average the noise."""
# Factor on Satterthwaite's degrees of freedom. False alarms come from the lower tail of an estimate, and that is
# thinner than his approximation says where the larger of two estimates is taken and two axes must agree. Set by
# simulation with benches/onset.py: with 3 the rate is just held when all axes carry one and the same noise.
_THINNER_TAIL = 2.5


@dataclass(frozen=True)
class RestNoise:
    """Noise at rest of n recordings of C axes.

    Attributes
    ----------
    level, sd : ndarray, shape (n, C)
        Mean and standard deviation of the samples.
    shift_variance : ndarray, shape (n, C)
        Variance of the difference between the means of two neighbouring windows, taking noise to have one
        colour on all axes; at least `own_variance`.
    dof : ndarray, shape (n,)
        Degrees of freedom of that variance.
    own_variance : ndarray, shape (n, C)
        The same variance from each axis alone.
    own_dof : float
        Its degrees of freedom.
    count : ndarray, shape (n, C)
        One count of the sensor: by this much a level may seem to differ though it does not.
    """

    level: FloatArray
    sd: FloatArray
    shift_variance: FloatArray
    dof: FloatArray
    own_variance: FloatArray
    own_dof: float
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
    too few to be sure of anything; but axes come from one sensor, as a rule through one filter. How much larger
    the differences are than those of single samples is therefore also pooled over the axes, with only the size
    from each axis itself. Axes that move together count once (participation ratio of their correlations).
    """
    at_rest = samples[:, :rest]
    level = at_rest.mean(axis=1)
    centred = at_rest - level[:, np.newaxis]
    step = np.abs(np.diff(samples, axis=1))
    count = _one_count(step, rest)
    fast = np.square(step[:, : rest - 1]).mean(axis=1)
    means = windows_of(centred, window)
    own = np.square(means[:, window:] - means[:, :-window]).mean(axis=1)
    size_dof = 2 / 3 * (rest - 1)  # of the mean square of differences between independent samples
    own_dof = size_dof if window == 1 else 0.75 * (rest / window - 1)
    live = fast > 0
    colour = np.divide(own, fast, out=np.zeros_like(own), where=live).sum(axis=1) / np.maximum(
        live.sum(axis=1), 1
    )
    pooled_dof = own_dof * _independent(centred)
    dof = _THINNER_TAIL / (1 / pooled_dof + 1 / size_dof)
    # reading is exact to half a count at best, evenly spread: a variance of one count squared over twelve
    own = np.maximum(own, 2 / window * np.square(count) / 12)
    shared = np.maximum(own, colour[:, np.newaxis] * fast)
    return RestNoise(level, centred.std(axis=1), shared, dof, own, own_dof, count)


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


def _independent(centred: FloatArray) -> FloatArray:
    """Count how many independent axes those that are not still are worth, shape (n,), at least 1."""
    size = np.sqrt(np.square(centred).sum(axis=1, keepdims=True))
    scaled = np.divide(centred, size, out=np.zeros_like(centred), where=size > 0)
    correlation = np.matmul(scaled.transpose(0, 2, 1), scaled)
    total = np.square(correlation).sum(axis=(1, 2))
    trace = np.trace(correlation, axis1=1, axis2=2)
    independent: FloatArray = np.maximum(np.square(trace) / np.where(total > 0, total, 1.0), 1.0)
    return independent
