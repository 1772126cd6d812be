"""The statistics behind `find_onset`: windows compared with how they differ at rest, and when a change began.

docs/guide/recordings.md says how well it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray

# Windows that a change must last to count: two are compared, and one between them keeps glitches out.
SPAN = 3
# Windows that fit into the rest: fewer would not show how windows differ, more would not average the noise.
WINDOWS_IN_REST = 5


@dataclass(frozen=True)
class Detection:
    """What detection found in n recordings of T samples and C axes."""

    noise: RestNoise
    critical: FloatArray  # (n, C): smallest change that counts; infinite for an axis that never moves
    # (n, T, C): change at each sample over the critical one; 0 without room for the windows
    statistic: FloatArray
    joint: FloatArray  # (n, T): what decides, see `_joint`
    first: NDArray[np.intp]  # (n,): first sample at which that is above 1, or -1
    wander: FloatArray  # (n, C): largest distance of a window after the rest from the level at rest
    window: int


def detect(samples: FloatArray, rest: int, window: int, rate: float) -> Detection:
    """Find where each recording, of shape (n, T, C), near zero, T >= rest + SPAN window, changes by more than noise."""
    _, n_samples, n_axes = samples.shape
    n_tests = n_samples - rest - SPAN * window + 1
    noise = rest_noise(samples, rest, window)
    per_axis = rate / n_axes
    critical = critical_factors(noise.dof, n_tests, per_axis)[:, np.newaxis] * np.sqrt(noise.shift_variance)
    # A change of one axis only must stand out by its own noise, lest one with slower noise ring every alarm.
    alone = critical_factors(np.array([noise.own_dof]), n_tests, per_axis) * np.sqrt(noise.own_variance)
    critical[noise.shift_variance == 0] = np.inf
    critical[noise.held > window] = np.inf
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
    # Two windows before and two after must agree: no glitch passes. Their gap never exceeds the difference of the
    # two that meet, whose distribution at rest is known (MOSUM); two readings of one level may differ by one count.
    gap = np.maximum(low[:, after] - high[:, before], low[:, before] - high[:, after])
    gap -= noise.count[:, np.newaxis]
    np.maximum(gap, 0.0, out=gap)
    statistic = np.zeros(samples.shape)
    np.divide(gap, critical[:, np.newaxis], out=statistic[:, after])
    joint = _joint(statistic, share)
    passed = joint > 1
    first_passed = np.where(passed.any(axis=1), passed.argmax(axis=1), -1)
    wander = np.abs(means[:, rest:] - noise.level[:, np.newaxis]).max(axis=1)
    return Detection(noise, critical, statistic, joint, first_passed, wander, window)


def _joint(statistic: FloatArray, share: FloatArray) -> FloatArray:
    """Return the second largest of the axes, or the largest by what must be asked of an axis alone, shape (n, T)."""
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


# When a change that was found actually began.

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


def change_times(samples: FloatArray, found: Detection, rest: int, window: int) -> dict[int, int]:
    """Estimate the sample at which each change began, by the place of the recording.

    The axes, added up as by a matched filter, are fitted by a jump, a straight and a quadratic rise: the best by least
    squares is the maximum likelihood estimate for white noise (Hinkley).
    """
    passed = np.flatnonzero(found.first >= 0)
    first, moving = found.first[passed], samples[passed]
    before = np.take_along_axis(moving, (first[:, None] + np.arange(-window, 0))[:, :, None], axis=1)
    after = np.take_along_axis(moving, (first[:, None] + np.arange(window))[:, :, None], axis=1)
    carried = found.statistic[passed, first] > 1
    weights = np.zeros(carried.shape)
    change = after.mean(axis=1) - before.mean(axis=1)
    np.divide(change, found.noise.shift_variance[passed], out=weights, where=carried)
    length = rest + _AFTER * window // 2
    course = np.einsum("ntc,nc->nt", moving, weights)
    left = np.array([_leaves(*one, rest, window) for one in zip(course, first, strict=True)], dtype=np.intp)
    course = np.take_along_axis(course, (left - rest)[:, np.newaxis] + np.arange(length), axis=1)
    stride = -(-length // _MOST_POINTS)
    kept = length // stride
    course = course[:, length - kept * stride :].reshape(len(course), kept, stride).mean(axis=2)
    shapes, begins = _shapes(kept, -(-window // stride))
    best = begins[((course - course.mean(axis=1, keepdims=True)) @ shapes.T).argmax(axis=1)]
    began = left - rest + (length - kept * stride) + best * stride
    return dict(zip(passed.tolist(), began.tolist(), strict=True))


def _leaves(course: FloatArray, first: int, rest: int, window: int) -> int:
    """Return the last sample before `first` at which the course was at its level of some rests ago, drift and all."""
    begin = max(0, int(first) - (_LOOK_BACK + 1) * rest)
    means = windows_of(course[np.newaxis, begin:first, np.newaxis], window)[0, :, 0]
    calm = windows_of(course[np.newaxis, :rest, np.newaxis], window)[0, :, 0]
    usual = np.sqrt(np.square(calm[window:] - calm[:-window]).mean())
    level = course[begin : begin + rest].mean()
    at_level = np.flatnonzero(np.abs(means - level) <= _AT_LEVEL * usual)
    last = int(at_level[-1]) + window if len(at_level) else rest
    return begin + max(last, rest)


@lru_cache(maxsize=64)
def _shapes(length: int, window: int) -> tuple[FloatArray, NDArray[np.intp]]:
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


# What an axis does while nothing moves, measured on the few samples before the motion.

# Factor on Satterthwaite's degrees of freedom. False alarms come from the lower tail of an estimate, and that is
# thinner than his approximation says where the larger of two estimates is taken and two axes must agree. Set by
# simulation: with 3 the rate is just held when all axes carry one and the same noise.
_THINNER_TAIL = 2.5


@dataclass(frozen=True)
class RestNoise:
    """Noise at rest of n recordings of C axes."""

    level: FloatArray  # (n, C): mean of the samples
    sd: FloatArray  # (n, C): their standard deviation
    # (n, C): of the difference between the means of neighbouring windows, colour shared
    shift_variance: FloatArray
    dof: FloatArray  # (n,): its degrees of freedom
    own_variance: FloatArray  # (n, C): the same from each axis alone; not above `shift_variance`
    own_dof: float
    # (n, C): one count of the sensor, by which a level may seem to differ though it does not
    count: FloatArray
    held: FloatArray  # (n,): samples that one reading of the sensor lasts, 1 where each sample is new


def windows_of(samples: FloatArray, window: int) -> FloatArray:
    """Return the means of all windows, (n, T - window + 1, C), by running sums: `samples` should be near zero."""
    sums = np.cumsum(samples, axis=1)
    sums[:, window:] -= sums[:, :-window].copy()
    return sums[:, window - 1 :] / window


def rest_noise(samples: FloatArray, rest: int, window: int) -> RestNoise:
    """Measure how much neighbouring windows differ in the first `rest` samples of recordings, shape (n, T, C).

    One axis offers about three such differences, too few: how much larger they are than those of single samples is
    pooled over the axes of a sensor. Axes that move together count once (participation ratio of their correlations).
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
    changes: NDArray[np.bool_] = np.any(step > 0, axis=2)
    return RestNoise(level, centred.std(axis=1), shared, dof, own, own_dof, count, held_samples(changes))


