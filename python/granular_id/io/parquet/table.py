"""Parquet: an archive, or a table of others: one recording a file, or many that a column tells apart."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._text import counted
from granular_id.io.files import RecordingFileError, attempt
from granular_id.io.parquet.archive import Archive
from granular_id.io.parquet.layout import MARK, labels_of, open_parquet
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.io.ways_out import frames_line, reshaped
from granular_id.recording import AXES, Table, meaning_of, stated_beside

_INDEX = "__index_level_0__"
"""As pandas calls an index without a name."""


def read_parquet(source: FileSource, _: LoadOptions) -> FileContent:
    """Read an archive that ``save_parquet`` wrote, or a table with a row a sample."""
    if source.path.is_dir():
        data = Archive(source.path).read()
        return FileContent(recordings=data.recordings, history=data.history)
    with open_parquet(source.path, source.root) as opened:
        if MARK in labels_of(opened):
            what = "is part of an archive, or was made of one; wanted the folder of the archive"
            raise RecordingFileError(source.path, what)
        table = opened.read(use_threads=False)
        table.validate(full=True)
    if not table.num_rows:
        raise RecordingFileError(source.path, "holds no samples")
    columns = {name: _values(table.column(i)) for i, name in enumerate(table.column_names)}
    if _INDEX in columns and columns[_INDEX].dtype.kind in "mM":
        columns["time" if "time" not in columns else _INDEX] = columns.pop(_INDEX)
    units, beside = stated_beside(table)
    read = Table(name=source.name, columns=columns, units=units, beside=beside)
    opening = "pandas.read_parquet({})"
    has_axes = source.axes is not None or any(meaning_of(name).what in AXES for name in columns)
    if not has_axes and (mend := reshaped(columns)):
        problem = f"names none of {', '.join(AXES)}; there are {', '.join(columns)[:200]}"
        raise RecordingFileError(source.path, (problem, *frames_line(opening, source, read, mend)))

    def place(_: int, row: int | None) -> dict[str, Any]:
        return {} if row is None else {"place": f"row {row}"}

    return FileContent(
        [read],
        place=place,
        in_python=partial(frames_line, opening, source, read),
    )


def parquet_parts(source: FileSource, options: LoadOptions) -> Iterator[FileContent | RecordingFileError]:
    """Read the same, an archive a row group at a time; what of it cannot be read and is to be left out comes last."""
    if not source.path.is_dir():
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
            lost = (*error.parts, f"; its {counted(group.stop - group.start)} left out")
            problems.append(RecordingFileError(error.path, lost, place=f"row group {group.row_group}"))
    yield from problems


def _values(column: Any) -> NDArray[Any]:
    """Return a column as numpy has it: empty cells of numbers as NaN, categories as what they mean, dates in UTC."""
    kind = str(column.type)
    if kind.startswith("dictionary"):  # its indices may be of any width
        column = column.cast(column.type.value_type)
    return np.asarray(column.to_numpy())
