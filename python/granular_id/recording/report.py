"""``StepReport``: what a step did to a data set, as text for people and plain values for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from granular_id._checks import checked_text, freeze, frozen_mapping, items_of, thaw
from granular_id._core import GranularIdError
from granular_id._text import counted, in_columns, verb

_PRINTED_ROWS = 10

SESSION_MAY_BE = "sessions may stand elsewhere: data convert "
"""How a note of reading begins that `Dataset.check` repeats."""


@dataclass(frozen=True)
class StepReport:
    """One step of a data set's history.

    Printed, it leaves out settings that are None and figures that are zero; `to_dict` has them all.

    Parameters
    ----------
    step : str
        What was done: ``"load"``, ``"select"``, ``"resample"``, ``"align"``, ...
    parameters : mapping
        The settings of the step.
    totals : mapping
        Figures over all recordings.
    rows : sequence of mappings
        One per recording that the step changed or left out, the first key being ``"name"``.
    notes : sequence of str
        Sentences a reader should not miss.

    Examples
    --------
    >>> from granular_id import StepReport
    >>> print(StepReport("align", {"n_samples": 2}, {"dropped": 1}, [{"name": "a", "dropped_end": 1}]))
    align: n_samples=2
      dropped: 1
      name  dropped_end
      a     1
    """

    step: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    totals: Mapping[str, Any] = field(default_factory=dict)
    rows: Sequence[Mapping[str, Any]] = ()
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "step", checked_text(self.step, "step"))
        for name in ("parameters", "totals"):
            object.__setattr__(self, name, frozen_mapping(name, getattr(self, name)))
        for name, kind in (("rows", Mapping), ("notes", str)):
            object.__setattr__(self, name, freeze(items_of(name, getattr(self, name), kind), name))

    def __reduce__(self) -> tuple[Any, ...]:
        # read-only mappings cannot be pickled: rebuild from plain ones
        return (StepReport, tuple(self.to_dict().values()))

    def to_dict(self) -> dict[str, Any]:
        """Return plain dicts, lists, texts and numbers, ready for ``json.dumps``."""
        return {name: thaw(getattr(self, name)) for name in self.__dataclass_fields__}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> StepReport:
        """Make a report of what `to_dict` gave; TypeError or ValueError naming what does not fit."""
        if not isinstance(values, Mapping):
            raise TypeError(f"a step must be a mapping, got {type(values).__name__}")
        unknown = set(values) - set(cls.__dataclass_fields__)
        if unknown or "step" not in values:
            wanted = ", ".join(cls.__dataclass_fields__)
            raise GranularIdError(f"a step has the keys {', '.join(map(str, values))}; wanted {wanted}")
        return cls(**values)

    def __str__(self) -> str:
        given = {key: value for key, value in self.parameters.items() if value is not None}
        settings = ", ".join(f"{key}={_cell(value)}" for key, value in given.items())
        lines = [f"{self.step}: {settings}" if settings else self.step]
        lines += [f"  {line}" for line in text_totals(self.totals)]
        lines += [f"  note: {note}" for note in self.notes]
        lines += [f"  {line}" for line in text_table(self.rows[:_PRINTED_ROWS])]
        return "\n".join([*lines, *_rest(len(self.rows), " recordings")])


# What a step did, in words.


def skipped_lines(step: StepReport) -> list[str]:
    """Name what a step left out, and why."""
    reading = step.step == "load"
    rows = [row for row in step.rows if "skipped" in row]
    if not rows:
        return []
    # the problem of a file names it, with its folder
    lines = [f"  {'' if reading else row['name'] + ': '}{row['skipped']}" for row in rows[:_PRINTED_ROWS]]
    return [f"{counted(len(rows), 'file' if reading else 'recording')} skipped:", *lines, *_rest(len(rows))]


def noticed_lines(step: StepReport) -> list[str]:
    """Say where reading repaired time, what it remarked on single recordings, and its notes."""
    remarks: dict[str, list[str]] = {}
    repaired = [row["name"] for row in step.rows if row.get("moved") or row.get("merged")]
    lines = []
    if repaired:
        moved, merged = (step.totals.get(name, 0) for name in ("moved_samples", "merged_samples"))
        did = [f"{counted(moved, 'sample')} moved"] * bool(moved) + [f"{merged} merged"] * bool(merged)
        lines = [
            f"time repaired in {counted(len(repaired))} ({', '.join(did)}): {first_names(repaired, _PRINTED_ROWS)}"
        ]
    for row in step.rows:
        if row.get("remark"):
            remarks.setdefault(row["remark"], []).append(row["name"])
    lines += [
        f"{remark}, in {counted(len(names))}: {first_names(names, _PRINTED_ROWS)}"
        for remark, names in remarks.items()
    ]
    return [*lines, *(f"note: {note}" for note in step.notes)]


def _rest(n_rows: int, what: str = "") -> list[str]:
    return [f"  ... and {n_rows - _PRINTED_ROWS} more{what}"] if n_rows > _PRINTED_ROWS else []


def first_names(names: Sequence[str], most: int = 3) -> str:
    """Return the first few names in one text."""
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


def span(low: float, high: float) -> str:
    """Return the least and the largest of some numbers in one text."""
    return " to ".join(dict.fromkeys(f"{number:.6g}" for number in (low, high)))


def subject(n_recordings: int, singular: str = "has", plural: str = "have") -> str:
    """Begin a sentence about so many recordings: with their number and its verb."""
    return f"{counted(n_recordings)} {verb(n_recordings, singular, plural)}"


def text_totals(totals: Mapping[str, Any]) -> list[str]:
    """Return one line per figure; what is zero, empty or not known says nothing and is left out."""
    return [f"{key}: {_total(value)}" for key, value in totals.items() if value]


def text_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lay out mappings as columns under their keys; one in which every row holds zero, nothing or None is left out."""
    columns = list(dict.fromkeys(key for row in rows for key, value in row.items() if value))
    if not columns:
        return []
    cells = [[_cell(row[key]) if key in row else "" for key in columns] for row in rows]
    return [line.rstrip() for line in in_columns([columns, *cells])]


def _total(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_cell(count)} {key}" for key, count in value.items())
    return ", ".join(map(_cell, value)) if isinstance(value, (list, tuple)) else _cell(value)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(thaw(value))
