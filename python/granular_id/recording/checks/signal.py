"""What the samples show: units, clipping, axes that never change, outliers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import pdtrc, stdtrit

from granular_id._checks import FloatArray
from granular_id._text import counted, short, verb
from granular_id.recording.checks.measured import FALSE_ALARM_RATE, Measured, by_axis
from granular_id.recording.checks.report import Finding
from granular_id.recording.recording import Recording, places_of, unit_of
from granular_id.recording.report import subject

# Largest readings per unit: a rod through gravel takes tens of newtons, wrist sensors end at some hundred.
PLAUSIBLE = {"N": 1000.0, "N m": 100.0}
# Shorter recordings are not judged by their own extremes: what is usual is unknown.
SHORTEST = 30
# Axes that repeat the reading before in more than this part of the samples are too coarse to judge.
COARSE = 0.3


def check_units(data: Measured) -> Iterator[Finding]:
    """Find recordings whose largest readings, of axes in N and N m, are too large for that; others are not judged."""
    beyond: dict[int, tuple[float, str, str]] = {}
    for i, r in enumerate(data.recordings):
        for peak, axis in zip(np.abs(r.wrench).max(axis=0).tolist(), r.axes, strict=True):
            unit = unit_of(axis, r.meta)
            if peak > PLAUSIBLE.get(unit, np.inf):
                beyond[i] = max(beyond.get(i, (0.0, "", "")), (peak, axis, unit))
    if beyond:
        peak, axis, unit = max(beyond.values())
        message = (
            f"{counted(len(beyond))} with readings up to {peak:.3g} {unit} ({axis}), above {PLAUSIBLE[unit]:g}: are "
            f"they in m{unit.replace(' ', '')}, N mm or counts?"
        )
        yield data.finding("warning", "units", message, beyond)


# Samples at the end of the sensor's range, as far as it shows in the samples.

FEWEST = 5  # readings at the extreme from which on it is looked at
# Times as many readings as at any value nearby: the flat top of a smooth signal has up to 2.4 times.
PILED_UP = 3.0
_NEIGHBOURS = 10


def check_clipping(data: Measured) -> Iterator[Finding]:
    """Find axes whose readings pile up at their own extreme."""
    alpha = FALSE_ALARM_RATE / (2 * sum(len(r.axes) for r in data.recordings))
    piled = {i: _piled_up_axes(by_axis(r), alpha) for i, r in enumerate(data.recordings)}
    clipped = {i: columns for i, (columns, _) in piled.items() if columns}
    if clipped:
        axes, samples = data.axes_among(clipped), sum(number for _, number in piled.values())
        message = (
            f"{subject(len(clipped), 'seems', 'seem')} clipped on {', '.join(axes)}: "
            f"{counted(samples, 'reading')} piled up at the extreme; the true load was higher"
        )
        yield data.finding("warning", "clipped", message, clipped, axes=axes, samples=samples)


def _piled_up_axes(wrench: FloatArray, alpha: float) -> tuple[list[int], int]:
    """Return the columns with more readings at an extreme than chance explains, and how many these are."""
    piled = {
        (int(column), float(edge[column])): number
        for edge in (wrench.max(axis=0), wrench.min(axis=0))
        for column in np.flatnonzero(np.count_nonzero(wrench == edge, axis=0) >= FEWEST)
        if (number := _piled_up(wrench[:, column], edge[column], alpha))
    }
    return sorted({column for column, _ in piled}), sum(piled.values())


def _piled_up(samples: FloatArray, edge: float, alpha: float) -> int:
    """Return how many samples lie at the edge, 0 where chance explains them: readings thin out there (Poisson)."""
    at_edge = samples == edge
    inside = np.flatnonzero(~at_edge)
    if len(samples) < SHORTEST or not len(inside):
        return 0
    # a recording may begin or end at rest, at its extreme
    number = int(np.count_nonzero(at_edge[inside[0] : inside[-1]]))
    away = samples[~at_edge]
    if number < FEWEST or np.mean(away[1:] == away[:-1]) > COARSE:
        return 0
    values, counts = np.unique(away, return_counts=True)
    nearest = counts[np.argsort(np.abs(values - edge), kind="stable")[:_NEIGHBOURS]]
    expected = float(nearest.max())
    return number if number >= PILED_UP * expected and pdtrc(number - 1, expected) <= alpha else 0


def check_stuck(data: Measured) -> Iterator[Finding]:
    """Find axes that never change."""
    stuck = {
        i: columns.tolist()
        for i, r in enumerate(data.recordings)
        if r.n_samples > 1 and len(columns := np.flatnonzero(np.ptp(r.wrench, axis=0) == 0))
    }
    if stuck:
        axes = data.axes_among(stuck)
        where = "every recording" if len(stuck) == len(data.recordings) else counted(len(stuck))
        message = f"{where} with an axis that never changes ({', '.join(axes)})"
        yield data.finding("warning", "stuck-axis", message, stuck, axes=axes)


# Recordings that stand apart from their own label.

# Labels with fewer recordings are not judged.
FEWEST_TO_COMPARE = 8
_MAD_TO_SD = 1.4826  # of the normal distribution
_EFFICIENCY = 0.37  # of the median deviation: as certain as a standard deviation from 37 % of the values
_FLOOR = 0.01  # least spread of a figure, relative: a label cannot be known better than this
_TINY = 1e-12
_QUANTITIES = {"N": "force", "N m": "torque"}


def check_outliers(data: Measured) -> Iterator[Finding]:
    """Find recordings that stand apart from their label; the rate holds for the whole set (Bonferroni)."""
    groups = [group for group in data.labels.values() if len(group) >= FEWEST_TO_COMPARE]
    described = [_figures(r) for r in data.recordings]
    names = list(described[0])
    if not groups or any(list(d) != names for d in described):
        return
    table = np.array([list(d.values()) for d in described])
    alpha = FALSE_ALARM_RATE / (sum(map(len, groups)) * len(names))
    apart: dict[int, tuple[float, str]] = {}
    for group in groups:
        middle = np.median(table[group], axis=0)
        spread = _MAD_TO_SD * np.median(np.abs(table[group] - middle), axis=0)
        far = np.abs((table[group] - middle) / np.maximum(spread, _FLOOR))
        for row in np.flatnonzero((far > _largest_distance(len(group), alpha)).any(axis=1)):
            column = int(far[row].argmax())
            factor = float(np.exp(table[group[row], column] - middle[column]))
            apart[group[row]] = (float(far[row, column]), f"{names[column]} {factor:.3g} times")
    if apart:
        order = sorted(apart, key=lambda i: -apart[i][0])
        worst = data.recordings[order[0]]
        message = (
            f"{subject(len(apart), 'stands', 'stand')} apart from "
            f"{verb(len(apart), 'its', 'their')} label: "
            f"{worst.name!r} has a {apart[order[0]][1]} what is usual for {worst.label!r}"
        )
        distance = {data.recordings[i].name: round(apart[i][0], 1) for i in order}
        yield data.finding("warning", "outlier", message, order, robust_sd=distance)


def _figures(recording: Recording) -> dict[str, float]:
    """Return logarithms of mean, spread and roughness of the axes of each unit: such figures vary by factors."""
    described = {}
    wrench = by_axis(recording)
    steps = np.diff(wrench, axis=0) ** 2
    power = wrench**2
    variance = wrench.var(axis=0)
    units = places_of(
        unit_of(axis, recording.meta) for axis in recording.axes
    )  # those not known are as of one
    for unit, columns in units.items():
        name = _QUANTITIES.get(unit) or short(" ".join(recording.axes[column] for column in columns))
        described[f"mean {name}"] = float(np.sqrt(power[:, columns].sum(axis=1)).mean())
        described[f"spread of {name}"] = float(np.sqrt(variance[columns].sum()))
        changes = np.sort(np.sqrt(steps[:, columns].sum(axis=1)))
        usual = changes[: len(changes) - len(changes) // 100]  # without single spikes
        described[f"roughness of {name}"] = float(usual.mean()) if len(usual) else 0.0
    return {name: float(np.log(value + _TINY)) for name, value in described.items()}


def _largest_distance(n: int, alpha: float) -> float:
    """Return the robust distance that one of `n` normal values exceeds with probability `alpha`.

    A distance in median absolute deviations is taken as a Student t whose degrees of freedom the efficiency reduces
    (P. J. Rousseeuw and C. Croux, "Alternatives to the median absolute deviation", JASA 88, 1993), widened by the
    uncertainty of the median itself.
    """
    return float(-stdtrit(_EFFICIENCY * (n - 1), alpha / 2) * np.sqrt(1 + np.pi / (2 * n)))
