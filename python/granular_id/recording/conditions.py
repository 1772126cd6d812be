"""What the recordings of a data set were made with: set-ups, units, and conditions that can be held out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id._text import counted, short
from granular_id.recording.checks import Finding
from granular_id.recording.dataset import Dataset
from granular_id.recording.onset import ONSET_STEP
from granular_id.recording.recording import single_values, unit_of
from granular_id.recording.setup import Setup, quoted, taken_off, unit_differences, values_in


def setups_in(data: Dataset) -> list[Setup]:
    """Return the set-up of each recording."""
    setups = [Setup.of(recording.meta) for recording in data]
    onsets = [step for step in data.history if step.step == ONSET_STEP]
    if not onsets:
        return setups
    # The motion begins where it was found in the forces, whatever started the recording.
    trigger = None if onsets[-1].totals.get("kept") else "onset"
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
    """Say where recordings of one data set differ in their frame, or in what was taken off them, one line each."""
    known = values_in(setups_in(data))
    follows = dict.fromkeys(("frame", "transform", "sign"), "nothing is turned")
    follows |= dict.fromkeys(("compensated", *taken_off(known)), "their forces do not count from one zero")
    return [
        f"warning: recordings differ in their {name}: {', '.join(map(quoted, values))}; {what}"
        for name, what in follows.items()
        if len(values := known.get(name, ())) > 1
    ]


SEVERE_PREFIXES = ("error: ", "warning: ")
"""How the lines of `data_warnings` begin."""


def data_warnings(data: Dataset, findings: Iterable[Finding] | None = None) -> list[str]:
    """Return what may mislead a reader of the accuracies: set-ups that differ, errors and warnings of the checks."""
    made = data.check() if findings is None else findings
    told = [str(finding) for finding in made if finding.severity != "info"]
    return mixed_setup_warnings(data) + told


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


# Conditions, such as tool, depth or day.

MOST_VALUES = 50
"""Values of a condition that are held out one after the other: each costs a training."""

_MOST_NAMED = 12
_LATEST_S = 1e11  # a clock beyond the year 5000 counts something else than seconds


def conditions_in(data: Dataset) -> dict[str, NDArray[np.object_]]:
    """Gather what recordings state about how they were made, as text (n,), None where one does not state it.

    Session, the fields of `Setup`, values of the metadata by their path, and the day (UTC): of equal names the first in
    this order that any recording states.
    """
    found: dict[str, NDArray[np.object_]] = {}
    for source in (
        ({"session": recording.session} for recording in data),
        map(vars, setups_in(data)),
        (dict(single_values(recording.meta)) for recording in data),
        ({"day": _day(recording.start_time)} for recording in data),
    ):
        own: dict[str, NDArray[np.object_]] = {}
        for row, stated in enumerate(source):
            for name, value in stated.items():
                text = "" if value is None else str(value).strip()
                if not isinstance(value, str):
                    text = text.removesuffix(".0")
                if text:
                    own.setdefault(name, np.full(len(data), None, dtype=object))[row] = text
        found |= {name: texts for name, texts in own.items() if name not in found}
    return found


def _day(time: float | None) -> str | None:
    return None if time is None or abs(time) > _LATEST_S else str(np.datetime64(int(time), "s"))[:10]


def condition_of(data: Dataset, condition: Any) -> tuple[str, NDArray[np.object_]]:
    """Return the whole name and the values (n,) of a condition that can be held out, by it or the end of its path."""
    if not isinstance(condition, str):
        raise argument_error(TypeError, "by", f"must be the name of a condition, got {condition!r:.60}")
    known = conditions_in(data)
    ends = [name for name in known if name.rpartition(".")[2] == condition]
    name = condition if condition in known else ends[0] if len(ends) == 1 else None
    if name is None:
        reason = (
            "the labels are what is told apart"
            if condition == "label"
            else (f"no recording states it (a column {condition!r} of index.csv, or an entry of meta)")
        )
        if any(condition in recording.meta for recording in data):
            within = [name for name in known if name.startswith(f"{condition}.")]
            reason = "it is no single value" + f": take one within it, such as {within[0]!r}" * bool(within)
        if ends:
            reason = f"it is several things: {', '.join(ends)}"
    else:
        reason = _why_not(data, known[name])
        if not reason:
            return name, known[name]
    able = [
        f"{other} ({len(set(values.tolist()))} values)"
        for other, values in known.items()
        if not _why_not(data, values)
    ]
    more = f" and {len(able) - _MOST_NAMED} more" if len(able) > _MOST_NAMED else ""
    which = f"those that can be: {', '.join(able[:_MOST_NAMED])}{more}"
    which = which if able else "these recordings state none that can be"
    raise argument_error(GranularIdError, "by", f"={condition!r} cannot be held out, as {reason}; {which}")


def _why_not(data: Dataset, values: NDArray[np.object_]) -> str:
    """Say why a condition cannot be held out; nothing where it can."""
    y, n_values = data.y, len(set(values.tolist()))
    missing = [row for row, value in enumerate(values.tolist()) if value is None]
    if missing:
        return (
            f"{len(missing)} of {counted(len(data))} do not state it, the first is {data.names[missing[0]]!r}"
        )
    if n_values == 1:
        return f"all recordings have the same value, {short(values[0], 40)!r}"
    several = [label for label in data.labels if len(set(values[y == label].tolist())) > 1]
    if not several:
        return f"each material has one value of it only ({y[0]}: {values[0]!r}), and would not train when held out"
    if n_values > MOST_VALUES or n_values == len(data):
        return (
            f"it has {n_values} values in {len(data)} recordings, each a training of its own: note a few rounded "
            "values in the metadata"
        )
    only = f"{several[0]} alone has several values of it: no other material would be tested"
    return only if len(several) == 1 else ""
