"""``index.csv``: what is known about the files of a folder, a line each.

Column ``file`` (path within the folder; or ``filename``, ``path``) is needed; ``label`` (or ``material``), ``session``,
``start_time`` (seconds since 1970, or a date, of UTC where it states no zone), ``rate_hz`` (or ``irregular``: keep the
stamps), ``trigger_index``, ``name``, ``meta`` (a JSON object) and ``axes`` (a JSON list, or names with commas between
them) may follow in any order, empty cells meaning "not known". Any other column goes into ``meta`` as text.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any

from granular_id._core import GranularIdError
from granular_id.io.csv_head import encoding_of
from granular_id.io.files import RecordingFileError, attempt
from granular_id.io.flat import checked_history, history_json
from granular_id.io.source import FileSource
from granular_id.recording import LABEL, SESSION, Dataset, StepReport, checked_axes, meaning_of

INDEX_NAME = "index.csv"
INDEX_COLUMNS = ("file", "label", "session", "start_time", "rate_hz", "trigger_index", "name", "meta", "axes")
"""The last one is there where recordings have other axes than the six of a wrench."""

_FILES = frozenset(
    (
        *("files", "filename", "filenames", "filepath", "path", "paths"),
        *("datei", "dateiname", "fichier", "archivo", "tiedosto", "nomefile"),
    )
)
"""Other names of the column ``file``, without what stands between words."""

_WITHOUT_ZONE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d([T ][\d:.]+)?")

IRREGULAR = "irregular"
"""What stands for a rate where a recording's own stamps stay as they are."""

HISTORY_NAME = "history.json"
"""Beside index.csv: the steps that made the data set, see ``StepReport.to_dict``."""


def read_index(
    root: Path, problems: list[RecordingFileError], notes: list[str], stated: Mapping[str, Any]
) -> tuple[list[str], list[FileSource]]:
    """Return the columns of the index of a folder, and what it lists; lines that cannot be used go to `problems`."""
    path = root / INDEX_NAME
    rows = _rows(path, notes)
    line, names = next(rows, (1, None))
    if names is None:
        raise RecordingFileError(path, "is empty (0 bytes)")
    columns = [column.strip().lower() for column in names]
    for i, column in enumerate(columns):
        if not column or not column.isprintable() or column in columns[:i]:
            problem = f"column {column!r} occurs twice" if column else "the column has no proper name"
            raise RecordingFileError(path, problem, line=line, column=str(i + 1))
    if "file" not in columns:
        of_files = [i for i, column in enumerate(columns) if re.sub(r"[\W_]", "", column) in _FILES]
        if len(of_files) != 1:
            wanted = ", ".join(map(repr, INDEX_COLUMNS))
            problem = f"no column 'file'; wanted {wanted}: call the one with the paths of the files so"
            raise RecordingFileError(path, problem, line=line)
        columns[of_files[0]] = "file"
    called: dict[str, str] = {}
    for what in (LABEL, SESSION):  # material, class: as in tables
        alike = [i for i, column in enumerate(columns) if meaning_of(column).what == what]
        if what not in columns and len(alike) == 1:
            called[columns[alike[0]]] = what
            columns[alike[0]] = what
    lines: dict[Path, int] = {}
    found: list[FileSource] = []
    for line, cells in rows:
        source = attempt(problems, _indexed, root, columns, called, cells, line, stated)
        if source is None:
            continue
        if source.path in lines:
            problem = f"{cells[columns.index('file')]!r} is already listed in line {lines[source.path]}"
            problems.append(RecordingFileError(path, problem, line=line, column="file"))
            continue
        found.append(source)
        lines[source.path] = line
        text = dict(zip(columns, cells, strict=True)).get("start_time", "")
        if _WITHOUT_ZONE.fullmatch(text.strip()) and not any("no zone" in note for note in notes):
            notes.append(f"start_time {text.strip()!r} of {INDEX_NAME} states no zone: taken as UTC")
    if not found and not problems:
        raise RecordingFileError(path, "has a header but lists no file", line=2)
    return columns, found


def column_of_files(path: Path, names: Collection[str]) -> tuple[str, str] | None:
    """Return the column of a table that lists files of its folder with labels or sessions, and the ending left out."""
    if path.suffix.lower() != ".csv":
        return None
    with suppress(RecordingFileError, ValueError):
        (_, columns), (_, cells) = islice(_rows(path, []), 2)
        if not {meaning_of(column).what for column in columns} & {LABEL, SESSION}:
            return None  # results, as a mean of each
        for column, cell in zip(columns, cells, strict=True):
            ending = next((name.removeprefix(cell) for name in names if cell and name.startswith(cell)), None)
            if ending is not None and "/" not in ending and (not ending or ending[0] == "."):
                return column, ending
    return None


def read_history(path: Path) -> tuple[StepReport, ...]:
    """Read the steps that made a data set, stored beside its index."""
    try:
        return checked_history(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror}") from error
    except (ValueError, TypeError) as error:
        raise RecordingFileError(path, f"is no history of a data set: {error}") from error


def write_history(dataset: Dataset, folder: Path) -> None:
    """Write the steps that made a data set into its folder, where there were any."""
    if dataset.history:
        (folder / HISTORY_NAME).write_text(history_json(dataset), encoding="utf-8")


