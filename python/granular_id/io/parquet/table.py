"""Parquet of others: one table of samples in a file, of one recording or of many."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._text import counted
from granular_id.io.columns import (
    FLAGS,
    LABEL,
    MASK,
    RATE,
    RECORDING,
    SESSION,
    TIME,
    ColumnError,
    axes_shown,
    columns_of,
    split_unit,
)
from granular_id.io.errors import RecordingFileError, attempt, need
from granular_id.io.long_table import LongTable, Stated, recordings_of, refuse_mask
from granular_id.io.options import LoadOptions
from granular_id.io.parquet.archive import Archive, coded_texts
from granular_id.io.parquet.layout import MARK, labels_of, open_parquet
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES

_PANDAS_INDEX = "__index_level_0__"
"""As pandas calls an index without a name."""

_WANTED_NAMES = "wanted whole numbers or texts that name recordings"


def read_parquet(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an archive that ``save_parquet`` wrote, or a table with columns fx fy fz tx ty tz.

    A table may have columns time, flags, recording, label and session. Rows with the same value in the column
    ``recording`` make a recording, in the order of the file; without that column the whole file is one. Where the
    columns hold lists, each row is a recording. Columns that mean nothing here are not read, and a note says so.
    """
    path, most = source.path, options.max_binary_bytes
    if path.is_dir():
        data = Archive(path).read()
        known: dict[str, Any] = {"start_time": source.start_time, "trigger_index": source.trigger_index}
        known = {name: value for name, value in known.items() if value is not None}
        return FileContent(recordings=[replace(one, **known) for one in data], history=data.history)
    with open_parquet(path, source.root, most) as opened:
        schema = opened.schema_arrow
        columns = _columns(schema, source, options)
        units = {field.name: unit for field in schema if (unit := _unit_of(field))}
        labels = labels_of(opened)
        if MARK in labels:
            raise RecordingFileError(path, "is part of an archive; wanted the folder of the archive")
        about = _metadata(labels)
        stated = Stated.of(columns, path, options, about=about, units_of_columns=units)
        table = opened.read(list(columns.values()))
        table.validate(full=True)
    if not table.num_rows:
        raise RecordingFileError(path, "holds no samples")
    axes = options.axes or AXES
    found, remarked = recordings_of(_Columns(table, columns, axes, path).decoded(stated), source, options)
    unread = ", ".join(name for name in schema.names if name not in columns.values())[:200]
    notes = [*stated.notes, *([f"columns that are not read: {unread}"] if unread else [])]
    return FileContent(recordings=found, rows=remarked, notes=notes, obeyed=("axes", "session"))


def parquet_parts(source: FileSource, options: LoadOptions) -> Iterator[FileContent | RecordingFileError]:
    """Read the same, an archive a row group at a time; what of it cannot be read and is to be left out comes last."""
    stated = (
        source.start_time is not None or source.trigger_index is not None
    )  # which only one recording may have
    if not source.path.is_dir() or stated:
        yield read_parquet(source, options)
        return
    problems: list[RecordingFileError] = []
    unreadable = problems if options.on_error == "skip" else None
    archive = Archive(source.path, unreadable=unreadable)
    history = archive.history if unreadable is None else attempt(problems, lambda: archive.history) or ()
    for group in archive.row_groups:
        try:
            yield FileContent(recordings=archive.read(group).recordings, history=history)
        except RecordingFileError as error:  # noqa: PERF203
            if unreadable is None:
                raise
            lost = f"{error.problem}; its {counted(group.stop - group.start)} left out"
            problems.append(RecordingFileError(error.path, lost, place=f"row group {group.row_group}"))
    yield from problems


