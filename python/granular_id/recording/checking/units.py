"""Units: readings that no push through a granular material gives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from granular_id._words import counted
from granular_id.recording._values import FloatArray
from granular_id.recording.axes import unit_of
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.one import Recording

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
