"""Drift of the rest level: slowly over the clock, or by a step from session to session."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, stdtr

from granular_id._words import counted, fixed
from granular_id.recording._values import FloatArray
from granular_id.recording.axes import unit_of
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.checking.rest import Rest, unit_columns
from granular_id.recording.one import Recording

MOST = 0.8
"""Drift is judged where at least this part of the recordings begins at rest."""

FEWEST = 8
"""Sessions with fewer recordings at rest are not judged."""

LARGE = 0.2
"""A drift of this part of the signal (the median of the recordings' standard deviations) warns."""

SMALL = 0.05
"""Below this part it is not worth a word, however certain it is."""


@dataclass(frozen=True)
class _Change:
    size: float  # in the unit of the axis
    share: float  # of the signal
    noise: float  # times the noise of one sample
    axis: str
    where: str
    indices: list[int]


def check_drift(
    recordings: Sequence[Recording], rests: Sequence[Rest | None], false_alarm_rate: float
) -> Iterator[Finding]:
    """Compare the rest levels of recordings with the clock and between sessions, against noise and signal."""
    resting = [i for i, rest in enumerate(rests) if rest is not None]
    if len({r.axes for r in recordings}) > 1 or len(resting) < MOST * len(recordings):
        return
    levels = np.array([rest.level for rest in rests if rest is not None])
    noise = np.median([rest.noise for rest in rests if rest is not None], axis=0)
    signal = np.median([by_axis(recordings[i]).std(axis=0) for i in resting], axis=0)
    axes = recordings[0].axes
    scale = np.empty(len(axes))
    for unit in unit_columns(axes):
        scale[unit] = np.linalg.norm(signal[unit])
    sessions: dict[str | None, list[int]] = {}
    for row, i in enumerate(resting):
        sessions.setdefault(recordings[i].session, []).append(row)
    judged = {name: rows for name, rows in sessions.items() if len(rows) >= FEWEST}
    n_tests = (len(judged) + 1) * len(axes)  # a slope in each session, and one comparison of all
    alpha = false_alarm_rate / n_tests
    slow = [
        _Change(size, abs(size) / scale[c], abs(size) / max(noise[c], 1e-300), axes[c], _name(session), rows)
        for session, rows in judged.items()
        for c, size in _trends(_starts(recordings, resting, rows), levels[rows], alpha)
    ]
    if slow:
        yield from _report(recordings, resting, "rest-drift", "drifts by", max(slow, key=lambda d: d.share))
    named = {name: rows for name, rows in judged.items() if name is not None}
    differing = _differing(levels, list(named.values()), alpha)
    if len(differing):
        medians = {name: np.median(levels[rows], axis=0) for name, rows in named.items()}
        middle = np.median(list(medians.values()), axis=0)
        off = [
            _Change(
                float(level[c] - middle[c]),
                float(abs(level[c] - middle[c]) / scale[c]),
                float(abs(level[c] - middle[c]) / max(noise[c], 1e-300)),
                axes[c],
                _name(name),
                named[name],
            )
            for name, level in medians.items()
            for c in differing
        ]
        yield from _report(recordings, resting, "rest-shift", "is off by", max(off, key=lambda d: d.share))


def _name(session: str | None) -> str:
    return "over the set" if session is None else f"in {session!r}"


def _starts(recordings: Sequence[Recording], resting: Sequence[int], rows: Sequence[int]) -> FloatArray:
    starts = [recordings[resting[row]].start_time for row in rows]
    return np.array([math.nan if start is None else start for start in starts])


def _trends(starts: FloatArray, levels: FloatArray, alpha: float) -> Iterator[tuple[int, float]]:
    """Yield column and change over the stretch of each line whose slope differs from zero at level `alpha`."""
    span = float(np.ptp(starts))
    if not span > 0:  # also where a start is not known
        return
    time = (starts - starts.mean()) / span
    free = len(time) - 2
    slopes = time @ (levels - levels.mean(axis=0)) / (time @ time)
    left = levels - levels.mean(axis=0) - time[:, np.newaxis] * slopes
    errors = np.sqrt((left**2).sum(axis=0) / free / (time @ time))
    for column, (slope, error) in enumerate(zip(slopes, errors, strict=True)):
        if error > 0 and 2 * stdtr(free, -abs(slope) / error) < alpha:
            yield column, float(slope)


def _differing(levels: FloatArray, groups: Sequence[Sequence[int]], alpha: float) -> NDArray[np.intp]:
    """Return the columns whose means differ between groups of rows, by analysis of variance at level `alpha`."""
    if len(groups) < 2:
        return np.empty(0, np.intp)
    sizes = np.array([len(rows) for rows in groups])
    means = np.array([levels[rows].mean(axis=0) for rows in groups])
    between = sizes @ (means - sizes @ means / sizes.sum()) ** 2
    within = sum(((levels[rows] - mean) ** 2).sum(axis=0) for rows, mean in zip(groups, means, strict=True))
    free, left = len(groups) - 1, int(sizes.sum()) - len(groups)
    ratio = np.full(len(between), np.inf)
    np.divide(between / free, within / left, out=ratio, where=within > 0)
    return np.flatnonzero((fdtrc(free, left, ratio) < alpha) & (between > 0))


def _report(
    recordings: Sequence[Recording], resting: Sequence[int], code: str, words: str, change: _Change
) -> Iterator[Finding]:
    if change.share < SMALL:
        return
    unit = unit_of(change.axis, recordings[0].meta)
    large = change.share >= LARGE
    message = (
        f"the rest level of {change.axis} {words} {abs(change.size):.2g} {unit} {change.where} "
        f"({counted(len(change.indices))}): {100 * change.share:.0f} % of the signal, "
        f"{fixed(change.noise, 0)} times the noise; subtract it"
    )
    concerned = [resting[row] for row in change.indices] if large else []
    values = {"axis": change.axis, "change": change.size, "of_signal": change.share, "of_noise": change.noise}
    yield found("warning" if large else "info", code, message, recordings, concerned, **values)
