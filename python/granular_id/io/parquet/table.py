"""A single Parquet file that somebody else wrote: one table of samples, of one recording or of many."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.details import Entries, stated_rates
from granular_id.io.arrays.names import Role, role_of
from granular_id.io.arrays.stated import ALL, Columns, single_unit, time_unit_in_name, units_of, what_has_unit
from granular_id.io.arrays.tree import Origin
from granular_id.io.columns import FLAGS, TIME, refusal, split_unit
from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.options import LoadOptions
from granular_id.io.parquet.file import TEXTS, CheckedParquet, open_parquet
from granular_id.io.parquet.index import coded_texts
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import AXES, Recording
from granular_id.recording._values import FloatArray, checked_text
from granular_id.recording.flags import KNOWN_FLAGS

__all__ = ["read_parquet_table"]

RECORDING, LABEL, SESSION, RATE = "recording", "label", "session", "rate"
_NAMES = {
    RECORDING: (
        *("recording", "recording_id", "recording id", "id", "name", "trial", "trial_id", "run", "run_id"),
        *("episode", "episode_id", "episode_index"),
    ),
    LABEL: ("label", "material", "class"),
    SESSION: ("session",),
}
_MEANING = {name: what for what, names in _NAMES.items() for name in names}
_OF_ROLE: dict[Role | None, str] = {"labels": LABEL, "sessions": SESSION}

_PANDAS_INDEX = "__index_level_0__"
"""As pandas calls an index without a name."""

_MOST_TEXT = 1 << 20
"""Characters of an entry of the footer that is looked into."""

_WANTED_NAMES = "wanted whole numbers or texts that name recordings"


def read_parquet_table(source: FileSource, options: LoadOptions) -> FileContent:
    """Read a table with columns fx fy fz tx ty tz, and optionally time, flags, recording, label and session.

    Rows with the same value in the column ``recording`` make a recording, in the order of the file; without that
    column the whole file is one. A recording has one label and one session. Columns that mean nothing here are not
    read, and a note says so.

    Raises
    ------
    RecordingFileError
        A column is missing, stands there twice, or has cells that are empty or of another kind; a recording with
        two labels; what `stamped_recording` says of the clock.
    """
    path, root, most = source.path, source.root, options.max_binary_bytes
    with open_parquet(path, root, most) as parquet:
        columns = _columns(parquet, options.label)
        said = _Said.of(parquet, columns, options)
        text = [name for name in columns.values() if str(parquet.columns[name]) in TEXTS]
    with open_parquet(path, root, most, texts=text) as parquet:
        if not sum(parquet.rows):
            raise RecordingFileError(path, "holds no samples")
        parquet.check(list(columns.values()))
        arrow = need("pyarrow", extra="app", why="to read Parquet files")
        parts = [parquet.read(group, list(columns.values())) for group in range(len(parquet.rows))]
        table = _Table(arrow.concat_tables(parts).unify_dictionaries(), columns, path, said)
        unread = [name for name in parquet.columns if name not in columns.values()]
    notes = [*said.notes, *([f"columns that are not read: {', '.join(unread)[:200]}"] if unread else [])]
    found: list[Recording] = []
    remarked: list[dict[str, Any]] = []
    for rows, name in table.recordings(source.name):
        recording, remarks = _recording(table, rows, replace(source, name=name), options)
        found.append(recording)
        remarked += [{"name": name, **remarks}] if remarks else []
    return FileContent(recordings=found, rows=remarked, notes=notes)


@dataclass(frozen=True)
class _Said:
    """What the metadata of a table and of its columns say.

    Attributes
    ----------
    scales : tuple of float or None
        What each axis must be multiplied with; None: nothing.
    time_unit : str or None
    rate_hz : float or None
    texts : dict
        Label and session of the whole table.
    notes : list of str
        What was converted.
    """

    scales: tuple[float, ...] | None
    time_unit: str | None
    rate_hz: float | None
    texts: dict[str, str]
    notes: list[str]

    @classmethod
    def of(cls, parquet: CheckedParquet, columns: Mapping[str, str], options: LoadOptions) -> _Said:
        about = _metadata(parquet.labels)
        origin = Origin(parquet.path, "metadata", about)
        units: dict[str, tuple[str, tuple[str, ...]]] = {}
        entries: Entries = {}
        for key, value in about.items():
            whose, role = what_has_unit(key, {}), role_of(key)
            if whose is not None and value is not None:
                units |= units_of(value, whose, key, {}, origin)
            elif role in ("rate", "step"):
                entries.setdefault(role, {})[key] = value
        units |= {
            meaning: (f"of column {name}", (parquet.units[name],))
            for meaning, name in columns.items()
            if name in parquet.units and meaning in (*AXES, TIME)
        }
        named = tuple(columns[axis] for axis in AXES)
        rates = stated_rates(entries, 1, units, origin, options)
        time_unit = single_unit(units.get(TIME))
        if time_unit is None and TIME in columns:
            time_unit = time_unit_in_name(columns[TIME])
        wrench = Columns.named(named, {ALL: ("", ()), **units}, "the table", origin)
        texts = {_OF_ROLE[role]: value for key, value in about.items() if (role := role_of(key)) in _OF_ROLE}
        return cls(
            scales=wrench.scales,
            time_unit=time_unit,
            rate_hz=None if rates is None else rates[0],
            texts={
                what: text for what, text in texts.items() if isinstance(text, str) and what not in columns
            },
            notes=[] if wrench.scales is None else [wrench.said(named)],
        )


def _metadata(labels: Mapping[str, str]) -> dict[str, Any]:
    """Return what the footer says in words of its own: also what pandas keeps of ``DataFrame.attrs``."""
    about: dict[str, Any] = {}
    for key, text in labels.items():
        try:
            value = json.loads(text) if len(text) <= _MOST_TEXT else None
        except (ValueError, RecursionError):
            value = text
        if key == "PANDAS_ATTRS" and isinstance(value, dict):
            about |= value
        elif key not in ("ARROW:schema", "pandas"):
            about[key] = value
    return {
        key: np.asarray(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else value
        for key, value in about.items()
    }


def _columns(parquet: CheckedParquet, label: str | None) -> dict[str, str]:
    """Return the name of the column that holds each axis, the time, the flags, the recording ..."""
    found: dict[str, str] = {}
    if label is not None and label not in parquet.columns:
        raise RecordingFileError(parquet.path, f"label={label!r} is no column of it")
    for name, kind in parquet.columns.items():
        meaning = split_unit(name)[0] or _MEANING.get(name.strip().lower())
        if name == _PANDAS_INDEX and str(kind).startswith(("timestamp", "duration")):
            meaning = TIME
        role = None if meaning else role_of(name)
        if role == "mask":
            problem = "tells which rows are samples: leave the others out first, and then the column"
            raise RecordingFileError(parquet.path, problem, column=name)
        meaning = RATE if role == "rate" else meaning
        if label is not None and (name == label or meaning == LABEL):
            meaning = LABEL if name == label else None
        if meaning is not None:
            if meaning in found:
                problem = (
                    f"columns {found[meaning]!r} and {name[:40]!r} both mean {meaning}; wanted one of them"
                )
                raise RecordingFileError(parquet.path, problem)
            found[meaning] = name
    missing = [axis for axis in AXES if axis not in found]
    if missing:
        other = [name for name in parquet.columns if name not in found.values()]
        hint = f"; {refusal(other[0])}" if other else ""
        raise RecordingFileError(parquet.path, f"no column for {', '.join(missing)}{hint}")
    return found


class _Table:
    """A decoded table, its columns called by what they mean."""

    def __init__(self, table: Any, columns: Mapping[str, str], path: Path, said: _Said) -> None:
        self._table = table
        self._columns = columns
        self._path = path
        self._arrow = need("pyarrow", extra="app", why="to read Parquet files")
        self.said = said
        self.rates = self._numbers(RATE) if RATE in columns else None
        self.wrench = np.stack([self._numbers(axis) for axis in AXES], axis=1)
        if said.scales is not None:
            self.wrench *= said.scales
        self.nanoseconds = self._nanoseconds()
        timed = TIME in columns and self.nanoseconds is None
        self.stamps = self._numbers(TIME) if timed else None
        self.flags = self._flags() if FLAGS in columns else None
        self._texts = {name: self._coded(name) for name in (LABEL, SESSION) if name in columns}

    def recordings(self, source_name: str) -> list[tuple[NDArray[np.intp], str]]:
        """Return the rows and the name of each recording, in the order in which they begin."""
        if RECORDING not in self._columns:
            return [(np.arange(self._table.num_rows), source_name)]
        name, column = self._filled(RECORDING)
        values: list[str | None] = []
        if self._arrow.types.is_dictionary(column.type):
            keys, values = coded_texts(self._table, name)
        else:
            keys = column.to_numpy()
        if keys.dtype.kind not in "iu":
            raise RecordingFileError(self._path, f"holds {column.type}; {_WANTED_NAMES}", column=name)
        kinds, firsts, codes = np.unique(keys, return_index=True, return_inverse=True)
        names = [str(values[kind]) if values else f"{source_name}[{kind}]" for kind in kinds.tolist()]
        rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
        return [(rows[i], names[i]) for i in np.argsort(firsts).tolist()]

    def one_text(self, meaning: str, rows: NDArray[np.intp], name: str) -> str | None:
        """Return what a recording's rows say of its label or session: all of them the same."""
        if meaning not in self._texts:
            return self.said.texts.get(meaning)
        codes, values = self._texts[meaning]
        said = {values[code] for code in np.unique(codes[rows]).tolist()}
        if len(said) > 1:
            shown = ", ".join(sorted(f"{text!r:.30}" for text in said))[:80]
            self._refuse(meaning, f"recording {name!r:.60} has {len(said)} values: {shown}; wanted one")
        text = said.pop()
        try:
            return None if text is None else checked_text(text, meaning, spaced=False)
        except ValueError as error:
            raise RecordingFileError(self._path, str(error), column=self._columns[meaning]) from error

    def rate_hz(self, rows: NDArray[np.intp]) -> float | None:
        """Return the rate that a recording's rows, or the whole table, state."""
        if self.rates is None:
            return self.said.rate_hz
        rates = np.unique(self.rates[rows])
        if len(rates) > 1 or rates[0] <= 0 or self.said.rate_hz not in (None, rates[0]):
            self._refuse(
                RATE, f"states rates of {rates[0]:g} ... {rates[-1]:g} Hz; wanted one for a recording"
            )
        return float(rates[0])

    def _numbers(self, meaning: str) -> FloatArray:
        name, column = self._filled(meaning)
        values = column.to_numpy()
        if values.dtype.kind not in "iuf":
            wanted = "seconds as numbers, or dates and times" if meaning == TIME else "numbers"
            self._refuse(meaning, f"holds {column.type}; wanted {wanted}")
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            place = f"row {bad[0]}"
            problem = f"is {values[bad[0]]}; wanted a finite number"
            raise RecordingFileError(self._path, problem, place=place, column=name)
        return np.asarray(values, np.float64)

    def _flags(self) -> NDArray[np.uint8]:
        values = self._numbers(FLAGS)
        wrong = np.flatnonzero((values != np.floor(values)) | (values < 0) | (values > KNOWN_FLAGS))
        if len(wrong):
            said = f"row {wrong[0]} holds {values[wrong[0]]:g}"
            self._refuse(FLAGS, f"{said}; wanted a sum of SampleFlag bits (0 to {KNOWN_FLAGS})")
        return values.astype(np.uint8)

    def _nanoseconds(self) -> NDArray[np.int64] | None:
        """Return dates and times as nanoseconds since 1970; None where the clock is one of numbers."""
        if TIME not in self._columns:
            return None
        kind = self._table.column(self._columns[TIME]).type
        if not self._arrow.types.is_timestamp(kind):
            return None
        _, column = self._filled(TIME)
        try:
            column = column.cast(self._arrow.timestamp("ns", kind.tz))
        except self._arrow.ArrowInvalid:
            self._refuse(TIME, "holds dates that no 64-bit count of nanoseconds reaches; wanted 1678 to 2261")
        return np.asarray(column.cast(self._arrow.int64()).to_numpy())

    def _coded(self, meaning: str) -> tuple[NDArray[np.int64], list[str | None]]:
        name = self._columns[meaning]
        kind = self._table.column(name).type
        if not self._arrow.types.is_dictionary(kind):
            self._refuse(meaning, f"holds {kind}; wanted texts")
        return coded_texts(self._table, name)

    def _filled(self, meaning: str) -> tuple[str, Any]:
        name = self._columns[meaning]
        column = self._table.column(name)
        if column.null_count:
            self._refuse(meaning, f"has {column.null_count} empty cells; wanted a value in every row")
        return name, column

    def _refuse(self, meaning: str, problem: str) -> NoReturn:
        raise RecordingFileError(self._path, problem, column=self._columns[meaning])


def _recording(
    table: _Table, rows: NDArray[np.intp], source: FileSource, options: LoadOptions
) -> tuple[Recording, dict[str, Any]]:
    def locate(sample: int | None) -> dict[str, Any]:
        place = f"recording {source.name!r:.60}"
        return {"place": place if sample is None else f"{place}, row {rows[sample]}"}

    stamps = None if table.stamps is None else table.stamps[rows]
    start_time = None
    if table.nanoseconds is not None:
        own = table.nanoseconds[rows]
        stamps, start_time = (own - own[0]) / 1e9, float(own[0]) / 1e9
    recording, remarks = stamped_recording(
        table.wrench[rows],
        source,
        options,
        stamps=stamps,
        start_time=start_time,
        flags=None if table.flags is None else table.flags[rows],
        locate=locate,
        time_unit="s" if table.nanoseconds is not None else table.said.time_unit,
        file_rate_hz=table.rate_hz(rows),
    )
    known = {name: table.one_text(name, rows, source.name) for name in (LABEL, SESSION)}
    return Recording._trusted(**{**vars(recording), **known}), remarks
