"""What results and models say of a data set: the set-ups, units and history of its recordings, and what may mislead."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from granular_id._core import GranularIdError
from granular_id.recording.checks import Finding
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.stated import check_lengths
from granular_id.recording.dataset import Dataset
from granular_id.recording.onset import ONSET_STEP
from granular_id.recording.recording import unit_of
from granular_id.recording.setup import (
    Setup,
    quoted,
    taken_off,
    unit_differences,
    values_in,
)

PAUSE_S = 1.0
"""So long a pause is none of jitter: several pushes stand in one log."""


def setups_in(data: Dataset) -> list[Setup]:
    """Return the set-up of each recording."""
    setups = [Setup.of(recording.meta) for recording in data]
    onsets = [step for step in data.history if step.step == ONSET_STEP]
    if not onsets:
        return setups
    # The motion begins where it was found in the forces, whatever started the recording.
    trigger = None if onsets[-1].totals.get("recorded") else "onset"
    return [replace(setup, trigger=trigger) for setup in setups]


def common_units(data: Dataset) -> list[str]:
    """Return the unit of each axis, or refuse recordings that differ in them."""
    units = dict.fromkeys(data.axes, "")
    first = dict.fromkeys(data.axes, data[0].name)
    for recording in data:
        for other in unit_differences(units, recording.meta):
            axis = other.now.partition(":")[0]
            raise GranularIdError(
                f"recordings differ in the units of their axes: {first[axis]!r} has {other.trained[0]}, "
                f"{recording.name!r} has {other.now}; convert the samples to the same before"
            )
        for axis in [axis for axis, unit in units.items() if not unit]:
            units[axis], first[axis] = unit_of(axis, recording.meta), recording.name
    return list(units.values())


def mixed_setup_warnings(data: Dataset) -> list[str]:
    """Say where recordings of one data set differ in frame, topic, array, or what was taken off them, one line each."""
    known = values_in(setups_in(data))
    follows = dict.fromkeys(("frame", "transform", "sign"), "nothing is turned")
    follows["read_as"] = "another topic or array is another signal"
    follows |= dict.fromkeys(("compensated", *taken_off(known)), "their forces do not count from one zero")
    units = []
    if len({one.axes for one in data}) == 1:
        try:
            common_units(data)
        except GranularIdError as error:
            units = [f"warning: {error}"]
    return units + [
        f"warning: recordings differ in their {name}: {', '.join(map(quoted, values))}; {what}"
        for name, what in follows.items()
        if len(values := known.get(name, ())) > 1
    ]


def short_warnings(data: Dataset) -> list[str]:
    """Say which recordings are far shorter than the others, as `Dataset.check` does."""
    return [str(finding) for finding in check_lengths(Measured(data.recordings))]


SEVERE_PREFIXES = ("error: ", "warning: ")
"""How the lines of `data_warnings` begin."""


def data_warnings(data: Dataset, findings: Iterable[Finding] | None = None) -> list[str]:
    """Return what may mislead a reader of the accuracies: set-ups that differ, errors and warnings of the checks."""
    made = data.check() if findings is None else findings
    found = [str(finding) for finding in made if finding.severity != "info"]
    return mixed_setup_warnings(data) + found


def labelled_check_note(note: str) -> str:
    """Say whose a line of `data_warnings` is: "error: " alone is what a command prints that has failed."""
    return f"data check: {note}" if note.startswith(SEVERE_PREFIXES) else note


def describe_data(data: Dataset) -> dict[str, Any]:
    """Return size, rate and summary of a data set with the history of the steps that made it."""
    n_recordings, n_samples, n_axes = data.X.shape
    return {
        "n_recordings": n_recordings,
        "n_samples": n_samples,
        "n_axes": n_axes,
        "rate_hz": data.rate_hz,
        "summary": data.summary().to_dict(),
        "history": [step.to_dict() for step in data.history],
    }
