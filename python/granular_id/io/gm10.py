"""GM10-ts and GM10-ts-Plus: public force recordings of 10 granular materials, one recording per row of a CSV file.

A row without a header is ``id, times ..., forces ...`` (GM10-ts: an odd number of cells) or
``id, a, v, d, times ..., forces ...`` (GM10-ts-Plus: an even number), as the README and the loader of the data set's
own repository (Benjizhang/GmClass) have it. ``docs/formats/gm10.md`` says what of this is stated there and what is
assumed here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from granular_id._checks import FloatArray, checked_text
from granular_id._core import NumberTableError, parse_number_table
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import open_bounded, read_bounded
from granular_id.io.numbers import first_line, plain_number
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import Recording

AXES = ("force",)

_MAX_FILE_BYTES = 512 * 1024 * 1024
"""Default cap: the larger set is 140 MB zipped; rows are read one at a time and the first bad one ends it."""

_MAX_ROW_BYTES = 1 << 20
_MAX_NAMES_BYTES = 1 << 16
_LEAST_CELLS = 21
"""Rows with fewer cells are taken for ordinary tables."""

_SETTINGS = ("a", "v", "d")
_SPLIT = re.compile(r"(.+)_(train|valid|test[0-9]*)", re.IGNORECASE)


def is_gm10(path: Path) -> bool:
    """Tell whether a CSV file holds rows of GM10-ts, from its first row alone.

    No header, more than 20 cells, all plain numbers; a whole number first; then stamps that increase and as many
    values.
    """
    line = first_line(path, _MAX_ROW_BYTES)
    cells = line.decode("ascii", "replace").rstrip("\r\n").split(",")
    numbers = [plain_number(cell) for cell in cells] if len(cells) >= _LEAST_CELLS else [None]
    if None in numbers:
        return False
    values = np.array(numbers, np.float64)
    start, middle = _spans(len(values))
    return _is_id(float(values[0])) and bool((np.diff(values[start:middle]) > 0).all())


def read_gm10(source: FileSource, options: LoadOptions) -> FileContent:
    """Read all rows of a file as recordings with the one axis ``force`` (N).

    The label is the material's id; where the list of names that comes with the data set lies beside the file
    (``HKUGM10_ts.txt`` beside ``HKUGM10_ts_train.csv``), the name. a, v and d stand in ``meta`` where they are given.
    """
    names = _material_names(source)
    most = _MAX_FILE_BYTES if options.max_file_bytes is None else options.max_file_bytes
    recordings: list[Recording] = []
    content = FileContent(recordings)
    odd = 0
    for line, values in _rows(source, most):
        if recordings and len(values) % 2 != odd:
            problem = f"{len(values)} cells; the rows before have an {'odd' if odd else 'even'} number"
            raise RecordingFileError(source.path, f"{problem} (with a, v, d: even)", line=line)
        odd = len(values) % 2
        named = replace(source, name=f"{source.name}[{len(recordings)}]")
        recording, remarks = _recording(line, values, named, options, names)
        recordings.append(recording)
        content.rows += [{"name": recording.name, **remarks}] if remarks else []
    if not recordings:
        raise RecordingFileError(source.path, "holds no rows")
    kind = "GM10-ts (id, times, forces)" if odd else "GM10-ts-Plus (id, a, v, d, times, forces)"
    content.notes.append(f"rows taken as {kind}")
    if names is None:
        content.notes.append("labels are the ids of the materials: no list of names lies beside the file")
    return content


def _spans(n_cells: int) -> tuple[int, int]:
    """Return where the stamps and where the forces of a row begin."""
    start = 1 + len(_SETTINGS) * (n_cells % 2 == 0)
    return start, start + (n_cells - start) // 2


def _is_id(value: float) -> bool:
    return 0 <= value < 1e6 and value == int(value)


def _rows(source: FileSource, max_bytes: int) -> Iterator[tuple[int, FloatArray]]:
    path = source.path
    with open_bounded(path, source.root, max_bytes) as (file, _):
        number = 0
        while data := file.readline(_MAX_ROW_BYTES + 1):
            number += 1
            if len(data) > _MAX_ROW_BYTES:
                raise RecordingFileError(path, f"the line is longer than {_MAX_ROW_BYTES} bytes", line=number)
            data = data.rstrip(b"\r\n")
            if not data:  # the rest is looked at as a whole: millions of empty lines would take minutes
                if file.read(_MAX_ROW_BYTES).strip(b"\r\n") or file.read(1):
                    raise RecordingFileError(
                        path, "the line is empty; only the end of a file may be", line=number
                    )
                return
            yield number, _numbers(data, path, number)


def _numbers(line: bytes, path: Path, number: int) -> FloatArray:
    """Return the cells of one row, by the rules of every CSV file here: as a table that has a row per cell."""
    cells = line.split(b",")
    empty = next((i for i, cell in enumerate(cells) if not cell.strip()), None)
    if empty is not None or b"\r" in line:
        problem = "the cell is empty; wanted a number"
        if empty is None:
            problem = "holds a bare carriage return"
        raise RecordingFileError(path, problem, line=number, column=str(1 + (empty or 0)))
    if len(cells) < _LEAST_CELLS:
        wanted = f"id, [a, v, d,] times and forces, at least {_LEAST_CELLS} in all"
        problem = f"{len(cells)} cells; wanted {wanted}"
        raise RecordingFileError(path, problem, line=number)
    try:
        return parse_number_table(b"\n".join(cells), 0, 1)[:, 0]
    except NumberTableError as error:
        cell, _, problem = error.args
        raise RecordingFileError(path, problem, line=number, column=str(cell + 1)) from error


def _recording(
    line: int, values: FloatArray, source: FileSource, options: LoadOptions, names: list[str] | None
) -> tuple[Recording, dict[str, Any]]:
    start, middle = _spans(len(values))

    def locate(sample: int | None) -> dict[str, Any]:
        return {"line": line} if sample is None else {"line": line, "column": str(start + sample + 1)}

    if not _is_id(float(values[0])):
        problem = f"the material's id is {values[0]:g}; wanted 0, 1, 2 ..."
        raise RecordingFileError(source.path, problem, line=line, column="1")
    material = int(values[0])
    if names is not None and material >= len(names):
        problem = f"the material's id is {material}, but the list of names beside the file has {len(names)}"
        raise RecordingFileError(source.path, problem, line=line, column="1")
    settings = dict(zip(_SETTINGS, values[1:start].tolist(), strict=False))
    return stamped_recording(
        values[middle:, None].copy(),
        source,
        options,
        stamps=values[start:middle],
        label=str(material) if names is None else names[material],
        axes=AXES,
        meta=settings,
        locate=locate,
        time_unit="s",
    )


def _material_names(source: FileSource) -> list[str] | None:
    """Return the names of the materials, in order of their ids, where the data set's list lies beside the file."""
    split = _SPLIT.fullmatch(source.path.stem)
    path = source.path.with_name(f"{split[1] if split else source.path.stem}.txt")
    if not path.is_file():
        return None
    data = read_bounded(path, source.root, _MAX_NAMES_BYTES)
    try:
        lines = [line.strip() for line in data.decode("utf-8-sig").splitlines()]
        names = [
            checked_text(line, f"line {i}") for i, line in enumerate(lines, start=1) if line or i < len(lines)
        ]
    except ValueError as error:  # also UnicodeDecodeError
        raise RecordingFileError(path, f"is no list of names, one a line: {error}") from error
    return names or None
