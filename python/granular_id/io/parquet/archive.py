"""Read a native archive: the whole of it, or one row group at a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import accumulate, groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._core import interleave
from granular_id._parallel import spread
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import check_expansion, check_file, read_bounded
from granular_id.io.flat import RECORDING_BYTES, FlatRecordings, unflatten
from granular_id.io.folder_save import HISTORY_NAME
from granular_id.io.options import MAX_BINARY_BYTES, MAX_TEXT_BYTES
from granular_id.io.parquet.file import CheckedParquet, open_parquet
from granular_id.io.parquet.index import Partition, floats, integers, partitions, read_index, texts
from granular_id.io.parquet.layout import FLAGS, INDEX_COLUMNS, INDEX_FILE, INDEX_TEXTS, TIME, read_mark
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset

__all__ = ["ParquetArchive"]


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
        with open_parquet(path, self.folder, max_file_bytes, texts=INDEX_TEXTS) as parquet:
            mark = read_mark(parquet.labels, "recordings", path)
            self.axes = mark.axes
            self._mark = mark
            self.index = read_index(parquet)
            self._unread = [name for name in parquet.columns if name not in INDEX_COLUMNS]
        self.partitions = partitions(self.index, path)
        self._groups = Counter(part.file for part in self.partitions)

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
            content.notes.append(
                f"columns of {INDEX_FILE} that are not read: {', '.join(self._unread)[:200]}"
            )
        return content

    def _content(self, parts: Sequence[Partition], source: FileSource, history_json: str) -> FileContent:
        block = _Block(sum(part.n_samples for part in parts), self._mark.columns)
        files = {part.file: self.folder / part.file for part in parts}
        read = [self.folder / INDEX_FILE, *files.values()]
        n_bytes = sum(check_file(path, self.folder, self._max_file_bytes) for path in read)
        n_recordings = parts[-1].stop - parts[0].start
        expanded = block.n_bytes + RECORDING_BYTES * n_recordings
        check_expansion(self.folder / INDEX_FILE, n_bytes, expanded, place="column n_samples")
        filled, finite = 0, True
        for file, group in groupby(parts, key=lambda part: part.file):
            some = list(group)
            with open_parquet(files[file], self.folder, self._max_file_bytes) as parquet:
                finite = self._fill(block, parquet, some, filled) and finite
            filled += sum(part.n_samples for part in some)
        rows = self.index.slice(parts[0].start, n_recordings)
        flat = FlatRecordings(
            axes=self.axes,
            wrench=block.wrench,
            n_samples=integers(rows, "n_samples"),
            rate_hz=floats(rows, "rate_hz"),
            start_time=floats(rows, "start_time"),
            trigger_index=integers(rows, "trigger_index"),
            label=texts(rows, "label"),
            session=texts(rows, "session"),
            name=texts(rows, "name"),
            meta_json=texts(rows, "meta"),
            time_s=block.time_s,
            flags=block.flags,
            history_json=history_json,
        )
        return unflatten(flat, self.folder, source, finite=finite)

    def _history(self) -> str:
        path = self.folder / HISTORY_NAME
        if not path.is_file():
            return "[]"
        # text becomes objects of many times its size: as much as a CSV file, or a line for each recording
        most = max(MAX_TEXT_BYTES, RECORDING_BYTES * self.index.num_rows)
        data = read_bounded(path, self.folder, min(most, self._max_file_bytes))
        try:
            return data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise RecordingFileError(path, f"is not UTF-8 text: {error}") from error

    def _fill(self, block: _Block, parquet: CheckedParquet, parts: Sequence[Partition], filled: int) -> bool:
        """Put in the samples of one file, behind those that are filled; tell whether they are finite."""
        self._check_groups(parquet, parts)
        columns = _sample_columns(parquet, self._mark.columns)
        parquet.check(columns)
        block.make(columns)
        starts = accumulate((part.n_samples for part in parts[:-1]), initial=filled)

        def fill(item: tuple[Partition, int]) -> bool:
            part, start = item
            table = parquet.read(part.row_group, columns)
            return block.put(table, start, parquet.path, f"row group {part.row_group}")

        return all(spread(fill, zip(parts, starts, strict=True), parquet.most_threads))

    def _check_groups(self, parquet: CheckedParquet, parts: Sequence[Partition]) -> None:
        path = parquet.path
        if read_mark(parquet.labels, "samples", path) != self._mark:
            raise RecordingFileError(path, f"holds other axes than {INDEX_FILE} says", place="footer")
        listed = self._groups[parts[0].file]
        if len(parquet.rows) != listed:
            raise RecordingFileError(
                path, f"holds {len(parquet.rows)} row groups; {INDEX_FILE} lists {listed}"
            )
        for part in parts:
            rows = parquet.rows[part.row_group]
            if rows != part.n_samples:
                problem = f"holds {rows} samples; by {INDEX_FILE} its recordings have {part.n_samples}"
                raise RecordingFileError(path, problem, place=f"row group {part.row_group}")


class _Block:
    """The samples of neighbouring partitions, put in row group by row group."""

    def __init__(self, n_rows: int, axes: Sequence[str]) -> None:
        self.n_rows = n_rows
        self.axes = axes
        self.n_bytes = 8 * n_rows * len(axes)
        self.wrench: FloatArray = np.empty((0, len(axes)))
        self.time_s: FloatArray | None = None
        self.flags: NDArray[np.uint8] | None = None

    def make(self, columns: Sequence[str]) -> None:
        """Take the memory, when sizes are checked."""
        if not len(self.wrench):
            self.wrench = np.empty((self.n_rows, len(self.axes)))
        if TIME in columns and self.time_s is None:
            self.time_s = np.full(self.n_rows, np.nan)
        if FLAGS in columns and self.flags is None:
            self.flags = np.zeros(self.n_rows, np.uint8)

    def put(self, table: Any, start: int, path: Path, place: str) -> bool:
        """Put in one row group, and tell whether its samples are finite; several threads may, for rows of their own."""
        for name in table.column_names:
            if table.column(name).null_count:
                raise RecordingFileError(path, "holds empty cells; wanted numbers", place=place, column=name)
        rows = slice(start, start + table.num_rows)
        columns = [table.column(name).to_numpy() for name in self.axes]
        finite = interleave(columns, self.wrench[rows])
        for name, values in ((TIME, self.time_s), (FLAGS, self.flags)):
            if name in table.column_names and values is not None:
                values[rows] = table.column(name).to_numpy()
        return finite


def _sample_columns(parquet: CheckedParquet, axes: Sequence[str]) -> list[str]:
    """Return the columns to read, their types checked."""
    wanted = {**dict.fromkeys(axes, "double"), TIME: "double", FLAGS: "uint8"}
    for name, kind in wanted.items():
        if name not in parquet.columns:
            if name in axes:
                raise RecordingFileError(
                    parquet.path, f"column {name!r} is missing; wanted {', '.join(axes)}"
                )
        elif str(parquet.columns[name]) != kind:
            raise RecordingFileError(
                parquet.path, f"holds {parquet.columns[name]}; wanted {kind}", column=name
            )
    return [name for name in wanted if name in parquet.columns]
