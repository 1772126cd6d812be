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
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Any

from granular_id.io.csv.numbers import plain_number, split_header, split_rows
from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.files import read_text_bounded
from granular_id.io.json_text import check_parts
from granular_id.io.source import FileSource

INDEX_NAME = "index.csv"
INDEX_COLUMNS = ("file", "label", "session", "start_time", "rate_hz", "trigger_index", "name", "meta")

IRREGULAR = "irregular"
"""What stands for a rate where a recording's own stamps are to be kept as they are."""

_WHOLE_NUMBER = re.compile(r"[0-9]{1,15}")


def read_index(
    root: Path, max_bytes: int, readable: Callable[[Path], bool]
) -> tuple[list[FileSource], list[RecordingFileError], list[str]]:
    """Read ``index.csv`` of a folder."""
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
    seen: dict[str, int] = {}
    rows = list(split_rows(data, header, path))
    if not rows:
        raise RecordingFileError(path, "has a header but lists no file", line=2)
    for line, cells in rows:
        source = attempt(problems, _listed, root, columns, cells, line, seen)
        if source is not None and not readable(source.path):
            problem = f"{cells[columns.index('file')]!r} is of no known format"
            problems.append(RecordingFileError(path, problem, line=line, column="file"))
            continue
        if source is not None:
            sources.append(source)
    return sources, problems, columns


def _listed(root: Path, columns: list[str], cells: list[str], line: int, seen: dict[str, int]) -> FileSource:
    """Make a source of one line, unless an earlier one (in `seen`) names the same file."""
    path = root / INDEX_NAME
    if len(cells) != len(columns):
        problem = f"{len(cells)} cells; wanted {len(columns)}, as in the header"
        raise RecordingFileError(path, problem, line=line)
    source = _source(root, dict(zip(columns, cells, strict=True)), line)
    key = source.path.as_posix()
    if key in seen:
        problem = f"{source.path.name!r} is already listed in line {seen[key]}"
        raise RecordingFileError(path, problem, line=line, column="file")
    seen[key] = line
    return source


def _source(root: Path, cells: dict[str, str], line: int) -> FileSource:
    def number(column: str) -> float | None:
        text = cells.get(column, "")
        value = plain_number(text) if text else None
        if text and value is None:
            problem = f"{text[:40]!r} is not a plain finite decimal number"
            raise RecordingFileError(root / INDEX_NAME, problem, line=line, column=column)
        return value

    trigger = cells.get("trigger_index", "")
    if trigger and not _WHOLE_NUMBER.fullmatch(trigger):
        problem = f"{trigger[:40]!r} is not a whole number"
        raise RecordingFileError(root / INDEX_NAME, problem, line=line, column="trigger_index")
    irregular = cells.get("rate_hz") == IRREGULAR
    rate_hz = None if irregular else number("rate_hz")
    if rate_hz is not None and rate_hz <= 0:
        problem = f"the rate must be positive, got {rate_hz:g}"
        raise RecordingFileError(root / INDEX_NAME, problem, line=line, column="rate_hz")
    meta = _meta(root, cells.get("meta", ""), line)
    extra = {column: text for column, text in cells.items() if column not in INDEX_COLUMNS and text}
    return FileSource(
        path=_inside(root, cells["file"], line),
        root=root,
        name=cells.get("name", cells["file"]),
        label=cells.get("label") or None,
        session=cells.get("session") or None,
        start_time=_start_time(root, cells.get("start_time", ""), line),
        rate_hz=rate_hz,
        irregular=irregular,
        trigger_index=int(trigger) if trigger else None,
        meta={**extra, **meta},
    )


def _start_time(root: Path, text: str, line: int) -> float | None:
    if not text:
        return None
    seconds = plain_number(text)
    if seconds is not None:
        return seconds
    try:
        # before Python 3.11 it knows no Z, and fractions of three or six digits only
        digits = re.sub(r"\.([0-9]+)", lambda fraction: f".{fraction[1]:0<6.6}", text)
        when = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", digits))
    except ValueError:
        when = None
    if when is None or when.tzinfo is None:
        problem = (
            f"{text[:40]!r} is no time; wanted seconds since 1970, or ISO 8601 with its zone, like "
            "2026-11-21T09:30:00+01:00"
        )
        raise RecordingFileError(root / INDEX_NAME, problem, line=line, column="start_time")
    return when.timestamp()


def _inside(root: Path, text: str, line: int) -> Path:
    """Turn a cell into a path under the folder; anything that could lead elsewhere is refused."""
    path = PurePosixPath(text)
    strange = any(c in text for c in "\\:") or not text.isprintable()
    if not path.name or path.is_absolute() or ".." in path.parts or strange:
        problem = f"{text[:80]!r} is not a file within the folder (like rice/rice_01.csv)"
        raise RecordingFileError(root / INDEX_NAME, problem, line=line, column="file")
    return root.joinpath(path)


def _meta(root: Path, text: str, line: int) -> dict[str, Any]:
    if not text:
        return {}
    try:
        check_parts([text], "meta")
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        problem = f"not a JSON object: {error}"
        raise RecordingFileError(root / INDEX_NAME, problem, line=line, column="meta") from error
    if not isinstance(value, dict):
        problem = f'a JSON {type(value).__name__}; wanted an object like {{"tool": "cylinder"}}'
        raise RecordingFileError(root / INDEX_NAME, problem, line=line, column="meta")
    return value
