"""One CSV file to one ``Recording``.

Line 1 names the columns, in any order: the six axes of a wrench (N, N m), and optionally a time (seconds) and
``flags`` (bits of ``SampleFlag``). ``columns`` lists the names that are known. Names with other units (``fx_mN``)
and other columns are refused: what they hold would have to be guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.columns import FLAGS, TIME, ColumnError, columns_of
from granular_id.io.csv.numbers import parse_numbers, split_header
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import read_text_bounded
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import AXES, SampleFlag


def read_csv(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file as one recording; see ``stamped_recording`` for what its stamps mean.

    Raises
    ------
    RecordingFileError
        With the line and column of the first fault.
    """
    data = read_text_bounded(source.path, source.root, options.max_text_bytes)
    header, start = split_header(data, source.path)
    columns = _columns(header, source.path)
    values = parse_numbers(data, start, header, source.path)
    time_name = header[columns[TIME]] if TIME in columns else None

    def locate(sample: int | None) -> dict[str, Any]:
        if sample is None:
            return {"column": time_name} if time_name else {"line": 1}
        return {"line": sample + 2, "column": time_name}

    recording, remarks = stamped_recording(
        _wrench(values, columns),
        source,
        options,
        stamps=np.ascontiguousarray(values[:, columns[TIME]]) if TIME in columns else None,
        flags=_flags(values[:, columns[FLAGS]], source.path) if FLAGS in columns else None,
        locate=locate,
        clock="time column",
    )
    if not data.endswith(b"\n"):
        remarks = {"remark": "no line end after the last line: it may be cut off", **remarks}
    rows = [{"name": recording.name, **remarks}] if remarks else []
    return FileContent([recording], rows, _renamed(header, columns))


def _columns(header: list[str], path: Path) -> dict[str, int]:
    try:
        return columns_of(header)
    except ColumnError as error:
        column = None if error.index is None else str(error.index + 1)
        raise RecordingFileError(path, error.problem, line=1, column=column) from error


def _wrench(values: NDArray[np.float64], columns: Mapping[str, int]) -> NDArray[np.float64]:
    """Return the six axes, in memory of their own that nobody can write to."""
    wrench = np.ascontiguousarray(values[:, [columns[axis] for axis in AXES]])
    wrench.flags.writeable = False
    return wrench


def _renamed(header: list[str], columns: Mapping[str, int]) -> list[str]:
    names = {header[i]: axis for axis, i in columns.items() if header[i].lower() not in (axis, "timestamp")}
    if not names:
        return []
    return [f"columns {', '.join(map(repr, names))} taken as {', '.join(names.values())}"]


def _flags(column: NDArray[np.float64], path: Path) -> NDArray[np.uint8]:
    wrong = np.flatnonzero((column != np.floor(column)) | (column < 0) | (column > sum(SampleFlag)))
    if len(wrong):
        problem = f"{column[wrong[0]]:g} is not a sum of SampleFlag bits (0 to {sum(SampleFlag)})"
        raise RecordingFileError(path, problem, line=int(wrong[0]) + 2, column=FLAGS)
    return column.astype(np.uint8)
