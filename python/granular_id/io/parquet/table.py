"""A single Parquet file that somebody else wrote: one table of samples, of one recording or of many."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.io.columns import (
    FLAGS,
    LABEL,
    MASK,
    RATE,
    RECORDING,
    SESSION,
    TIME,
    ColumnError,
    columns_of,
    split_unit,
)
from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.long_table import LongTable, Stated, recordings_of, refuse_mask
from granular_id.io.options import LoadOptions
from granular_id.io.parquet.file import TEXTS, CheckedParquet, is_list, open_parquet
from granular_id.io.parquet.index import coded_texts
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES, KNOWN_FLAGS

__all__ = ["read_parquet_table"]

_PANDAS_INDEX = "__index_level_0__"
"""As pandas calls an index without a name."""

_MOST_TEXT = 1 << 20
"""Characters of an entry of the footer that is looked into."""

_WANTED_NAMES = "wanted whole numbers or texts that name recordings"


def read_parquet_table(source: FileSource, options: LoadOptions) -> FileContent:
    """Read a table with columns fx fy fz tx ty tz, and optionally time, flags, recording, label and session.

    Rows with the same value in the column ``recording`` make a recording, in the order of the file; without that
    column the whole file is one. Where the columns hold lists, each row is a recording. A recording has one label and
    one session. Columns that mean nothing here are not read, and a note says so.

    Raises
    ------
    RecordingFileError
        A column is missing, stands there twice, or has cells that are empty or of another kind; a recording with
        two labels; what `stamped_recording` says of the clock.
    """
    path, root, most = source.path, source.root, options.max_binary_bytes
    with open_parquet(path, root, most) as parquet:
        columns = _columns(parquet, options.label)
        about = _metadata(parquet.labels)
        stated = Stated.of(columns, path, options, about=about, units_of_columns=parquet.units)
        text = [name for name in columns.values() if str(parquet.columns[name]) in TEXTS]
    with open_parquet(path, root, most, texts=text) as parquet:
        if not sum(parquet.rows):
            raise RecordingFileError(path, "holds no samples")
        parquet.check(list(columns.values()))
        arrow = need("pyarrow", extra="app", why="to read Parquet files")
        parts = [parquet.read(group, list(columns.values())) for group in range(len(parquet.rows))]
        whole = arrow.concat_tables(parts).unify_dictionaries()
        table = _decoded(_Columns(whole, columns, path), stated)
        unread = [name for name in parquet.columns if name not in columns.values()]
    notes = [*stated.notes, *([f"columns that are not read: {', '.join(unread)[:200]}"] if unread else [])]
    found, remarked = recordings_of(table, source, options)
    return FileContent(recordings=found, rows=remarked, notes=notes)


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
    names = list(parquet.columns)
    dated = str(parquet.columns.get(_PANDAS_INDEX)).startswith(("timestamp", "duration"))
    try:
        found = columns_of(names, label=label, known={_PANDAS_INDEX: TIME} if dated else None)
    except ColumnError as error:
        lists = (name for name, kind in parquet.columns.items() if is_list(kind))
        six = next((name for name in lists if split_unit(name)[0] is None), None)
        wide = f"frame[{list(AXES)}] = frame[{six!r:.60}].tolist()"
        split = f"; if {six!r:.60} holds a wrench in each row, with pandas: {wide}"
        raise RecordingFileError(parquet.path, error.problem + (split if six else "")) from error
    return {meaning: names[i] for meaning, i in found.items()}


def _decoded(columns: _Columns, stated: Stated) -> LongTable:
    known = columns.names
    if MASK in known:
        refuse_mask(columns.kinds(MASK), known[MASK], columns.path)
    nanoseconds = columns.nanoseconds() if TIME in known else None
    keys, names = columns.keys() if RECORDING in known else (columns.lists, None)

    def place(recording: str, row: int | None) -> dict[str, Any]:
        said = f"recording {recording!r:.60}"
        return {"place": said if row is None else f"{said}, row {row}"}

    return LongTable(
        np.stack([columns.numbers(axis) for axis in AXES], axis=1),
        known,
        stated,
        place,
        stamps=columns.numbers(TIME) if TIME in known and nanoseconds is None else None,
        nanoseconds=nanoseconds,
        flags=columns.flags() if FLAGS in known else None,
        rates=columns.numbers(RATE) if RATE in known else None,
        keys=keys,
        names=names,
        texts={name: columns.coded(name) for name in (LABEL, SESSION) if name in known},
    )


class _Columns:
    """A decoded table, its columns called by what they mean.

    Attributes
    ----------
    lists : ndarray of int, or None
        Which row of the file each sample lies in, where a row is a recording and its columns hold lists.
    """

    def __init__(self, table: Any, names: Mapping[str, str], path: Path) -> None:
        self.names = names
        self.lists: NDArray[np.intp] | None = None
        self._table = table
        self.path = path
        self._arrow = need("pyarrow", extra="app", why="to read Parquet files")
        listed = {name: meaning for meaning, name in names.items() if is_list(table.column(name).type)}
        if listed:
            self._expand(listed)

    def _expand(self, listed: Mapping[str, str]) -> None:
        """Make a row of each sample."""
        compute = need("pyarrow.compute", extra="app", why="to read Parquet files")
        for meaning in (*AXES, *({TIME, FLAGS} & set(self.names))):
            if self.names[meaning] not in listed:
                self._refuse(
                    meaning, f"holds a value a row, {next(iter(listed))!r} a list; wanted lists in both"
                )
        lengths = {}
        for name, meaning in listed.items():
            lengths[name] = compute.list_value_length(self._filled(meaning)[1]).to_numpy()
        first = next(iter(lengths.values()))
        for name, own in lengths.items():
            wrong = np.flatnonzero((own != first) | (own < 1))
            if len(wrong):
                wanted = f"as many as {self.names['fx']!r}, and at least one"
                problem = f"row {wrong[0]} has {own[wrong[0]]} values; wanted {wanted}"
                self._refuse(listed[name], problem)
        rows = np.repeat(np.arange(len(first)), first)
        self.lists = rows
        whole = {name: self._table.column(name) for name in self.names.values()}
        self._table = self._arrow.table(
            {
                name: compute.list_flatten(column) if name in listed else column.take(rows)
                for name, column in whole.items()
            }
        )

    def keys(self) -> tuple[NDArray[Any], list[str | None] | None]:
        """Return which recording each row belongs to, and what the keys are called if they are no numbers."""
        name, column = self._filled(RECORDING)
        if self._arrow.types.is_dictionary(column.type):
            return coded_texts(self._table, name)
        keys = column.to_numpy()
        if keys.dtype.kind not in "iu":
            self._refuse(RECORDING, f"holds {column.type}; {_WANTED_NAMES}")
        return keys, None

    def kinds(self, meaning: str) -> list[Any]:
        """Return the values that stand in a column, each once."""
        found: list[Any] = self._filled(meaning)[1].unique().to_pylist()
        return found

    def numbers(self, meaning: str) -> FloatArray:
        name, column = self._filled(meaning)
        values = column.to_numpy()
        if values.dtype.kind not in "iuf":
            wanted = "seconds as numbers, or dates and times" if meaning == TIME else "numbers"
            self._refuse(meaning, f"holds {column.type}; wanted {wanted}")
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            place = f"row {bad[0]}"
            problem = f"is {values[bad[0]]}; wanted a finite number"
            raise RecordingFileError(self.path, problem, place=place, column=name)
        return np.asarray(values, np.float64)

    def flags(self) -> NDArray[np.uint8]:
        values = self.numbers(FLAGS)
        wrong = np.flatnonzero((values != np.floor(values)) | (values < 0) | (values > KNOWN_FLAGS))
        if len(wrong):
            said = f"row {wrong[0]} holds {values[wrong[0]]:g}"
            self._refuse(FLAGS, f"{said}; wanted a sum of SampleFlag bits (0 to {KNOWN_FLAGS})")
        return values.astype(np.uint8)

    def nanoseconds(self) -> NDArray[np.int64] | None:
        """Return dates and times as nanoseconds since 1970; None where the clock is one of numbers."""
        kind = self._table.column(self.names[TIME]).type
        if not self._arrow.types.is_timestamp(kind):
            return None
        _, column = self._filled(TIME)
        try:
            column = column.cast(self._arrow.timestamp("ns", kind.tz))
        except self._arrow.ArrowInvalid:
            self._refuse(TIME, "holds dates that no 64-bit count of nanoseconds reaches; wanted 1678 to 2261")
        return np.asarray(column.cast(self._arrow.int64()).to_numpy())

    def coded(self, meaning: str) -> tuple[NDArray[np.int64], list[str | None]]:
        name = self.names[meaning]
        kind = self._table.column(name).type
        if not self._arrow.types.is_dictionary(kind):
            self._refuse(meaning, f"holds {kind}; wanted texts")
        return coded_texts(self._table, name)

    def _filled(self, meaning: str) -> tuple[str, Any]:
        name = self.names[meaning]
        column = self._table.column(name)
        if column.null_count:
            self._refuse(meaning, f"has {column.null_count} empty cells; wanted a value in every row")
        return name, column

    def _refuse(self, meaning: str, problem: str) -> NoReturn:
        raise RecordingFileError(self.path, problem, column=self.names[meaning])
