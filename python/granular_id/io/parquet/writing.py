"""Archives written: as a whole, or more and more recordings by any number of writers."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error, checked_index, thaw
from granular_id._files import absolute, check_target, durable_file, made_folder
from granular_id._progress import ProgressCallback, check_progress, showing
from granular_id.io.errors import RecordingFileError, need
from granular_id.io.flat import flat_samples
from granular_id.io.folder_save import checked_dataset, history_json, new_folder, write_history
from granular_id.io.options import MAX_BINARY_BYTES
from granular_id.io.parquet.index import RowDigests, hashed
from granular_id.io.parquet.layout import (
    DIGEST,
    FLAGS,
    HISTORY,
    INDEX_FILE,
    INDEX_FOLDER,
    MARK,
    SAMPLES_FOLDER,
    TIME,
    Mark,
    added_names,
    index_names,
    labels_of,
    open_parquet,
    part_name,
    read_mark,
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
    >>> from granular_id import load
    >>> from granular_id.io.parquet.writing import save_parquet
    >>> from granular_id import Dataset, Recording
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
        table = _index_table(recordings, groups, files, list(map(digest_of, recordings)))
        _write_index(library, partial / INDEX_FILE, table, {MARK: mark.to_json("recordings")})
        write_history(dataset, partial)
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


def append(
    folder: str | os.PathLike[str], dataset: Dataset, *, progress: bool | ProgressCallback = False
) -> Appended:
    """Add recordings to an archive, or begin one.

    Of every 8192 recordings two files are made: ``samples/<key>.parquet``, and then ``recordings/<key>.parquet``, which
    lists them; a reader sees all of them or none. Each is written under a temporary name, brought to the disk and
    renamed. An append that was killed is simply run again: what is in the archive already is not added again.

    Any number of threads, processes and machines may append to one archive at once. Of two that add the same recording
    in the same moment, but not the same data set, both may: `granular_id.archive.check` tells.

    Parameters
    ----------
    folder : str or path
        An archive, or a new or empty folder.
    dataset : Dataset
        Some thousand recordings at a time: each append makes two files more. Its history is kept with them.
    progress : bool or callable, default False
        Show it; or called as ``progress(recordings_done, recordings_in_all, folder)`` after each row group.

    Returns
    -------
    Appended
        ``n_added`` and ``n_present``: a recording is present if one with the same samples, stamps and flags, name,
        label, session and start time is in the archive, or earlier in `dataset`.

    Raises
    ------
    FileExistsError
        `folder` is a file, or a folder that holds something else.
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
    every = checked_dataset(dataset).recordings
    check_progress(progress)
    library = need("pyarrow.parquet", extra="app", why="to write Parquet files")
    target, mark = Path(folder), Mark.of_axes(dataset.axes)
    digests = _absent(target, dataset)
    recordings = [every[i] for i in digests]
    listed = [*digests.values()]
    groups = _groups(recordings, RECORDINGS_PER_GROUP) if recordings else []
    n_added = 0
    with showing(progress) as step:
        for first in range(0, len(groups), _GROUPS_PER_PART):
            spans = groups[first : first + _GROUPS_PER_PART]
            start, stop = spans[0][0], spans[-1][1]
            chunk = Dataset(recordings[start:stop], dataset.history)
            spans = [(a - start, b - start) for a, b in spans]

            def told(done: int, start: int = start) -> None:
                if step is not None:
                    step(start + done, len(recordings), os.fspath(target))

            added = _append_chunk(library, target, chunk, listed[start:stop], spans, mark, told)
            n_added += len(chunk) * added
    return Appended(n_added, len(every) - n_added)


