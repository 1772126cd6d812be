"""What archives consist of: names of files and columns, the mark in their footers; Parquet files, opened."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granular_id.io.files import RecordingFileError, check_place, naming, need
from granular_id.recording import unit_of

SAMPLES_FOLDER = "samples"
VERSION = 1
MARK, HISTORY = "granular_id", "history"
TIME, FLAGS, DIGEST = "time_s", "flags", "digest"

INDEX_COLUMNS = {
    "id": "string",
    "name": "text",
    "label": "text",
    "session": "text",
    "start_time": "float64",
    "rate_hz": "float64",
    "n_samples": "int64",
    "trigger_index": "int64",
    "file": "text",
    "row_group": "int64",
    "meta": "text",
    DIGEST: "string",
}
"""Columns of an index file and their types; "text" repeats, and is a dictionary in memory."""

INDEX_FILE = re.compile(r"recordings-([0-9a-f]{32})\.parquet")


def index_file(key: str) -> str:
    """Name the index file with this key."""
    return f"recordings-{key}.parquet"


def samples_file(key: str) -> str:
    """Name the file of samples that the index file with this key lists: no name in a file ever becomes a path."""
    return f"{SAMPLES_FOLDER}/part-{key}.parquet"


def key_of(file: str) -> str:
    """Return the key of a file of samples."""
    return Path(file).stem.removeprefix("part-")


def index_of(file: str) -> str:
    """Name the index file that lists a file of samples."""
    return index_file(key_of(file))


def index_keys(folder: Path) -> list[str]:
    """Return the keys of the index files of an archive: what has no index file does not exist."""
    try:
        found = [INDEX_FILE.fullmatch(name) for name in os.listdir(folder)]  # noqa: PTH208 (a third of the time)
    except OSError:  # there is no such folder, or it may not be listed
        return []
    return sorted(match[1] for match in found if match is not None)


def is_parquet_archive(folder: Path) -> bool:
    """Tell whether a folder is a native archive: an index file lies in it."""
    return bool(index_keys(folder))


def index_schema() -> Any:
    """Return the schema of an index in memory."""
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    kinds = {"text": arrow.dictionary(arrow.int32(), arrow.string()), "string": arrow.string()}
    kinds |= {"float64": arrow.float64(), "int64": arrow.int64()}
    return arrow.schema([(name, kinds[kind]) for name, kind in INDEX_COLUMNS.items()])


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

    def to_json(self, what: str, **more: float) -> str:
        """Return the text that goes into a footer; `what` is "recordings" or "samples"."""
        about = {"format": what, "version": VERSION, "axes": self.axes, "columns": self.columns}
        units = [unit_of(axis) for axis in self.axes]
        return json.dumps({**about, "units": units, **more}, ensure_ascii=False)

    @classmethod
    def read(cls, opened: Any, what: str, path: Path) -> tuple[Mark, dict[str, Any]]:
        """Return what the footer of an open file says of the archive, as a mark and whole."""
        try:
            entry = json.loads(labels_of(opened).get(MARK, "null"))
            mark = cls.of_axes(entry["axes"])
            wanted = json.loads(mark.to_json(what))
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            problem = f"has no entry {MARK!r} that names axes, each once"
            raise RecordingFileError(path, problem, place="footer") from error
        other = next((key for key in wanted if entry.get(key) != wanted[key]), None)
        if other is not None:
            came = f"says that the {other} is {entry.get(other)!r:.80}; wanted {wanted[other]!r:.80}"
            raise RecordingFileError(path, f"the entry {MARK!r} {came}", place="footer")
        return mark, entry


@contextmanager
def open_parquet(path: Path, root: Path, texts: Sequence[str] = ()) -> Iterator[Any]:
    """Open a file inside `root` as ``pyarrow.parquet.ParquetFile``, some columns to be read dictionary-encoded."""
    library = need("pyarrow.parquet", extra="app", why="to read Parquet files")
    check_place(path, root)
    # Without threads of its own.
    options = {"read_dictionary": texts, "page_checksum_verification": True, "pre_buffer": False}
    with naming(path, "reading it as Parquet"), library.ParquetFile(path, **options) as opened:
        yield opened


def labels_of(opened: Any) -> dict[str, str]:
    """Return the key-value texts of a footer."""
    found: Mapping[bytes, bytes] = opened.metadata.metadata or {}
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in found.items()}
