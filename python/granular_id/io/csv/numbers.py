"""The header of a CSV file, and the strict table of decimal numbers below it (read by the Rust core)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from granular_id._core import MAX_LINE_BYTES, NumberTableError, parse_number_table
from granular_id.io.columns import axis_of
from granular_id.io.errors import RecordingFileError
from granular_id.recording import AXES

_NUMBER = re.compile(r"[ \t]*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?[ \t]*")


def split_header(data: bytes, path: str | PathLike[str]) -> tuple[list[str], int]:
    """Return the cells of line 1 (without blanks and quotes around them) and where line 2 begins.

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
    for separator, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars"), (None, "blanks")):
        parts = text.split(separator) if "," not in text else []
        if len(parts) > 1 and (separator or set(AXES) <= {axis_of(part) for part in parts}):
            problem = f"columns are separated by {name}; wanted commas (and points in decimal numbers)"
            raise RecordingFileError(path, problem, line=1)
    return [_plain(cell) for cell in text.split(",")], end + 1


def parse_numbers(
    data: bytes, start: int, columns: Sequence[str], path: str | PathLike[str], *, first_line: int = 2
) -> NDArray[np.float64]:
    """Return the numbers from byte `start` on (the beginning of line `first_line`), shape (T, len(columns)).

    Numbers are plain decimals (``-1.5e-3``), with or without blanks around them. Empty lines may stand at the
    end.

    Raises
    ------
    RecordingFileError
        With line and column: what is not a number, not finite as float64, missing or too much.
    """
    try:
        return parse_number_table(data, start, len(columns))
    except NumberTableError as error:
        row, column, problem = error.args
        name = None if column is None else columns[column]
        raise RecordingFileError(path, problem, line=row + first_line, column=name) from error


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