# Readings that come at an even pace: so many of the samples lie in runs that are as long as the usual one, give or take
# a quarter. Counts too coarse for the noise change at random, and those of a motion at every sample.
_EVEN, _PACE = 0.8, 0.25
_READINGS = 4


def held_samples(changes: NDArray[np.bool_]) -> FloatArray:
    """Return how many samples a reading lasts where a sensor is slower than its messages, which repeat it, shape (n,).

    `changes`: whether any axis changes from sample to sample, shape (n, T - 1). A reading begins where some axis
    changes and none did the sample before: between two readings there may be one sample in between, of interpolation.
    """
    held = np.ones(len(changes))
    begins = changes[:, 1:] & ~changes[:, :-1]
    for i in np.flatnonzero(begins.sum(axis=1) > _READINGS):
        lasts = np.diff(np.flatnonzero(begins[i]))
        usual = np.median(lasts)
        even = lasts[np.abs(lasts - usual) <= max(_PACE * usual, 1.0)]
        if even.sum() >= _EVEN * begins.shape[1]:
            held[i] = even.mean()
    return held


def _one_count(step: FloatArray, rest: int) -> FloatArray:
    """Find the resolution of each axis: the smallest change, or of one that stands still at rest the usual one."""
    changed = np.where(step > 0, step, np.inf)
    count: FloatArray = changed.min(axis=1)
    count[np.isinf(count)] = 0.0
    still = (step[:, : rest - 1] == 0).all(axis=1) & (count > 0)
    for i, axis in np.argwhere(still):  # interpolation may have divided one count into small steps
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


