"""How a text table begins and ends: its encoding, separator, names of columns, and whether it is whole."""

from __future__ import annotations

import codecs
import csv
import gzip
import os
import re
import sys
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import IO, Any, NamedTuple, cast

from granular_id._text import in_both
from granular_id.io.files import RecordingFileError
from granular_id.recording import AXES

SEPARATORS = (",", ";", "\t", "|")
NUMERIC = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?|[-+]?nan|[-+]?inf", re.IGNORECASE)

_LONGEST_ROW = 1 << 16
"""Bytes at the end of a text in which its last row is looked for."""

_HEAD_LINES = 60
"""Lines in which names of columns are looked for, for an error."""

_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
    codecs.BOM_UTF8: "utf-8-sig",
}
_SEP_LINE = re.compile(r'"?sep=(.)"?')


class Head(NamedTuple):
    """How a table begins: options for pandas, the first lines, the names and the number of the line that holds them."""

    path: Path
    options: dict[str, Any]
    lines: list[str]
    names: list[str]
    line: int
    below: int  # index of the line of samples that comes first, which may hold units
    is_whole: bool  # the last line has an end
    texts: list[int]  # columns that are read as they are written: labels, sessions, ids


def head_of(path: Path, given: Mapping[str, Any]) -> Head:
    """Find encoding, separator and names, as far as the options leave them open."""
    options: dict[str, Any] = dict(given)
    begins, is_whole = _both_ends(path)
    if not begins:
        raise RecordingFileError(path, "is empty (0 bytes)")
    mark = next((name for mark, name in _MARKS.items() if begins.startswith(mark)), None)
    if "encoding" in given:
        options["encoding"] = _own_encoding(path, str(given["encoding"]))
    elif mark is not None:
        options["encoding"] = mark
    elif b"\0" in begins[:2] and begins[:2] != b"\0\0":
        encoding = "utf-16-le" if begins[1] == 0 else "utf-16-be"
        raise RecordingFileError(
            path, ("may be UTF-16 text: pass ", in_both(csv={"encoding": encoding})), line=1
        )
    above = given.get("skiprows", 0)
    skipped = (
        range(above) if isinstance(above, int) else above if isinstance(above, (list, tuple, set)) else ()
    )
    lines = list(lines_of(path, options.get("encoding"), max(skipped, default=0) + _HEAD_LINES))
    if any("\0" in line for line in lines):
        raise RecordingFileError(path, "is binary (holds NUL bytes); wanted text", line=1)
    if not skipped and lines and (stated := _SEP_LINE.fullmatch(lines[0].strip(" "))):
        options.setdefault("sep", stated[1])
        options["skiprows"], skipped = 1, range(1)
    comment = str(given.get("comment") or "\n")
    shown = ((i, line) for i, line in enumerate(lines) if i not in skipped and line.strip())
    rows = [i for i, line in shown if not line.startswith(comment)]
    if not rows:
        n = sum(1 for line in lines if line.strip())
        problem = f"holds no line but the {n} that csv= leaves out" if n else "is empty"
        raise RecordingFileError(path, f"{problem}: no line names the columns", no_wrench=n > 0)
    i, below = rows[0], rows[0] if given.get("header", 0) is None else (*rows, rows[0] + 1)[1]
    line = lines[i]
    if not given.keys() & {"sep", "delimiter"}:
        by_one = {one: [cell.strip() for cell in line.split(one)] for one in SEPARATORS}
        figures = (
            one for one in (";", "\t") if len(by_one[one]) > 1 and all(map(NUMERIC.fullmatch, by_one[one]))
        )
        options.setdefault("sep", next(figures, max(SEPARATORS, key=lambda one: len(by_one[one]))))
        if len(line.split(options["sep"])) < 2 and len(line.split()) > 1:
            options["sep"] = r"\s+"
    cells = cells_of(line, options)
    if len(cells) > 1 and "comment" not in given and "names" not in given:
        cells[0] = cells[0].lstrip("#")  # as numpy.savetxt writes names
    cells[0] = cells[0].lstrip("%")  # as rostopic does
    return Head(path, options, lines, [cell.strip() for cell in cells], i + 1, below, is_whole, [])


