"""Read a native archive: the whole of it, or one row group at a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._core import interleave
from granular_id.io.errors import RecordingFileError, naming, need
from granular_id.io.files import open_bounded, read_bounded
from granular_id.io.flat import FlatRecordings, unflatten
from granular_id.io.flat_checks import NO_TRIGGER
from granular_id.io.folder_save import HISTORY_NAME
from granular_id.io.options import MAX_BINARY_BYTES
from granular_id.io.parquet.layout import (
    FLAGS,
    INDEX_COLUMNS,
    INDEX_FILE,
    INDEX_TEXTS,
    TIME,
    Mark,
    is_part_name,
    read_mark,
)
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset

__all__ = ["ParquetArchive", "coded_texts", "labels_of", "open_parquet"]


@dataclass(frozen=True)
class Partition:
    """A row group of a file of samples, and the rows of the index (`start` to `stop`) that describe it."""

    file: str
    row_group: int
    start: int
    stop: int
    n_samples: int


class ParquetArchive:
    """A native archive, opened: its index is in memory, samples are read a row group at a time.

    Parameters
    ----------
    folder : str or path
        What ``save_parquet`` wrote.
    max_file_bytes : int
        Largest file that is opened; 2 GiB by default.

    Attributes
    ----------
    axes : tuple of str
        Names of the columns of the samples.
    index : pyarrow.Table
        A row per recording: id, name, label, session, start_time, rate_hz, n_samples, trigger_index, file, row_group
        and meta (JSON); texts are dictionary-encoded.
    partitions : tuple of Partition
        The row groups, in the order of the index.

    Raises
    ------
    RecordingFileError
        The index cannot be read, or does not describe an archive.
    ImportError
        pyarrow is missing.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io.parquet.archive import ParquetArchive
    >>> from granular_id.io.parquet.save import save_parquet
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.full((3, 6), i), rate_hz=500, label="rice") for i in range(5)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     archive = ParquetArchive(save_parquet(data, folder + "/rice", recordings_per_group=2))
    ...     archive.index.num_rows, [len(part) for part in archive]
    (5, [2, 2, 1])
    """

    def __init__(self, folder: str | os.PathLike[str], *, max_file_bytes: int = MAX_BINARY_BYTES) -> None:
        self.folder = Path(folder)
        self._max_file_bytes = max_file_bytes
        path = self.folder / INDEX_FILE
        with open_parquet(path, self.folder, max_file_bytes, INDEX_TEXTS) as opened:
            names = opened.schema_arrow.names
            self._mark = read_mark(labels_of(opened), "recordings", path)
            self._unread = [name for name in names if name not in INDEX_COLUMNS]
            missing = [name for name in INDEX_COLUMNS if name not in names]
            if missing:
                problem = f"column {missing[0]!r} is missing; wanted {', '.join(INDEX_COLUMNS)}"
                raise RecordingFileError(path, problem)
            self.index = opened.read(list(INDEX_COLUMNS)).unify_dictionaries()
            self.index.validate(full=True)
            self.partitions = _partitions(self.index, path)
        self.axes = self._mark.axes

    def __len__(self) -> int:
        return len(self.partitions)

    def __iter__(self) -> Iterator[Dataset]:
        return (self.partition(i) for i in range(len(self)))

    def partition(self, i: int) -> Dataset:
        """Read the recordings of one row group, without the history of the whole.

        Raises
        ------
        IndexError
            There is no such partition.
        RecordingFileError
            With file and row group: damaged, cut off, or not what the index says.
        """
        source = FileSource(self.folder, self.folder, self.folder.name)
        return Dataset(self._content([self.partitions[i]], source, "[]").recordings)

    def content(self, source: FileSource) -> FileContent:
        """Read everything, into one block of samples, and the history."""
        content = self._content(self.partitions, source, self._history())
        if self._unread:
            unread = ", ".join(self._unread)[:200]
            content.notes.append(f"columns of {INDEX_FILE} that are not read: {unread}")
        return content

    def _history(self) -> str:
        path = self.folder / HISTORY_NAME
        if not path.is_file():
            return "[]"
        with naming(path, "reading the history"):
            return read_bounded(path, self.folder, self._max_file_bytes).decode()

    def _content(self, parts: Sequence[Partition], source: FileSource, history_json: str) -> FileContent:
        block = _Block(sum(part.n_samples for part in parts), self._mark)
        groups = Counter(part.file for part in self.partitions)
        for file, some in groupby(parts, key=lambda part: part.file):
            path = self.folder / file
            with open_parquet(path, self.folder, self._max_file_bytes) as opened:
                if read_mark(labels_of(opened), "samples", path) != self._mark:
                    raise RecordingFileError(path, f"holds other axes than {INDEX_FILE} says", place="footer")
                if opened.num_row_groups != groups[file]:
                    problem = f"holds {opened.num_row_groups} row groups; {INDEX_FILE} lists {groups[file]}"
                    raise RecordingFileError(path, problem)
                for part in some:
                    block.add(opened, part, path)
        rows = self.index.slice(parts[0].start, parts[-1].stop - parts[0].start)
        flat = FlatRecordings(
            axes=self.axes,
            wrench=block.wrench,
            n_samples=_integers(rows, "n_samples"),
            rate_hz=rows["rate_hz"].to_numpy(),
            start_time=rows["start_time"].to_numpy(),
            trigger_index=_integers(rows, "trigger_index"),
            label=_texts(rows, "label"),
            session=_texts(rows, "session"),
            name=_texts(rows, "name"),
            meta_json=_texts(rows, "meta"),
            time_s=block.time_s,
            flags=block.flags,
            history_json=history_json,
        )
        return unflatten(flat, self.folder, source, finite=block.finite)


class _Block:
    """The samples of neighbouring partitions, put in row group by row group."""

    def __init__(self, n_rows: int, mark: Mark) -> None:
        self.n_rows, self._columns, self._filled = n_rows, mark.columns, 0
        self.wrench: FloatArray = np.empty((n_rows, len(mark.columns)))
        self.time_s: FloatArray | None = None
        self.flags: NDArray[np.uint8] | None = None
        self.finite = True

    def add(self, opened: Any, part: Partition, path: Path) -> None:
        """Read the next row group."""
        place = f"row group {part.row_group}"
        n_samples = opened.metadata.row_group(part.row_group).num_rows
        if n_samples != part.n_samples:
            problem = f"holds {n_samples} samples; by {INDEX_FILE} its recordings have {part.n_samples}"
            raise RecordingFileError(path, problem, place=place)
        try:
            table = opened.read_row_group(part.row_group, [*self._columns, TIME, FLAGS])
            columns = [np.asarray(table[name].to_numpy(), np.float64) for name in self._columns]
        except (
            Exception
        ) as error:  # of many kinds: checksums, columns that are missing or hold something else
            raise RecordingFileError(path, f"cannot be decoded: {error}"[:300], place=place) from error
        rows = slice(self._filled, self._filled + n_samples)
        self._filled = rows.stop
        self.finite = interleave(columns, self.wrench[rows]) and self.finite
        if TIME in table.column_names:
            self.time_s = np.full(self.n_rows, np.nan) if self.time_s is None else self.time_s
            self.time_s[rows] = table[TIME].to_numpy()
        if FLAGS in table.column_names:
            self.flags = np.zeros(self.n_rows, np.uint8) if self.flags is None else self.flags
            self.flags[rows] = table[FLAGS].to_numpy()


@contextmanager
def open_parquet(path: Path, root: Path, max_bytes: int, texts: Sequence[str] = ()) -> Iterator[Any]:
    """Open a file inside `root` as ``pyarrow.parquet.ParquetFile``, some columns to be read dictionary-encoded."""
    library = need("pyarrow.parquet", extra="app", why="to read Parquet files")
    with open_bounded(path, root, max_bytes) as (file, _), naming(path, "reading it as Parquet"):
        try:
            place = os.fspath(path).encode().decode()
        except UnicodeEncodeError:  # pyarrow cannot spell it
            place = need("pyarrow", extra="app", why="to read Parquet files").BufferReader(file.read())
        with library.ParquetFile(place, read_dictionary=texts, page_checksum_verification=True) as opened:
            yield opened


def labels_of(opened: Any) -> dict[str, str]:
    """Return the key-value texts of a footer."""
    found = opened.metadata.metadata or {}
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in found.items()}


def coded_texts(column: Any) -> tuple[NDArray[np.int64], list[str | None]]:
    """Return a dictionary-encoded column as codes and what they mean; the last one, None, is an empty cell."""
    whole = column.unify_dictionaries().combine_chunks()
    values: list[str | None] = whole.dictionary.to_pylist()
    codes = whole.indices.fill_null(len(values)).to_numpy(zero_copy_only=False)
    return codes.astype(np.int64), [*values, None]


def _partitions(index: Any, path: Path) -> tuple[Partition, ...]:
    """Return the row groups that the index names: every one in order, of files that are the archive's."""
    lengths, groups, files = (
        _integers(index, "n_samples"),
        _integers(index, "row_group"),
        _texts(index, "file"),
    )
    if not index.num_rows:
        raise RecordingFileError(path, "lists no recordings")
    for column, wrong, wanted in (
        ("id", _integers(index, "id") != np.arange(len(files)), "0, 1, 2 ... in order"),
        ("n_samples", lengths < 1, "at least 1"),
        ("file", np.array([not is_part_name(file) for file in files]), "samples/part-00000.parquet ..."),
    ):
        if wrong.any():
            row = int(wrong.argmax())
            problem = f"row {row} holds {index[column][row].as_py()!r:.80}; wanted {wanted}"
            raise RecordingFileError(path, problem, column=column)
    names = np.array(files, dtype=object)
    changes = np.flatnonzero((names[1:] != names[:-1]) | (groups[1:] != groups[:-1])) + 1
    found: list[Partition] = []
    counts: Counter[str] = Counter()
    for start, stop in pairwise([0, *changes.tolist(), len(files)]):
        file, group = str(files[start]), int(groups[start])
        if group != counts[file] or (group and found[-1].file != file):
            problem = f"row {start} is said to lie in row group {group} of {file}; wanted every one in order"
            raise RecordingFileError(path, problem, column="row_group")
        counts[file] += 1
        found.append(Partition(file, group, start, stop, int(lengths[start:stop].sum())))
    return tuple(found)


def _integers(table: Any, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers; -1 where a cell is empty."""
    return np.asarray(table[name].fill_null(NO_TRIGGER).to_numpy(), np.int64)


def _texts(table: Any, name: str) -> list[str | None]:
    """Return a column of texts, equal ones being one object, so that a long one is held once."""
    codes, values = coded_texts(table[name])
    return [values[code] for code in codes.tolist()]
