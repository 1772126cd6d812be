"""Archives written: as a whole, or more and more recordings by any number of writers."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from granular_id._checks import FloatArray, argument_error, thaw
from granular_id._core import GranularIdError
from granular_id._files import check_target, durable_file, made_folder
from granular_id._progress import ProgressCallback
from granular_id.io.files import need, new_folder
from granular_id.io.flat import checked_dataset, flat_samples, history_json
from granular_id.io.parquet.layout import (
    FLAGS,
    HISTORY,
    MARK,
    SAMPLES_FOLDER,
    TIME,
    Mark,
    index_file,
    index_keys,
    index_schema,
    open_parquet,
    samples_file,
)
from granular_id.recording import Dataset, Recording

RECORDINGS_PER_GROUP = 128
"""A row group of 1600 samples each has 10 MB of samples: what a worker holds of them at least."""

_COMMON = {"compression": "zstd", "write_page_checksum": True, "store_schema": False}
_GROUPS_PER_PART = 64
_MAX_GROUP_SAMPLES = 1 << 22
_PAGE_BYTES = 8 << 20
_PROBED_SAMPLES = 1 << 16
_DISTINCT_SHARE = 0.3


def save_parquet(
    dataset: Dataset,
    folder: str | os.PathLike[str],
    *,
    recordings_per_group: int = RECORDINGS_PER_GROUP,
    progress: ProgressCallback | None = None,
) -> Path:
    """Write a data set as a new archive, to which more can be appended; with every bit."""
    rows = [_Row.of(recording) for recording in checked_dataset(dataset)]
    mark = Mark.of_axes(dataset.axes)
    need("pyarrow.parquet", extra="app", why="to write Parquet files")
    with new_folder(folder) as partial:
        _write(partial, rows, recordings_per_group, mark, history_json(dataset), progress)
    return Path(folder)


@dataclass(frozen=True)
class Appended:
    """What `append` did.

    Attributes
    ----------
    n_added, n_present : int
        Recordings that it added, and those that were in the archive already.
    """

    n_added: int
    n_present: int


def append(folder: str | os.PathLike[str], dataset: Dataset) -> Appended:
    """Add recordings to an archive, or begin one.

    Of every 8192 recordings two files are made: ``samples/part-<key>.parquet``, and then ``recordings-<key>.parquet``,
    which lists them; a reader sees all of them or none. Each is written under a temporary name, brought to the disk and
    renamed. An append that was killed is simply run again: what is in the archive already is not added again.

    Any number of threads, processes and machines may append to one archive at once. Of two that add the same recording
    in the same moment, but not the same data set, both may: `granular_id.archive.check` tells.

    Parameters
    ----------
    folder : str or path
        An archive, or a new or empty folder.
    dataset : Dataset
        Some thousand recordings at a time: each append makes two files more. Its history is stored with them.

    Returns
    -------
    Appended
        ``n_added`` and ``n_present``: a recording is present if one with the same samples, stamps and flags, name,
        label, session and start time is in the archive, or earlier in `dataset`.

    Raises
    ------
    FileExistsError, NotADirectoryError
        `folder` holds something else, or is a file.
    OSError
        A file cannot be written; it is named, and nothing half-written is left.
    RecordingFileError
        The archive cannot be read.
    ImportError
        pyarrow is missing.
    TypeError, ValueError
        `dataset` is no Dataset, or its axes are not those of the archive.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.archive import Archive, append
    >>> from granular_id import Dataset, Recording
    >>> pushes = [Recording(np.full((3, 6), i), rate_hz=500, label="rice", name=f"push {i}") for i in range(5)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     append(folder, Dataset(pushes[:3]))
    ...     append(folder, Dataset(pushes))
    ...     Archive(folder).index["name"].to_pylist()
    Appended(n_added=3, n_present=0)
    Appended(n_added=2, n_present=3)
    ['push 0', 'push 1', 'push 2', 'push 3', 'push 4']
    """
    checked_dataset(dataset)
    with made_folder(folder):
        return Appender(folder).append(dataset)


class Appender:
    """Appends to an archive again and again: each index file, which never changes, is read once.

    A folder that cannot become an archive, or, where `axes` are given, holds one of other axes, is refused at once;
    `whose` says in the error what has these axes.
    """

    def __init__(
        self, folder: str | os.PathLike[str], axes: Sequence[str] | None = None, whose: str = "dataset"
    ) -> None:
        need("pyarrow.parquet", extra="app", why="to write archives")
        self._folder = Path(folder)
        self._read: set[str] = set()
        self._ids: set[str] = set()
        self._axes: tuple[str, ...] | None = None
        check_target(self._folder / "recordings.parquet")
        self.update(axes, whose)

    def append(self, dataset: Dataset) -> Appended:
        """Add recordings, as `granular_id.archive.append` does."""
        self.update(dataset.axes)
        fresh: dict[str, _Row] = {}
        for recording in dataset:
            row = _Row.of(recording)
            if row.id not in self._ids:
                fresh.setdefault(row.id, row)
        n_added = 0
        if fresh:
            mark, history = Mark.of_axes(dataset.axes), history_json(dataset)
            with made_folder(self._folder / SAMPLES_FOLDER):
                n_added = _write(self._folder, [*fresh.values()], RECORDINGS_PER_GROUP, mark, history)
        self._ids |= fresh.keys()
        return Appended(n_added, len(dataset) - n_added)

    def update(self, axes: Sequence[str] | None, whose: str = "dataset") -> None:
        """Read the index files that are new, and refuse other axes."""
        keys = index_keys(self._folder)
        if not self._read <= set(keys):  # another archive in its place
            self._read, self._ids, self._axes = set(), set(), None
        # An append that was killed leaves drafts and samples, and another one may be the first meanwhile.
        ours = re.compile(rf"\..*|{SAMPLES_FOLDER}|recordings-.*\.parquet")
        other = next((path.name for path in self._folder.iterdir() if not ours.fullmatch(path.name)), None)
        if other is not None and not keys:
            wanted = "wanted an archive, or a new or empty folder"
            raise FileExistsError(f"{self._folder}: holds {other!r:.60}; {wanted}")
        for key in keys:
            if key not in self._read:
                path = self._folder / index_file(key)
                with open_parquet(path, self._folder) as opened:
                    self._axes = Mark.read(opened, "recordings", path)[0].axes
                    self._ids.update(opened.read(["id"], use_threads=False)["id"].to_pylist())
                self._read.add(key)
        if axes is not None and self._axes not in (None, tuple(axes)):
            came = (
                f"has the axes {' '.join(axes)}, and the archive {self._folder} {' '.join(self._axes or ())}"
            )
            raise argument_error(GranularIdError, whose, f"{came}; add it to another one")


@dataclass(frozen=True)
class _Row:
    """A recording and what identifies it: of two with the same `id` an archive holds one."""

    recording: Recording
    digest: str
    id: str

    @classmethod
    def of(cls, recording: Recording) -> _Row:
        digest = digest_of(recording)
        names = f"{recording.name!a} {recording.label!a} {recording.session!a} {recording.start_time!r}"
        return cls(recording, digest, _hashed(f"{digest} {names}"))


def digest_of(recording: Recording) -> str:
    """Return 32 hexadecimal digits of the SHA-256 of what a recording holds per sample: wrench, stamps, flags."""
    mark = hashlib.sha256(np.ascontiguousarray(recording.wrench, "<f8").data)
    for values, kind in ((recording.time_s, "<f8"), (recording.flags, "u1")):
        if values is not None:
            mark.update(np.ascontiguousarray(values, kind).data)
    return mark.hexdigest()[:32]


def _hashed(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _write(
    folder: Path,
    rows: Sequence[_Row],
    per_group: int,
    mark: Mark,
    history: str,
    step: ProgressCallback | None = None,
) -> int:
    """Write files of samples, and the index of each; return how many recordings no other writer had written."""
    library = need("pyarrow.parquet", extra="app", why="to write Parquet files")
    (folder / SAMPLES_FOLDER).mkdir(exist_ok=True)
    groups = _grouped(rows, per_group)
    written, done, n_added = time.time(), 0, 0
    for number, first in enumerate(range(0, len(groups), _GROUPS_PER_PART)):
        part = groups[first : first + _GROUPS_PER_PART]
        index = _index_columns(part)
        # `id` covers samples and names
        about = [index[name] for name in ("id", "row_group", "rate_hz", "trigger_index", "meta")]
        key = _hashed(json.dumps([number, mark.axes, *about]))
        index["file"] = [samples_file(key)] * sum(map(len, part))
        with durable_file(folder / samples_file(key)) as draft:
            for n in _write_samples(library, draft, part, mark):
                done += n
                if step is not None:
                    step(done, len(rows), os.fspath(folder))
        path = folder / index_file(key)
        if path.is_file():  # of a writer that was quicker
            continue
        with durable_file(path) as draft:
            footer = mark.to_json("recordings", written=written, part=number)
            _write_index(library, draft, index, {MARK: footer, HISTORY: history})
        n_added += len(index["file"])
    return n_added


def _grouped(rows: Sequence[_Row], most: int) -> list[list[_Row]]:
    """Cut rows into groups of at most `most`, and not more samples than fit into a row group."""
    groups: list[list[_Row]] = []
    n_samples = 0
    for row in rows:
        n_samples += row.recording.n_samples
        if not groups or len(groups[-1]) == most or n_samples > _MAX_GROUP_SAMPLES:
            groups.append([])
            n_samples = row.recording.n_samples
        groups[-1].append(row)
    return groups


def _index_columns(groups: Sequence[Sequence[_Row]]) -> dict[str, list[Any]]:
    rows = [row for group in groups for row in group]
    columns = ("name", "label", "session", "start_time", "rate_hz", "n_samples", "trigger_index")
    return {
        "id": [row.id for row in rows],
        **{name: [getattr(row.recording, name) for row in rows] for name in columns},
        "row_group": [number for number, group in enumerate(groups) for _ in group],
        "meta": [json.dumps(thaw(row.recording.meta)) if row.recording.meta else None for row in rows],
        "digest": [row.digest for row in rows],
    }


def _write_index(library: Any, path: Path, columns: dict[str, list[Any]], labels: dict[str, str]) -> None:
    arrow = need("pyarrow", extra="app", why="to write Parquet files")
    table = arrow.table({name: columns[name] for name in index_schema().names}, schema=index_schema())
    with library.ParquetWriter(path, table.schema, **_COMMON) as writer:
        writer.add_key_value_metadata(labels)
        writer.write_table(table)


def _write_samples(library: Any, path: Path, groups: Sequence[Sequence[_Row]], mark: Mark) -> Iterator[int]:
    """Write one file of samples; yield after each row group how many recordings it holds.

    Columns whose values repeat, as counts of a sensor do, are stored as a dictionary, all others with their bytes split
    into streams: half the size and a third of the time of a dictionary there. zstd compresses both.
    """
    arrow = need("pyarrow", extra="app", why="to write Parquet files")
    recordings = [row.recording for group in groups for row in group]
    timed = any(r.time_s is not None for r in recordings)
    flagged = any(r.flags is not None for r in recordings)
    fields = [arrow.field(column, arrow.float64(), nullable=False) for column in mark.columns]
    fields += [arrow.field(TIME, arrow.float64(), nullable=False)] if timed else []
    fields += [arrow.field(FLAGS, arrow.uint8(), nullable=False)] if flagged else []
    schema = arrow.schema(fields)
    probe = _probe(recordings)
    repeating = [column for j, column in enumerate(mark.columns) if _repeats(probe[:, j])]
    split = [field.name for field in fields if field.name not in (*repeating, FLAGS)]
    with library.ParquetWriter(
        path,
        schema,
        use_dictionary=repeating + [FLAGS] * flagged,
        use_byte_stream_split=split,
        write_statistics=False,  # of samples nobody asks for the least and the largest
        data_page_size=_PAGE_BYTES,
        **_whole_pages(library),
        **_COMMON,
    ) as writer:
        writer.add_key_value_metadata({MARK: mark.to_json("samples")})
        for group in groups:
            wrench, time_s, flags = flat_samples([row.recording for row in group])
            n = len(wrench)
            columns = [np.ascontiguousarray(column) for column in wrench.T]
            columns += [np.full(n, np.nan) if time_s is None else time_s] if timed else []
            columns += [np.zeros(n, np.uint8) if flags is None else flags] if flagged else []
            writer.write_table(arrow.Table.from_arrays(columns, schema=schema), row_group_size=n)
            yield len(group)


def _whole_pages(library: Any) -> dict[str, int]:
    """Return what keeps pyarrow from cutting columns into pages of 20,000 rows, which take half as long again to read.

    Versions that do not cut do not know the setting.
    """
    known = inspect.signature(library.ParquetWriter).parameters
    return {"max_rows_per_page": _MAX_GROUP_SAMPLES} if "max_rows_per_page" in known else {}


def _probe(recordings: Sequence[Recording]) -> FloatArray:
    """Take samples from all over the recordings, about as many as decide whether values repeat."""
    total = sum(r.n_samples for r in recordings)
    step = max(1, total // _PROBED_SAMPLES)
    some = islice(recordings, 0, None, step)
    return np.concatenate([r.wrench[:_PROBED_SAMPLES] for r in some])


def _repeats(values: FloatArray) -> bool:
    return len(np.unique(values)) < _DISTINCT_SHARE * len(values)
