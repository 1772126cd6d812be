"""What goes into a reader and what comes out: ``LoadOptions`` (checked once), ``FileSource`` and ``FileContent``."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from granular_id._checks import argument_error, checked_choice, checked_text, finite_number
from granular_id._core import GranularIdError
from granular_id.recording import (
    AXES,
    RECORDING,
    TIME,
    Made,
    Recording,
    Stated,
    StepReport,
    Table,
    names_in,
    units_by_axis,
)

NO_MATERIAL = frozenset(
    (
        *("trial", "run", "push", "recording", "rec", "take", "test", "sample", "measurement", "data", "log"),
        *("exp", "experiment", "demo", "file", "episode", "session", "day", "rep", "rosbag", "rosbag2"),
        *("ft", "wrench", "force", "forces", "sensor", "signal"),
        *(
            "messung",
            "versuch",
            "lauf",
            "aufnahme",
            "essai",
            "mesure",
            "ensayo",
            "prueba",
            "medida",
            "prova",
            "misura",
        ),
        *("mittaus", "ajo", "toisto"),
    )
)
"""Names that number recordings: no label."""

SESSION_LIKE = re.compile(
    r"(\d{2,4}[-_.]\d{1,2}[-_.]\d{1,4}.*|\d{8}|(mon|tues|wednes|thurs|fri|satur|sun)day([\s_-]?\d+)?|"
    r"train(ing)?|test(ing)?|val(id|idation)?|raw|csv|data(set)?s?|recordings?|measurements?|"
    r"logs?|files?|date|(session|day|week|run|trial|take|batch|exp|experiment|"
    r"person|subject|participant|operator|user|robot|rig)[\s_-]*\w{0,3})",
    re.IGNORECASE,
)
"""Names of folders, or groups, that are most likely no material."""


def likeliest_first(values: Mapping[str, Collection[Any]]) -> list[str]:
    """Sort what may be labels, names with their values: days and persons last, of others those with more values."""

    def key(name: str) -> tuple[bool, int]:
        texts = [str(value) for value in values[name]]
        called = name not in ("file", "folder") and SESSION_LIKE.fullmatch(name.removeprefix("column:"))
        is_session = called or all(map(SESSION_LIKE.fullmatch, texts))
        return bool(is_session) or len(texts) < 2, -len(texts)

    return sorted(values, key=key)


_CHOICES = {
    "on_error": ("raise", "skip"),
    "on_time_error": ("raise", "repair"),
    "time_unit": ("s", "ms", "us", "ns", "sample"),
}
_PLACE = re.compile(r"folder|parent|file|(column|meta):.+")
_PLACES = "'folder', 'parent', 'file', 'column:NAME' or 'meta:PATH'"


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
    stated: dict[str, Any] = field(init=False, repr=False)
    """What they say of every file, in the words of `Stated`."""

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            object.__setattr__(self, "rate_hz", finite_number("rate_hz", self.rate_hz, positive=True))
        for name, known in _CHOICES.items():
            if getattr(self, name) is not None and getattr(self, name) not in known:
                checked_choice(name, getattr(self, name), *known)
        for name in ("topic", "array", "time", "id", "label", "session"):
            if getattr(self, name) is not None:
                checked_text(getattr(self, name), name)
        for name in ("label", "session"):
            if not _PLACE.fullmatch(getattr(self, name) or "file"):
                raise argument_error(GranularIdError, name, f"={getattr(self, name)!r:.60}; wanted {_PLACES}")
        for name in ("axes", "units"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, names_in(name, getattr(self, name), empty=name == "units"))
        if self.axes is not None and self.units is not None:
            units_by_axis(self.axes, self.units)
        if self.csv is not None and (
            not isinstance(self.csv, Mapping) or not all(isinstance(k, str) for k in self.csv)
        ):
            problem = "must be a mapping of options of pandas.read_csv to their values"
            raise argument_error(TypeError, "csv", problem)

        columns = {TIME: self.time, RECORDING: self.id}
        stated: dict[str, Any] = {
            name: getattr(self, name) for name in ("rate_hz", "time_unit", "axes", "units")
        }
        for name in ("label", "session"):
            kind, _, place = (getattr(self, name) or "").partition(":")
            columns |= {name: place} if kind == "column" else {}
            stated |= {f"{name}_from": getattr(self, name)} if kind == "meta" else {}
        chosen = {name: getattr(self, name) for name in ("array", "topic", "time")}
        chosen["axes"] = None if self.axes is None or self.axes == AXES else ",".join(self.axes)
        read_as = [f"{name}={value}" for name, value in chosen.items() if value is not None]
        read_as += [f"csv {key}={value!r}" for key, value in sorted((self.csv or {}).items())]
        stated["columns"] = tuple((what, name) for what, name in columns.items() if name is not None)
        stated["repair"] = self.on_time_error == "repair"
        # what somebody chose to read of files is part of the set-up that models compare
        stated["meta"] = {"read_as": ", ".join(read_as)} if read_as else {}
        object.__setattr__(self, "stated", stated)


@dataclass(frozen=True, kw_only=True)
class FileSource(Stated):
    """A file (or a folder that is one recording) to read, and what options, index.csv and its place state of it."""

    path: Path
    root: Path  # nothing outside of this folder is opened, whatever links say
    name: str  # how reports call the recording: the path within the folder, or what index.csv says
    label_place: str = ""  # where label and session come from, for the report
    session_place: str = ""
    two_meanings: tuple[str, ...] | None = (
        None  # the refusal where it states no label: folders may mean two things
    )
    name_label: str | None = None  # the label that its name says
    n_alike: int = 1  # files of its kind in the folder that is read
    n_labels: int = 1  # what the places of all files say; one that is that of all may be no label

    @property
    def label_known(self) -> str | None:
        """The label that is stated, or that the place says where it tells files apart."""
        return self.label or (self.label_else if self.n_labels > 1 else None)

    @property
    def place_rule(self) -> str:
        """The value of `label` that means its place."""
        return "folder" if self.label_place == "folder" else "file"


@dataclass
class FileContent:
    """What a reader found in a file: tables, or recordings that are complete already.

    `place` leads from a table (its number) and a row to what an error names: ``line=``, ``place=``; `in_python` from
    methods of a data frame to the lines that read the table, mended by these.
    """

    tables: Sequence[Table] = ()
    recordings: Sequence[Recording] = ()
    rows: list[dict[str, Any]] = field(default_factory=list)  # remarks on single recordings, "name" first
    notes: list[str] = field(default_factory=list)
    orders: Sequence[str] = ()  # notes on axes that might be in another order, which are printed first
    history: Sequence[StepReport] = ()
    may_be_labels: Mapping[str, list[str]] = field(default_factory=dict)  # as in `Made`
    may_be_sessions: dict[str, list[str]] = field(default_factory=dict)
    place: Callable[[int, int | None], dict[str, Any]] = lambda _table, _row: {}
    in_python: Callable[[str], Sequence[str]] = lambda _mend: ()


@dataclass
class ReadFile(Made):
    """What a file, or a piece of one, became."""

    source: FileSource = field(kw_only=True)
    orders: Sequence[str] = ()
    history: Sequence[StepReport] = ()
