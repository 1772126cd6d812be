"""A folder of CSV files to a ``Dataset``.

Three layouts, recognised in this order:

1. ``index.csv`` lists the files (see ``csv_index``); files it does not list are not read.
2. ``label/*.csv``: a sub-folder per label; with one more level, ``label/session/*.csv``.
3. ``label_*.csv``: all files in one folder, the label being the name up to the last underscore.

Files are read in natural order (``rice_2`` before ``rice_10``). Sessions come from the index or from the
third level; elsewhere they stay None, because a guess would hide leakage between sessions. Hidden files and
files that do not end in ``.csv`` are passed over.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from granular_id.io.csv_file import CsvSource, read_csv
from granular_id.io.csv_index import INDEX_COLUMNS, INDEX_NAME, read_index
from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.files import list_folder, refuse_outside
from granular_id.io.options import LoadOptions
from granular_id.recording import Dataset, Recording, StepReport

_FOLDERS, _INDEX = "label/*.csv, label/session/*.csv", "or an index.csv with the columns file and label"
LAYOUTS = f"{_FOLDERS}, label_*.csv, {_INDEX}"


def is_csv_file(path: Path) -> bool:
    """Tell whether a path looks like one CSV file."""
    return path.suffix.lower() == ".csv" and not path.is_dir()


def load_csv_file(path: Path, options: LoadOptions) -> Dataset:
    """Read a single CSV file as a data set of one recording without a label."""
    recording, remarks = read_csv(CsvSource(path, path.name), path.resolve().parent, options)
    rows = [{"name": recording.name, **remarks}] if remarks else []
    return Dataset([recording], [_report(_Found("CSV file"), options, [recording], rows, [])])


def load_csv_folder(root: Path, options: LoadOptions) -> Dataset:
    """Read a folder of CSV files in any of the three layouts.

    Raises
    ------
    RecordingFileError
        The first file that cannot be read (with ``on_error="raise"``), an index that cannot be used, a folder
        that has none of the layouts, or nothing readable in it.
    """
    found = _find(root, options)
    if options.on_error == "raise" and found.problems:
        raise _skippable(found.problems[0])
    recordings: list[Recording] = []
    rows: list[dict[str, Any]] = []
    problems = list(found.problems)
    for done, source in enumerate(found.sources, start=1):
        result = attempt(problems, read_csv, source, root, options)
        if result is not None:
            recordings.append(result[0])
            if result[1]:
                rows.append({"name": source.name, **result[1]})
        elif options.on_error == "raise":
            raise _skippable(problems[-1])
        if options.progress is not None:
            options.progress(done, len(found.sources))
    if not recordings:
        problem = f"none of {len(problems)} recordings could be read; the first problem: {problems[0]}"
        raise RecordingFileError(root, problem) from problems[0]
    return Dataset(recordings, [_report(found, options, recordings, rows, problems)])


def _skippable(problem: RecordingFileError) -> RecordingFileError:
    problem.skippable = True
    return problem


class _Found:
    """What a folder holds before any recording is read."""

    def __init__(self, layout: str) -> None:
        self.layout = layout
        self.sources: list[CsvSource] = []
        self.problems: list[RecordingFileError] = []
        self.notes: list[str] = []


def _find(root: Path, options: LoadOptions) -> _Found:
    files, folders = list_folder(root)
    csv_files = [path for path in files if is_csv_file(path)]
    if any(path.name == INDEX_NAME for path in csv_files):
        found = _Found("index.csv")
        found.sources, found.problems, columns = read_index(root, options.max_file_bytes)
        if "label" not in columns:
            found.notes.append(f"index.csv has no column label (found: {', '.join(columns)})")
        extra = [column for column in columns if column not in INDEX_COLUMNS]
        if extra:
            found.notes.append(f"columns of index.csv kept in meta: {', '.join(extra)}")
        listed = {source.path for source in found.sources}
        unlisted = sum(path not in listed and path.name != INDEX_NAME for path in csv_files)
        if unlisted:
            found.notes.append(
                f"{unlisted} CSV files beside index.csv are not listed in it and were not read"
            )
        return found
    nested = _find_nested(root, folders)
    if csv_files and (nested.sources or nested.problems):
        problem = (
            f"CSV files both here ({csv_files[0].name!r}) and in sub-folders; wanted one layout: {LAYOUTS}"
        )
        raise RecordingFileError(root, problem)
    if csv_files:
        return _find_flat(csv_files)
    if not nested.sources and not nested.problems:
        raise RecordingFileError(root, f"holds no CSV recordings; wanted {LAYOUTS}")
    return nested


def _find_flat(csv_files: list[Path]) -> _Found:
    found = _Found("label_*.csv")
    for path in csv_files:
        label, _, rest = path.stem.rpartition("_")
        if label and rest:
            found.sources.append(CsvSource(path, path.name, label=label))
        else:
            wanted = f"label_*.csv, or another layout: {_FOLDERS}, {_INDEX}"
            problem = f"the name {path.name!r} gives no label; wanted {wanted}"
            found.problems.append(RecordingFileError(path, problem))
    return found


def _find_nested(root: Path, folders: list[Path]) -> _Found:
    found = _Found("label/*.csv")
    for folder in folders:
        sources = attempt(found.problems, _labelled, folder, root) or []
        if any(source.session is not None for source in sources):
            found.layout = "label/session/*.csv"
        found.sources += sources
    return found


def _labelled(folder: Path, root: Path) -> list[CsvSource]:
    """List the files of one label, with or without a level for sessions."""
    refuse_outside(folder, root)
    sources, deeper = _csv_in(folder, root, session=False)
    sessions = [source for sub in deeper for source in _sessions_in(sub, root)]
    if sources and sessions:
        problem = f"CSV files both here ({sources[0].path.name!r}) and in sub-folders; wanted one of the two"
        raise RecordingFileError(folder, problem)
    return sources + sessions


def _sessions_in(folder: Path, root: Path) -> list[CsvSource]:
    refuse_outside(folder, root)
    sources, deeper = _csv_in(folder, root, session=True)
    for sub in deeper:
        if any(is_csv_file(path) for path in list_folder(sub)[0]):
            raise RecordingFileError(sub, f"CSV files lie too deep; wanted {LAYOUTS}")
    return sources


def _csv_in(folder: Path, root: Path, *, session: bool) -> tuple[list[CsvSource], list[Path]]:
    files, folders = list_folder(folder)
    label = folder.parent.name if session else folder.name
    source = CsvSource(folder, "", label=label, session=folder.name if session else None)
    csv_files = [path for path in files if is_csv_file(path)]
    return [replace(source, path=path, name=path.relative_to(root).as_posix()) for path in csv_files], folders


def _report(
    found: _Found,
    options: LoadOptions,
    recordings: list[Recording],
    rows: list[dict[str, Any]],
    problems: list[RecordingFileError],
) -> StepReport:
    parameters = {
        "format": found.layout,
        "rate_hz": options.rate_hz,
        "on_error": options.on_error,
        "on_time_error": options.on_time_error,
    }
    totals = {
        "recordings": len(recordings),
        "skipped": len(problems),
        "uniform": sum(r.is_uniform for r in recordings),
        "irregular": sum(not r.is_uniform for r in recordings),
        "moved_samples": sum(row.get("moved", 0) for row in rows),
        "merged_samples": sum(row.get("merged", 0) for row in rows),
    }
    skipped = [{"name": Path(problem.path).name, "skipped": str(problem)} for problem in problems]
    return StepReport("load", parameters, totals, skipped + rows, found.notes)