# How many standard errors a change must measure before chance is ruled out for a whole recording.

# Degrees of freedom of the table; below the first nothing is known about the noise, above the last all is.
_LEAST, _MOST, _POINTS = 0.5, 1e4, 160
# Numbers of tests are rounded up to the next of 5 % steps: recordings of similar length share one table.
_GRID = 1.05
# Variances are integrated over their probability, from this upwards: less than any rate that can be asked for.
_RAREST = 1e-16
_NODES, _HALVINGS = 160, 32


def critical_factors(dof: FloatArray, n_tests: int, rate: float) -> FloatArray:
    """Return the upper point of the studentised maximum modulus for these degrees of freedom.

    The factor c with P(max |N_i| > c s) = `rate` for `n_tests` standard normal N_i and an independent estimate s
    of their standard deviation with `dof` degrees of freedom; infinite below 0.5 of them. All tests of an axis share
    the estimate, which Student's t per test would not know. Tests may be correlated in any way (Sidak).
    """
    grid = n_tests if n_tests < 20 else math.ceil(_GRID ** math.ceil(math.log(n_tests, _GRID) - 1e-9))
    known, factors = _table(grid, rate)
    found = np.exp(np.interp(np.log(np.clip(dof, _LEAST, _MOST)), known, factors))
    return np.where(dof < _LEAST, np.inf, found)


@lru_cache(maxsize=256)
def _table(n_tests: int, rate: float) -> tuple[FloatArray, FloatArray]:
    """Logarithms of degrees of freedom and of the factor, by bisection for all of them at once."""
    from scipy.special import ndtr  # slow to import, and only this step needs it

    dof, sd, weights = _estimates()
    low, high = np.zeros(_POINTS), np.full(_POINTS, math.log(1e30))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore"):
            all_inside = n_tests * np.log1p(-2 * ndtr(-np.exp(middle)[:, np.newaxis] * sd))
        too_often = -np.expm1(all_inside) @ weights > rate
        low, high = np.where(too_often, middle, low), np.where(too_often, high, middle)
    return np.log(dof), high


@lru_cache(maxsize=1)
def _estimates() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Degrees of freedom, the standard deviations that each may estimate where 1 is true, and their weights."""
    from scipy.special import gammaincinv

    dof = np.geomspace(_LEAST, _MOST, _POINTS)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    # equal care for every decade of probability: the small variances make the false alarms
    probability = np.exp(0.5 * math.log(_RAREST) * (1.0 - nodes))
    weights = weights * -0.5 * math.log(_RAREST) * probability
    sd = np.sqrt(gammaincinv(dof[:, np.newaxis] / 2, probability) * 2 / dof[:, np.newaxis])
    return dof, sd, weights
