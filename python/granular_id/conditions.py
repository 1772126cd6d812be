"""Conditions under which recordings were made, such as tool, depth or day: which can be held out, and their values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id._text import counted, short
from granular_id.recording import Dataset, setups_in, single_values

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
