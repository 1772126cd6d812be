"""``Measured``: the recordings that are checked, with what several checks need of them; the ranges of sensors."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from granular_id._checks import FloatArray, argument_error, finite_number
from granular_id._core import AXES, GranularIdError
from granular_id.recording.checks.report import Finding, Severity
from granular_id.recording.clock import MAX_GAP_S
from granular_id.recording.onset import REST_S
from granular_id.recording.recording import Recording, places_of, unit_of


class Measured:
    """Recordings, the settings of the checks, and what several checks look at; each figure is made when first used."""

    def __init__(
        self, recordings: Sequence[Recording], ranges: Mapping[str, float] | None, false_alarm_rate: float
    ) -> None:
        self.recordings = recordings
        self.ranges = ranges
        self.false_alarm_rate = false_alarm_rate

    @cached_property
    def labels(self) -> dict[str, list[int]]:
        """Places of the recordings of each label, labels in order of first appearance."""
        places = places_of(r.label for r in self.recordings)
        return {label: group for label, group in places.items() if label is not None}

    @cached_property
    def peaks(self) -> list[FloatArray]:
        """Largest reading of each axis, either sign."""
        return [np.abs(r.wrench).max(axis=0) for r in self.recordings]

    @cached_property
    def paces(self) -> list[Pace]:
        """How the samples of each recording follow each other."""
        return [_pace(r) for r in self.recordings]

    @cached_property
    def rests(self) -> list[Rest | None]:
        """Level and noise before the motion; None where a recording begins in motion or too late."""
        return [_rest(r) for r in self.recordings]

    @cached_property
    def labels_of_one_session(self) -> list[str]:
        """Labels that cannot be told from their session; none where all of them share one session."""
        sessions = {
            label: frozenset({self.recordings[i].session for i in group} - {None})
            for label, group in self.labels.items()
        }
        alone = [label for label, its in sessions.items() if len(its) == 1]
        return alone if len({sessions[label] for label in alone}) > 1 else []

    def axes_among(self, columns: Mapping[int, Iterable[int]]) -> list[str]:
        """Return the names of these columns of the recordings at these places, sorted, each once."""
        return sorted({self.recordings[i].axes[column] for i, its in columns.items() for column in its})

    def finding(
        self, severity: Severity, code: str, message: str, places: Iterable[int] = (), **values: Any
    ) -> Finding:
        """Make a finding about the recordings at these places; about the whole set when none is given."""
        indices = tuple(map(int, places))
        return Finding(
            severity, code, message, tuple(self.recordings[i].name for i in indices), indices, values
        )


def by_axis(recording: Recording) -> FloatArray:
    """Return the samples with those of an axis side by side: statistics along time take a third of the time."""
    return np.asfortranarray(recording.wrench)


def unit_columns(recording: Recording) -> dict[str, list[int]]:
    """Return the columns of each unit; those whose unit is not known count as of one."""
    return places_of(unit_of(axis, recording.meta) for axis in recording.axes)


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether an entry of ``meta`` is a number that a float can hold."""
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    )


# How the samples follow each other.

GAP_STEPS = 5.0  # a gap is longer than this many of the recording's long steps (their 95 % quantile)


class Pace(NamedTuple):
    """Steps between neighbouring samples; all 0 for a single sample."""

    median_s: float
    mean_s: float
    spread: float  # 90 % less 10 % quantile, relative to the median
    longest_s: float
    limit_s: float  # the longest step that does not count as a gap


def _pace(recording: Recording) -> Pace:
    if recording.n_samples < 2:
        return Pace(0.0, 0.0, 0.0, 0.0, 0.0)
    if recording.rate_hz is not None:
        step = 1 / recording.rate_hz
        return Pace(step, step, 0.0, step, step)
    steps = np.diff(recording.times())
    low, median, high, long = (float(q) for q in np.quantile(steps, (0.1, 0.5, 0.9, 0.95)))
    limit = min(GAP_STEPS * long, max(MAX_GAP_S, GAP_STEPS * median))
    return Pace(median, float(steps.mean()), (high - low) / median, float(steps.max()), limit)


# What the sensor read before the motion began.

FEWEST_AT_REST = 5  # fewer samples give no level
# a recording rests while its samples spread by less than this part of what they do over the whole of it.
QUIET = 0.2


class Rest(NamedTuple):
    """Mean and standard deviation of each axis at rest."""

    level: FloatArray
    noise: FloatArray


def _rest(recording: Recording) -> Rest | None:
    """Measure the first `REST_S` seconds, or up to the trigger; None where there is no rest."""
    times = recording.times()
    until = REST_S
    if recording.trigger_index is not None:
        until = min(until, float(times[recording.trigger_index]))
    n_rest = int(np.searchsorted(times, until))
    if n_rest < FEWEST_AT_REST or n_rest > recording.n_samples // 2:
        return None
    wrench = by_axis(recording)
    noise, whole = wrench[:n_rest].std(axis=0), wrench.std(axis=0)
    for unit in unit_columns(recording).values():  # together: weak axes are all noise
        if np.linalg.norm(noise[unit]) > QUIET * np.linalg.norm(whole[unit]):
            return None
    return Rest(wrench[:n_rest].mean(axis=0), noise)


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
    """Return the largest reading of each axis, as `Dataset.check` takes it."""
    if isinstance(value, str):
        if value not in SENSOR_RANGES:
            problem = (
                f"={value!r} is no known sensor; choose from {', '.join(SENSOR_RANGES)}, or give numbers"
            )
            raise argument_error(GranularIdError, "sensor_range", problem)
        known = SENSOR_RANGES[value]
        value = {axis: known[axis] for axis in axes if axis in known}
        if len(value) < len(axes):
            raise argument_error(
                GranularIdError, "sensor_range", f"has the axes {' '.join(known)} only; give numbers"
            )
    if isinstance(value, (list, tuple, np.ndarray)):
        if len(value) != len(axes):
            problem = f"has {len(value)} numbers; wanted {len(axes)}: {', '.join(axes)}"
            raise argument_error(GranularIdError, "sensor_range", problem)
        value = dict(zip(axes, value, strict=True))
    numbers = value if isinstance(value, Mapping) else dict.fromkeys(axes, value)
    foreign = [str(axis) for axis in numbers if axis not in axes]
    if foreign:
        problem = f"names the axis {foreign[0]!r}; there are {', '.join(axes)}"
        raise argument_error(GranularIdError, "sensor_range", problem)
    return {axis: finite_number("sensor_range", number, positive=True) for axis, number in numbers.items()}
