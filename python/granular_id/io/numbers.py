"""The header of a CSV file, and the strict table of decimal numbers below it (read by the Rust core)."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._core import MAX_LINE_BYTES, NumberTableError, parse_number_table
from granular_id.io.columns import split_unit
from granular_id.io.errors import RecordingFileError
from granular_id.recording import AXES

_NUMBER = re.compile(r"[ \t]*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?[ \t]*")

PANDAS = "with pandas: read_csv(path, {}).to_csv(path, index=False)"
"""What to do about a table that is not read."""

_FIRST = 2
"""Line of the first row."""


class Header(NamedTuple):
    """Line 1 of a table: its cells without blanks and quotes, where line 2 begins, the separator (None: blanks)."""

    names: list[str]
    end: int
    separator: str | None


def split_header(data: bytes, path: str | PathLike[str], axes: Sequence[str] = AXES) -> Header:
    """Split line 1; ``#`` before the names, as numpy.savetxt writes it, is left out.

    Blanks part them where all `axes` are among what they part.
    """
    if not data:
        raise RecordingFileError(path, "is empty (0 bytes)")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise RecordingFileError(path, "is UTF-16 text; wanted UTF-8", line=1)
    start = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    end = data.find(b"\n", start, start + MAX_LINE_BYTES + 1)
    if end < 0:
        end = len(data)
    header = data[start : min(end, start + MAX_LINE_BYTES)]
    if b"\0" in header:
        raise RecordingFileError(path, "is binary (holds NUL bytes); wanted text", line=1)
    if end - start > MAX_LINE_BYTES:
        raise RecordingFileError(path, f"the line is longer than {MAX_LINE_BYTES} bytes", line=1)
    try:
        text = header.decode("utf-8")
    except UnicodeDecodeError as error:
        raise RecordingFileError(
            path, f"byte 0x{header[error.start]:02x} is not UTF-8 text", line=1
        ) from error
    text = text.removesuffix("\r")
    if "\r" in text:
        raise RecordingFileError(path, "lines end with a bare carriage return; wanted LF or CR LF", line=1)
    if text.startswith("#"):
        if data[end + 1 : end + 2] == b"#":
            how = "comment='#', names=[...]"
            problem = "is a second line that begins with #; wanted the names of the columns in line 1, alone"
            raise RecordingFileError(path, f"{problem}; {PANDAS.format(how)}", line=2)
        text = text[1:]
    for separator in () if "," in text else (";", "\t", "|", None):
        cells = text.split(separator)
        if len(cells) > 1 and (separator or set(axes) <= {*cells, *(split_unit(cell)[0] for cell in cells)}):
            return Header([_plain(cell) for cell in cells], end + 1, separator)
    return Header([_plain(cell) for cell in text.split(",")], end + 1, ",")


def split_rows(data: bytes, header: Header, path: str | PathLike[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each line that is not empty; quoted cells may hold separators."""
    start = header.end
    try:
        text = data[start:].decode("utf-8")
    except UnicodeDecodeError as error:
        line = _FIRST + data.count(b"\n", start, start + error.start)
        problem = f"byte 0x{data[start + error.start]:02x} is not UTF-8 text"
        raise RecordingFileError(path, problem, line=line) from error
    if "\0" in text:
        problem = "is binary (holds NUL bytes); wanted text"
        line = _FIRST + text.count("\n", 0, text.index("\0"))
        raise RecordingFileError(path, problem, line=line)
    if header.separator is None:
        yield from ((line, row.split()) for line, row in enumerate(text.split("\n"), _FIRST) if row.strip())
        return
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=header.separator)
    line = _FIRST
    try:
        for cells in reader:
            if cells:
                yield line, cells
            line = reader.line_num + _FIRST
    except csv.Error as error:
        raise RecordingFileError(path, f"is not valid CSV: {error}", line=line) from error


def parse_numbers(
    data: bytes, start: int, columns: Sequence[str], path: str | PathLike[str]
) -> NDArray[np.float64]:
    """Return the numbers from byte `start` on, where line 2 begins; shape (T, len(columns)).

    Numbers are plain decimals (``-1.5e-3``), with or without blanks around them. Empty lines may stand at the
    end.
    """
    try:
        return parse_number_table(data, start, len(columns))
    except NumberTableError as error:
        row, column, problem = error.args
        name = None if column is None else columns[column]
        raise RecordingFileError(path, problem, line=row + _FIRST, column=name) from error


def picked_columns(
    data: bytes,
    header: Header,
    numeric: Sequence[int],
    texts: Sequence[int],
    path: str | PathLike[str],
) -> tuple[NDArray[np.float64], dict[int, list[str]]]:
    """Return some columns of a table that has others too: numbers, shape (T, len(numeric)), and the cells of texts."""
    where = [header.names[i] for i in numeric]
    kept: list[str] = []
    others: dict[int, list[str]] = {i: [] for i in texts}
    for line, cells in split_rows(data, header, path):
        if len(cells) != len(header.names):
            problem = f"{len(cells)} cells; wanted {len(header.names)}, as in the header"
            raise RecordingFileError(path, problem, line=line)
        if line != len(kept) + _FIRST:
            problem = "the line is empty, or a quoted cell goes on in it"
            raise RecordingFileError(path, problem, line=len(kept) + _FIRST)
        row = [cells[i] for i in numeric]
        kept.append(",".join(row))
        if kept[-1].count(",") != len(row) - 1:
            wrong, cell = next((i, cell) for i, cell in enumerate(row) if "," in cell)
            way_out = PANDAS.format(f"sep={header.separator!r}, decimal=','")
            problem = f"{cell[:40]!r} is no number with a decimal point; {way_out}"
            raise RecordingFileError(path, problem, line=line, column=where[wrong])
        for i, values in others.items():
            values.append(cells[i].strip())
    return parse_numbers("\n".join(kept).encode(), 0, where, path), others


def plain_number(text: str) -> float | None:
    """Return a finite plain decimal number, or None: no ``nan``, ``1e999``, ``1_000``, ``0x10``."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def _plain(cell: str) -> str:
    cell = cell.strip()
    quoted = len(cell) > 1 and cell[0] == cell[-1] == '"'
    return (cell[1:-1] if quoted else cell).strip()
