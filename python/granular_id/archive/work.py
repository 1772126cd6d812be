"""What a worker does: one task reads some row groups of an archive and writes one whole file."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import threading
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._files import cannot_write, sha256_of, sync_folder
from granular_id.io.errors import RecordingFileError, naming, need, printable
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.io.parquet.index import coded_texts
from granular_id.io.parquet.layout import INDEX_FILE
from granular_id.recording import Dataset, Recording, Setup

FloatArray = npt.NDArray[np.float64]

INDEX_COLUMNS = ("name", "label", "session", "start_time", "digest")
"""Columns of the index that stand in front of what is computed."""

MARK, VERSION = "granular_id", 1

_KEPT_ARCHIVES = 4

_LEAST_ROWS = 128
"""Rows of a row group that is written, at least: archives of pushes that were recorded one by one have one in each."""


class Work(Protocol):
    """What is made of recordings. Picklable: it travels to workers, and holds no data."""

    def about(self) -> dict[str, Any]:
        """Everything that decides the output, as JSON: it is part of the name of every file."""
        ...

    def check(self, archive: Archive) -> None:
        """Refuse an archive that it does not suit: ValueError with the way out, before any work."""
        ...

    def fields(self) -> list[Any]:
        """Fields (pyarrow) of its columns."""
        ...

    def columns(self, archive: Archive, group: RowGroup) -> list[Any]:
        """Columns (pyarrow arrays) of the recordings of one row group; valid until the next call in this thread."""
        ...


@dataclass(frozen=True)
class Task:
    """One partition: which row groups make which file. A few KB; no data goes through a scheduler."""

    archive: str
    out: str
    name: str
    row_groups: tuple[tuple[str, int], ...]  # file, row group
    n_recordings: int
    work: Work


@dataclass(frozen=True)
class Outcome:
    """What became of a task: a file, or a problem."""

    name: str
    n_recordings: int
    sha256: str = ""
    n_bytes: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    """For "reading", "computing" and "writing"; empty where the file was there."""
    problem: str = ""


def process_partition(task: Task) -> Outcome:
    """Make the file of a task, unless it is there: whole, under a name made of what it is made of.

    A task may run twice, anywhere, at the same time: both write the same bytes under temporary names, and rename.

    Raises
    ------
    OSError
        The file cannot be written. What cannot be read or computed is an `Outcome` with a problem instead.
    """
    there = finished(task)
    return _made(task, Path(task.out, task.name)) if there is None else there


def finished(task: Task) -> Outcome | None:
    """Return the outcome of a task whose file is there and whole: as many rows as wanted, by the sums of its pages."""
    library = need("pyarrow.parquet", extra="app", why="to work on archives")
    target = Path(task.out, task.name)
    try:
        with library.ParquetFile(target, page_checksum_verification=True) as opened:
            n_rows = sum(batch.num_rows for batch in opened.iter_batches(use_threads=False))
    except (OSError, ValueError):  # there is none, or it is cut off or damaged: made anew
        return None
    if n_rows != task.n_recordings:
        return None
    with target.open("rb") as file:
        return Outcome(task.name, task.n_recordings, sha256_of(file), file.tell())


def _made(task: Task, target: Path) -> Outcome:
    """Compute and write a file, under a temporary name until it is whole and on the disk."""
    begun = perf_counter()
    try:
        opened = _opened(task)
        groups = [opened.groups[place] for place in task.row_groups]
        schema = opened.schema(task.work)
    except Exception as error:
        return Outcome(task.name, task.n_recordings, problem=_in_words(error, task.archive))
    library = need("pyarrow.parquet", extra="app", why="to work on archives")
    seconds = {"reading": perf_counter() - begun, "computing": 0.0, "writing": 0.0}
    _scratch.reading = 0.0
    draft = target.with_name(f".{target.name}.{secrets.token_hex(8)}.tmp")
    try:
        with _Draft(draft) as file:
            writer = library.ParquetWriter(file, schema, **_encoding(schema))
            pending: list[list[Any]] = []
            joined: list[RowGroup] = []
            for group in groups:
                begun = perf_counter()
                try:
                    columns = task.work.columns(opened.archive, group)
                    joined.append(group)
                    whole = group is groups[-1] or sum(one.stop - one.start for one in joined) >= _LEAST_ROWS
                    pending.append(columns if whole else [_copied(column) for column in columns])
                    rows = opened.table(joined, pending, schema) if whole else None
                except Exception as error:
                    file.give_up()
                    place = f"{group.file}, row group {group.row_group}"
                    return Outcome(task.name, task.n_recordings, problem=_in_words(error, place))
                computed = perf_counter()
                if rows is not None:
                    writer.write_table(rows, row_group_size=rows.num_rows)
                    pending, joined = [], []
                seconds["computing"] += computed - begun
                seconds["writing"] += perf_counter() - computed
            begun = perf_counter()
            writer.close()
            file.sync()
        draft.replace(target)
        sync_folder(target.parent)
    except OSError as error:
        raise cannot_write(target, error) from error
    finally:
        draft.unlink(missing_ok=True)
    seconds["writing"] += perf_counter() - begun
    reading = getattr(_scratch, "reading", 0.0)
    seconds["reading"] += reading
    seconds["computing"] -= reading
    return Outcome(task.name, task.n_recordings, file.sha256, file.n_bytes, seconds)


def _copied(column: Any) -> Any:
    """Copy a column, whose memory is used again for the next row group."""
    return column.take(np.arange(len(column)))


def _in_words(error: Exception, place: str) -> str:
    """Say in one line what cannot be read or computed, and where."""
    said = printable(str(error))
    if isinstance(error, RecordingFileError):  # names file and place itself
        return said
    return f"{place}: {said or type(error).__name__}"


def _encoding(schema: Any) -> dict[str, Any]:
    """Return how columns are written: texts as a dictionary, lists of numbers split into bytes, which lz4 then packs.

    Of 600 counts that makes 256 bytes of 4,800 at 165,000 recordings a second on a core; zstd takes twice the time
    for numbers that hardly repeat, and saves a twentieth of their size.
    """
    arrow = need("pyarrow", extra="app", why="to work on archives")
    lists = [field.name for field in schema if arrow.types.is_fixed_size_list(field.type)]
    return {
        "compression": "lz4",
        "use_dictionary": [field.name for field in schema if arrow.types.is_string(field.type)],
        "use_byte_stream_split": [f"{name}.list.element" for name in lists],
        "write_statistics": [field.name for field in schema if field.name not in lists],
        "write_page_checksum": True,
    }


# The archive of a worker, opened once, and memory that is used again.


class _Opened:
    """An archive as the tasks of a process share it."""

    def __init__(self, archive: Archive, mark: object) -> None:
        self.archive, self.mark = archive, mark
        self.groups = {(group.file, group.row_group): group for group in archive.row_groups}
        self._schemas: dict[str, Any] = {}

    def schema(self, work: Work) -> Any:
        """Return the schema of what is written: columns of the index, then those of the work."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        key = spec_json(work, self.archive)
        if key not in self._schemas:
            kinds = {"start_time": arrow.float64()}
            own = [arrow.field(name, kinds.get(name, arrow.string())) for name in INDEX_COLUMNS]
            mark = {MARK: json.dumps({"format": "partition", "version": VERSION, "spec": json.loads(key)})}
            self._schemas[key] = arrow.schema([*own, *work.fields()], metadata=mark)
        return self._schemas[key]

    def table(self, groups: Sequence[RowGroup], columns: Sequence[Sequence[Any]], schema: Any) -> Any:
        """Put rows of the index beside the columns of the work, which come row group by row group."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        # Neighbours for the driver may not be here: what was appended meanwhile may stand between them.
        index = self.archive.index
        rows = arrow.concat_tables([index.slice(group.start, group.stop - group.start) for group in groups])
        nothing = arrow.nulls(rows.num_rows)
        about = [rows[name] if name in rows.column_names else nothing for name in INDEX_COLUMNS]
        own = [arrow.chunked_array(list(parts)) for parts in zip(*columns, strict=True)]
        kinds = schema.types[: len(about)]
        texts = [column.cast(kind) for column, kind in zip(about, kinds, strict=True)]
        return arrow.Table.from_arrays([*texts, *own], schema=schema)


_archives: dict[str, _Opened] = {}
_opening = threading.Lock()


def _opened(task: Task) -> _Opened:
    """Open an archive once a process, and again when it has grown or is another one by now."""
    with _opening:
        known = _archives.get(task.archive)
        mark = _mark_of(task.archive)
        if known is None or known.mark != mark or not known.groups.keys() >= set(task.row_groups):
            known = remember(Archive(task.archive), task.archive)
        return known


def remember(archive: Archive, folder: str) -> _Opened:
    """Keep an open archive for the tasks of this process."""
    if len(_archives) >= _KEPT_ARCHIVES:
        _archives.pop(next(iter(_archives)), None)
    known = _archives[folder] = _Opened(archive, _mark_of(folder))
    return known


def forget(folder: str) -> None:
    """Let go of the archive that tasks of this process used, and of the memory of this thread."""
    _archives.pop(folder, None)
    _scratch.__dict__.clear()


def _mark_of(folder: str) -> object:
    """Tell one archive in a folder from the next; what is appended to it changes nothing that was there."""
    try:
        about = os.stat(os.path.join(folder, INDEX_FILE))  # noqa: PTH116, PTH118 (for every task)
    except OSError:
        return None
    return about.st_ino, about.st_size, about.st_mtime_ns


_scratch = threading.local()


def read_samples(archive: Archive, group: RowGroup) -> FloatArray:
    """Read the samples (n_samples, C) of one row group into memory that this thread uses again; time is taken."""
    begun = perf_counter()
    samples = archive.samples(group, buffer("samples", (group.n_samples, len(archive.axes))))
    _scratch.reading = getattr(_scratch, "reading", 0.0) + perf_counter() - begun
    return samples


def buffer(name: str, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """Return memory of this thread, used again by whoever asks for the same name."""
    kept = getattr(_scratch, name, None)
    if kept is None or kept.dtype != dtype or kept.shape[1:] != shape[1:] or len(kept) < shape[0]:
        kept = np.empty(shape, dtype)
        setattr(_scratch, name, kept)
    return kept[: shape[0]]


# What is looked at before any work.


def one_of_each(archive: Archive, rate_hz: float) -> Dataset:
    """Return blank recordings of all set-ups, units and rates that occur, for what looks at nothing else."""
    index = archive.index
    codes, _ = coded_texts(index["meta"])
    rates = np.asarray(index["rate_hz"].to_numpy(), np.float64)
    first = set(np.unique(codes, return_index=True)[1].tolist())
    first |= set(np.flatnonzero(rates != rate_hz)[:1].tolist())
    blank = np.zeros((1, len(archive.axes)))
    blank.flags.writeable = False
    recordings: dict[Hashable, Recording] = {}
    with naming(archive.folder, "reading metadata"):
        for row in index.select(["name", "meta", "rate_hz"]).take(sorted(first)).to_pylist():
            meta = json.loads(row["meta"] or "{}")
            key = Setup.of(meta), repr(meta.get("units")), row["rate_hz"]
            if key not in recordings:
                recordings[key] = Recording(
                    blank,
                    rate_hz=row["rate_hz"],
                    time_s=np.zeros(1) if row["rate_hz"] is None else None,
                    meta=meta,
                    name=row["name"] or "",
                    axes=archive.axes,
                )
    return Dataset(list(recordings.values()), archive.history)


# Files that are whole, named by what they are made of.


class _Draft:
    """A file that is written and digested at once; after a failure pyarrow may close what it wants."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._sha, self.n_bytes, self._given_up = hashlib.sha256(), 0, False
        self.closed = False

    def __enter__(self) -> _Draft:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.give_up()
        self._file.close()

    @property
    def sha256(self) -> str:
        return self._sha.hexdigest()

    def give_up(self) -> None:
        """Take no more notice of what is written."""
        self._given_up = True

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        n_bytes = len(left)
        if self._given_up:
            return n_bytes
        self._sha.update(left)
        self.n_bytes += n_bytes
        try:
            while left:
                left = left[self._file.write(left) :]
        except BaseException:
            self.give_up()
            raise
        return n_bytes

    def flush(self) -> None:
        """Do nothing: nothing is held back."""

    def tell(self) -> int:
        return self.n_bytes

    def close(self) -> None:
        """Do nothing: whoever opened it closes it."""

    def sync(self) -> None:
        """Wait until it is on the disk."""
        os.fsync(self._file.fileno())


def spec_json(work: Work, archive: Archive) -> str:
    """Everything beside the recordings that decides what is written, as one text."""
    spec = {"work": work.about(), "axes": archive.axes, "granular_id": _core.__version__}
    return json.dumps(spec, sort_keys=True, ensure_ascii=False, allow_nan=False)


def partition_name(spec: str, groups: Sequence[RowGroup]) -> str:
    """Name a file by what it is made of."""
    text = json.dumps([spec, *(group.digest for group in groups)])
    return f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.parquet"
