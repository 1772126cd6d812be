"""Samples at the end of the sensor's range, whether the range is known or shows in the samples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from granular_id._checks import FloatArray, checked_number
from granular_id._core import AXES
from granular_id._text import counted, verb
from granular_id.recording.checks.report import Finding, Severity, found
from granular_id.recording.recording import Recording, SampleFlag, unit_of

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


# How far the axes of a sensor reach: stated by the caller, or looked up by name.

SensorRange = str | float | Sequence[float] | Mapping[str, float]

# Calibrated ranges of ATI Industrial Automation's sensors: Fx and Fy, Fz (N), Tx, Ty and Tz (N m). They are the
# nominal ones of each SI calibration; the certificate of a sensor comes first.
_ATI = {
    "Nano17 SI-12-0.12": (12, 17, 0.12),
    "Nano17 SI-25-0.25": (25, 35, 0.25),
    "Nano17 SI-50-0.5": (50, 70, 0.5),
    "Mini40 SI-20-1": (20, 60, 1),
    "Mini40 SI-40-2": (40, 120, 2),
    "Mini40 SI-80-4": (80, 240, 4),
    "Mini45 SI-145-5": (145, 290, 5),
    "Mini45 SI-290-10": (290, 580, 10),
    "Mini45 SI-580-20": (580, 1160, 20),
    "Gamma SI-32-2.5": (32, 100, 2.5),
    "Gamma SI-65-5": (65, 200, 5),
    "Gamma SI-130-10": (130, 400, 10),
    "Delta SI-165-15": (165, 495, 15),
    "Delta SI-330-30": (330, 990, 30),
    "Delta SI-660-60": (660, 1980, 60),
    "Axia80-M20 SI-200-8": (200, 360, 8),
    "Axia80-M20 SI-500-20": (500, 900, 20),
}

SENSOR_RANGES: dict[str, dict[str, float]] = {
    f"ATI {name}": dict(zip(AXES, (side, side, axial, *[torque] * 3), strict=True))
    for name, (side, axial, torque) in _ATI.items()
}
"""Largest readings of well-known sensors, axis by axis, N and N m; they hold for both signs."""


def resolve_range(value: SensorRange, axes: Sequence[str]) -> dict[str, float]:
    """Return the largest reading of each axis.

    Parameters
    ----------
    value : str, float, sequence of float or mapping
        Name of a sensor of `SENSOR_RANGES` (case does not matter, "ATI" or the model may be left out), one
        number for all axes, one for each, or numbers by the name of the axis.
    axes : sequence of str
        The axes of the recordings.

    Raises
    ------
    TypeError, ValueError
        Naming what came and what is wanted: an unknown sensor (with those that are known), as many numbers
        as axes, axes that do not occur, numbers that are not positive.

    Examples
    --------
    >>> resolve_range("SI-290-10", ["fx", "fz", "tx"])
    {'fx': 290.0, 'fz': 580.0, 'tx': 10.0}
    """
    if isinstance(value, str):
        ranges: Mapping[str, float] = _named(value)
        foreign = [axis for axis in axes if axis not in ranges]
        if foreign:
            raise ValueError(f"sensor_range={value!r} has no axis {foreign[0]!r}; give numbers instead")
        return {axis: float(ranges[axis]) for axis in axes}
    numbers: dict[str, float]
    if isinstance(value, Mapping):
        foreign = [str(axis) for axis in value if axis not in axes]
        if foreign:
            raise ValueError(f"sensor_range names the axis {foreign[0]!r}; there are {', '.join(axes)}")
        numbers = dict(value)
    elif isinstance(value, (list, tuple, np.ndarray)):
        if len(value) != len(axes):
            raise ValueError(f"sensor_range has {len(value)} numbers; wanted {len(axes)}: {', '.join(axes)}")
        numbers = dict(zip(axes, value, strict=True))
    else:
        numbers = dict.fromkeys(axes, checked_number(value, "sensor_range"))
    checked = {axis: checked_number(number, "sensor_range") for axis, number in numbers.items()}
    wrong = next((f"{axis}: {number:g}" for axis, number in checked.items() if number <= 0), None)
    if wrong is not None:
        raise ValueError(f"sensor_range must be positive, got {wrong}")
    return checked


def _named(name: str) -> Mapping[str, float]:
    wanted = name.lower().split()
    matches = [known for known in SENSOR_RANGES if wanted and set(wanted) <= set(known.lower().split())]
    if len(matches) == 1:
        return SENSOR_RANGES[matches[0]]
    which = "is the name of several sensors" if matches else "is no known sensor"
    choice = ", ".join(matches or SENSOR_RANGES)
    raise ValueError(f"sensor_range={name!r} {which}; choose from {choice}, or give one number per axis")


# Quantisation: the step on whose multiples all readings of an axis lie.

FEWEST_CHANGES = 30
"""An axis that changes less often is not judged: multiples of a coarser step would come by chance."""

ON_GRID = 0.95
"""Share of the changes that must be whole steps; samples that a repair averaged lie in between."""

VISIBLE = 0.01
"""Steps below this part of the usual change from sample to sample are drowned by it and count as none."""

_OFF = 0.02  # how far from a whole number of steps a change may lie
_SAME = 0.01  # relative difference below which two steps are one
_LOOKED_AT = 200  # changes tried against a step: enough to refuse it
_EPSILON = 1e-9  # of the largest reading: below it a change is rounding of float64


def steps_of(wrench: FloatArray) -> FloatArray:
    """Measure the quantisation step of each axis.

    Parameters
    ----------
    wrench : ndarray, shape (T, C)

    Returns
    -------
    ndarray, shape (C,)
        Steps in the unit of the axis; 0 where the readings lie on no grid, NaN where they change too rarely.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=(500, 2))
    >>> steps_of(np.column_stack([noise[:, 0].round(1), noise[:, 1]])).round(6).tolist()
    [0.1, 0.0]
    """
    return _steps(wrench, np.abs(np.diff(wrench, axis=0)))


def _steps(wrench: FloatArray, changes: FloatArray) -> FloatArray:
    real = changes > _EPSILON * np.abs(wrench).max(axis=0)
    smallest = np.where(real, changes, np.inf).min(axis=0, initial=np.inf)
    sample = slice(None, None, max(1, len(changes) // _LOOKED_AT))
    looked_at, counted = changes[sample], real[sample]
    steps: FloatArray = np.where(np.count_nonzero(real, axis=0) < FEWEST_CHANGES, np.nan, 0.0)
    for divisor in (1, 2, 3):  # the smallest change seen need not be a single step
        open_columns = np.flatnonzero(steps == 0)
        if not len(open_columns):
            break
        step = smallest[open_columns] / divisor
        ratio = looked_at[:, open_columns] / step
        off = (np.abs(ratio - np.rint(ratio)) >= _OFF) & counted[:, open_columns]
        on_grid = off.sum(axis=0) <= (1 - ON_GRID) * counted[:, open_columns].sum(axis=0)
        steps[open_columns[on_grid]] = step[on_grid]
    return steps


def signatures(recordings: Sequence[Recording]) -> list[tuple[float | None, ...]]:
    """Return the steps of each recording as something that can be compared: equal steps are equal numbers.

    Steps within 1 % of each other count as equal, steps too fine to matter (`VISIBLE`) as 0; None stands for
    axes that cannot be judged.
    """
    measured = []
    usual: dict[str, list[float]] = {}
    for r in recordings:
        wrench = by_axis(r)
        changes = np.abs(np.diff(wrench, axis=0))
        measured.append(_steps(wrench, changes))
        if r.n_samples > FEWEST_CHANGES:
            typical = np.median(changes[:: max(1, len(changes) // _LOOKED_AT)], axis=0)
            for axis, change in zip(r.axes, typical, strict=True):
                usual.setdefault(axis, []).append(float(change))
    finest = {axis: VISIBLE * float(np.median(changes)) for axis, changes in usual.items()}
    centre: dict[float, float] = {}
    last = 0.0
    for step in sorted({float(step) for steps in measured for step in steps if step > 0}):
        last = last if last and step <= last * (1 + _SAME) else step
        centre[step] = last

    def comparable(axis: str, step: float) -> float | None:
        if np.isnan(step):
            return None
        return centre[step] if step > finest[axis] else 0.0

    return [
        tuple(comparable(axis, float(step)) for axis, step in zip(r.axes, steps, strict=True))
        for r, steps in zip(recordings, measured, strict=True)
    ]


def check_resolution(
    recordings: Sequence[Recording], steps: Sequence[tuple[float | None, ...]]
) -> Iterator[Finding]:
    """Find recordings that were quantised in another way than most of the others."""
    differing: dict[str, set[float]] = {}
    other: set[int] = set()
    names = reduce(lambda seen, r: {**seen, **dict.fromkeys(r.axes)}, recordings, dict[str, None]())
    for axis in names:
        seen: dict[float, list[int]] = {}
        for i, r in enumerate(recordings):
            step = steps[i][r.axes.index(axis)] if axis in r.axes else None
            if step is not None:
                seen.setdefault(step, []).append(i)
        if len(seen) > 1:
            usual = max(seen, key=lambda step: len(seen[step]))
            differing[axis] = set(seen)
            other |= {i for step, group in seen.items() if step != usual for i in group}
    if differing:
        axis = next(iter(differing))
        kinds = " and ".join(_words(step) for step in sorted(differing[axis])[:3])
        message = (
            f"{counted(len(other))} {verb(len(other), 'has', 'have')} another resolution than the rest on "
            f"{', '.join(differing)} ({axis}: {kinds}): other sensor, settings or decimals"
        )
        yield found("warning", "resolution-differs", message, recordings, sorted(other), axes=list(differing))


def _words(step: float) -> str:
    return f"steps of {step:.3g}" if step else "no steps"


# Axes that do not move, for a whole recording or for a long stretch of it.

SHORTEST_STUCK = 20
"""Shorter stretches are not judged: coarse converters repeat themselves while the tool rests."""

"""Axes that repeat the reading before in more than this part of the other samples are too coarse to judge."""

MOVING = 0.5
"""The other axes move when they change, step by step, at least by this part of what is usual for them."""


def check_stuck(recordings: Sequence[Recording], false_alarm_rate: float) -> Iterator[Finding]:
    """Find axes that never change, axes that stand still while others move, and samples sent again and again."""
    whole: dict[int, set[str]] = {}
    part: dict[int, set[str]] = {}
    frozen: dict[int, int] = {}
    alpha = false_alarm_rate / sum(len(r.axes) for r in recordings)
    for i, r in enumerate(recordings):
        if r.n_samples < 2:
            continue
        wrench = by_axis(r)
        still = np.asarray(np.ptp(wrench, axis=0) == 0)
        if still.any():
            whole[i] = {axis for axis, stands in zip(r.axes, still, strict=True) if stands}
        stretches, length = _stretches(wrench, still, alpha)
        if stretches:
            part[i] = {r.axes[column] for column in stretches}
        if length:
            frozen[i] = length
    if whole:
        axes = sorted(set().union(*whole.values()))
        where = "every recording" if len(whole) == len(recordings) else counted(len(whole))
        message = f"{where} with an axis that never changes ({', '.join(axes)})"
        yield found("warning", "stuck-axis", message, recordings, whole, axes=axes)
    if part:
        axes = sorted(set().union(*part.values()))
        message = (
            f"{counted(len(part))} {verb(len(part), 'has', 'have')} an axis that stands still for a stretch while "
            f"others move ({', '.join(axes)})"
        )
        yield found("warning", "stuck-stretch", message, recordings, part, axes=axes)
    if frozen:
        worst = max(frozen, key=lambda i: frozen[i])
        message = (
            f"{counted(len(frozen))} in which all axes repeat one sample: {frozen[worst]} times in "
            f"{recordings[worst].name!r}; a reader that fell behind, or samples lost on the way"
        )
        yield found("warning", "frozen", message, recordings, frozen, longest=frozen[worst])


def _stretches(wrench: FloatArray, still: NDArray[np.bool_], alpha: float) -> tuple[list[int], int]:
    """Return the columns that stand still for a surprising stretch, and how long all of them do."""
    n_samples = len(wrench)
    moving = np.flatnonzero(~still)
    if n_samples <= SHORTEST_STUCK or not len(moving):
        return [], 0
    equal = wrench[1:] == wrench[:-1]
    repeated = np.count_nonzero(equal, axis=0) / (n_samples - 1)
    candidates = [
        c
        for c in moving
        if repeated[c] * (n_samples - 1) >= SHORTEST_STUCK and longest_run(equal[:, c])[1] >= SHORTEST_STUCK
    ]
    if not candidates:
        return [], 0
    start, length = longest_run(equal[:, moving].all(axis=1))
    all_still = length + 1 if _judged(length, float(repeated[moving].min()), n_samples, alpha) else 0
    steps = np.abs(np.diff(wrench, axis=0))
    usual = steps.mean(axis=0)
    stuck = []
    for column in candidates:
        at, run = longest_run(equal[:, column])
        if at == 0 or (at == start and run <= length):  # still at rest, or the sample as a whole was repeated
            continue
        if wrench[at, column] in (wrench[:, column].max(), wrench[:, column].min()):  # clipped, if anything
            continue
        others = [c for c in moving if c != column]
        if not others or not _judged(run, float(repeated[column]), n_samples, alpha):
            continue
        if (steps[at : at + run, others].mean(axis=0) >= MOVING * usual[others]).mean() >= 0.5:
            stuck.append(int(column))
    return stuck, all_still


def _judged(run: int, repeated: float, n_samples: int, alpha: float) -> bool:
    elsewhere = max(repeated - run / (n_samples - 1), 0.0)
    if elsewhere > COARSE:
        return False
    return run + 1 >= max(SHORTEST_STUCK, surprising_run(elsewhere, n_samples, alpha))


# Single samples that jump away and come back: bits lost on the way, no load.

"""Shorter recordings are not judged: there is no telling what is usual for them."""

UNUSUAL = 50.0
"""A spike is this many times the median distance of a sample from the mean of its neighbours, twice what slips of
grains reach (at 500 Hz 25, in 1000 recordings of a finger sliding at 90 Hz 32)."""

LONE = 0.2
"""Its neighbours differ from each other by less than this part of it: a step or a slip is no spike."""

_ROUNDING = 1e-12  # of the largest reading: what float64 leaves between equal readings
_LOOKED_AT_SPIKES = 400  # samples that tell what is usual


def check_spikes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find samples far from both neighbours, which agree with each other."""
    places: dict[int, int] = {}
    touched: set[str] = set()
    for i, r in enumerate(recordings):
        if r.n_samples < SHORTEST:
            continue
        wrench = by_axis(r)
        before, here, after = wrench[:-2], wrench[1:-1], wrench[2:]
        away = np.abs(here - 0.5 * (before + after))
        usual = np.median(away[:: max(1, len(away) // _LOOKED_AT_SPIKES)], axis=0)
        usual = np.where(usual > _ROUNDING * np.abs(here).max(axis=0), usual, np.inf)  # too coarse to judge
        if (away.max(axis=0) <= UNUSUAL * usual).all():
            continue
        hit: NDArray[np.bool_] = (away > UNUSUAL * usual) & (np.abs(after - before) < LONE * away)
        spiky = np.flatnonzero(hit.any(axis=0))
        number = int(np.count_nonzero(hit.any(axis=1)))
        if number:
            places[i] = number
            touched |= {r.axes[column] for column in spiky}
    if places:
        samples = sum(places.values())
        message = (
            f"{counted(len(places))} {verb(len(places), 'has', 'have')} single samples that jump away and come back "
            f"({counted(samples, 'spike')} on {', '.join(sorted(touched))})"
        )
        yield found("warning", "spikes", message, recordings, places, spikes=samples, axes=sorted(touched))


# Samples that carry a flag: what earlier steps or the sensor itself said about them.

MANY_FILLED = 0.05
"""Share of samples inside filled gaps from which on a reader is warned: high frequencies are lost there."""

_WORDS = {
    SampleFlag.GAP_FILLED: "were interpolated inside gaps, where high frequencies are lost",
    SampleFlag.SATURATED: "were marked as saturated when they were recorded",
    SampleFlag.BAD_STATUS: "came with an error reported by the sensor",
    SampleFlag.TIME_REPAIRED: "were sorted or merged because their time ran back or stood still",
}


def check_flags(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Count flagged samples, flag by flag; see `docs/checks.md` for which of them warn."""
    total = sum(r.n_samples for r in recordings)
    flagged = [(i, r.flags) for i, r in enumerate(recordings) if r.flags is not None]
    for bit in SampleFlag:
        counts = {i: int(np.count_nonzero(flags & bit)) for i, flags in flagged}
        places = [i for i, number in counts.items() if number]
        if not places:
            continue
        samples = sum(counts.values())
        share = samples / total
        worrying = (
            share > MANY_FILLED if bit is SampleFlag.GAP_FILLED else bit is not SampleFlag.TIME_REPAIRED
        )
        message = (
            f"{counted(samples, 'sample')} in {counted(len(places))} ({100 * share:.2g} %) {_WORDS[bit]}"
        )
        code = str(bit.name).lower().replace("_", "-")
        severity: Severity = "warning" if worrying else "info"
        yield found(severity, code, message, recordings, places, samples=samples, share=share)


# Units: readings that no push through a granular material gives.

PLAUSIBLE = {"N": 1000.0, "N m": 100.0}
"""Largest readings per unit: a rod through gravel takes tens of newtons, wrist sensors end at some hundred."""


def check_units(recordings: Sequence[Recording], peaks: Sequence[FloatArray]) -> Iterator[Finding]:
    """Find recordings whose largest readings, of each axis, are too large to be in newton and newton metre."""
    large: list[int] = []
    worst = (0.0, "", "")
    for i, recording in enumerate(recordings):
        units = [unit_of(axis, recording.meta) for axis in recording.axes]
        beyond = [
            (float(peak), axis, unit)
            for peak, axis, unit in zip(peaks[i], recording.axes, units, strict=True)
            if peak > PLAUSIBLE.get(unit, np.inf)
        ]
        if beyond:
            large.append(i)
            worst = max(worst, *beyond)
    if large:
        peak, axis, unit = worst
        message = (
            f"{counted(len(large))} with readings up to {peak:.3g} {unit} ({axis}), above {PLAUSIBLE[unit]:g}: are "
            f"they in m{unit.replace(' ', '')}, N mm or counts?"
        )
        yield found("warning", "units", message, recordings, large)


# Runs of samples in which something holds, and how long a run of equal values may be by chance.


def longest_run(held: NDArray[np.bool_]) -> tuple[int, int]:
    """Return start and length of the longest run of True, (0, 0) when there is none.

    Examples
    --------
    >>> import numpy as np
    >>> longest_run(np.array([True, False, True, True]))
    (2, 2)
    """
    edges: NDArray[Any] = np.flatnonzero(np.diff(held, prepend=False, append=False))
    if not len(edges):
        return 0, 0
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    best = int(lengths.argmax())
    return int(starts[best]), int(lengths[best])


def surprising_run(repeated: float, n_samples: int, alpha: float) -> int:
    """Return how many equal samples in a row come by chance less often than `alpha`.

    Parameters
    ----------
    repeated : float
        Share of samples that equal the one before, elsewhere on the axis: high for coarse converters and for
        data that were repeated to reach a higher rate.
    n_samples : int
        Length of the recording.
    alpha : float
        Probability of one such run in the whole recording, were repetitions independent:
        ``n_samples * repeated ** (length - 1) <= alpha``.

    Returns
    -------
    int
        At least 4; `n_samples` + 1, which no run reaches, where nearly every sample is a repetition.

    Examples
    --------
    >>> surprising_run(0.05, 1600, 1e-6), surprising_run(0.8, 1600, 1e-6)
    (9, 96)
    """
    share = max(repeated, 1 / n_samples)
    if share >= 1:
        return n_samples + 1
    return min(n_samples + 1, max(4, math.ceil(1 + math.log(alpha / n_samples) / math.log(share))))


# Samples laid out for statistics along time.


def by_axis(recording: Recording) -> FloatArray:
    """Return the samples, shape (T, C), with those of an axis next to each other in memory.

    Means, medians and extremes along time take a third of the time that they take on the recording's own rows.
    """
    return np.asfortranarray(recording.wrench)
