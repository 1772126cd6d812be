"""Samples at the end of the sensor's range, whether the range is known or shows in the samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from granular_id.recording._values import FloatArray
from granular_id.recording.checking.finding import Finding, count, found, verb
from granular_id.recording.checking.runs import longest_run, surprising_run
from granular_id.recording.one import Recording

NEAR_RANGE = 0.999
"""From this part of the range on a reading counts as clipped: converters stop a few counts early."""

FAR_BEYOND = 2.0
"""Readings above this many ranges are no overload but another unit or another sensor."""

SHORTEST = 30
"""Shorter recordings are not judged without a range: what is usual for them cannot be told."""


def check_clipping(
    recordings: Sequence[Recording], ranges: Mapping[str, float] | None, false_alarm_rate: float
) -> Iterator[Finding]:
    """Find samples at the sensor's range; without one, axes that stay at their own extreme.

    Without a range an axis counts as clipped when its highest (or lowest) value comes in a run, away from both
    ends of the recording, that is longer than repeated values explain: see :func:`surprising_run`.
    """
    if ranges is not None:
        yield from _beyond_range(recordings, ranges)
        return
    n_tests = 2 * sum(len(r.axes) for r in recordings)
    places: dict[int, list[str]] = {}
    samples = 0
    for i, r in enumerate(recordings):
        for axis, run in plateaus(r.wrench, r.axes, false_alarm_rate / n_tests):
            places.setdefault(i, []).append(axis)
            samples += run
    if places:
        axes = sorted({axis for names in places.values() for axis in names})
        message = (
            f"{count(len(places))} {verb(len(places), 'seems', 'seem')} clipped on {', '.join(axes)}: the extreme "
            f"value stands still for {count(samples, 'sample')} in all; state sensor_range to be sure"
        )
        yield found("warning", "clipped", message, recordings, places, axes=axes, samples=samples)


def plateaus(wrench: FloatArray, axes: Sequence[str], alpha: float) -> Iterator[tuple[str, int]]:
    """Yield axis and length of runs at the highest or lowest value that chance does not explain."""
    if len(wrench) < SHORTEST:
        return
    equal = wrench[1:] == wrench[:-1]
    repeated = equal.mean(axis=0)
    for edge in (wrench.max(axis=0), wrench.min(axis=0)):
        held = (wrench[1:] == edge) & equal
        for column in np.flatnonzero(held.sum(axis=0) >= 2):
            start, length = longest_run(held[:, column])
            inside = start > 0 and start + length < len(held)
            rest = (repeated[column] * len(equal) - length) / len(equal)
            if inside and length + 1 >= surprising_run(rest, len(wrench), alpha):
                yield axes[int(column)], length + 1


def _beyond_range(recordings: Sequence[Recording], ranges: Mapping[str, float]) -> Iterator[Finding]:
    clipped: dict[int, int] = {}
    touched: set[str] = set()
    far: list[int] = []
    for i, r in enumerate(recordings):
        limit = np.array([ranges.get(axis, np.inf) for axis in r.axes])
        peak = np.abs(r.wrench).max(axis=0)
        if (peak > FAR_BEYOND * limit).any():
            far.append(i)
        elif (peak >= NEAR_RANGE * limit).any():
            clipped[i] = int((np.abs(r.wrench) >= NEAR_RANGE * limit).any(axis=1).sum())
            touched |= {axis for axis, hit in zip(r.axes, peak >= NEAR_RANGE * limit, strict=True) if hit}
    if far:
        message = f"{count(len(far))} with readings above twice the range: are they in N and N m?"
        yield found("error", "beyond-range", message, recordings, far)
    if clipped:
        samples = sum(clipped.values())
        message = (
            f"{count(len(clipped))} {verb(len(clipped), 'reaches', 'reach')} the sensor's range on "
            f"{', '.join(sorted(touched))}, in {count(samples, 'sample')}: the true load was higher"
        )
        yield found("warning", "clipped", message, recordings, clipped, axes=sorted(touched), samples=samples)