def _append_chunk(
    library: Any,
    target: Path,
    dataset: Dataset,
    digests: Sequence[str],
    spans: Sequence[tuple[int, int]],
    mark: Mark,
    told: Callable[[int], None],
) -> bool:
    """Add one file of samples and its index, unless another writer is quicker."""
    table = _index_table(dataset.recordings, spans, [""] * len(spans), digests)
    counts = [str(end - start) for start, end in spans]
    key = hashed([*mark.axes, *counts, RowDigests(table).of(0, len(dataset))])
    file, index_file = added_names(key)
    table = table.set_column(table.column_names.index("file"), "file", [[file] * len(dataset)])
    labels = {HISTORY: history_json(dataset)} if dataset.history else {}
    with made_folder(target / SAMPLES_FOLDER) as samples, made_folder(target / INDEX_FOLDER) as indices:
        try:
            if (target / index_file).is_file():
                return False
            with durable_file(target / file) as draft:
                for done in _write_part(library, draft, dataset, spans, mark):
                    told(done)
            with durable_file(target / index_file) as draft:
                labels[MARK] = mark.to_json("recordings", written=time.time())
                _write_index(library, draft, table, labels)
        except OSError:
            if (target / index_file).is_file():  # and the other writer has tidied up
                return False
            raise
        for draft in (*samples.glob(f".{key[:20]}-*"), *indices.glob(f".{key[:20]}-*")):
            with suppress(OSError):  # what an append of the same left that was killed
                draft.unlink()
    return True


def _absent(target: Path, dataset: Dataset) -> dict[int, str]:
    """Return the digests of the recordings that are not in the archive yet, by their place in the data set."""
    digests = list(map(digest_of, dataset))
    if not index_names(target):
        _check_new(target)
    seen = _present(target, dataset, digests)
    found: dict[int, str] = {}
    for i, (recording, digest) in enumerate(zip(dataset, digests, strict=True)):
        identity = _identity(recording, digest)
        if identity not in seen:
            seen.add(identity)
            found[i] = digest
    return found


_Identity = tuple[str, str | None, str | None, str | None, float | None]


def _identity(recording: Recording, digest: str) -> _Identity:
    return (digest, recording.name, recording.label, recording.session, recording.start_time)


def _present(target: Path, dataset: Dataset, digests: Sequence[str]) -> set[_Identity]:
    """Return the identities of what is in the archive, as far as they may be those of these recordings."""
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    compute = need("pyarrow.compute", extra="app", why="to read Parquet files")
    wanted = arrow.array(digests, arrow.string())
    seen: set[_Identity] = set()
    for name in _known(target, dataset.axes, "dataset").that_may_list(digests):
        with open_parquet(target / name, target, MAX_BINARY_BYTES) as opened:
            rows = opened.read(_IDENTITY, use_threads=False)
            rows = rows.filter(compute.is_in(rows[DIGEST], value_set=wanted))
            seen.update(zip(*(rows[column].to_pylist() for column in _IDENTITY), strict=True))
    return seen


_IDENTITY = [DIGEST, "name", "label", "session", "start_time"]


_File = tuple[str, tuple[int, ...]]
"""An index file, by name; of ``recordings.parquet``, whose name does not tell what it holds, also its state."""


@dataclass(frozen=True)
class _Known:
    """Which index files list recordings of which digests: a hash of each, and the place of its file."""

    files: dict[_File, int]
    hashes: NDArray[np.int64]
    places: NDArray[np.int32]

    def that_may_list(self, digests: Sequence[str]) -> list[str]:
        """Return the names of the files that may list one of these digests."""
        found = np.unique(self.places[np.isin(self.hashes, _hashes(digests))])
        names = [name for name, _ in self.files]
        return [names[place] for place in found.tolist()]

    @property
    def n_bytes(self) -> int:
        return self.hashes.nbytes + self.places.nbytes + _FILE_BYTES * len(self.files)


_remembered: dict[tuple[str, tuple[str, ...]], _Known] = {}
"""By archive and axes, the latest last. An appended index file never changes, so that each is read once."""

_FILE_BYTES = 300
_MOST_BYTES = 64 << 20


def _known(target: Path, axes: tuple[str, ...], whose: str) -> _Known:
    """Return what the index files of an archive list; only those that were not read before are read now."""
    key = absolute(target), axes
    files = [(name, _state(target / name) if name == INDEX_FILE else ()) for name in index_names(target)]
    nothing = _Known({}, np.zeros(0, np.int64), np.zeros(0, np.int32))
    known = _remembered.get(key, nothing)
    if not known.files.keys() <= set(files):  # another archive of that name
        known = nothing
    new = [file for file in files if file not in known.files]
    places = dict(known.files)
    hashes, counts = [known.hashes], []
    for file in new:
        places[file] = len(places)
        hashes.append(_hashes(_digests_in(target, file[0], axes, whose)))
        counts.append(len(hashes[-1]))
    if new:
        added = np.repeat(np.arange(len(known.files), len(places), dtype=np.int32), counts)
        known = _Known(places, np.concatenate(hashes), np.concatenate([known.places, added]))
        _remember(key, known)
    return known


