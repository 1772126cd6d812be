"""Recordings that stand apart from their own label."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import stdtrit

from granular_id._words import counted, verb
from granular_id.recording._values import FloatArray
from granular_id.recording.axes import unit_of
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.labels import by_label
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.checking.rest import unit_columns
from granular_id.recording.one import Recording

FEWEST = 8
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
