"""What a folder of recordings holds, before any of them is read.

Three layouts, recognised in this order:

1. ``index.csv`` lists the files (see ``index``); files it does not list are not read.
2. ``label/*``: a sub-folder per label; with one more level, ``label/session/*``.
3. ``label_*``: all files in one folder, the label being the name up to the last underscore.

Files of every known format count, several side by side too, and folders that are a recording themselves (ROS 2
bags). They are read in natural order (``rice_2`` before ``rice_10``). Sessions come from the index, the files or
the third level; elsewhere they stay None, because a guess would hide leakage between sessions. Hidden files and
files of no known format are passed over.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from granular_id._words import counted, verb
from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.files import list_folder, read_bounded, refuse_outside
from granular_id.io.flat_checks import checked_history
from granular_id.io.folder_save import HISTORY_NAME
from granular_id.io.formats import format_of
from granular_id.io.index import INDEX_COLUMNS, INDEX_NAME, read_index
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.recording import StepReport

__all__ = ["LAYOUTS", "FoundFiles", "find_files"]

_FOLDERS, _INDEX = "label/*.csv, label/session/*.csv", "or an index.csv with the columns file and label"
LAYOUTS = f"{_FOLDERS}, label_*.csv, {_INDEX}"

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


def find_files(root: Path, options: LoadOptions) -> FoundFiles:
    """Find the recordings of a folder.

    Raises
    ------
    RecordingFileError
        The folder has none of the layouts, mixes two, or has an index that cannot be used.
    """
    entries, folders = _listed(root, root)
    if any(path.name == INDEX_NAME for path in entries):
        return _find_indexed(root, entries, options)
    nested = _find_nested(root, folders)
    if entries and (nested.sources or nested.problems):
        problem = (
            f"recordings both here ({entries[0].name!r}) and in sub-folders; wanted one layout: {LAYOUTS}"
        )
        raise RecordingFileError(root, problem)
    if entries:
        return _find_flat(root, entries)
    if not nested.sources and not nested.problems:
        problem = f"holds no recordings; wanted {LAYOUTS} (or files of another format)"
        raise RecordingFileError(root, problem + _found_instead(root))
    return nested


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
    return f"; it holds files of no known format ({', '.join(common)})" if common else ""


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
    found.sources, found.problems, columns = read_index(
        root, options.max_text_bytes, lambda path: format_of(path) is not None
    )
    if "label" not in columns:
        found.notes.append(f"index.csv has no column label (found: {', '.join(columns)})")
    extra = [column for column in columns if column not in INDEX_COLUMNS]
    if extra:
        found.notes.append(f"columns of index.csv kept in meta: {', '.join(extra)}")
    listed = {source.path for source in found.sources}
    unlisted = sum(path not in listed and path.name != INDEX_NAME for path in entries)
    if unlisted:
        beside = f"{counted(unlisted)} beside index.csv {verb(unlisted, 'is', 'are')}"
        found.notes.append(f"{beside} not listed in it and {verb(unlisted, 'was', 'were')} not read")
    if (root / HISTORY_NAME).is_file():
        found.history = _read_history(root / HISTORY_NAME, root, options, len(found.sources))
    return found


def _read_history(path: Path, root: Path, options: LoadOptions, n_recordings: int) -> tuple[StepReport, ...]:
    data = read_bounded(path, root, options.max_text_bytes)
    try:
        return checked_history(data.decode("utf-8"), n_recordings)
    except (ValueError, TypeError) as error:
        raise RecordingFileError(path, f"is no history of a data set: {error}") from error


def _find_flat(root: Path, entries: list[Path]) -> FoundFiles:
    found = FoundFiles("label_*")
    for path in entries:
        label, _, rest = path.stem.rpartition("_")
        if label and rest:
            found.sources.append(FileSource(path, root, path.name, folder_label=label))
        elif (known := format_of(path)) is not None and known.knows_labels:
            found.sources.append(FileSource(path, root, path.name))
        else:
            wanted = f"label_*.csv, or another layout: {_FOLDERS}, {_INDEX}"
            problem = f"the name {path.name!r} gives no label; wanted {wanted}"
            found.problems.append(RecordingFileError(path, problem))
    return found


def _find_nested(root: Path, folders: list[Path]) -> FoundFiles:
    found = FoundFiles("label/*")
    for folder in folders:
        sources = attempt(found.problems, _labelled, folder, root) or []
        if any(source.folder_session is not None for source in sources):
            found.layout = "label/session/*"
        found.sources += sources
    return found


def _labelled(folder: Path, root: Path) -> list[FileSource]:
    """List the files of one label, with or without a level for sessions."""
    sources, deeper = _sources_in(folder, root, session=False)
    sessions = [source for sub in deeper for source in _sessions_in(sub, root)]
    if sources and sessions:
        problem = f"recordings both here ({sources[0].path.name!r}) and in sub-folders; wanted one of the two"
        raise RecordingFileError(folder, problem)
    return sources + sessions


def _sessions_in(folder: Path, root: Path) -> list[FileSource]:
    sources, deeper = _sources_in(folder, root, session=True)
    for sub in deeper:
        if _listed(sub, root)[0]:
            raise RecordingFileError(sub, f"recordings lie too deep; wanted {LAYOUTS}")
    return sources


def _sources_in(folder: Path, root: Path, *, session: bool) -> tuple[list[FileSource], list[Path]]:
    entries, folders = _listed(folder, root)
    label = folder.parent.name if session else folder.name
    source = FileSource(folder, root, "", folder_label=label, folder_session=folder.name if session else None)
    return [replace(source, path=path, name=path.relative_to(root).as_posix()) for path in entries], folders
