"""``StepReport``: what a step did to a data set; reports as text for people and JSON for programs."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from granular_id._checks import checked_text, freeze, thaw
from granular_id._files import JSON, refuse_other_kind, whole_file
from granular_id._text import counted, in_columns, verb

_PRINTED_ROWS = 10


class Report:
    """What prints as text and can be saved."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain dicts, lists, texts and numbers, ready for ``json.dumps``."""
        raise NotImplementedError

    def to_json(self) -> str:
        """Return the whole report as one JSON text."""
        return json.dumps(self.to_dict(), ensure_ascii=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the report: all of it as JSON where `path` ends in ``.json``, else the text that `print` shows.

        A `path` that ends like another kind of file is a ValueError.
        """
        refuse_other_kind(path, JSON)
        text = self.to_json() if Path(path).suffix.lower() == ".json" else str(self)
        with whole_file(path) as draft:
            draft.write_text(text + "\n", encoding="utf-8")


@dataclass(frozen=True)
class StepReport(Report):
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
    >>> from granular_id.recording import StepReport
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
        kinds = {"parameters": Mapping, "totals": Mapping, "rows": Sequence, "notes": Sequence}
        for name, kind in kinds.items():
            value = getattr(self, name)
            if not isinstance(value, kind) or isinstance(value, str):
                wanted = kind.__name__.lower()
                raise TypeError(f"{name} of a step must be a {wanted}, got {type(value).__name__}")
            object.__setattr__(self, name, freeze(value, name))
        for name, item_kind in (("rows", Mapping), ("notes", str)):
            items = getattr(self, name)
            wrong = next((i for i, item in enumerate(items) if not isinstance(item, item_kind)), None)
            if wrong is not None:
                raise TypeError(f"{name}[{wrong}] of a step must be a {item_kind.__name__.lower()}")

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
            raise ValueError(f"a step has the keys {', '.join(map(str, values))}; wanted {wanted}")
        return cls(**values)

    def __str__(self) -> str:
        given = {key: value for key, value in self.parameters.items() if value is not None}
        settings = ", ".join(f"{key}={_cell(value)}" for key, value in given.items())
        lines = [f"{self.step}: {settings}" if settings else self.step]
        lines += [f"  {line}" for line in text_totals(self.totals)]
        lines += [f"  note: {note}" for note in self.notes]
        lines += [f"  {line}" for line in text_table(self.rows[:_PRINTED_ROWS])]
        if len(self.rows) > _PRINTED_ROWS:
            lines.append(f"  ... and {len(self.rows) - _PRINTED_ROWS} more recordings")
        return "\n".join(lines)


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
