"""A strict table of decimal numbers from the bytes of a CSV file.

A fast pass (numpy's C parser) reads what is clean. Where it stumbles, or where a byte occurs that no
plain decimal number has, a slow pass with the same rules goes over the same lines and names the first fault.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError

MAX_LINE_BYTES = 4096
"""Longest line: seven numbers of 25 characters need 181."""

_CHUNK_BYTES = 1 << 20
_NUMBER_BYTES = b"0123456789+-.eE,\n \t"
_NUMBER = re.compile(r"[ \t]*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?[ \t]*")


def split_header(data: bytes, path: str | PathLike[str]) -> tuple[list[str], int]:
    """Return the cells of line 1 (lower case, without blanks and quotes) and where line 2 begins.

    Raises
    ------
    RecordingFileError
        Empty, binary, not UTF-8, a separator other than a comma, an over-long first line.
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
    for separator, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if separator in text and "," not in text:
            problem = f"columns are separated by {name}; wanted commas (and points in decimal numbers)"
            raise RecordingFileError(path, problem, line=1)
    return [_plain(cell) for cell in text.split(",")], end + 1


def parse_numbers(
    data: bytes, start: int, columns: Sequence[str], path: str | PathLike[str]
) -> NDArray[np.float64]:
    """Return the numbers from byte `start` on (the beginning of line 2), shape (T, len(columns)).

    Numbers are plain decimals (``-1.5e-3``), with or without blanks around them. Empty lines may stand at the
    end.

    Raises
    ------
    RecordingFileError
        With line and column: what is not a number, not finite as float64, missing or too much.
    """
    end = len(data.rstrip(b"\r\n \t"))
    if end <= start:
        raise RecordingFileError(path, "has a header but no samples", line=2)
    # a row has at least two bytes per cell, so a file of bare line ends cannot ask for more memory than this
    most = min(data.count(b"\n", start, end) + 1, (end - start) // (2 * len(columns)) + 1)
    values = np.empty((most, len(columns)))
    filled = 0
    while start < end:
        stop = data.find(b"\n", min(start + _CHUNK_BYTES, end), end)
        stop = end if stop < 0 else stop
        chunk = data[start:stop]
        if b"\r" in chunk:
            chunk = chunk.replace(b"\r\n", b"\n").removesuffix(b"\r")
        rows = _parse_fast(chunk, len(columns))
        if rows is None:
            rows = _parse_slowly(chunk.split(b"\n"), filled + 2, columns, path)
        values[filled : filled + len(rows)] = rows
        filled += len(rows)
        start = stop + 1
    return values[:filled]


def plain_number(text: str) -> float | None:
    """Return a finite plain decimal number, or None: no ``nan``, ``1e999``, ``1_000``, ``0x10``."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def _plain(cell: str) -> str:
    cell = cell.strip()
    quoted = len(cell) > 1 and cell[0] == cell[-1] == '"'
    return (cell[1:-1] if quoted else cell).strip().lower()


def _parse_fast(chunk: bytes, n_columns: int) -> NDArray[np.float64] | None:
    """Return the numbers, or None when anything at all is unusual."""
    if chunk.translate(None, _NUMBER_BYTES):
        return None
    lines = chunk.decode("ascii").split("\n")
    if max(map(len, lines)) > MAX_LINE_BYTES or not all(lines):  # numpy would skip empty lines
        return None
    try:
        values = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2, dtype=np.float64)
    except ValueError:
        return None  # the slow pass reads the same lines and names the place
    return values if values.shape == (len(lines), n_columns) and np.isfinite(values).all() else None


def _parse_slowly(
    lines: Sequence[bytes], first_line: int, columns: Sequence[str], path: str | PathLike[str]
) -> NDArray[np.float64]:
    """Return the numbers, or raise at the first fault."""
    values = np.empty((len(lines), len(columns)))
    for i, line in enumerate(lines):
        number = first_line + i
        if len(line) > MAX_LINE_BYTES:
            raise RecordingFileError(path, f"the line is longer than {MAX_LINE_BYTES} bytes", line=number)
        if b"\0" in line:
            raise RecordingFileError(path, "is binary (holds NUL bytes); wanted text", line=number)
        if not line:
            raise RecordingFileError(path, "the line is empty; only the end of a file may be", line=number)
        cells = line.decode("ascii", "backslashreplace").split(",")
        for j, (column, cell) in enumerate(zip(columns, cells, strict=False)):
            value = plain_number(cell)
            if value is None:
                raise RecordingFileError(path, _cell_problem(cell), line=number, column=column)
            values[i, j] = value
        if len(cells) != len(columns):
            problem = f"{len(cells)} cells; wanted {len(columns)}, as in the header"
            raise RecordingFileError(path, problem, line=number)
    return values


def _cell_problem(cell: str) -> str:
    if not cell.strip():
        return "the cell is empty; wanted a number"
    shown = repr(cell.strip()[:40]) + ("..." if len(cell.strip()) > 40 else "")
    if _NUMBER.fullmatch(cell):
        return f"{shown} is too large for float64"
    return f"{shown} is not a plain decimal number"
