"""What the recordings of a data set were made with, what of it can be held out, and what a trained model requires."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import WayOutError, argument_error
from granular_id._core import GranularIdError
from granular_id._text import counted, short, typed, verb
from granular_id.recording.checks import Finding
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.stated import check_lengths
from granular_id.recording.dataset import Dataset
from granular_id.recording.onset import ONSET_STEP
from granular_id.recording.recording import single_values, unit_of
from granular_id.recording.setup import (
    Difference,
    Setup,
    quoted,
    refuse_or_list,
    setup_differences,
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
    name = ends[0] if len(ends) == 1 and condition not in known else condition
    if name in known:
        reason = _why_not(data, known[name])
        if not reason:
            return name, known[name]
    elif ends:
        reason = f"it is several things: {', '.join(ends)}"
    elif any(condition in recording.meta for recording in data):
        within = [name for name in known if name.startswith(f"{condition}.")]
        reason = "it is no single value" + f": take one within it, such as {within[0]!r}" * bool(within)
    elif condition == "label":
        reason = "the labels are what is distinguished"
    else:
        reason = f"no recording states it (a column {condition!r} of index.csv, or an entry of meta)"
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


# What a trained model requires: its axes, rate and set-up; its length, with its rest before the motion.


@dataclass(frozen=True)
class Requirements:
    """What the recordings of a training had in common, and those that a model names must have.

    `setup` holds values of the training as `values_in` gives them. `lead_s` is the rest ahead of the trigger, where all
    had the same; without it `at_first` says that they began at their first sample, or were windows.
    """

    n_samples: int
    rate_hz: float
    axes: tuple[str, ...]
    units: tuple[str, ...]
    setup: Mapping[str, Sequence[str]]
    lead_s: float | None
    at_first: bool

    def differences(self, setup: Setup, meta: Mapping[str, Any]) -> list[Difference]:
        """Compare a set-up, and units in metadata, with those of the training."""
        units = dict(zip(self.axes, self.units, strict=True))
        return [*unit_differences(units, meta), *setup_differences(self.setup, setup)]

    def check(self, data: Dataset, accept: str | Sequence[str] = ()) -> tuple[str, ...]:
        """Refuse other axes, rates and set-ups but for what is in `accept`; return what else differs, each once."""
        for recording in data:
            if recording.axes != self.axes:
                way_out = (f": call .select(axes={list(self.axes)}) ", typed(axes=self.axes))
                raise WayOutError(
                    f"recording {recording.name!r} has the axes {' '.join(recording.axes)}; the model was trained on "
                    f"{' '.join(self.axes)}",
                    *(way_out if set(recording.axes) >= set(self.axes) else ()),
                )
            if recording.rate_hz != self.rate_hz:
                own = recording.rate_hz
                came = "is sampled irregularly" if own is None else f"has {own:g} Hz"
                came += f", the model was trained at {self.rate_hz:g} Hz"
                call, options = f".resample({self.rate_hz:g})", {"resample_hz": self.rate_hz}
                longest = 0.0 if own is not None else float(np.diff(recording.times()).max(initial=0))
                if longest >= PAUSE_S:
                    came += f", and has pauses of up to {longest:.3g} s"
                    call, options = f".split(gap_s={PAUSE_S:g}){call}", {"split_gap_s": PAUSE_S, **options}
                problem = f"recording {recording.name!r} {came}; nothing is resampled unasked: call {call} "
                raise WayOutError(problem, typed(**options))
        found: dict[str, None] = {}
        for recording, setup in zip(data, setups_in(data), strict=True):
            differences = self.differences(setup, recording.meta)
            where = f"recording {recording.name!r} has "
            found.update(dict.fromkeys(refuse_or_list(differences, accept, where)))
        return tuple(found)

    def crop(self, data: Dataset, *, over_all: bool = True) -> Dataset:
        """Crop recordings of the rate and axes to the length, from the first sample or the trigger less the lead on.

        Those of the length stay as they are, and longer ones begin as in the training. `over_all` says whether answers
        over all of a recording would do, too.
        """
        n, rate_hz = self.n_samples, self.rate_hz
        lengths = [recording.n_samples for recording in data]
        if set(lengths) == {n}:
            return data
        short = [recording for recording in data if recording.n_samples < n]
        if short:
            skip = (f": call .align({n}, on_short='skip') ", typed(duration_s=n / rate_hz, on_error="skip"))
            raise WayOutError(
                f"recording {short[0].name!r} has {short[0].n_samples} samples "
                f"({short[0].n_samples / rate_hz:g} s), the model takes {n} ({n / rate_hz:g} s); {len(short)} of "
                f"{counted(len(data))} {verb(len(short), 'is', 'are')} shorter",
                *(skip if len(short) < len(data) else ()),
            )
        if self._begins_at_first:
            cropped = data.align(n)
            step = replace(cropped.history[-1], notes=["begins at the first sample, as in the training"])
            return Dataset(cropped.recordings, [*data.history, step])
        if self.lead_s is None:
            longer = next(recording for recording in data if recording.n_samples > n)
            over = ", or answer over all of it (--hop-s, .predict_over(recording))"
            raise WayOutError(
                f"recording {longer.name!r} has {longer.n_samples} samples, the model takes {n}, and does not know how "
                f"much rest comes before the motion: crop recordings as those of the training, Dataset.align({n}) from "
                "the first sample on ",
                typed(duration_s=n / rate_hz),
                over * over_all,
            )
        start = round(self.lead_s * rate_hz)
        begun = [replace(r, trigger_index=start) if r.n_samples == n else r for r in data]
        return Dataset(begun, data.history).align(n, trigger="recorded", lead_s=self.lead_s)

    def starts(
        self,
        names: Sequence[str],
        lengths: NDArray[np.int64],
        triggers: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the sample at which `crop` has each of n recordings begin by itself; -1: left out, or no trigger."""
        n = self.n_samples
        starts = np.zeros(len(lengths), np.int64)
        from_trigger = (lengths > n) & (not self._begins_at_first)
        if from_trigger.any():
            if self.lead_s is None:
                first = int(from_trigger.argmax())
                raise GranularIdError(
                    f"recording {names[first]!r} has {lengths[first]} samples; the model does not know how much rest "
                    f"comes before the motion, and wants {n} of each: call .align on the recordings"
                )
            begun = np.where(triggers >= 0, triggers - round(self.lead_s * self.rate_hz), -1)
            starts = np.where(from_trigger, begun, starts)
        fits: NDArray[np.int64] = np.where((starts >= 0) & (starts + n <= lengths), starts, -1)
        return fits

    @property
    def _begins_at_first(self) -> bool:
        return self.lead_s is None and self.at_first
