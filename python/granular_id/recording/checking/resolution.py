"""Quantisation: the step on whose multiples all readings of an axis lie."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce

import numpy as np

from granular_id._words import counted, verb
from granular_id.recording._values import FloatArray
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.one import Recording

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
