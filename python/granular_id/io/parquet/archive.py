"""The native archive, read as a whole or one row group at a time.

``recordings-*.parquet`` have a row per recording and say in which row group its samples lie; ``samples/part-*.parquet``
hold the samples, a column per axis, whole recordings in each row group. Each append wrote a file of both.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._files import check_source
from granular_id._text import counted
from granular_id.io.files import RecordingFileError, attempt, naming, need
from granular_id.io.flat import checked_history
from granular_id.io.parquet.layout import (
    FLAGS,
    HISTORY,
    INDEX_COLUMNS,
    TIME,
    Mark,
    index_file,
    index_keys,
    index_of,
    index_schema,
    labels_of,
    open_parquet,
    samples_file,
)
from granular_id.recording import Dataset, Recording, StepReport

__all__ = ["Archive", "RowGroup"]

_TEXTS = tuple(name for name, kind in INDEX_COLUMNS.items() if kind == "text")
_BATCH_ROWS = 1 << 14
"""Six columns of so many values stay in the cache of a core from decoding to interleaving: a tenth faster."""


@dataclass(frozen=True)
class RowGroup:
    """A row group of a file of samples.

    Attributes
    ----------
    file : str
        Its file, in the folder of the archive: the name is a digest of all that the archive says of its recordings.
    row_group : int
        Its number in that file.
    start, stop : int
        The rows of the index that describe it.
    n_samples : int
        Samples of its recordings.
    """

    file: str
    row_group: int
    start: int
    stop: int
    n_samples: int


class Archive:
    """A native archive, opened: its index is in memory, samples are read a row group at a time.

    Parameters
    ----------
    folder : str or path
        What ``save_parquet`` or `append` wrote.
    unreadable : list, optional
        Where the errors about index files go that cannot be read, and whose recordings are then left out. By default
        the first is raised.
    keys : sequence of str, optional
        Open only a part of the archive: the index files with these keys. By default all.

    Attributes
    ----------
    axes : tuple of str
        Names of the columns of the samples.
    index : pyarrow.Table
        A row per recording, appends in the order in which they were written: id (of the recording), name, label,
        session, start_time, rate_hz, n_samples, trigger_index, file, row_group, meta (JSON) and digest (of its
        samples, stamps and flags).
    row_groups : tuple of RowGroup
        In the order of the index.

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
    >>> from granular_id.archive import Archive
    >>> from granular_id import Dataset, Recording, save
    >>> data = Dataset([Recording(np.full((3, 6), i), rate_hz=500, label="rice") for i in range(300)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     archive = Archive(save(data, folder + "/rice", "parquet"))
    ...     archive.n_recordings, [len(part) for part in archive]
    ...     first = archive.read(archive.row_groups[0])
    (300, [128, 128, 44])
    >>> first[0].wrench.shape
    (3, 6)
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        unreadable: list[RecordingFileError] | None = None,
        keys: Sequence[str] | None = None,
    ) -> None:
        self.folder = check_source(folder)
        known = index_keys(self.folder) if keys is None else keys
        if not known:
            raise RecordingFileError(self.folder, "is no archive: no recordings-*.parquet lies in it")
        problems: list[RecordingFileError] = []
        found = [attempt(problems, _read_part, self.folder, key) for key in known]
        parts: list[_Part] = []
        for part in sorted((part for part in found if part is not None), key=lambda part: part[:3]):
            if not parts or part.mark == parts[0].mark:
                parts.append(part)
            else:
                problem = f"lists other axes ({' '.join(part.mark.axes)}) than {index_file(parts[0].key)}"
                path = self.folder / index_file(part.key)
                problems.append(RecordingFileError(path, problem, place="footer"))
        if unreadable is not None:
            unreadable += problems
        if problems and (unreadable is None or not parts):
            raise problems[0]
        self._parts, self._mark, self.axes = parts, parts[0].mark, parts[0].mark.axes
        arrow = need("pyarrow", extra="app", why="to read Parquet files")
        self.index = arrow.concat_tables([part.table for part in parts]).unify_dictionaries()
        starts = accumulate((part.table.num_rows for part in parts), initial=0)
        self.row_groups = tuple(
            RowGroup(samples_file(part.key), number, start + first, start + last, n)
            for part, start in zip(parts, starts, strict=False)
            for number, (first, last, n) in enumerate(part.groups)
        )

    def __repr__(self) -> str:
        return f"Archive({os.fspath(self.folder)!r}: {counted(self.n_recordings)} of {' '.join(self.axes)})"

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the index files, in the order in which they were written."""
        return tuple(part.key for part in self._parts)

    @property
    def written(self) -> tuple[float, int]:
        """When the first index file was written, seconds since 1970, and its number among those of one append."""
        return self._parts[0].written, self._parts[0].number

    @property
    def n_recordings(self) -> int:
        """Recordings in all."""
        return int(self.index.num_rows)

    def __iter__(self) -> Iterator[Dataset]:
        return map(self.read, self.row_groups)

    def read(self, group: RowGroup | None = None) -> Dataset:
        """Read the recordings of one row group, without history; or all, into one block of samples, with it.

        Raises
        ------
        RecordingFileError
            With file and row group: damaged, cut off, or not what the index says.
        """
        groups = self.row_groups if group is None else [group]
        index = self.index.slice(groups[0].start, groups[-1].stop - groups[0].start)
        n_rows, done = sum(one.n_samples for one in groups), 0
        wrench = np.empty((n_rows, len(self.axes)))
        others: dict[str, NDArray[Any]] = {FLAGS: np.zeros(n_rows, np.uint8)}
        if index["rate_hz"].null_count:
            others[TIME] = np.full(n_rows, np.nan)
        for one in groups:
            rows = slice(done, done + one.n_samples)
            self.decode(one, wrench[rows], {name: values[rows] for name, values in others.items()})
            done = rows.stop
        for array in (wrench, *others.values()):
            array.flags.writeable = False
        recordings = self._recordings(index, wrench, others)
        return Dataset(recordings, self.history if group is None else ())

    @property
    def history(self) -> tuple[StepReport, ...]:
        """Steps that made the recordings; those that several appends share, once."""
        steps: list[StepReport] = []
        with naming(self.folder, "reading the history"):
            for text in dict.fromkeys(part.history for part in self._parts):
                own = checked_history(text)
                steps += [step for step in own if step not in steps] if steps else own
        return tuple(steps)

    @property
    def n_synthetic(self) -> int:
        """Recordings that were simulated, as their metadata say."""
        return self.count_synthetic(self.index["meta"])

    def count_synthetic(self, metas: Any) -> int:
        """Count the same in cells of the column meta."""
        codes, values = coded_texts(metas)
        simulated = ['"synthetic"' in (text or "") and self.meta_of(text).get("synthetic") for text in values]
        return int(np.array(simulated, bool)[codes].sum())

    def meta_of(self, text: str | None) -> Mapping[str, Any]:
        """Return the metadata in a cell of the index."""
        with naming(self.folder, "reading metadata"):
            meta = json.loads(text or "{}")
            if not isinstance(meta, dict):
                raise TypeError(f"{text:.80} is no JSON object")
            return meta

    def _recordings(
        self, index: Any, wrench: FloatArray, others: Mapping[str, NDArray[Any]]
    ) -> list[Recording]:
        """Make recordings of some rows of the index and their samples."""
        made: list[Recording] = []
        metas: dict[str | None, Mapping[str, Any]] = {}
        start = 0
        for row in index.drop_columns(["id", "file", "row_group", "digest"]).to_pylist():
            rows = slice(start, start + row.pop("n_samples"))
            start, text = rows.stop, row.pop("meta")
            meta = metas[text] if text in metas else metas.setdefault(text, self.meta_of(text))
            row["name"] = row["name"] or ""
            row |= {
                "time_s": others[TIME][rows] if row["rate_hz"] is None else None,
                "flags": others[FLAGS][rows],
            }
            try:
                made.append(Recording(wrench[rows], meta=meta, axes=self.axes, **row))
            except (TypeError, ValueError) as error:
                raise RecordingFileError(self.folder, f"recording {row['name']!r:.60}: {error}") from error
        return made

    def decode(
        self, group: RowGroup, wrench: FloatArray, others: Mapping[str, NDArray[Any]] = MappingProxyType({})
    ) -> None:
        """Decode a row group into `wrench` (n_samples, C), and into those of `others` that there are.

        Memory that is taken anew for each group costs more than this.
        """
        path, place = self.folder / group.file, f"row group {group.row_group}"
        with open_parquet(path, self.folder) as opened:
            if Mark.read(opened, "samples", path)[0] != self._mark:
                problem = f"holds other axes than {index_of(group.file)} says"
                raise RecordingFileError(path, problem, place="footer")
            is_there = group.row_group < opened.num_row_groups
            n_samples = opened.metadata.row_group(group.row_group).num_rows if is_there else 0
            if n_samples != group.n_samples:
                listed = f"by {index_of(group.file)} its recordings have {group.n_samples}"
                raise RecordingFileError(path, f"holds {n_samples} samples; {listed}", place=place)
            there = [name for name in others if name in opened.schema_arrow.names]
            finite, start = True, 0
            try:
                wanted = {"row_groups": [group.row_group], "columns": [*self._mark.columns, *there]}
                for batch in opened.iter_batches(_BATCH_ROWS, **wanted, use_threads=False):
                    rows = slice(start, start + batch.num_rows)
                    start = rows.stop
                    columns = [_values(batch.column(name)) for name in self._mark.columns]
                    np.stack(columns, axis=1, out=wrench[rows])
                    finite = finite and bool(np.isfinite(wrench[rows]).all())
                    for name in there:
                        others[name][rows] = batch.column(name).to_numpy(zero_copy_only=False)
            except Exception as error:  # checksums, columns that are missing or hold something else
                raise RecordingFileError(path, f"cannot be decoded: {error}"[:300], place=place) from error
        if start != n_samples:
            raise RecordingFileError(path, f"holds {start} samples; its footer says {n_samples}", place=place)
        if not finite:
            row, axis = np.argwhere(~np.isfinite(wrench))[0].tolist()
            problem = f"sample {row} is {wrench[row, axis]}; wanted finite numbers"
            raise RecordingFileError(path, problem, place=place, column=self.axes[axis])


class _Part(NamedTuple):
    """One index file, checked."""

    written: float
    number: int
    key: str
    mark: Mark
    history: str
    table: Any
    groups: list[tuple[int, int, int]]  # of each row group: first row, end, samples


def _read_part(folder: Path, key: str) -> _Part:
    path, schema = folder / index_file(key), index_schema()
    with open_parquet(path, folder, texts=_TEXTS) as opened:
        mark, entry = Mark.read(opened, "recordings", path)
        table = opened.read(schema.names, use_threads=False)
        history = labels_of(opened).get(HISTORY, "[]")
    other = next((name for name in schema.names if name not in table.column_names), None)
    if other is not None:
        raise RecordingFileError(path, f"column {other!r} is missing; wanted {', '.join(schema.names)}")
    with naming(path, "reading its columns"):
        table = table.cast(schema)
        table.validate(full=True)
        written, number = float(entry["written"]), int(entry["part"])
    if not table.num_rows:
        raise RecordingFileError(path, "lists no recordings")
    return _Part(written, number, key, mark, history, table, _groups(table, path))


def _groups(table: Any, path: Path) -> list[tuple[int, int, int]]:
    """Return rows and samples of each row group that an index file lists: every one, in order."""
    numbers, lengths = integers(table, "row_group"), integers(table, "n_samples")
    steps = np.diff(numbers, prepend=0)
    for column, wrong, wanted in (
        ("n_samples", lengths < 1, "at least 1"),
        ("row_group", (steps != 0) & (steps != 1), "row groups one after the other"),
        ("row_group", (numbers != 0) & (np.arange(len(numbers)) == 0), "row group 0 first"),
    ):
        if wrong.any():
            row = int(wrong.argmax())
            problem = f"row {row} holds {table[column][row].as_py()!r:.80}; wanted {wanted}"
            raise RecordingFileError(path, problem, column=column)
    bounds = [*np.flatnonzero(np.diff(numbers, prepend=-1)).tolist(), len(numbers)]
    return [(start, stop, int(lengths[start:stop].sum())) for start, stop in pairwise(bounds)]


def _values(column: Any) -> FloatArray:
    return np.asarray(column.to_numpy(zero_copy_only=False), np.float64)


def coded_texts(column: Any) -> tuple[NDArray[np.int64], list[str | None]]:
    """Return a column of texts as codes and what they mean; the last one, None, is an empty cell."""
    coded = column if str(column.type).startswith("dictionary") else column.dictionary_encode()
    whole = coded.unify_dictionaries().combine_chunks()
    values: list[str | None] = whole.dictionary.to_pylist()
    codes = whole.indices.fill_null(len(values)).to_numpy(zero_copy_only=False)
    return codes.astype(np.int64), [*values, None]


def integers(table: Any, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers; -1 where a cell is empty."""
    return np.asarray(table[name].fill_null(-1).to_numpy(), np.int64)
