"""Samples at the end of the sensor's range, whether the range is known or shows in the samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.special import pdtrc

from granular_id._words import counted, verb
from granular_id.recording._values import FloatArray
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.one import Recording

NEAR_RANGE = 0.999
"""From this part of the range on a reading counts as clipped: converters stop a few counts early."""

FAR_BEYOND = 2.0
"""Readings above this many ranges are no overload but another unit or another sensor."""

SHORTEST = 30
"""Shorter recordings are not judged without a range: what is usual for them cannot be told."""

FEWEST = 5
"""Readings at the extreme from which on it is looked at."""

PILED_UP = 3.0
"""Times as many readings as at any value nearby: the flat top of a smooth signal has up to 2.4 times."""

COARSE = 0.3
"""Axes that repeat the reading before in more than this part of the samples are not judged without a range."""

_NEIGHBOURS = 10


def check_clipping(
    recordings: Sequence[Recording], ranges: Mapping[str, float] | None, false_alarm_rate: float
) -> Iterator[Finding]:
    """Find samples at the sensor's range; without one, axes that stay at their own extreme.

    Without a range an axis counts as clipped when readings pile up at its highest (or lowest) value: three times
    as many as at any of the ten values next to it, and more than a Poisson variable of that mean reaches by
    chance. Unclipped readings thin out towards their extremes.
    """
    if ranges is not None:
        yield from _beyond_range(recordings, ranges)
        return
    n_tests = 2 * sum(len(r.axes) for r in recordings)
    places: dict[int, list[str]] = {}
    samples = 0
    for i, r in enumerate(recordings):
        for axis, run in plateaus(by_axis(r), r.axes, false_alarm_rate / n_tests):
            places.setdefault(i, []).append(axis)
            samples += run
    if places:
        axes = sorted({axis for names in places.values() for axis in names})
        message = (
            f"{counted(len(places))} {verb(len(places), 'seems', 'seem')} clipped on {', '.join(axes)}: "
            f"{counted(samples, 'reading')} piled up at the extreme; state sensor_range to be sure"
        )
        yield found("warning", "clipped", message, recordings, places, axes=axes, samples=samples)


def plateaus(wrench: FloatArray, axes: Sequence[str], alpha: float) -> Iterator[tuple[str, int]]:
    """Yield axes that meet their highest or lowest value more often than chance explains, and how often."""
    if len(wrench) < SHORTEST:
        return
    for edge in (wrench.max(axis=0), wrench.min(axis=0)):
        for column in np.flatnonzero(np.count_nonzero(wrench == edge, axis=0) >= FEWEST):
            number = _piled_up(wrench[:, column], float(edge[column]), alpha)
            if number:
                yield axes[int(column)], number


def _piled_up(samples: FloatArray, edge: float, alpha: float) -> int:
    """Return how many samples lie at the edge, 0 where their number surprises nobody."""
    at_edge = samples == edge
    inside = np.flatnonzero(~at_edge)
    if not len(inside):
        return 0
    visits = at_edge[inside[0] : inside[-1]]  # a recording may begin or end at rest, at its extreme
    number = int(np.count_nonzero(visits))
    away = samples[~at_edge]
    if number < FEWEST or np.mean(away[1:] == away[:-1]) > COARSE:
        return 0
    values, counts = np.unique(away, return_counts=True)
    nearest = counts[np.argsort(np.abs(values - edge), kind="stable")[:_NEIGHBOURS]]
    expected = float(nearest.max())
    surprising = number >= PILED_UP * expected and pdtrc(number - 1, expected) <= alpha
    return number if surprising else 0


def _beyond_range(recordings: Sequence[Recording], ranges: Mapping[str, float]) -> Iterator[Finding]:
    clipped: dict[int, int] = {}
    touched: set[str] = set()
    far: list[int] = []
    for i, r in enumerate(recordings):
        limit = np.array([ranges.get(axis, np.inf) for axis in r.axes])
        peak = np.abs(by_axis(r)).max(axis=0)
        if (peak > FAR_BEYOND * limit).any():
            far.append(i)
        elif (peak >= NEAR_RANGE * limit).any():
            clipped[i] = int((np.abs(r.wrench) >= NEAR_RANGE * limit).any(axis=1).sum())
            touched |= {axis for axis, hit in zip(r.axes, peak >= NEAR_RANGE * limit, strict=True) if hit}
    if far:
        message = f"{counted(len(far))} with readings above twice the range: are they in N and N m?"
        yield found("error", "beyond-range", message, recordings, far)
    if clipped:
        samples = sum(clipped.values())
        message = (
            f"{counted(len(clipped))} {verb(len(clipped), 'reaches', 'reach')} the sensor's range on "
            f"{', '.join(sorted(touched))}, in {counted(samples, 'sample')}: the true load was higher"
        )
        yield found("warning", "clipped", message, recordings, clipped, axes=sorted(touched), samples=samples)
