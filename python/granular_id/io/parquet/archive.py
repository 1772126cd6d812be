"""The native archive, read as a whole or one row group at a time, and written.

``recordings.parquet`` has one row per recording and says in which row group of which file its samples lie;
``samples/part-00000.parquet`` and so on hold the samples, a column per axis, whole recordings in each row group.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, checked_index, thaw
from granular_id._core import interleave
from granular_id._progress import ProgressCallback
from granular_id.io.errors import RecordingFileError, naming, need
from granular_id.io.files import open_bounded, read_bounded
from granular_id.io.flat import NO_TRIGGER, FlatRecordings, flatten, unflatten
from granular_id.io.folder_save import HISTORY_NAME, checked_dataset, new_folder, write_history
from granular_id.io.options import MAX_BINARY_BYTES
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset, Recording, unit_of


@dataclass(frozen=True)
class RowGroup:
    """A row group of a file of samples, and the rows of the index (`start` to `stop`) that describe it."""

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
        What ``save_parquet`` wrote.
    max_file_bytes : int
        Largest file that is opened; 2 GiB by default.

    Attributes
    ----------
    axes : tuple of str
        Names of the columns of the samples.
    index : pyarrow.Table
        A row per recording: id, name, label, session, start_time, rate_hz, n_samples, trigger_index, file, row_group
        meta (JSON) and digest (see `digest_of`); texts are dictionary-encoded.
    row_groups : tuple of RowGroup
        In the order of the index.

    Raises
    ------
    RecordingFileError
        The index cannot be read, or does not describe an archive.
    ImportError
        pyarrow is missing.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io.parquet.archive import Archive
    >>> from granular_id.io.parquet.archive import save_parquet
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.full((3, 6), i), rate_hz=500, label="rice") for i in range(5)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     archive = Archive(save_parquet(data, folder + "/rice", recordings_per_group=2))
    ...     archive.n_recordings, [len(part) for part in archive]
    (5, [2, 2, 1])
    """

    def __init__(self, folder: str | os.PathLike[str], *, max_file_bytes: int = MAX_BINARY_BYTES) -> None:
        self.folder = Path(folder)
        self._max_file_bytes = max_file_bytes
        path = self.folder / INDEX_FILE
        with open_parquet(path, self.folder, max_file_bytes, INDEX_TEXTS) as opened:
            names = opened.schema_arrow.names
            self._mark = read_mark(labels_of(opened), "recordings", path)
            self._unread = [name for name in names if name not in (*INDEX_COLUMNS, DIGEST)]
            missing = [name for name in INDEX_COLUMNS if name not in names]
            if missing:
                problem = f"column {missing[0]!r} is missing; wanted {', '.join(INDEX_COLUMNS)}"
                raise RecordingFileError(path, problem)
            self.index = opened.read([*INDEX_COLUMNS, *({DIGEST} & set(names))]).unify_dictionaries()
            self.index.validate(full=True)
            self.row_groups = _row_groups(self.index, path)
        self.axes = self._mark.axes

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

    def content(self, source: FileSource) -> FileContent:
        """Read everything, into one block of samples, and the history."""
        content = self._content(self.row_groups, source, self._history())
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

    def _content(self, parts: Sequence[RowGroup], source: FileSource, history_json: str) -> FileContent:
        block = _Block(sum(part.n_samples for part in parts), self._mark)
        groups = Counter(part.file for part in self.row_groups)
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
    """The samples of neighbouring row groups, put in row group by row group."""

    def __init__(self, n_rows: int, mark: Mark) -> None:
        self.n_rows, self._columns, self._filled = n_rows, mark.columns, 0
        self.wrench: FloatArray = np.empty((n_rows, len(mark.columns)))
        self.time_s: FloatArray | None = None
        self.flags: NDArray[np.uint8] | None = None
        self.finite = True

    def add(self, opened: Any, part: RowGroup, path: Path) -> None:
        """Read the next row group."""
        place = f"row group {part.row_group}"
        n_samples = opened.metadata.row_group(part.row_group).num_rows
        if n_samples != part.n_samples:
            problem = f"holds {n_samples} samples; by {INDEX_FILE} its recordings have {part.n_samples}"
            raise RecordingFileError(path, problem, place=place)
        try:
            table = opened.read_row_group(part.row_group, [*self._columns, TIME, FLAGS])
            columns = [np.asarray(table[name].to_numpy(), np.float64) for name in self._columns]
        except Exception as error:  # checksums, columns that are missing or hold something else
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


def _row_groups(index: Any, path: Path) -> tuple[RowGroup, ...]:
    """Return the row groups that the index names: every one in order, of files that are the archive's."""
    lengths, groups = _integers(index, "n_samples"), _integers(index, "row_group")
    files = _texts(index, "file")
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
    found: list[RowGroup] = []
    counts: Counter[str] = Counter()
    for start, stop in pairwise([0, *changes.tolist(), len(files)]):
        file, group = str(files[start]), int(groups[start])
        if group != counts[file] or (group and found[-1].file != file):
            problem = f"row {start} is said to lie in row group {group} of {file}; wanted every one in order"
            raise RecordingFileError(path, problem, column="row_group")
        counts[file] += 1
        found.append(RowGroup(file, group, start, stop, int(lengths[start:stop].sum())))
    return tuple(found)


