"""What goes into a reader and what comes out: ``LoadOptions`` (checked once), ``FileSource`` and ``FileContent``."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from granular_id._checks import argument_error, checked_text, finite_number
from granular_id._core import GranularIdError
from granular_id.recording import (
    AXES,
    Recording,
    Stated,
    StepReport,
    Table,
    checked_time_unit,
    names_in,
    units_by_axis,
)

NO_MATERIAL = frozenset(
    (
        *("trial", "run", "push", "recording", "rec", "take", "test", "sample", "measurement", "data", "log"),
        *("exp", "experiment", "file", "episode", "session", "day", "rep", "rosbag", "rosbag2"),
    )
)
"""Names that number recordings: no label."""

SESSION_LIKE = re.compile(
    r"(\d{2,4}[-_.]\d{1,2}[-_.]\d{1,4}.*|\d{8}|(mon|tues|wednes|thurs|fri|satur|sun)day|"
    r"train(ing)?|test(ing)?|val(id|idation)?|raw|csv|data(set)?s?|recordings?|measurements?|"
    r"logs?|files?|(session|day|week|run|trial|take|batch|exp|experiment|"
    r"person|subject|participant|operator|user|robot|rig)[\s_-]*\w{0,3})",
    re.IGNORECASE,
)
"""Names of folders, or groups, that are most likely no material."""

_CHOICES = {"on_error": ("raise", "skip"), "on_time_error": ("raise", "repair")}
PLACES = "'folder', 'parent', 'file', 'column:NAME' or 'meta:PATH'"


@dataclass(frozen=True)
class LoadOptions:
    """Settings of :func:`granular_id.load`, where they are described."""

    rate_hz: float | None = None
    on_error: Literal["raise", "skip"] = "raise"
    on_time_error: Literal["raise", "repair"] = "raise"
    topic: str | None = None
    array: str | None = None
    time: str | None = None
    time_unit: str | None = None
    axes: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    id: str | None = None
    label: str | None = None
    session: str | None = None
    csv: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            object.__setattr__(self, "rate_hz", finite_number("rate_hz", self.rate_hz, positive=True))
        for name, wanted in _CHOICES.items():
            if getattr(self, name) not in wanted:
                words = " or ".join(map(repr, wanted))
                raise argument_error(GranularIdError, name, f"={getattr(self, name)!r}; wanted {words}")
        checked_time_unit(self.time_unit)
        for name in ("topic", "array", "time", "id", "label", "session"):
            if getattr(self, name) is not None:
                checked_text(getattr(self, name), name)
        for name in ("label", "session"):
            place = getattr(self, name)
            if place is not None and place not in ("folder", "parent", "file"):
                kind, _, rest = place.partition(":")
                if kind not in ("column", "meta") or not rest:
                    raise argument_error(GranularIdError, name, f"={place!r:.60}; wanted {PLACES}")
        for name in ("axes", "units"):
            object.__setattr__(self, name, names_in(name, getattr(self, name), empty=name == "units"))
        if self.axes is not None and self.units is not None:
            units_by_axis(self.axes, self.units)
        if self.csv is not None and (
            not isinstance(self.csv, Mapping) or not all(isinstance(k, str) for k in self.csv)
        ):
            raise argument_error(
                TypeError, "csv", "must be a mapping of options of pandas.read_csv to their values"
            )

    @property
    def read_as(self) -> str | None:
        """What somebody chose to read of files: part of the set-up that models compare."""
        chosen = {"array": self.array, "topic": self.topic, "time": self.time}
        if self.axes is not None and self.axes != AXES:
            chosen["axes"] = ",".join(self.axes)
        said = [f"{name}={value}" for name, value in chosen.items() if value is not None]
        said += [f"csv {key}={value!r}" for key, value in sorted((self.csv or {}).items())]
        return ", ".join(said) or None

    def to_dict(self) -> dict[str, Any]:
        """Return the settings that were given, for a report."""
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        if self.csv is not None:
            given["csv"] = {key: repr(value) for key, value in self.csv.items()}
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True)
class FileSource:
    """A file (or a folder that is one recording) to read, and what is known about it from outside.

    Attributes
    ----------
    path, root : Path
        Nothing outside of the folder `root` is opened, whatever links say.
    name : str
        How reports call the recording: the path within the folder, or what index.csv says.
    label, session : str or None
        What an option or index.csv states; it wins over what the file says.
    label_else, session_else : str or None
        What its folder or name says, where nothing else does.
    label_place, session_place : str
        Where these come from, for the report.
    two_meanings : str or None
        Why a file that states no label itself is refused: its folders may mean two things.
    start_time, trigger_index, meta, rate_hz, irregular, axes
        What index.csv states.
    """

    path: Path
    root: Path
    name: str
    label: str | None = None
    session: str | None = None
    label_else: str | None = None
    session_else: str | None = None
    label_place: str = ""
    session_place: str = ""
    two_meanings: str | None = None
    start_time: float | None = None
    trigger_index: int | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    rate_hz: float | None = None
    irregular: bool = False
    axes: tuple[str, ...] | None = None

    @classmethod
    def alone(cls, path: Path) -> FileSource:
        """Return the source of a single file that nothing is known about."""
        return cls(path, path.resolve().parent, path.name)

    def stated(self, options: LoadOptions) -> Stated:
        """Join what the options and what index.csv say of it."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name in Stated.__dataclass_fields__}
        given = {name: getattr(options, name) for name in ("time_unit", "units", "time", "id")}
        for what in ("label", "session"):
            rule = getattr(options, what)
            given[f"{what}_from"] = rule if rule is not None and ":" in rule else None
        if options.read_as is not None:
            given["meta"] = {**self.meta, "read_as": options.read_as}
        if self.rate_hz is None and not self.irregular:
            given["rate_hz"] = options.rate_hz
        repair = options.on_time_error == "repair"
        return Stated(**{**own, **given, "axes": options.axes or self.axes, "repair": repair})


@dataclass
class FileContent:
    """What a reader found in a file: tables, or recordings that are complete already.

    `place` leads from a table (its number) and a row to what an error names: ``line=``, ``place=``.
    """

    tables: Sequence[Table] = ()
    recordings: Sequence[Recording] = ()
    rows: list[dict[str, Any]] = field(default_factory=list)  # remarks on single recordings, "name" first
    notes: list[str] = field(default_factory=list)
    history: Sequence[StepReport] = ()
    place: Callable[[int, int | None], dict[str, Any]] = lambda table, row: {}  # noqa: ARG005
