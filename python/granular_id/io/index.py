"""``index.csv``: what is known about the files of a folder, one line per recording.

Column ``file`` (path within the folder) is needed; ``label``, ``session``, ``start_time`` (seconds since 1970,
or ISO 8601 with its zone), ``rate_hz`` (or ``irregular``: keep the stamps), ``trigger_index``, ``name`` and
``meta`` (a JSON object) may follow in any order, empty cells meaning "not known". Any other column goes into each
recording's ``meta`` as text.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Any

from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.files import check_parts, read_text_bounded
from granular_id.io.numbers import plain_number, split_header, split_rows
from granular_id.io.source import FileSource

INDEX_NAME = "index.csv"
INDEX_COLUMNS = ("file", "label", "session", "start_time", "rate_hz", "trigger_index", "name", "meta")

IRREGULAR = "irregular"
"""What stands for a rate where a recording's own stamps are to be kept as they are."""

_WHOLE_NUMBER = re.compile(r"[0-9]{1,15}")


def read_index(
    root: Path, max_bytes: int, readable: Callable[[Path], bool]
) -> tuple[list[FileSource], list[RecordingFileError], list[str]]:
    """Read ``index.csv`` of a folder: what it lists in its order, the lines that cannot be used, its columns."""
    path = root / INDEX_NAME
    data = read_text_bounded(path, root, max_bytes)
    header = split_header(data, path)
    columns = [column.lower() for column in header.names]
    for i, column in enumerate(columns):
        if not column or not column.isprintable() or column in columns[:i]:
            problem = (
                f"column {column!r} occurs twice"
                if column in columns[:i]
                else "the column has no proper name"
            )
            raise RecordingFileError(path, problem, line=1, column=str(i + 1))
    if "file" not in columns:
        wanted = ", ".join(map(repr, INDEX_COLUMNS))
        raise RecordingFileError(path, f"no column 'file'; wanted {wanted}", line=1)
    sources: list[FileSource] = []
    problems: list[RecordingFileError] = []
    lines: dict[Path, int] = {}
    rows = list(split_rows(data, header, path))
    if not rows:
        raise RecordingFileError(path, "has a header but lists no file", line=2)
    for line, cells in rows:
        source = attempt(problems, _source, root, columns, cells, line)
        if source is None:
            continue
        problem = "" if readable(source.path) else "is of no known format"
        if source.path in lines:
            problem = f"is already listed in line {lines[source.path]}"
        if problem:
            problem = f"{cells[columns.index('file')]!r} {problem}"
            problems.append(RecordingFileError(path, problem, line=line, column="file"))
        else:
            sources.append(source)
        lines.setdefault(source.path, line)
    return sources, problems, columns


def _source(root: Path, columns: list[str], cells: list[str], line: int) -> FileSource:
    path = root / INDEX_NAME
    if len(cells) != len(columns):
        raise RecordingFileError(
            path, f"{len(cells)} cells; wanted {len(columns)}, as in the header", line=line
        )
    texts = dict(zip(columns, cells, strict=True))
    known: dict[str, Any] = {}
    for column, value_of in _VALUES.items():
        text = texts.get(column, "")
        try:
            known[column] = value_of(text) if text or column == "file" else None
        except (TypeError, ValueError, RecursionError) as error:
            raise RecordingFileError(path, str(error), line=line, column=column) from error
    irregular = known["rate_hz"] == IRREGULAR
    extra = {column: text for column, text in texts.items() if column not in INDEX_COLUMNS and text}
    return FileSource(
        path=root.joinpath(known["file"]),
        root=root,
        name=texts.get("name", texts["file"]),
        label=texts.get("label") or None,
        session=texts.get("session") or None,
        start_time=known["start_time"],
        rate_hz=None if irregular else known["rate_hz"],
        irregular=irregular,
        trigger_index=known["trigger_index"],
        meta={**extra, **(known["meta"] or {})},
    )


def _inside(text: str) -> PurePosixPath:
    """Turn a cell into a path under the folder; anything that could lead elsewhere is refused."""
    path = PurePosixPath(text)
    strange = any(c in text for c in "\\:") or not text.isprintable()
    if not path.name or path.is_absolute() or ".." in path.parts or strange:
        raise ValueError(f"{text[:80]!r} is not a file within the folder (like rice/rice_01.csv)")
    return path


def _start_time(text: str) -> float:
    seconds = plain_number(text)
    if seconds is not None:
        return seconds
    with suppress(ValueError):
        # before Python 3.11 it knows no Z, and fractions of three or six digits only
        digits = re.sub(r"\.([0-9]+)", lambda fraction: f".{fraction[1]:0<6.6}", text)
        when = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", digits))
        if when.tzinfo is not None:
            return when.timestamp()
    wanted = "seconds since 1970, or ISO 8601 with its zone, like 2026-11-21T09:30:00+01:00"
    raise ValueError(f"{text[:40]!r} is no time; wanted {wanted}")


def _rate(text: str) -> float | str:
    if text == IRREGULAR:
        return text
    value = plain_number(text)
    if value is None or value <= 0:
        raise ValueError(f"{text[:40]!r} is no rate; wanted a plain positive number of Hz, or {IRREGULAR}")
    return value


def _trigger(text: str) -> int:
    if not _WHOLE_NUMBER.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is not a whole number")
    return int(text)


def _meta(text: str) -> dict[str, Any]:
    check_parts([text], "meta")
    value = json.loads(text)
    if not isinstance(value, dict):
        raise TypeError(f'a JSON {type(value).__name__}; wanted an object like {{"tool": "cylinder"}}')
    return value


_VALUES: dict[str, Callable[[str], Any]] = {
    "trigger_index": _trigger,
    "rate_hz": _rate,
    "meta": _meta,
    "file": _inside,
    "start_time": _start_time,
}
"""What stands in the cells of columns that are no plain texts."""