def _metadata(labels: Mapping[str, str]) -> dict[str, Any]:
    """Return what the footer says in words of its own: also what pandas keeps of ``DataFrame.attrs``."""
    about: dict[str, Any] = {}
    for key, text in labels.items():
        try:
            value = json.loads(text)
        except ValueError:
            value = text
        if key == "PANDAS_ATTRS" and isinstance(value, dict):
            about |= value
        elif key not in ("ARROW:schema", "pandas"):
            about[key] = value
    return {
        key: np.asarray(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else value
        for key, value in about.items()
    }


def _unit_of(field: Any) -> str | None:
    """Return what the metadata of a column say of its unit."""
    about = {key.lower(): value for key, value in (field.metadata or {}).items()}
    said = about.get(b"units", about.get(b"unit", b""))
    return said.decode("utf-8", "replace").strip() or None


def _columns(schema: Any, source: FileSource, options: LoadOptions) -> dict[str, str]:
    """Return the name of the column that holds each axis, the time, the flags, the recording ..."""
    names, kinds = schema.names, schema.types
    dated = {
        name: TIME
        for name, kind in zip(names, kinds, strict=True)
        if name == _PANDAS_INDEX and str(kind).startswith(("timestamp", "duration"))
    }
    try:
        session = source.session_column(options)
        found = columns_of(names, label=options.label, session=session, axes=options.axes, known=dated)
    except ColumnError as error:
        lists = (name for name, kind in zip(names, kinds, strict=True) if _is_list(kind))
        six = next((name for name in lists if split_unit(name)[0] is None), None)
        wide = f"frame[{list(AXES)}] = frame[{six!r:.60}].tolist()"
        split = f"; if {six!r:.60} holds a wrench in each row, with pandas: {wide}"
        numbers = [
            names[i] for i in error.others if str(kinds[i]).startswith(("float", "double", "int", "uint"))
        ]
        other = f"; {axes_shown(numbers)}" if numbers else ""
        raise RecordingFileError(source.path, error.problem + (split if six else other)) from error
    return {meaning: names[i] for meaning, i in found.items()}


def _is_list(kind: Any) -> bool:
    return str(kind).startswith(("list<", "large_list<", "fixed_size_list<"))


class _Columns:
    """A table that was read, its columns called by what they mean: categories decoded, lists as long columns."""

    def __init__(self, table: Any, names: Mapping[str, str], axes: tuple[str, ...], path: Path) -> None:
        self._arrow = need("pyarrow", extra="app", why="to read Parquet files")
        self._names, self._axes, self._path = names, axes, path
        types = self._arrow.types
        self._table = {}
        for meaning, name in names.items():
            column = table.column(name)
            if types.is_dictionary(column.type):  # its indices may be of any width
                column = column.cast(column.type.value_type)
            self._table[meaning] = column
        self._row_of_sample = self._expanded()

    def decoded(self, stated: Stated) -> LongTable:
        names = self._names
        if MASK in names:
            refuse_mask(self._filled(MASK).unique().to_pylist(), names[MASK], self._path)
        nanoseconds = self._nanoseconds() if TIME in names else None
        keys, values = self._keys() if RECORDING in names else (self._row_of_sample, None)

        def place(recording: str, row: int | None) -> dict[str, Any]:
            said = f"recording {recording!r:.60}"
            return {"place": said if row is None else f"{said}, row {row}"}

        return LongTable(
            np.stack([self._numbers(axis) for axis in self._axes], axis=1),
            self._axes,
            names,
            stated,
            place,
            stamps=self._numbers(TIME) if TIME in names and nanoseconds is None else None,
            nanoseconds=nanoseconds,
            flags=self._numbers(FLAGS) if FLAGS in names else None,
            rates=self._numbers(RATE) if RATE in names else None,
            keys=keys,
            names=values,
            texts={meaning: self._coded(meaning) for meaning in (LABEL, SESSION) if meaning in names},
        )

    def _expanded(self) -> NDArray[np.intp] | None:
        """Make a row of each sample where a row is a recording; return the row that each was in."""
        listed = {meaning for meaning, column in self._table.items() if _is_list(column.type)}
        if not listed:
            return None
        compute = need("pyarrow.compute", extra="app", why="to read Parquet files")
        for meaning in (*self._axes, *({TIME, FLAGS} & set(self._names))):
            if meaning not in listed:
                other = self._names[min(listed)]
                self._refuse(meaning, f"holds a value a row, {other!r} a list; wanted lists in both")
        lengths = {
            m: compute.list_value_length(self._filled(m)).to_numpy() for m in self._table if m in listed
        }
        first = lengths[self._axes[0]]
        for meaning, own in lengths.items():
            wrong = np.flatnonzero((own != first) | (own < 1))
            if len(wrong):
                wanted = f"as many as {self._names[self._axes[0]]!r}, and at least one"
                self._refuse(meaning, f"row {wrong[0]} has {own[wrong[0]]} values; wanted {wanted}")
        rows = np.repeat(np.arange(len(first)), first)
        for meaning, column in self._table.items():
            self._table[meaning] = compute.list_flatten(column) if meaning in listed else column.take(rows)
        return rows

    def _keys(self) -> tuple[NDArray[Any], list[str | None] | None]:
        """Return which recording each row belongs to, and what the keys are called if they are no numbers."""
        column = self._filled(RECORDING)
        if self._is_text(column):
            return self._coded(RECORDING)
        keys = column.to_numpy()
        if keys.dtype.kind not in "iu":
            self._refuse(RECORDING, f"holds {column.type}; {_WANTED_NAMES}")
        return keys, None

    def _numbers(self, meaning: str) -> FloatArray:
        column = self._filled(meaning)
        values = column.to_numpy()
        if values.dtype.kind not in "iuf":
            wanted = "seconds as numbers, or dates and times" if meaning == TIME else "numbers"
            self._refuse(meaning, f"holds {column.type}; wanted {wanted}")
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            problem = f"is {values[bad[0]]}; wanted a finite number"
            raise RecordingFileError(self._path, problem, place=f"row {bad[0]}", column=self._names[meaning])
        return np.asarray(values, np.float64)

    def _nanoseconds(self) -> NDArray[np.int64] | None:
        """Return dates and times as nanoseconds since 1970; None where the clock is one of numbers."""
        kind = self._table[TIME].type
        if not self._arrow.types.is_timestamp(kind):
            return None
        try:
            column = self._filled(TIME).cast(self._arrow.timestamp("ns", kind.tz))
        except self._arrow.ArrowInvalid:
            self._refuse(TIME, "holds dates that no 64-bit count of nanoseconds reaches; wanted 1678 to 2261")
        return np.asarray(column.cast(self._arrow.int64()).to_numpy())

    def _coded(self, meaning: str) -> tuple[NDArray[np.int64], list[str | None]]:
        column = self._table[meaning]
        if not self._is_text(column):
            self._refuse(meaning, f"holds {column.type}; wanted texts")
        return coded_texts(column.cast(self._arrow.large_string()).dictionary_encode())

    def _is_text(self, column: Any) -> bool:
        return str(column.type) in ("string", "large_string", "string_view")

    def _filled(self, meaning: str) -> Any:
        column = self._table[meaning]
        if column.null_count:
            self._refuse(meaning, f"has {column.null_count} empty cells; wanted a value in every row")
        return column

    def _refuse(self, meaning: str, problem: str) -> NoReturn:
        raise RecordingFileError(self._path, problem, column=self._names[meaning])
