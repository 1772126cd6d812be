"""Axes that do not move, for a whole recording or for a long stretch of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from granular_id._words import counted, verb
from granular_id.recording._values import FloatArray
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.checking.runs import longest_run, surprising_run
from granular_id.recording.one import Recording

SHORTEST = 20
"""Shorter stretches are not judged: coarse converters repeat themselves while the tool rests."""

COARSE = 0.3
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
    if n_samples <= SHORTEST or not len(moving):
        return [], 0
    equal = wrench[1:] == wrench[:-1]
    repeated = np.count_nonzero(equal, axis=0) / (n_samples - 1)
    candidates = [
        c
        for c in moving
        if repeated[c] * (n_samples - 1) >= SHORTEST and longest_run(equal[:, c])[1] >= SHORTEST
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
    return run + 1 >= max(SHORTEST, surprising_run(elsewhere, n_samples, alpha))
