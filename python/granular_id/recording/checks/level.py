"""The rest level: what the sensor read before the motion began."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, stdtr, stdtrit

from granular_id._checks import FloatArray
from granular_id._text import counted, fixed, verb
from granular_id.recording.checks.report import Finding, by_label, found
from granular_id.recording.checks.signal import by_axis
from granular_id.recording.onset import REST_S
from granular_id.recording.recording import Recording, unit_of

FEWEST_SAMPLES = 5
"""Fewer samples within it give no level."""

QUIET = 0.2
"""A recording rests while its samples spread by less than this part of what they do over the whole of it."""


@dataclass(frozen=True)
class Rest:
    """Rest of one recording.

    Attributes
    ----------
    level : ndarray, shape (C,)
        Mean of the samples at rest.
    noise : ndarray, shape (C,)
        Their standard deviation.
    """

    level: FloatArray
    noise: FloatArray


def rest_of(recording: Recording) -> Rest | None:
    """Measure the rest before the motion; None where the recording begins in motion or too late.

    Rest is looked for in the first `REST_S` seconds, or up to the trigger where that comes earlier.
    The spreads of axes of one unit are compared together: weak axes are all noise.
    """
    until = REST_S
    times = recording.times()
    if recording.trigger_index is not None:
        until = min(until, float(times[recording.trigger_index]))
    n_rest = int(np.searchsorted(times, until))
    if n_rest < FEWEST_SAMPLES or n_rest > recording.n_samples // 2:
        return None
    wrench = by_axis(recording)
    quiet = wrench[:n_rest]
    noise, whole = quiet.std(axis=0), wrench.std(axis=0)
    for unit in unit_columns(recording.axes):
        if np.linalg.norm(noise[unit]) > QUIET * np.linalg.norm(whole[unit]):
            return None
    return Rest(quiet.mean(axis=0), noise)


def unit_columns(axes: Sequence[str]) -> list[list[int]]:
    """Return the columns that share a unit: torques (tx, ty, tz) apart from the rest."""
    torques = [i for i, axis in enumerate(axes) if unit_of(axis) == "N m"]
    forces = [i for i in range(len(axes)) if i not in torques]
    return [columns for columns in (forces, torques) if columns]


# Drift of the rest level: slowly over the clock, or by a step from session to session.

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


# Recordings that stand apart from their own label.

"""Labels with fewer recordings are not judged: their median deviation says little."""

_MAD_TO_SD = 1.4826  # of the normal distribution
_EFFICIENCY = (
    0.37  # of the median deviation: it is as certain as a standard deviation from 37 % of the values
)
_FLOOR = 0.01  # least spread of a figure, relative: a label cannot be known better than this
_TINY = 1e-12


def figures(recording: Recording) -> dict[str, float]:
    """Describe a recording by a few numbers that mean something.

    Returns
    -------
    dict
        Natural logarithms, because such figures vary by factors, for forces and, where there are some, torques:
        ``mean`` (of the norm, over time), ``spread`` (norm of the axes' standard deviations) and ``roughness``
        (mean norm of the change from sample to sample, the largest 1 % left out: spikes are another check's).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording import Recording
    >>> sorted(figures(Recording(np.ones((9, 1)), rate_hz=500, axes=("force",))))
    ['mean force', 'roughness of force', 'spread of force']
    """
    described = {}
    wrench = by_axis(recording)
    steps = np.diff(wrench, axis=0) ** 2
    power = wrench**2
    variance = wrench.var(axis=0)
    for columns in unit_columns(recording.axes):
        name = "torque" if unit_of(recording.axes[columns[0]]) == "N m" else "force"
        described[f"mean {name}"] = float(np.sqrt(_row_sum(power, columns)).mean())
        described[f"spread of {name}"] = float(np.sqrt(variance[columns].sum()))
        changes = np.sort(np.sqrt(_row_sum(steps, columns)))
        usual = changes[: len(changes) - len(changes) // 100]
        described[f"roughness of {name}"] = float(usual.mean()) if len(usual) else 0.0
    return {name: float(np.log(value + _TINY)) for name, value in described.items()}


def _row_sum(samples: FloatArray, columns: Sequence[int]) -> FloatArray:
    total = np.zeros(len(samples))
    for column in columns:
        total += samples[:, column]
    return total


def threshold(n: int, alpha: float) -> float:
    """Return the robust distance that one of `n` normal values exceeds with probability `alpha`.

    The distance of a value from the median, in median absolute deviations scaled to standard deviations, is
    taken as a Student t with ``0.37 (n - 1)`` degrees of freedom, 0.37 being the efficiency of the median
    absolute deviation (P. J. Rousseeuw and C. Croux, "Alternatives to the median absolute deviation", JASA 88,
    1993), widened by the uncertainty of the median itself.

    Examples
    --------
    >>> round(threshold(62, 0.01 / 62), 1), round(threshold(8, 0.01 / 8), 1)
    (4.6, 17.0)
    """
    return float(-stdtrit(_EFFICIENCY * (n - 1), alpha / 2) * np.sqrt(1 + np.pi / (2 * n)))


def distances(values: FloatArray) -> FloatArray:
    """Return the distance of each row from the column's median in robust standard deviations, shape as given."""
    middle = np.median(values, axis=0)
    spread = _MAD_TO_SD * np.median(np.abs(values - middle), axis=0)
    return np.asarray((values - middle) / np.maximum(spread, _FLOOR))


def check_outliers(recordings: Sequence[Recording], false_alarm_rate: float) -> Iterator[Finding]:
    """Compare each recording with its label, keeping the chance of any false alarm in the set.

    The rate is divided by the number of recordings times figures judged (Bonferroni), so it holds whatever the
    figures have to do with each other.
    """
    described = [figures(r) for r in recordings]
    names = list(described[0])
    groups = {label: group for label, group in by_label(recordings).items() if len(group) >= FEWEST}
    if not groups or any(list(d) != names for d in described):
        return
    table = np.array([list(d.values()) for d in described])
    alpha = false_alarm_rate / (sum(map(len, groups.values())) * len(names))
    apart: dict[int, tuple[float, str]] = {}
    for group in groups.values():
        far = distances(table[group])
        limit = threshold(len(group), alpha)
        for row in np.flatnonzero((np.abs(far) > limit).any(axis=1)):
            column = int(np.abs(far[row]).argmax())
            factor = float(np.exp(table[group[row], column] - np.median(table[group, column])))
            apart[group[row]] = (float(np.abs(far[row, column])), f"{names[column]} {_times(factor)}")
    if apart:
        worst = max(apart, key=lambda i: apart[i][0])
        message = (
            f"{counted(len(apart))} {verb(len(apart), 'stands', 'stand')} apart from "
            f"{verb(len(apart), 'its', 'their')} label: "
            f"{recordings[worst].name!r} has a {apart[worst][1]} what is usual for {recordings[worst].label!r}"
        )
        order = sorted(apart, key=lambda i: -apart[i][0])
        distance = {recordings[i].name: round(apart[i][0], 1) for i in order}
        yield found("warning", "outlier", message, recordings, order, robust_sd=distance)


def _times(factor: float) -> str:
    if factor >= 1.1 or factor <= 1 / 1.1:
        return f"{factor:.2g} times"
    return f"{abs(factor - 1):.1%} {'above' if factor > 1 else 'below'}"
