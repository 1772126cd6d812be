"""How the native archive is laid out: names of files and columns, and the mark that tells it from other Parquet.

``recordings.parquet`` has one row per recording and says in which row group of which file its samples lie;
``samples/part-00000.parquet`` and so on hold the samples, a column per axis, whole recordings in each row group.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granular_id.io.errors import RecordingFileError
from granular_id.recording import unit_of

INDEX_FILE = "recordings.parquet"
SAMPLES_FOLDER = "samples"
VERSION = 1
MARK = "granular_id"
TIME, FLAGS = "time_s", "flags"
INDEX_COLUMNS: dict[str, type] = {
    "id": int,
    "name": str,
    "label": str,
    "session": str,
    "start_time": float,
    "rate_hz": float,
    "n_samples": int,
    "trigger_index": int,
    "file": str,
    "row_group": int,
    "meta": str,
}
INDEX_TEXTS = tuple(name for name, kind in INDEX_COLUMNS.items() if kind is str)

_PART = re.compile(SAMPLES_FOLDER + r"/part-[0-9]{5,9}\.parquet")


@dataclass(frozen=True)
class Mark:
    """What the footer of ``recordings.parquet`` says of the whole archive.

    Attributes
    ----------
    axes : tuple of str
    columns : tuple of str
        The column of the sample files that holds each axis.
    """

    axes: tuple[str, ...]
    columns: tuple[str, ...]

    @classmethod
    def of_axes(cls, axes: Sequence[str]) -> Mark:
        """Name the columns as the axes, unless one would be taken for the stamps or the flags."""
        taken = {TIME, FLAGS} & set(axes)
        return cls(tuple(axes), tuple(f"axis_{i}" for i in range(len(axes))) if taken else tuple(axes))

    def to_json(self, what: str) -> str:
        """Return the text that goes into a footer; `what` is "recordings" or "samples"."""
        units = [unit_of(axis) for axis in self.axes]
        text: dict[str, Any] = {
            "format": what,
            "version": VERSION,
            "axes": self.axes,
            "columns": self.columns,
        }
        return json.dumps({**text, "units": units}, ensure_ascii=False)


def read_mark(labels: dict[str, str], what: str, path: Path) -> Mark:
    """Return what a footer says of an archive.

    Raises
    ------
    RecordingFileError
        Not written by granular_id, another version, or not what is wanted.
    """
    if MARK not in labels:
        raise RecordingFileError(
            path, f"is not part of an archive: its footer has no entry {MARK!r}", place="footer"
        )
    try:
        said = json.loads(labels[MARK])
    except ValueError as error:
        raise RecordingFileError(path, f"the entry {MARK!r} is not JSON: {error}", place="footer") from error
    if not isinstance(said, dict) or said.get("format") != what:
        raise RecordingFileError(
            path, f"the entry {MARK!r} does not say that these are {what}", place="footer"
        )
    if said.get("version") != VERSION:
        problem = f"is of version {said.get('version')!r}; this granular_id reads version {VERSION}"
        raise RecordingFileError(path, problem, place="footer")
    axes, columns = _names(said.get("axes")), _names(said.get("columns"))
    if not axes or len(axes) != len(columns):
        problem = f"the entry {MARK!r} names the axes {said.get('axes')!r:.80} and columns {said.get('columns')!r:.80}"
        raise RecordingFileError(path, f"{problem}; wanted two lists of different names", place="footer")
    units = said.get("units")
    if units is not None and units != [unit_of(axis) for axis in axes]:
        problem = (
            f"the entry {MARK!r} names the units {units!r:.80}; wanted {[unit_of(axis) for axis in axes]}"
        )
        raise RecordingFileError(path, problem, place="footer")
    return Mark(axes, columns)


def part_name(number: int) -> str:
    """Name the file of samples with this number, as the index does."""
    return f"{SAMPLES_FOLDER}/part-{number:05d}.parquet"


def is_part_name(text: object) -> bool:
    """Tell whether the index may name this file: nothing else ever becomes a path."""
    return isinstance(text, str) and _PART.fullmatch(text) is not None


def is_parquet_archive(folder: Path) -> bool:
    """Tell whether a folder is a native archive: a file ``recordings.parquet`` lies in it."""
    return os.path.isfile(folder / INDEX_FILE)  # noqa: PTH113 (says False where is_file raises: no permission)


def _names(value: object) -> tuple[str, ...]:
    """Return a list of different texts as a tuple; an empty one for anything else."""
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        return ()
    return tuple(value) if len(set(value)) == len(value) else ()
