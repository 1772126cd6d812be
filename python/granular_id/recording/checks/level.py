"""Recordings compared with each other: drift of the level at rest, and outliers of a label."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, stdtr, stdtrit

from granular_id._checks import FloatArray
from granular_id._text import counted, fixed, verb
from granular_id.recording.checks.measured import Measured, by_axis, unit_columns
from granular_id.recording.checks.report import Finding, Severity
from granular_id.recording.recording import Recording, unit_of

FEWEST = 8
"""Sessions with fewer recordings at rest, and labels with fewer recordings, are not judged."""

# Drift of the rest level: slowly over the clock, or by a step from session to session.

MOST = 0.8
"""Drift is judged where at least this part of the recordings begins at rest."""

LARGE = 0.2
"""A drift of this part of the signal (the median of the recordings' standard deviations) warns."""

SMALL = 0.05
"""Below this part it is not worth a word, however certain it is."""

_Change = tuple[float, int, str | None]
"""By how much the level of an axis is off, in its unit; the column of the axis; the session."""


def check_drift(data: Measured) -> Iterator[Finding]:
    """Compare the rest levels of recordings with the clock and between sessions, against noise and signal."""
    recordings = data.recordings
    resting = [i for i, rest in enumerate(data.rests) if rest is not None]
    if len({r.axes for r in recordings}) > 1 or len(resting) < MOST * len(recordings):
        return
    axes = recordings[0].axes
    levels = np.array([rest.level for rest in data.rests if rest is not None])
    noise = np.median([rest.noise for rest in data.rests if rest is not None], axis=0)
    signal = np.median([by_axis(recordings[i]).std(axis=0) for i in resting], axis=0)
    scale = np.empty(len(axes))
    for unit in unit_columns(axes):
        scale[unit] = np.linalg.norm(signal[unit])
    sessions: dict[str | None, list[int]] = {}
    for row, i in enumerate(resting):
        sessions.setdefault(recordings[i].session, []).append(row)
    sessions = {name: rows for name, rows in sessions.items() if len(rows) >= FEWEST}
    alpha = data.false_alarm_rate / (
        (len(sessions) + 1) * len(axes)
    )  # a slope each, and one comparison of all

    def largest(code: str, words: str, changes: Sequence[_Change]) -> Iterator[Finding]:
        if not changes:
            return
        size, column, session = max(changes, key=lambda change: abs(change[0]) / scale[change[1]])
        share, of_noise = abs(size) / scale[column], abs(size) / max(noise[column], 1e-300)
        if share < SMALL:
            return
        rows = sessions[session]
        axis = axes[column]
        where = "over the set" if session is None else f"in {session!r}"
        message = (
            f"the rest level of {axis} {words} {abs(size):.2g} {unit_of(axis, recordings[0].meta)} {where} "
            f"({counted(len(rows))}): {100 * share:.0f} % of the signal, "
            f"{fixed(of_noise, 0)} times the noise; subtract it"
        )
        severity: Severity = "warning" if share >= LARGE else "info"
        concerned = [resting[row] for row in rows] if share >= LARGE else []
        values = {"axis": axis, "change": size, "of_signal": share, "of_noise": of_noise}
        yield data.finding(severity, code, message, concerned, **values)

    starts = np.array([np.nan if (s := recordings[i].start_time) is None else s for i in resting])
    slopes = [
        (size, column, session)
        for session, rows in sessions.items()
        for column, size in _trends(starts[rows], levels[rows], alpha)
    ]
    yield from largest("rest-drift", "drifts by", slopes)
    named = {name: rows for name, rows in sessions.items() if name is not None}
    differing = _differing(levels, list(named.values()), alpha)
    if len(differing):
        medians = np.array([np.median(levels[rows], axis=0) for rows in named.values()])
        off = medians - np.median(medians, axis=0)
        shifts = [
            (float(change[column]), column, name)
            for name, change in zip(named, off, strict=True)
            for column in differing
        ]
        yield from largest("rest-shift", "is off by", shifts)


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


# Recordings that stand apart from their own label.

_MAD_TO_SD = 1.4826  # of the normal distribution
_EFFICIENCY = 0.37  # of the median deviation: as certain as a standard deviation from 37 % of the values
_FLOOR = 0.01  # least spread of a figure, relative: a label cannot be known better than this
_TINY = 1e-12


def check_outliers(data: Measured) -> Iterator[Finding]:
    """Compare each recording with its label, keeping the chance of any false alarm in the set.

    The rate is divided by the number of recordings times figures judged (Bonferroni), so it holds whatever the
    figures have to do with each other.
    """
    groups = [group for group in data.labels.values() if len(group) >= FEWEST]
    described = [_figures(r) for r in data.recordings]
    names = list(described[0])
    if not groups or any(list(d) != names for d in described):
        return
    table = np.array([list(d.values()) for d in described])
    alpha = data.false_alarm_rate / (sum(map(len, groups)) * len(names))
    apart: dict[int, tuple[float, str]] = {}
    for group in groups:
        middle = np.median(table[group], axis=0)
        spread = _MAD_TO_SD * np.median(np.abs(table[group] - middle), axis=0)
        far = np.abs((table[group] - middle) / np.maximum(spread, _FLOOR))
        for row in np.flatnonzero((far > _largest_distance(len(group), alpha)).any(axis=1)):
            column = int(far[row].argmax())
            factor = float(np.exp(table[group[row], column] - middle[column]))
            apart[group[row]] = (float(far[row, column]), f"{names[column]} {_times(factor)}")
    if apart:
        order = sorted(apart, key=lambda i: -apart[i][0])
        worst = data.recordings[order[0]]
        message = (
            f"{counted(len(apart))} {verb(len(apart), 'stands', 'stand')} apart from "
            f"{verb(len(apart), 'its', 'their')} label: "
            f"{worst.name!r} has a {apart[order[0]][1]} what is usual for {worst.label!r}"
        )
        distance = {data.recordings[i].name: round(apart[i][0], 1) for i in order}
        yield data.finding("warning", "outlier", message, order, robust_sd=distance)


def _figures(recording: Recording) -> dict[str, float]:
    """Describe forces and torques by logarithms, as such figures vary by factors.

    Mean of the norm, norm of the standard deviations of the axes, and mean norm of the change from sample to sample,
    the largest 1 % left out: spikes are another check's.
    """
    described = {}
    wrench = by_axis(recording)
    steps = np.diff(wrench, axis=0) ** 2
    power = wrench**2
    variance = wrench.var(axis=0)
    for columns in unit_columns(recording.axes):
        name = "torque" if unit_of(recording.axes[columns[0]]) == "N m" else "force"
        described[f"mean {name}"] = float(np.sqrt(power[:, columns].sum(axis=1)).mean())
        described[f"spread of {name}"] = float(np.sqrt(variance[columns].sum()))
        changes = np.sort(np.sqrt(steps[:, columns].sum(axis=1)))
        usual = changes[: len(changes) - len(changes) // 100]
        described[f"roughness of {name}"] = float(usual.mean()) if len(usual) else 0.0
    return {name: float(np.log(value + _TINY)) for name, value in described.items()}


def _largest_distance(n: int, alpha: float) -> float:
    """Return the robust distance that one of `n` normal values exceeds with probability `alpha`.

    The distance of a value from the median, in median absolute deviations scaled to standard deviations, is
    taken as a Student t with ``0.37 (n - 1)`` degrees of freedom, 0.37 being the efficiency of the median
    absolute deviation (P. J. Rousseeuw and C. Croux, "Alternatives to the median absolute deviation", JASA 88,
    1993), widened by the uncertainty of the median itself.
    """
    return float(-stdtrit(_EFFICIENCY * (n - 1), alpha / 2) * np.sqrt(1 + np.pi / (2 * n)))


def _times(factor: float) -> str:
    if factor >= 1.1 or factor <= 1 / 1.1:
        return f"{factor:.2g} times"
    return f"{abs(factor - 1):.1%} {'above' if factor > 1 else 'below'}"
