"""The rest level: what the sensor read before the motion began."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granular_id.recording._values import FloatArray
from granular_id.recording.axes import unit_of
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.one import Recording
from granular_id.recording.onset.find import REST_S

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