def _remember(key: tuple[str, tuple[str, ...]], known: _Known) -> None:
    kept = {**_remembered}
    kept.pop(key, None)
    kept[key] = known
    while sum(one.n_bytes for one in kept.values()) > _MOST_BYTES:
        del kept[next(iter(kept))]
    _remembered.clear()  # a thread that looks in between reads its files anew
    _remembered.update(kept)


def _state(path: Path) -> tuple[int, ...]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size, found.st_ino


def _hashes(digests: Sequence[str]) -> NDArray[np.int64]:
    return np.fromiter(map(hash, digests), np.int64, len(digests))


def _digests_in(target: Path, name: str, axes: tuple[str, ...], whose: str) -> list[str]:
    """Return the digests that an index file lists. Other axes are refused."""
    with open_parquet(target / name, target, MAX_BINARY_BYTES) as opened:
        others = read_mark(labels_of(opened), "recordings", target / name).axes
        if DIGEST not in opened.schema_arrow.names:
            raise RecordingFileError(target / name, f"column {DIGEST!r} is missing")
        digests: list[str] = opened.read([DIGEST], use_threads=False)[DIGEST].to_pylist()
    if others != axes:
        problem = f"has the axes {' '.join(axes)}, and the archive {target} {' '.join(others)}"
        raise argument_error(ValueError, whose, f"{problem}; add it to another one")
    return digests


def check_archive(folder: str | os.PathLike[str], axes: Sequence[str] | None = None) -> None:
    """Refuse, before any work, what recordings (with these axes, of a sensor) cannot be appended to."""
    need("pyarrow.parquet", extra="app", why="to write archives")
    with made_folder(folder) as place:
        check_target(place / INDEX_FILE)
        if not index_names(place):
            _check_new(place)
        elif axes is not None:
            _known(place, tuple(axes), "the sensor")


def _check_new(target: Path) -> None:
    """Refuse to begin an archive where something else is; what an append that was killed has left may be there."""
    if not os.path.lexists(target):
        return
    if not target.is_dir():
        raise FileExistsError(f"{target}: is a file; wanted an archive, or a new or empty folder")
    for path in target.rglob("*"):
        place = path.relative_to(target).as_posix()
        if not _LEFT.fullmatch(place):
            raise FileExistsError(
                f"{target}: holds {place!r:.60}; wanted an archive, or a new or empty folder"
            )


_LEFT = re.compile(
    rf"({SAMPLES_FOLDER}|{INDEX_FOLDER})(/(\.[^/]*|[0-9a-f]{{32}})\.parquet)?|\.recordings-[0-9a-f]{{16}}\.parquet"
)


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
            wrench, time_s, flags = flat_samples(dataset.recordings[start:end])
            n = len(wrench)
            columns = [np.ascontiguousarray(column) for column in wrench.T]
            columns += [_or_full(time_s, n, np.nan)] if timed else []
            columns += [_or_full(flags, n, np.uint8(0))] if flagged else []
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


def _write_index(library: Any, path: Path, index: Any, labels: dict[str, str]) -> None:
    with library.ParquetWriter(path, index.schema, **_COMMON) as writer:
        writer.add_key_value_metadata(labels)
        writer.write_table(index)


def digest_of(recording: Recording) -> str:
    """Return 32 hexadecimal digits of the SHA-256 of what a recording holds per sample: wrench, stamps, flags."""
    mark = hashlib.sha256(np.ascontiguousarray(recording.wrench, "<f8").data)
    for values, kind in ((recording.time_s, "<f8"), (recording.flags, "u1")):
        if values is not None:
            mark.update(np.ascontiguousarray(values, kind).data)
    return mark.hexdigest()[:32]


def _index_table(
    recordings: Sequence[Recording],
    groups: Sequence[tuple[int, int]],
    files: Sequence[str],
    digests: Sequence[str],
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
        DIGEST: (digests, text),
    }
    return arrow.table({name: arrow.array(values, kind) for name, (values, kind) in columns.items()})
