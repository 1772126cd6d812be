"""Compare neighbouring windows of a recording with how they differ at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granular_id.recording._values import FloatArray
from granular_id.recording.onset.noise import RestNoise, rest_noise, windows_of
from granular_id.recording.onset.threshold import critical_factors

__all__ = ["SPAN", "Detection", "detect"]

SPAN = 3
"""Windows that a change must last to count: two are compared, and one between them keeps glitches out."""


@dataclass(frozen=True)
class Detection:
    """What detection found in n recordings of T samples and C axes.

    Attributes
    ----------
    noise : RestNoise
        What rest looks like.
    critical : ndarray, shape (n, C)
        Smallest change between windows that counts, in units of the axis; infinite for an axis that never moves.
    statistic : ndarray, shape (n, T, C)
        Change at each sample over the critical one; 0 where there is no room for the windows.
    joint : ndarray, shape (n, T)
        What decides: above 1 where two axes change, or one by what is critical for an axis alone.
    first : ndarray of int, shape (n,)
        First sample at which that is so, or -1.
    wander : ndarray, shape (n, C)
        Largest distance of a window after the rest from the level at rest.
    """

    noise: RestNoise
    critical: FloatArray
    statistic: FloatArray
    joint: FloatArray
    first: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    wander: FloatArray


def detect(samples: FloatArray, rest: int, window: int, rate: float) -> Detection:
    """Find the first sample at which any axis changes by more than noise, in recordings of shape (n, T, C).

    At sample t there are two windows before it and two from it on, one window's length apart. Its change is the
    gap between the two before and the two after: all four must agree, so a glitch shorter than a window, which
    touches one of them at most, cannot pass. The gap never exceeds the difference of the two windows that meet
    at t, the moving sum statistic whose distribution at rest is known (Basseville & Nikiforov, "Detection of
    Abrupt Changes", 1993, section 2.1; P. Bauer and P. Hackl, "The use of MOSUMS for quality control",
    Technometrics 20, 1978), so its threshold holds. As the comparison is with what came just before, slow drift
    does not add up. One count is taken off: two readings of one level may differ by that much.

    The motion of a tool loads several axes. Where two change together, the colour of the noise is taken from all
    axes; a change of one axis only must stand out from what this axis alone has shown, lest the odd axis with
    slower noise than the others ring every alarm.

    Parameters
    ----------
    samples : ndarray, shape (n, T, C)
        Near zero (less the first sample, for instance).
    rest, window : int
        Samples known to be at rest, and samples of a window; T >= rest + SPAN window.
    rate : float
        Probability of a false alarm in a recording without motion.
    """
    _, n_samples, n_axes = samples.shape
    n_tests = n_samples - rest - SPAN * window + 1
    noise = rest_noise(samples, rest, window)
    per_axis = rate / n_axes
    critical = critical_factors(noise.dof, n_tests, per_axis)[:, np.newaxis] * np.sqrt(noise.shift_variance)
    alone = critical_factors(np.array([noise.own_dof]), n_tests, per_axis) * np.sqrt(noise.own_variance)
    critical[noise.shift_variance == 0] = np.inf
    if n_axes == 1:
        critical = np.where(np.isinf(critical), np.inf, alone)
    share = np.divide(
        critical, np.maximum(alone, critical), out=np.zeros_like(critical), where=np.isfinite(critical)
    )
    means = windows_of(samples, window)
    apart = (SPAN - 1) * window
    low, high = (bound(means[:, apart:], means[:, :-apart]) for bound in (np.minimum, np.maximum))
    first = rest - SPAN * window  # where the stretch before the first tested sample begins
    before, after = slice(first, first + n_tests), slice(rest, rest + n_tests)
    gap = np.maximum(low[:, after] - high[:, before], low[:, before] - high[:, after])
    gap -= noise.count[:, np.newaxis]
    np.maximum(gap, 0.0, out=gap)
    statistic = np.zeros(samples.shape)
    np.divide(gap, critical[:, np.newaxis], out=statistic[:, after])
    joint = _joint(statistic, share)
    passed = joint > 1
    first_passed = np.where(passed.any(axis=1), passed.argmax(axis=1), -1)
    wander = np.abs(means[:, rest:] - noise.level[:, np.newaxis]).max(axis=1)
    return Detection(noise, critical, statistic, joint, first_passed, wander)


def _joint(statistic: FloatArray, share: FloatArray) -> FloatArray:
    """Return the second largest of the axes, or the largest in terms of what one axis alone must show."""
    first = statistic[:, :, 0].copy()
    second = np.zeros_like(first)
    alone = first * share[:, :1]
    for axis in range(1, statistic.shape[2]):
        own = statistic[:, :, axis]
        np.maximum(second, np.minimum(first, own), out=second)
        np.maximum(first, own, out=first)
        np.maximum(alone, own * share[:, axis : axis + 1], out=alone)
    joint: FloatArray = np.maximum(second, alone)
    return joint