def _integers(table: Any, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers; -1 where a cell is empty."""
    return np.asarray(table[name].fill_null(NO_TRIGGER).to_numpy(), np.int64)


def _texts(table: Any, name: str) -> list[str | None]:
    """Return a column of texts, equal ones being one object, so that a long one is held once."""
    codes, values = coded_texts(table[name])
    return [values[code] for code in codes.tolist()]


# Names of files and columns, and the mark that tells an archive from other Parquet.

INDEX_FILE = "recordings.parquet"
SAMPLES_FOLDER = "samples"
VERSION = 1
MARK = "granular_id"
TIME, FLAGS, DIGEST = "time_s", "flags", "digest"
INDEX_TEXTS = ("name", "label", "session", "file", "meta")
INDEX_COLUMNS = (*INDEX_TEXTS, "id", "start_time", "rate_hz", "n_samples", "trigger_index", "row_group")

_PART = re.compile(SAMPLES_FOLDER + r"/part-[0-9]{5,9}\.parquet")


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

    def to_json(self, what: str) -> str:
        """Return the text that goes into a footer; `what` is "recordings" or "samples"."""
        about = {"format": what, "version": VERSION, "axes": self.axes, "columns": self.columns}
        return json.dumps({**about, "units": [unit_of(axis) for axis in self.axes]}, ensure_ascii=False)


def read_mark(labels: Mapping[str, str], what: str, path: Path) -> Mark:
    """Return what a footer says of an archive; `what` is "recordings" or "samples"."""
    try:
        said = json.loads(labels.get(MARK, "null"))
        mark = Mark(tuple(said["axes"]), tuple(said["columns"]))
        wanted = json.loads(mark.to_json(what))
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        problem = f"has no entry {MARK!r} that names axes and as many columns, each once"
        raise RecordingFileError(path, problem, place="footer") from error
    said = {"units": wanted["units"], **said}
    once = [unit or "N" for unit in wanted["units"]]  # old archives say N where nobody stated a unit
    if said["units"] == once:
        said["units"] = wanted["units"]
    other = next((key for key in wanted if said.get(key) != wanted[key]), None)
    if other is not None:
        problem = f"the entry {MARK!r} says that the {other} is {said.get(other)!r:.80}; wanted {wanted[other]!r:.80}"
        raise RecordingFileError(path, problem, place="footer")
    return mark


def part_name(number: int) -> str:
    """Name the file of samples with this number, as the index does."""
    return f"{SAMPLES_FOLDER}/part-{number:05d}.parquet"


def is_part_name(text: object) -> bool:
    """Tell whether the index may name this file: nothing else ever becomes a path."""
    return isinstance(text, str) and _PART.fullmatch(text) is not None


def is_parquet_archive(folder: Path) -> bool:
    """Tell whether a folder is a native archive: a file ``recordings.parquet`` lies in it."""
    return os.path.isfile(folder / INDEX_FILE)  # noqa: PTH113 (says False where is_file raises: no permission)


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
    """Write a data set as a Parquet archive.

    ``recordings.parquet`` has a row per recording; ``samples/part-*.parquet`` hold the samples as float64, a column
    per axis (N and N m), with ``time_s`` and ``flags`` where recordings have any. Every bit is kept: the encodings
    are lossless. Columns whose values repeat, as counts of a sensor do, are stored as a dictionary, all others with
    their bytes split into streams (half the size and a third of the time of a dictionary there); both are
    compressed by zstd, with a checksum per page.

    Parameters
    ----------
    dataset : Dataset
    folder : str or path
        New or empty folder. It is written under a temporary name and renamed at the end.
    recordings_per_group : int
        Recordings that share a row group, the unit in which archives are read: 128 by default, 10 MB of samples
        of 3.2 s at 500 Hz. Long recordings share with fewer.
    progress : callable, optional
        Called as ``progress(recordings_done, recordings_in_all, file)`` after each row group.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        `folder` is a file, a link or a folder with something in it.
    FileNotFoundError
        The folder to put it in does not exist.
    ImportError
        pyarrow is missing.
    TypeError, ValueError
        `dataset` is no Dataset, its recordings differ in their axes, or `recordings_per_group` is not positive.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load
    >>> from granular_id.io.parquet.archive import save_parquet
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save_parquet(data, folder + "/oats")) == data
    True
    """
    recordings = checked_dataset(dataset).recordings
    most = checked_index(recordings_per_group, "recordings_per_group")
    if most < 1:
        raise ValueError(f"recordings_per_group must be positive, got {most}")
    library = need("pyarrow.parquet", extra="app", why="to write Parquet files")
    mark = Mark.of_axes(dataset.axes)
    groups = _groups(recordings, most)
    files = [part_name(i // _GROUPS_PER_PART) for i in range(len(groups))]
    with new_folder(folder) as partial:
        (partial / SAMPLES_FOLDER).mkdir()
        for start in range(0, len(groups), _GROUPS_PER_PART):
            spans = groups[start : start + _GROUPS_PER_PART]
            for done in _write_part(library, partial / files[start], dataset, spans, mark):
                if progress is not None:
                    progress(done, len(recordings), files[start])
        _write_index(library, partial / INDEX_FILE, _index_table(recordings, groups, files), mark)
        write_history(dataset, partial)
    return Path(folder)


def _groups(recordings: Sequence[Recording], most: int) -> list[tuple[int, int]]:
    """Cut the recordings into runs of at most `most`, and not more samples than fit into a row group."""
    spans = []
    start = samples = 0
    for i, recording in enumerate(recordings):
        samples += recording.n_samples
        if i > start and (i - start == most or samples > _MAX_GROUP_SAMPLES):
            spans.append((start, i))
            start, samples = i, recording.n_samples
    return [*spans, (start, len(recordings))]


def _write_part(
    library: Any, path: Path, dataset: Dataset, spans: Sequence[tuple[int, int]], mark: Mark
) -> Iterator[int]:
    """Write one file of samples; yield after each row group how many recordings are written."""
    arrow = need("pyarrow", extra="app", why="to write Parquet files")
    fields = [arrow.field(column, arrow.float64(), nullable=False) for column in mark.columns]
    timed = any(r.time_s is not None for r in dataset)
    flagged = any(r.flags is not None for r in dataset)
    fields += [arrow.field(TIME, arrow.float64(), nullable=False)] if timed else []
    fields += [arrow.field(FLAGS, arrow.uint8(), nullable=False)] if flagged else []
    schema = arrow.schema(fields)
    probe = _probe(dataset.recordings[spans[0][0] : spans[-1][1]])
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
        for start, end in spans:
            flat = flatten(Dataset(dataset.recordings[start:end]))
            n = len(flat.wrench)
            columns = [np.ascontiguousarray(column) for column in flat.wrench.T]
            columns += [_or_full(flat.time_s, n, np.nan)] if timed else []
            columns += [_or_full(flat.flags, n, np.uint8(0))] if flagged else []
            writer.write_table(arrow.Table.from_arrays(columns, schema=schema), row_group_size=n)
            yield end


def _whole_pages(library: Any) -> dict[str, int]:
    """Return what keeps pyarrow from cutting columns into pages of 20,000 rows, which take half as long again to read.

    Versions that do not cut do not know the setting.
    """
    known = inspect.signature(library.ParquetWriter).parameters
    return {"max_rows_per_page": _MAX_GROUP_SAMPLES} if "max_rows_per_page" in known else {}


def _or_full(values: Any, n: int, nothing: Any) -> Any:
    return np.full(n, nothing) if values is None else values


def _probe(recordings: Sequence[Recording]) -> FloatArray:
    """Take samples from all over the recordings, about as many as decide whether values repeat."""
    total = sum(r.n_samples for r in recordings)
    step = max(1, total // _PROBED_SAMPLES)
    kept = islice(recordings, 0, None, step)
    return np.concatenate([r.wrench[:_PROBED_SAMPLES] for r in kept])


def _repeats(values: FloatArray) -> bool:
    return len(np.unique(values)) < _DISTINCT_SHARE * len(values)


def _write_index(library: Any, path: Path, index: Any, mark: Mark) -> None:
    with library.ParquetWriter(path, index.schema, **_COMMON) as writer:
        writer.add_key_value_metadata({MARK: mark.to_json("recordings")})
        writer.write_table(index)


def digest_of(recording: Recording) -> str:
    """Return 32 hexadecimal digits of the SHA-256 of what a recording holds per sample: wrench, stamps, flags."""
    mark = hashlib.sha256(np.ascontiguousarray(recording.wrench, "<f8").data)
    for values, kind in ((recording.time_s, "<f8"), (recording.flags, "u1")):
        if values is not None:
            mark.update(np.ascontiguousarray(values, kind).data)
    return mark.hexdigest()[:32]


def _index_table(
    recordings: Sequence[Recording], groups: Sequence[tuple[int, int]], files: Sequence[str]
) -> Any:
    arrow = need("pyarrow", extra="app", why="to write Parquet files")
    text, number, whole = arrow.string(), arrow.float64(), arrow.int64()
    counts = [end - start for start, end in groups]
    row_groups = [i % _GROUPS_PER_PART for i in range(len(groups))]
    columns = {
        "id": (range(len(recordings)), whole),
        "name": ([r.name for r in recordings], text),
        "label": ([r.label for r in recordings], text),
        "session": ([r.session for r in recordings], text),
        "start_time": ([r.start_time for r in recordings], number),
        "rate_hz": ([r.rate_hz for r in recordings], number),
        "n_samples": ([r.n_samples for r in recordings], whole),
        "trigger_index": ([r.trigger_index for r in recordings], whole),
        "file": (np.repeat(files, counts).tolist(), text),
        "row_group": (np.repeat(row_groups, counts), whole),
        "meta": ([json.dumps(thaw(r.meta)) if r.meta else None for r in recordings], text),
        DIGEST: (list(map(digest_of, recordings)), text),
    }
    return arrow.table({name: arrow.array(values, kind) for name, (values, kind) in columns.items()})