def _rows(path: Path, notes: list[str]) -> Any:
    """Yield the number and the cells of each line that is not empty."""
    try:
        encoding = encoding_of(path)
        text = path.read_bytes().decode(encoding)
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror}") from error
    notes += [] if encoding.startswith("utf") else [f"{path.name} is no UTF-8 text: read as {encoding}"]
    head = text.partition("\n")[0]
    separator = next((one for one in (",", ";", "\t") if one in head), ",")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for cells in reader:
            if cells:
                yield reader.line_num, cells
    except csv.Error as error:
        raise RecordingFileError(path, f"is not valid CSV: {error}", line=reader.line_num) from error


def _indexed(
    root: Path,
    columns: Sequence[str],
    called: Mapping[str, str],
    cells: Sequence[str],
    line: int,
    stated: Mapping[str, Any],
) -> FileSource:
    path = root / INDEX_NAME
    if len(cells) != len(columns):
        problem = f"{len(cells)} cells; wanted {len(columns)}, as in the header"
        raise RecordingFileError(path, problem, line=line)
    texts = dict(zip(columns, cells, strict=True))
    known: dict[str, Any] = {}
    for column, value_of in _VALUES.items():
        text = texts.get(column, "")
        try:
            known[column] = value_of(text) if text or column == "file" else None
        except (TypeError, ValueError, RecursionError) as error:
            raise RecordingFileError(path, str(error), line=line, column=column) from error
    named: dict[str, Any] = {}
    for what in (LABEL, SESSION):  # an option may name a column of the index
        name = (stated.get(f"{what}_from") or "").partition(":")[2] or dict(stated["columns"]).get(what, "")
        name = called.get(name.lower(), name.lower())
        if name in columns:
            named |= {what: texts[name] or None, f"{what}_from": None}
    named["columns"] = tuple(one for one in stated["columns"] if one[0] not in named)
    irregular = known["rate_hz"] == IRREGULAR
    others = {column: text for column, text in texts.items() if column not in INDEX_COLUMNS and text}
    own = {
        "label": texts.get("label") or None,
        "session": texts.get("session") or None,
        "label_place": INDEX_NAME,
        "session_place": INDEX_NAME,
        "start_time": known["start_time"],
        "rate_hz": None if irregular else known["rate_hz"] or stated["rate_hz"],
        "irregular": irregular,
        "trigger_index": known["trigger_index"],
        "axes": stated["axes"] or known["axes"],
        "meta": {**others, **(known["meta"] or {}), **stated["meta"]},
    }
    path = root.joinpath(known["file"])
    return FileSource(
        path=path, root=root, name=texts.get("name", texts["file"]), **{**stated, **own, **named}
    )


def _inside(text: str) -> PurePosixPath:
    path = PurePosixPath(text)
    strange = any(c in text for c in "\\:") or not text.isprintable()
    if not path.name or path.is_absolute() or ".." in path.parts or strange:
        raise GranularIdError(f"{text[:80]!r} is not a file within the folder (like rice/rice_01.csv)")
    return path


def _start_time(text: str) -> float:
    with suppress(ValueError):
        if math.isfinite(seconds := float(text)):
            return seconds
    with suppress(ValueError):
        # before Python 3.11 it knows no Z, and fractions of three or six digits only
        digits = re.sub(r"\.([0-9]+)", lambda fraction: f".{fraction[1]:0<6.6}", text)
        digits = digits.replace("/", "-") if _WITHOUT_ZONE.fullmatch(text.strip()) else digits
        when = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", digits.strip()))
        return when.timestamp() if when.tzinfo is not None else when.replace(tzinfo=timezone.utc).timestamp()
    wanted = "seconds since 1970, or a date like 2026-11-21, 2026-11-21 09:30:00 or 2026-11-21T09:30:00+01:00"
    raise GranularIdError(f"{text[:40]!r} is no time; wanted {wanted}")


def _rate(text: str) -> float | str:
    with suppress(ValueError):
        if text == IRREGULAR or 0 < float(text) < math.inf:
            return text if text == IRREGULAR else float(text)
    raise GranularIdError(f"{text[:40]!r} is no rate; wanted a positive number of Hz, or {IRREGULAR}")


def _trigger(text: str) -> int:
    if not text.isdecimal():
        raise GranularIdError(f"{text[:40]!r} is not a whole number")
    return int(text)


def _meta(text: str) -> dict[str, Any]:
    value = json.loads(text)
    if not isinstance(value, dict):
        raise TypeError(f'a JSON {type(value).__name__}; wanted an object like {{"tool": "cylinder"}}')
    return value


def _axes(text: str) -> tuple[str, ...]:
    listed = json.loads(text) if text.startswith("[") else [name.strip() for name in text.split(",")]
    return checked_axes(tuple(listed), (0, len(listed)))


_VALUES: dict[str, Callable[[str], Any]] = {
    "axes": _axes,
    "trigger_index": _trigger,
    "rate_hz": _rate,
    "meta": _meta,
    "file": _inside,
    "start_time": _start_time,
}
"""What stands in the cells of columns that are no plain texts."""