def cells_of(line: str, options: Mapping[str, Any]) -> list[str]:
    """Return the cells of a line, without blanks and quotes around them."""
    separator = str(options.get("sep", options.get("delimiter")))
    if len(separator) > 1:
        cells = re.split(separator, line.strip())
    else:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip().strip('"').strip() for cell in cells]


def _opened(path: Path, mode: str, **how: Any) -> IO[Any]:
    """Open a text, packed or not."""
    if path.suffix.lower() == ".gz":
        return cast("IO[Any]", gzip.open(path, mode, **how))
    return path.open(mode, **how)


def _both_ends(path: Path) -> tuple[bytes, bool]:
    """Return the first four bytes of a text, and whether its last line has an end."""
    is_packed = path.suffix.lower() == ".gz"
    begins, end = _bytes_of(path, 0 if is_packed else 4)
    return begins, is_packed or end.rstrip(b"\0").endswith((b"\n", b"\r"))


def last_width(path: Path) -> int | None:
    """Return how many cells the last row of a text has; None of those with fewer than there are axes."""
    lines = _bytes_of(path, _LONGEST_ROW)[1].decode(errors="replace").splitlines()
    last = next((line for line in reversed(lines) if line.strip()), "")
    width = max(last.count(separator) for separator in SEPARATORS) + 1
    return width if width >= len(AXES) else None


def _bytes_of(path: Path, n_last: int) -> tuple[bytes, bytes]:
    """Return the first four bytes of a text and the last n; of a packed one, which has no end to go to, all."""
    try:
        with _opened(path, "rb") as file:
            begins = file.read(4)
            if path.suffix.lower() == ".gz":
                file.seek(0)
            else:
                file.seek(-min(n_last, path.stat().st_size), os.SEEK_END)
            return begins, file.read() if n_last else b""
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingFileError(path, f"cannot be read: {error}") from error


def lines_of(path: Path, encoding: object, n: int) -> Iterator[str]:
    """Yield the first lines of a file, whatever their encoding."""
    try:
        with _opened(path, "rt", encoding=str(encoding or "utf-8"), errors="replace", newline="") as file:
            for line in islice(file, n):
                yield line.rstrip("\r\n")
    except (OSError, EOFError, LookupError, UnicodeError, zlib.error) as error:
        raise RecordingFileError(path, f"cannot be read: {error}") from error


def refuse_half_row(head: Head) -> None:
    """Refuse a file whose last row has no end, and fewer cells than the row above."""
    is_known = head.is_whole or "skipfooter" in head.options
    lines = [] if is_known else list(lines_of(head.path, head.options.get("encoding"), sys.maxsize))
    n_cells = [len(cells_of(line, head.options)) for line in lines[-2:]]
    if len(n_cells) > 1 and len(lines) > head.below + 1 and n_cells[1] < n_cells[0]:
        problem = f"the file ends in the middle of a row ({n_cells[1]} of {n_cells[0]} cells): it is cut off; without "
        way = ("the last row, of each file, pass ", in_both(csv={"skipfooter": 1}))
        raise RecordingFileError(head.path, (problem, *way), line=len(lines))


def _own_encoding(path: Path, stated: str) -> str:
    """Return the encoding that is stated, or UTF-8 where the file is such text and would be another in that."""
    with suppress(LookupError), _opened(path, "rb") as file:
        data = file.read()
        own = _encoding_in(data)
        is_other = own.startswith("utf") and not codecs.lookup(stated).name.startswith("utf")
        if is_other and data.decode(own) != data.decode(stated, "replace"):
            return own
    return stated


def encoding_of(path: Path) -> str:
    """Return the encoding that the first bytes of a file name, or the first usual one that it may be in."""
    with _opened(path, "rb") as file:
        return _encoding_in(file.read())


def _encoding_in(data: bytes) -> str:
    """Return the encoding that the first bytes name, or the first usual one that they may be in."""
    mark = next((name for mark, name in _MARKS.items() if data.startswith(mark)), None)
    for encoding in (*filter(None, [mark]), "utf-8", "cp1252", "cp932", "gb18030"):
        try:
            data.decode(encoding)
        except UnicodeDecodeError:
            continue
        return encoding
    return "latin-1"
