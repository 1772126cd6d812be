"""What archives consist of: names of files and columns, the mark in their footers; Parquet files, opened."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granular_id.io.errors import RecordingFileError, naming, need
from granular_id.io.files import open_bounded
from granular_id.recording import unit_of

INDEX_FILE, INDEX_FOLDER = "recordings.parquet", "recordings"
"""What lists the recordings that were saved at once, and the folder of those lists that were added."""

SAMPLES_FOLDER = "samples"
VERSION = 1
MARK, HISTORY = "granular_id", "history"
TIME, FLAGS, DIGEST = "time_s", "flags", "digest"
INDEX_TEXTS = ("name", "label", "session", "file", "meta")
INDEX_COLUMNS = (
    *INDEX_TEXTS,
    "id",
    "start_time",
    "rate_hz",
    "n_samples",
    "trigger_index",
    "row_group",
    DIGEST,
)

_PART = re.compile(SAMPLES_FOLDER + r"/part-[0-9]{5,9}\.parquet")
_ADDED = re.compile(r"([0-9a-f]{32})\.parquet")


@dataclass(frozen=True)
class Mark:
    """What the footer says of an archive: its axes, and the column of the sample files that holds each."""

    axes: tuple[str, ...]
    columns: tuple[str, ...]

    def __post_init__(self) -> None:
        for names in (self.axes, self.columns):
            texts = all(isinstance(name, str) and name for name in names)
            if not texts or not 0 < len(set(names)) == len(self.axes) == len(names):
                raise ValueError("names occur twice, or are none")

    @classmethod
    def of_axes(cls, axes: Sequence[str]) -> Mark:
        """Name the columns as the axes, unless one would be taken for the stamps or the flags."""
        taken = {TIME, FLAGS} & set(axes)
        return cls(tuple(axes), tuple(f"axis_{i}" for i in range(len(axes))) if taken else tuple(axes))

    def to_json(self, what: str, **more: float) -> str:
        """Return the text that goes into a footer; `what` is "recordings" or "samples"."""
        about = {"format": what, "version": VERSION, "axes": self.axes, "columns": self.columns}
        units = [unit_of(axis) for axis in self.axes]
        return json.dumps({**about, "units": units, **more}, ensure_ascii=False)


def read_mark(labels: Mapping[str, str], what: str, path: Path) -> Mark:
    """Return what a footer says of an archive; `what` is "recordings" or "samples"."""
    try:
        said = json.loads(labels.get(MARK, "null"))
        mark = Mark(tuple(said["axes"]), tuple(said["columns"]))
        wanted = json.loads(mark.to_json(what))
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        problem = f"has no entry {MARK!r} that names axes and as many columns, each once"
        raise RecordingFileError(path, problem, place="footer") from error
    other = next((key for key in wanted if said.get(key) != wanted[key]), None)
    if other is not None:
        problem = f"the entry {MARK!r} says that the {other} is {said.get(other)!r:.80}; wanted {wanted[other]!r:.80}"
        raise RecordingFileError(path, problem, place="footer")
    return mark


def written_at(labels: Mapping[str, str], path: Path) -> float:
    """Return when an append was written, seconds since 1970; of a footer that `read_mark` has read."""
    written = json.loads(labels[MARK]).get("written")
    if isinstance(written, bool) or not isinstance(written, (int, float)) or not math.isfinite(written):
        problem = f"the entry {MARK!r} says that it was written at {written!r:.80}; wanted seconds since 1970"
        raise RecordingFileError(path, problem, place="footer")
    return float(written)


def part_name(number: int) -> str:
    """Name the file of samples with this number, as the index does."""
    return f"{SAMPLES_FOLDER}/part-{number:05d}.parquet"


def added_names(key: str) -> tuple[str, str]:
    """Name the file of samples and the index file that an append of this key writes."""
    return f"{SAMPLES_FOLDER}/{key}.parquet", f"{INDEX_FOLDER}/{key}.parquet"


def is_sample_name(text: object, index_file: str) -> bool:
    """Tell whether an index file may name this file of samples: nothing else ever becomes a path."""
    if index_file == INDEX_FILE:
        return isinstance(text, str) and _PART.fullmatch(text) is not None
    return text == f"{SAMPLES_FOLDER}/{index_file.rpartition('/')[2]}"


def index_of(file: str) -> str:
    """Name the index file that lists a file of samples."""
    return INDEX_FILE if _PART.fullmatch(file) else f"{INDEX_FOLDER}/{file.rpartition('/')[2]}"


def index_names(folder: Path) -> list[str]:
    """Return the index files of an archive: ``recordings.parquet`` first, then what was added, by key."""
    try:
        names = [path.name for path in (folder / INDEX_FOLDER).iterdir()]
    except OSError:  # there is no such folder, or it may not be listed
        names = []
    whole = os.path.isfile(folder / INDEX_FILE)  # noqa: PTH113 (says False where is_file raises: no permission)
    return [INDEX_FILE] * whole + [
        f"{INDEX_FOLDER}/{name}" for name in sorted(names) if _ADDED.fullmatch(name)
    ]


def is_parquet_archive(folder: Path) -> bool:
    """Tell whether a folder is a native archive: an index file lies in it."""
    return bool(index_names(folder))


@contextmanager
def open_parquet(
    path: Path, root: Path, max_bytes: int, texts: Sequence[str] = (), *, footer: Any = None
) -> Iterator[Any]:
    """Open a file inside `root` as ``pyarrow.parquet.ParquetFile``, some columns to be read dictionary-encoded.

    With the `footer` that it had when it was opened before, a third of the time is needed.
    """
    library = need("pyarrow.parquet", extra="app", why="to read Parquet files")
    with open_bounded(path, root, max_bytes) as (file, _), naming(path, "reading it as Parquet"):
        try:
            place = os.fspath(path).encode().decode()
        except UnicodeEncodeError:  # pyarrow cannot spell it
            place = need("pyarrow", extra="app", why="to read Parquet files").BufferReader(file.read())
        with library.ParquetFile(
            place,
            metadata=footer,
            read_dictionary=texts,
            page_checksum_verification=True,
            pre_buffer=False,  # which reads by threads of its own
        ) as opened:
            yield opened


def labels_of(opened: Any) -> dict[str, str]:
    """Return the key-value texts of a footer."""
    found = opened.metadata.metadata or {}
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in found.items()}
