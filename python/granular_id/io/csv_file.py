"""One CSV file to one ``Recording``.

Line 1 names the columns, in any order and case: ``fx fy fz tx ty tz`` (N, N m), optionally ``time`` or
``timestamp`` (seconds) and ``flags`` (bits of ``SampleFlag``). Names with units (``fx_mN``) and other columns
are refused: what they hold would have to be guessed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.csv_numbers import parse_numbers, split_header
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import read_text_bounded
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import AXES, SampleFlag

TIME_NAMES = ("time", "timestamp")
FLAGS_NAME = "flags"


def read_csv(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file as one recording; see ``stamped_recording`` for what its stamps mean.

    Raises
    ------
    RecordingFileError
        With the line and column of the first fault.
    """
    data = read_text_bounded(source.path, source.root, options.max_text_bytes)
    header, start = split_header(data, source.path)
    columns = _checked_columns(header, source.path)
    values = parse_numbers(data, start, columns, source.path)
    time_name = next((name for name in TIME_NAMES if name in columns), None)

    def locate(sample: int | None) -> dict[str, Any]:
        if sample is None:
            return {"column": time_name} if time_name else {"line": 1}
        return {"line": sample + 2, "column": time_name}

    recording, remarks = stamped_recording(
        np.ascontiguousarray(values[:, [columns.index(axis) for axis in AXES]]),
        source,
        options,
        stamps=np.ascontiguousarray(values[:, columns.index(time_name)]) if time_name else None,
        flags=_flags(values[:, columns.index(FLAGS_NAME)], source.path) if FLAGS_NAME in columns else None,
        locate=locate,
        clock="time column",
    )
    if not data.endswith(b"\n"):
        remarks = {"remark": "no line end after the last line: it may be cut off", **remarks}
    return FileContent([recording], [{"name": recording.name, **remarks}] if remarks else [])


def _checked_columns(header: list[str], path: Path) -> list[str]:
    known = (*AXES, *TIME_NAMES, FLAGS_NAME)
    wanted = f"wanted {', '.join(AXES)}, and optionally time or timestamp (seconds)"
    for i, name in enumerate(header):
        if name not in known:
            problem = f"unknown column {name[:40]!r}; {wanted}; neither units in names nor other columns"
            raise RecordingFileError(path, problem, line=1, column=str(i + 1))
        if name in header[:i]:
            raise RecordingFileError(path, f"column {name!r} occurs twice", line=1, column=str(i + 1))
    missing = [axis for axis in AXES if axis not in header]
    if missing:
        raise RecordingFileError(path, f"column {missing[0]!r} is missing; {wanted}", line=1)
    if all(name in header for name in TIME_NAMES):
        raise RecordingFileError(path, "has both a time and a timestamp column; wanted one of them", line=1)
    return header


def _flags(column: NDArray[np.float64], path: Path) -> NDArray[np.uint8]:
    wrong = np.flatnonzero((column != np.floor(column)) | (column < 0) | (column > sum(SampleFlag)))
    if len(wrong):
        problem = f"{column[wrong[0]]:g} is not a sum of SampleFlag bits (0 to {sum(SampleFlag)})"
        raise RecordingFileError(path, problem, line=int(wrong[0]) + 2, column=FLAGS_NAME)
    return column.astype(np.uint8)
