"""The native archive, read as a whole or one row group at a time.

``recordings.parquet`` has one row per recording and says in which row group of which file its samples lie;
``samples/part-00000.parquet`` and so on hold the samples, a column per axis, whole recordings in each row group.
What was added has an index file of its own in ``recordings/``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._core import interleave
from granular_id._files import check_source
from granular_id._memory import empty
from granular_id._text import counted
from granular_id.io.errors import RecordingFileError, attempt, naming
from granular_id.io.flat import FlatRecordings, checked_history, unflatten
from granular_id.io.options import MAX_BINARY_BYTES
from granular_id.io.parquet.index import Index, RowGroup, coded_texts, integers, texts
from granular_id.io.parquet.layout import FLAGS, TIME, Mark, index_of, labels_of, open_parquet, read_mark
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset, StepReport

__all__ = ["Archive", "RowGroup"]

_BATCH_ROWS = 1 << 14
"""Six columns of so many values stay in the cache of a core from decoding to interleaving: a tenth faster."""

_KEPT_FOOTERS = 64


class Archive:
    """A native archive, opened: its index is in memory, samples are read a row group at a time.

    Parameters
    ----------
    folder : str or path
        What ``save_parquet`` wrote.
    max_file_bytes : int
        Largest file that is opened; 2 GiB by default.
    unreadable : list, optional
        Where the errors about index files go that cannot be read, and whose recordings are then left out. By default
        the first is raised.

    Attributes
    ----------
    axes : tuple of str
        Names of the columns of the samples.
    index : pyarrow.Table
        A row per recording: id, name, label, session, start_time, rate_hz, n_samples, trigger_index, file, row_group
        meta (JSON) and digest (see `digest_of`); texts are dictionary-encoded.
    row_groups : tuple of RowGroup
        In the order of the index; ``group.digest`` identifies the content of each.

    Raises
    ------
    FileNotFoundError
        There is no such folder.
    RecordingFileError
        The index cannot be read, or does not describe an archive.
    ImportError
        pyarrow is missing.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io.parquet.archive import Archive
    >>> from granular_id.io.parquet.writing import save_parquet
    >>> from granular_id import Dataset, Recording
    >>> data = Dataset([Recording(np.full((3, 6), i), rate_hz=500, label="rice") for i in range(5)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     archive = Archive(save_parquet(data, folder + "/rice", recordings_per_group=2))
    ...     archive.n_recordings, [len(part) for part in archive]
    ...     buffer = None
    ...     for group in archive.row_groups:  # the fast way: all samples, of the recordings one behind the other
    ...         samples = archive.samples(group, buffer)
    ...         buffer = samples if buffer is None else buffer
    ...         lengths = archive.index["n_samples"].slice(group.start, group.stop - group.start).to_pylist()
    ...         print(samples.shape, lengths)
    (5, [2, 2, 1])
    (6, 6) [3, 3]
    (6, 6) [3, 3]
    (3, 6) [3]
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        max_file_bytes: int = MAX_BINARY_BYTES,
        unreadable: list[RecordingFileError] | None = None,
    ) -> None:
        self.folder = check_source(folder)
        self._max_file_bytes = max_file_bytes
        self._index = Index(self.folder, max_file_bytes, unreadable)
        self._mark = self._index.mark
        self.axes, self.index, self.row_groups = self._mark.axes, self._index.table, self._index.row_groups
        self._footers: dict[str, Any] = {}

    def __repr__(self) -> str:
        return f"Archive({os.fspath(self.folder)!r}: {counted(self.n_recordings)} of {' '.join(self.axes)})"

    @property
    def index_files(self) -> tuple[str, ...]:
        """``recordings.parquet``, and those of appends in the order in which they were written."""
        return tuple(self._index.names)

    @property
    def n_recordings(self) -> int:
        """Recordings in all."""
        return int(self.index.num_rows)

    def __iter__(self) -> Iterator[Dataset]:
        return map(self.read, self.row_groups)

    def read(self, group: RowGroup) -> Dataset:
        """Read the recordings of one row group, without the history of the whole.

        Raises
        ------
        RecordingFileError
            With file and row group: damaged, cut off, or not what the index says.
        """
        source = FileSource(self.folder, self.folder, self.folder.name)
        return Dataset(self._content([group], source, "[]").recordings)

    def samples(self, group: RowGroup, out: FloatArray | None = None) -> FloatArray:
        """Decode the samples of one row group, without making recordings of them: the fast way to read.

        Parameters
        ----------
        group : RowGroup
        out : ndarray of shape (N, C), float64, optional
            A buffer to decode into, C-contiguous, for one row group after the other: memory that is taken anew each
            time costs more than the copying. With fewer than ``group.n_samples`` rows it is not used.

        Returns
        -------
        ndarray of shape (group.n_samples, C)
            Samples of the recordings ``group.start`` to ``group.stop`` of the index, one behind the other; N and N m.
            A view of `out` where that is used. All are finite, as many as the index says, and checksums are verified.

        Raises
        ------
        RecordingFileError
            As `read`.
        ValueError
            `out` has another type or number of columns.
        """
        n_axes, n = len(self.axes), group.n_samples
        if out is None or (len(out) < n and out.ndim):
            out = np.empty((n, n_axes))
        elif out.dtype != np.float64 or out.shape[1:] != (n_axes,) or not out.flags.c_contiguous:
            came = f"{out.dtype} of shape {out.shape}"
            raise ValueError(f"out must be C-contiguous float64 of shape (N, {n_axes}), got {came}")
        samples = out[:n]
        path = self.folder / group.file
        with self._opened(group.file) as opened:
            finite = _decode(opened, group, path, self._mark, samples, {})
        if not finite:
            raise self._not_finite(group, samples)
        return samples

    def _not_finite(self, group: RowGroup, samples: FloatArray) -> RecordingFileError:
        row, axis = np.argwhere(~np.isfinite(samples))[0].tolist()
        ends = np.cumsum(integers(self._index.rows_of(group), "n_samples"))
        i = int(np.searchsorted(ends, row, side="right"))
        sample = row - (int(ends[i - 1]) if i else 0)
        name = self.index["name"][group.start + i].as_py()
        problem = f"sample {sample} of recording {name!r:.60} is {samples[row, axis]}; wanted finite numbers"
        place = f"row group {group.row_group}"
        return RecordingFileError(self.folder / group.file, problem, place=place, column=self.axes[axis])

    def has_flags(self, group: RowGroup) -> bool:
        """Whether samples of the file that a row group is in have flags."""
        with self._opened(group.file) as opened:
            return FLAGS in opened.schema_arrow.names

    @property
    def history(self) -> tuple[StepReport, ...]:
        """Steps that made the recordings, of what was saved and of what was added."""
        with naming(self.folder, "reading the history"):
            return checked_history(self._index.history_json(), self.n_recordings)

    @property
    def is_synthetic(self) -> bool:
        """Whether any recording was simulated, as its metadata say."""
        return any(self._of_simulation(text) for text in coded_texts(self.index["meta"])[1])

    @property
    def n_synthetic(self) -> int:
        """Recordings that were simulated."""
        codes, values = coded_texts(self.index["meta"])
        return int(np.array([self._of_simulation(text) for text in values])[codes].sum())

    def _of_simulation(self, meta_json: str | None) -> bool:
        if meta_json is None or '"synthetic"' not in meta_json:
            return False
        with naming(self.folder, "reading metadata"):
            meta = json.loads(meta_json)
        return isinstance(meta, dict) and bool(meta.get("synthetic"))

    @property
    def fingerprint(self) -> str:
        """32 hexadecimal digits that change with any recording, its place or what is said of it."""
        return self._index.fingerprint

    def content(self, source: FileSource) -> FileContent:
        """Read everything, into one block of samples, and the history."""
        content = self._content(self.row_groups, source, self._index.history_json())
        content.notes += self._notes()
        return content

    def pieces(
        self, source: FileSource, unreadable: list[RecordingFileError] | None
    ) -> Iterator[FileContent]:
        """Read the same a row group at a time; notes come with the first, the history with each.

        With a list `unreadable`, errors about row groups and the history go there, and what they are about is left out.
        """
        history: Sequence[StepReport] | None = None
        if unreadable is not None:
            history = attempt(unreadable, lambda: self.history) or ()
        notes = self._notes()
        for group in self.row_groups:
            try:
                json_of = self._index.history_json() if history is None else "[]"
                content = self._content([group], source, json_of)
            except RecordingFileError as error:
                if unreadable is None:
                    raise
                lost = f"{error.problem}; its {counted(group.stop - group.start)} left out"
                unreadable.append(RecordingFileError(error.path, lost, place=f"row group {group.row_group}"))
                continue
            history = content.history if history is None else history
            content.history, content.notes, notes = history, [*content.notes, *notes], []
            yield content

    def _notes(self) -> list[str]:
        every = self._index.unread.items()
        return [f"columns of {name} that are not read: {', '.join(unread)[:200]}" for name, unread in every]

    def _content(self, parts: Sequence[RowGroup], source: FileSource, history_json: str) -> FileContent:
        block = _Block(sum(part.n_samples for part in parts), self._mark)
        for file, some in groupby(parts, key=lambda part: part.file):
            with self._opened(file) as opened:
                for part in some:
                    block.add(opened, part, self.folder / file)
        rows = self.index.slice(parts[0].start, parts[-1].stop - parts[0].start)
        flat = FlatRecordings(
            axes=self.axes,
            wrench=block.wrench,
            n_samples=integers(rows, "n_samples"),
            rate_hz=rows["rate_hz"].to_numpy(),
            start_time=rows["start_time"].to_numpy(),
            trigger_index=integers(rows, "trigger_index"),
            label=texts(rows, "label"),
            session=texts(rows, "session"),
            name=self._names(rows, parts[0].start, source),
            meta_json=texts(rows, "meta"),
            time_s=block.time_s,
            flags=block.flags,
            history_json=history_json,
        )
        return unflatten(flat, self.folder, source, finite=block.finite)

    @contextmanager
    def _opened(self, file: str) -> Iterator[Any]:
        """Open a file of samples; what its footer says is checked once, and kept for the next row group of it."""
        path, known = self.folder / file, self._footers.get(file)
        with open_parquet(path, self.folder, self._max_file_bytes, footer=known) as opened:
            if known is None:
                self._check_footer(opened, file, path)
                if len(self._footers) >= _KEPT_FOOTERS:
                    self._footers = {}
                self._footers[file] = opened.metadata
            yield opened

    def _check_footer(self, opened: Any, file: str, path: Path) -> None:
        index, listed = index_of(file), self._index.groups_of[file]
        if read_mark(labels_of(opened), "samples", path) != self._mark:
            raise RecordingFileError(path, f"holds other axes than {index} says", place="footer")
        if opened.num_row_groups != listed:
            problem = f"holds {opened.num_row_groups} row groups; {index} lists {listed}"
            raise RecordingFileError(path, problem)

    def _names(self, rows: Any, start: int, source: FileSource) -> list[str | None]:
        """Return the names in some rows; those that have none are counted through the whole archive."""
        names = texts(rows, "name")
        if self.n_recordings == 1:
            return names
        return [f"{source.name}[{start + i}]" if name is None else name for i, name in enumerate(names)]


class _Block:
    """The samples of neighbouring row groups, put in row group by row group."""

    def __init__(self, n_rows: int, mark: Mark) -> None:
        self.n_rows, self._mark, self._filled = n_rows, mark, 0
        self.wrench: FloatArray = empty((n_rows, len(mark.columns)), "the samples of the archive")
        self.time_s: FloatArray | None = None
        self.flags: NDArray[np.uint8] | None = None
        self.finite = True

    def add(self, opened: Any, part: RowGroup, path: Path) -> None:
        """Read the next row group."""
        rows = slice(self._filled, self._filled + part.n_samples)
        self._filled = rows.stop
        others: dict[str, Any] = {}
        names = opened.schema_arrow.names
        if TIME in names:
            self.time_s = np.full(self.n_rows, np.nan) if self.time_s is None else self.time_s
            others[TIME] = self.time_s[rows]
        if FLAGS in names:
            self.flags = np.zeros(self.n_rows, np.uint8) if self.flags is None else self.flags
            others[FLAGS] = self.flags[rows]
        self.finite = _decode(opened, part, path, self._mark, self.wrench[rows], others) and self.finite


def _decode(
    opened: Any,
    part: RowGroup,
    path: Path,
    mark: Mark,
    wrench: FloatArray,
    others: Mapping[str, NDArray[Any]],
) -> bool:
    """Decode a row group into `wrench` (n_samples, C) and `others`; tell whether the wrench is finite."""
    place = f"row group {part.row_group}"
    n_samples = opened.metadata.row_group(part.row_group).num_rows
    if n_samples != part.n_samples:
        problem = f"holds {n_samples} samples; by {index_of(part.file)} its recordings have {part.n_samples}"
        raise RecordingFileError(path, problem, place=place)
    finite, start = True, 0
    try:
        batches = opened.iter_batches(
            _BATCH_ROWS, row_groups=[part.row_group], columns=[*mark.columns, *others], use_threads=False
        )
        for batch in batches:
            rows = slice(start, start + batch.num_rows)
            start = rows.stop
            columns = [_values(batch.column(name)) for name in mark.columns]
            finite = interleave(columns, wrench[rows]) and finite
            for name, values in others.items():
                values[rows] = batch.column(name).to_numpy(zero_copy_only=False)
    except Exception as error:  # checksums, columns that are missing or hold something else
        raise RecordingFileError(path, f"cannot be decoded: {error}"[:300], place=place) from error
    if start != n_samples:
        raise RecordingFileError(path, f"holds {start} samples; its footer says {n_samples}", place=place)
    return finite


def _values(column: Any) -> FloatArray:
    return np.asarray(column.to_numpy(zero_copy_only=False), np.float64)
