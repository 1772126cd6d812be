"""What a folder of recordings holds, before any of them is read.

Three layouts, recognised in this order:

1. ``index.csv`` lists the files (see below); files it does not list are not read.
2. ``label/*``: a sub-folder per label; with one more level, ``label/session/*``.
3. ``label_*``: all files in one folder, the label being the name up to the last underscore; a name without one
   gives none.

Folders that are no label are recognised: ``label=rice`` and ``session=3`` state them, any other ``key=value`` is kept
in ``meta``, and so is, as ``split``, a level on which all folders are called train, test, validation or alike. Below
them the layouts are the same.

Files of every known format count, several side by side too, and folders that are a recording themselves (ROS 2
bags). They are read in natural order (``rice_2`` before ``rice_10``). Sessions come from the index, the files or
the third level; elsewhere they stay None, because a guess would hide leakage between sessions. Hidden files and
files of no known format are passed over.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

from granular_id._text import counted, verb
from granular_id.io.columns import ABOUT, LABEL, SESSION
from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.files import check_parts, list_folder, read_bounded, read_text_bounded, refuse_outside
from granular_id.io.flat import checked_history
from granular_id.io.folder_save import HISTORY_NAME, INDEX_COLUMNS, INDEX_NAME, IRREGULAR
from granular_id.io.formats import format_of
from granular_id.io.numbers import plain_number, split_header, split_rows
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.recording import StepReport, checked_axes

_FOLDERS, _INDEX = "label/*.csv, label/session/*.csv", "or an index.csv with the columns file and label"
LAYOUTS = f"{_FOLDERS}, label_*.csv, {_INDEX}"

OTHER_FILES = (
    "a table with names of columns in line 1 is read under a name that ends with .csv; anything else from arrays: "
    "numpy.savez('all.npz', X=X, labels=labels, fs=rate), X of shape (recordings, samples, axes)"
)
"""What to do about files of no known format."""

_SPLITS = frozenset(("train", "training", "test", "testing", "val", "valid", "validation"))
_STATED = re.compile(r"(\w+)=(.+)")
_WHOLE_NUMBER = re.compile(r"[0-9]{1,15}")
_MOST_DEEP = 12
"""Folders within each other; more are a circle of links."""

_LOOKED_AT = 100
"""Folders that are looked into for what to say of one without recordings."""


@dataclass
class FoundFiles:
    """The files of a folder and what is known of them."""

    layout: str
    sources: list[FileSource] = field(default_factory=list)
    problems: list[RecordingFileError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    history: Sequence[StepReport] = ()
    columns: Sequence[str] = ()  # of index.csv


def find_files(root: Path, options: LoadOptions) -> FoundFiles:
    """Find the recordings of a folder."""
    entries, folders = _listed(root, root)
    if any(path.name == INDEX_NAME for path in entries):
        return _find_indexed(root, [*entries, *_below(folders, root)], options)
    nested = _find_nested(root, folders)
    nested.notes += _not_read(root, folders)
    if entries and (nested.sources or nested.problems):
        both = f"recordings both here ({entries[0].name!r}) and in sub-folders"
        problem = f"{both}; wanted one layout: {LAYOUTS}"
        raise RecordingFileError(root, problem)
    if entries:
        flat = _find_flat(root, entries)
        flat.notes += _not_read(root, [])
        return flat
    if not nested.sources and not nested.problems:
        problem = f"holds no recordings; wanted {LAYOUTS} (or files of another format)"
        raise RecordingFileError(root, problem + _found_instead(root))
    return nested


def _not_read(root: Path, folders: Sequence[Path]) -> list[str]:
    """Say which files of no known format lie beside recordings."""
    files = [path for folder in (root, *folders) for path in list_folder(folder)[0]]
    others = [path.suffix or path.name for path in files if format_of(path) is None]
    if not others:
        return []
    kinds = ", ".join(ending for ending, _ in Counter(others).most_common(3))
    n = len(others)
    return [f"{counted(n, 'file')} of no known format {verb(n, 'is', 'are')} not read ({kinds})"]


def _found_instead(root: Path) -> str:
    """Say what lies in a folder in which there are no recordings where they are looked for."""
    endings: list[str] = []
    for seen, (place, _, names) in enumerate(os.walk(root)):
        for path in sorted(Path(place) / name for name in names if not name.startswith(".")):
            if format_of(path) is not None:
                return f"; {path.relative_to(root).as_posix()!r} lies too deep"
            endings.append(path.suffix or path.name)
        if seen >= _LOOKED_AT:
            break
    common = [ending for ending, _ in Counter(endings).most_common(3)]
    return f"; it holds files of no known format ({', '.join(common)}); {OTHER_FILES}" if common else ""


def _listed(folder: Path, root: Path) -> tuple[list[Path], list[Path]]:
    """Return what can be read in a folder, and the sub-folders that are no recordings themselves."""
    refuse_outside(folder, root)
    files, folders = list_folder(folder)
    entries = [path for path in files if format_of(path) is not None]
    deeper: list[Path] = []
    for path in folders:
        (deeper if format_of(path) is None else entries).append(path)
    return entries, deeper


def _find_indexed(root: Path, entries: list[Path], options: LoadOptions) -> FoundFiles:
    found = FoundFiles("index.csv")
    columns = found.columns = _read_index(root, found, options.max_text_bytes)
    if "label" not in columns:
        found.notes.append(f"index.csv has no column label (found: {', '.join(columns)})")
    extra = [column for column in columns if column not in INDEX_COLUMNS]
    if extra:
        found.notes.append(f"columns of index.csv kept in meta: {', '.join(extra)}")
    listed = {source.path for source in found.sources}
    unlisted = [path for path in entries if path not in listed and path.name != INDEX_NAME]
    if n := len(unlisted):
        first = unlisted[0].relative_to(root).as_posix()
        beside = f"{counted(n)} beside index.csv ({first}{' ...' * (n > 1)}) {verb(n, 'is', 'are')}"
        found.notes.append(f"{beside} not listed in it and {verb(n, 'was', 'were')} not read")
    if (root / HISTORY_NAME).is_file():
        found.history = _read_history(root / HISTORY_NAME, root, options, len(found.sources))
    return found


def _below(folders: Sequence[Path], root: Path, levels: int = 2) -> Iterator[Path]:
    """Yield what can be read in the folders of labels and sessions; links are not followed."""
    for folder in folders:
        if levels and not folder.is_symlink():
            entries, deeper = _listed(folder, root)
            yield from entries
            yield from _below(deeper, root, levels - 1)


def _read_history(path: Path, root: Path, options: LoadOptions, n_recordings: int) -> tuple[StepReport, ...]:
    data = read_bounded(path, root, options.max_text_bytes)
    try:
        return checked_history(data.decode("utf-8"), n_recordings)
    except (ValueError, TypeError) as error:
        raise RecordingFileError(path, f"is no history of a data set: {error}") from error


def _find_flat(root: Path, entries: list[Path], known: FileSource | None = None) -> FoundFiles:
    """List files whose label stands in `known`, or else in their names."""
    known = FileSource(root, root, "") if known is None else known
    found = FoundFiles("label_*")
    unnamed = []
    for path in entries:
        source = replace(known, path=path, name=path.relative_to(known.root).as_posix())
        label, _, rest = path.stem.rpartition("_")
        if known.folder_label is None and label and rest:
            source = replace(source, folder_label=label)
        elif known.folder_label is None:
            unnamed.append(path.name)
        found.sources.append(source)
    if unnamed:
        gives = f"{counted(len(unnamed), 'file')} whose name gives no label ({unnamed[0]!r})"
        found.notes.append(f"{gives}: wanted {LAYOUTS}")
    return found


def _find_nested(root: Path, folders: list[Path]) -> FoundFiles:
    found = FoundFiles("label/*")
    _add_folders(found, folders, FileSource(root, root, ""))
    if any(source.folder_session is not None for source in found.sources):
        found.layout = "label/session/*"
    keys = sorted({key for source in found.sources for key in source.meta})
    if keys:
        found.notes.append(f"names of folders kept in meta: {', '.join(keys)}")
    return found


def _add_folders(found: FoundFiles, folders: list[Path], known: FileSource) -> None:
    split = bool(folders) and {folder.name.lower() for folder in folders} <= _SPLITS
    for folder in folders:
        attempt(found.problems, _add_folder, found, folder, known, split=split)


def _add_folder(found: FoundFiles, folder: Path, known: FileSource, *, split: bool) -> None:
    """Add the files below a folder, of which `known` is known from the folders above it."""
    entries, deeper = _listed(folder, known.root)
    stated = _STATED.fullmatch(folder.name)
    key, name = ("split" if split else "", folder.name) if stated is None else (stated[1], unquote(stated[2]))
    meaning = ABOUT.get(key.lower())
    if not key and known.folder_label is not None and known.folder_session is not None:
        if entries:
            raise RecordingFileError(folder, f"recordings lie too deep; wanted {LAYOUTS}")
        return
    if meaning == LABEL or not (key or known.folder_label):
        known = replace(known, folder_label=name, folder_session=known.folder_session or known.folder_label)
    elif meaning == SESSION or not key:
        known = replace(known, folder_session=name)
    else:
        known = replace(known, meta={**known.meta, key: name})
    n_before = len(found.sources)
    if len(folder.relative_to(known.root).parts) < _MOST_DEEP:
        _add_folders(found, deeper, known)
    if entries and len(found.sources) > n_before:
        del found.sources[n_before:]
        problem = f"recordings both here ({entries[0].name!r}) and in sub-folders; wanted one of the two"
        raise RecordingFileError(folder, problem)
    here = _find_flat(folder, entries, known)
    found.sources += here.sources
    found.notes += here.notes


# ``index.csv``: what is known about the files of a folder, a line each. Column ``file`` (path within the folder) is
# needed; ``label``, ``session``, ``start_time`` (seconds since 1970, or ISO 8601 with its zone), ``rate_hz`` (or
# ``irregular``: keep the stamps), ``trigger_index``, ``name``, ``meta`` (a JSON object) and ``axes`` (a JSON list, or
# names with commas between them: those of the file that are the axes, where it is no wrench) may follow in any order,
# empty cells meaning "not known". Any other column goes into ``meta`` as text.


def _read_index(root: Path, found: FoundFiles, max_bytes: int) -> list[str]:
    """Read ``index.csv`` of a folder: what it lists in its order, and the lines that cannot be used; its columns."""
    path = root / INDEX_NAME
    data = read_text_bounded(path, root, max_bytes)
    header = split_header(data, path)
    columns = [column.lower() for column in header.names]
    for i, column in enumerate(columns):
        if not column or not column.isprintable() or column in columns[:i]:
            twice = column in columns[:i]
            problem = f"column {column!r} occurs twice" if twice else "the column has no proper name"
            raise RecordingFileError(path, problem, line=1, column=str(i + 1))
    if "file" not in columns:
        wanted = ", ".join(map(repr, INDEX_COLUMNS))
        raise RecordingFileError(path, f"no column 'file'; wanted {wanted}", line=1)
    lines: dict[Path, int] = {}
    rows = list(split_rows(data, header, path))
    if not rows:
        raise RecordingFileError(path, "has a header but lists no file", line=2)
    for line, cells in rows:
        source = attempt(found.problems, _indexed, root, columns, cells, line)
        if source is None:
            continue
        problem = "is of no known format" if format_of(source.path) is None else ""
        if source.path in lines:
            problem = f"is already listed in line {lines[source.path]}"
        if problem:
            problem = f"{cells[columns.index('file')]!r} {problem}"
            found.problems.append(RecordingFileError(path, problem, line=line, column="file"))
        else:
            found.sources.append(source)
        lines.setdefault(source.path, line)
    return columns


def _indexed(root: Path, columns: list[str], cells: list[str], line: int) -> FileSource:
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
        axes=known["axes"],
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


def _axes(text: str) -> tuple[str, ...]:
    listed = json.loads(text) if text.startswith("[") else text.split(",")
    if not isinstance(listed, list) or not listed:
        raise TypeError(f"{text[:40]!r} is no list of names; wanted one like wx,wy,wz")
    return checked_axes(
        tuple(name.strip() if isinstance(name, str) else name for name in listed), (0, len(listed))
    )


_VALUES: dict[str, Callable[[str], Any]] = {
    "axes": _axes,
    "trigger_index": _trigger,
    "rate_hz": _rate,
    "meta": _meta,
    "file": _inside,
    "start_time": _start_time,
}
"""What stands in the cells of columns that are no plain texts."""
