"""How the native archive is laid out: names of files and columns, and the mark that tells it from other Parquet.

``recordings.parquet`` has one row per recording and says in which row group of which file its samples lie;
``samples/part-00000.parquet`` and so on hold the samples, a column per axis, whole recordings in each row group.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
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
INDEX_TEXTS = ("name", "label", "session", "file", "meta")
INDEX_COLUMNS = (*INDEX_TEXTS, "id", "start_time", "rate_hz", "n_samples", "trigger_index", "row_group")

_PART = re.compile(SAMPLES_FOLDER + r"/part-[0-9]{5,9}\.parquet")


@dataclass(frozen=True)
class Mark:
    """What the footer says of an archive: its axes, and the column of the sample files that holds each."""

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


def read_mark(labels: Mapping[str, str], what: str, path: Path) -> Mark:
    """Return what a footer says of an archive; `what` is "recordings" or "samples"."""

    def refusal(problem: str) -> RecordingFileError:
        return RecordingFileError(path, problem, place="footer")

    if MARK not in labels:
        raise refusal(f"is not part of an archive: its footer has no entry {MARK!r}")
    try:
        said = json.loads(labels[MARK])
    except (ValueError, RecursionError) as error:
        raise refusal(f"the entry {MARK!r} is not JSON: {error}") from error
    if not isinstance(said, dict) or said.get("format") != what:
        raise refusal(f"the entry {MARK!r} does not say that these are {what}")
    if said.get("version") != VERSION:
        raise refusal(f"is of version {said.get('version')!r}; this granular_id reads version {VERSION}")
    lists: list[Any] = [said.get(name) for name in ("axes", "columns")]
    if not all(_different_texts(one) for one in lists) or len(lists[0]) != len(lists[1]):
        names = f"the axes {lists[0]!r:.80} and columns {lists[1]!r:.80}"
        raise refusal(f"the entry {MARK!r} names {names}; wanted two lists of different names")
    units = [unit_of(axis) for axis in lists[0]]
    if said.get("units") not in (None, units):
        raise refusal(f"the entry {MARK!r} names the units {said['units']!r:.80}; wanted {units}")
    return Mark(tuple(lists[0]), tuple(lists[1]))


def _different_texts(value: Any) -> bool:
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        return False
    return 0 < len(set(value)) == len(value)


def part_name(number: int) -> str:
    """Name the file of samples with this number, as the index does."""
    return f"{SAMPLES_FOLDER}/part-{number:05d}.parquet"


def is_part_name(text: object) -> bool:
    """Tell whether the index may name this file: nothing else ever becomes a path."""
    return isinstance(text, str) and _PART.fullmatch(text) is not None


def is_parquet_archive(folder: Path) -> bool:
    """Tell whether a folder is a native archive: a file ``recordings.parquet`` lies in it."""
    return os.path.isfile(folder / INDEX_FILE)  # noqa: PTH113 (says False where is_file raises: no permission)
