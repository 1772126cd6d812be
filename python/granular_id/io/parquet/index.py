"""The index of an archive: what its files list, checked, and what identifies each row group."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError, attempt, naming, need
from granular_id.io.files import check_parts, read_bounded
from granular_id.io.flat import NO_TRIGGER
from granular_id.io.folder_save import HISTORY_NAME
from granular_id.io.parquet.layout import (
    DIGEST,
    HISTORY,
    INDEX_COLUMNS,
    INDEX_FILE,
    INDEX_TEXTS,
    SAMPLES_FOLDER,
    Mark,
    index_names,
    is_sample_name,
    labels_of,
    open_parquet,
    read_mark,
    written_at,
)


@dataclass(frozen=True)
class RowGroup:
    """A row group of a file of samples.

    Attributes
    ----------
    file : str
        Its file, in the folder of the archive.
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
    _digest: Callable[[RowGroup], str] = field(repr=False, compare=False)

    @property
    def digest(self) -> str:
        """32 hexadecimal digits that change with anything the archive says of these recordings, and their samples.

        Over axes and rows of the index, with the digest of each recording.
        """
        return self._digest(self)


class Index:
    """What all index files of an archive list, in the order of the whole.

    First ``recordings.parquet``, then what was added, by the time it was written and then by key. Files that cannot be
    read go into `unreadable`; without such a list, or if that are all, the first of them is raised.
    """

    def __init__(self, folder: Path, max_bytes: int, unreadable: list[RecordingFileError] | None) -> None:
        self._folder, self._max_bytes = folder, max_bytes
        found: list[_Part] = []
        problems: list[RecordingFileError] = []
        for name in index_names(folder) or [INDEX_FILE]:
            part = attempt(problems, _Part.read, folder, name, max_bytes)
            found += [] if part is None else [part]
        parts: list[_Part] = []
        for part in sorted(found):
            if not parts or part.mark == parts[0].mark:
                parts.append(part)
            else:
                problem = f"lists other axes ({' '.join(part.mark.axes)}) than {parts[0].name}"
                problems.append(RecordingFileError(folder / part.name, problem, place="footer"))
        if unreadable is not None:
            unreadable += problems
        if problems and (unreadable is None or not parts):
            raise problems[0]
        self.mark = parts[0].mark
        self.names = [part.name for part in parts]
        self.unread = {part.name: part.unread for part in parts if part.unread}
        groups: list[RowGroup] = []
        start = 0
        for part in parts:
            groups += [
                RowGroup(file, group, start + first, start + last, n, self._digest_of)
                for file, group, first, last, n in part.row_groups
            ]
            start += part.table.num_rows
        self.row_groups = tuple(groups)
        self.groups_of = Counter(group.file for group in groups)
        self.table = parts[0].table if len(parts) == 1 else _joined([part.table for part in parts])

    def rows_of(self, group: RowGroup) -> Any:
        """Return the rows that describe a row group."""
        return self.table.slice(group.start, group.stop - group.start)

    def history_json(self) -> str:
        """Return the steps that made what was saved, and what was added; those that several appends share, once."""
        texts = []
        if self.names[0] == INDEX_FILE and (self._folder / HISTORY_NAME).is_file():
            path = self._folder / HISTORY_NAME
            with naming(path, "reading the history"):
                texts.append(read_bounded(path, self._folder, self._max_bytes).decode())
        for name in self.names:
            if name != INDEX_FILE:
                with open_parquet(self._folder / name, self._folder, self._max_bytes) as opened:
                    texts.append(labels_of(opened).get(HISTORY, "[]"))
        if len(texts) < 2:
            return texts[0] if texts else "[]"
        steps: list[Any] = []
        known: Counter[str] = Counter()
        with naming(self._folder, "reading the history"):
            for text in texts:
                check_parts([text], "history", self.table.num_rows)
                own: Counter[str] = Counter()
                for step in json.loads(text):
                    key = json.dumps(step)
                    own[key] += 1
                    if own[key] > known[key]:
                        known[key] += 1
                        steps.append(step)
        return json.dumps(steps)

    @cached_property
    def fingerprint(self) -> str:
        """Over the digests of all row groups."""
        return hashed([group.digest for group in self.row_groups])

    def _digest_of(self, group: RowGroup) -> str:
        return self._digests[group.file, group.row_group]

    @cached_property
    def _digests(self) -> dict[tuple[str, int], str]:
        rows = RowDigests(self.table)
        return {
            (group.file, group.row_group): hashed(
                [*self.mark.axes, group.file, str(group.row_group), rows.of(group.start, group.stop)]
            )
            for group in self.row_groups
        }


@dataclass(frozen=True, order=True)
class _Part:
    """One index file, checked."""

    written: float  # seconds since 1970; less than any of these for recordings.parquet
    name: str
    mark: Mark = field(compare=False)
    table: Any = field(compare=False)
    unread: list[str] = field(compare=False)
    row_groups: list[tuple[str, int, int, int, int]] = field(compare=False)

    @classmethod
    def read(cls, folder: Path, name: str, max_bytes: int) -> _Part:
        path = folder / name
        with open_parquet(path, folder, max_bytes, INDEX_TEXTS) as opened:
            names = opened.schema_arrow.names
            labels = labels_of(opened)
            mark = read_mark(labels, "recordings", path)
            unread = [column for column in names if column not in INDEX_COLUMNS]
            missing = [column for column in INDEX_COLUMNS if column not in names]
            if missing:
                problem = f"column {missing[0]!r} is missing; wanted {', '.join(INDEX_COLUMNS)}"
                raise RecordingFileError(path, problem)
            table = opened.read([*INDEX_COLUMNS], use_threads=False).unify_dictionaries()
            table.validate(full=True)
            row_groups = _row_groups(table, path, name)
        written = -np.inf if name == INDEX_FILE else written_at(labels, path)
        return cls(written, name, mark, table, unread, row_groups)


def _row_groups(index: Any, path: Path, name: str) -> list[tuple[str, int, int, int, int]]:
    """Return the row groups that an index file names: every one in order, of files that are the archive's."""
    lengths, groups = integers(index, "n_samples"), integers(index, "row_group")
    codes, values = coded_texts(index["file"])
    if not index.num_rows:
        raise RecordingFileError(path, "lists no recordings")
    known = np.array([is_sample_name(value, name) for value in values])
    files_wanted = "samples/part-00000.parquet ..." if name == INDEX_FILE else f"{SAMPLES_FOLDER}/{path.name}"
    for column, wrong, wanted in (
        ("id", integers(index, "id") != np.arange(len(codes)), "0, 1, 2 ... in order"),
        ("n_samples", lengths < 1, "at least 1"),
        ("file", ~known[codes], files_wanted),
        (DIGEST, np.asarray(index[DIGEST].is_null()), "32 hexadecimal digits"),
    ):
        if wrong.any():
            row = int(wrong.argmax())
            problem = f"row {row} holds {index[column][row].as_py()!r:.80}; wanted {wanted}"
            raise RecordingFileError(path, problem, column=column)
    changes = np.flatnonzero((codes[1:] != codes[:-1]) | (groups[1:] != groups[:-1])) + 1
    found: list[tuple[str, int, int, int, int]] = []
    counts: Counter[str] = Counter()
    for start, stop in pairwise([0, *changes.tolist(), len(codes)]):
        file, group = str(values[codes[start]]), int(groups[start])
        if group != counts[file] or (group and found[-1][0] != file):
            problem = f"row {start} is said to lie in row group {group} of {file}; wanted every one in order"
            raise RecordingFileError(path, problem, column="row_group")
        counts[file] += 1
        found.append((file, group, start, stop, int(lengths[start:stop].sum())))
    return found


def _joined(tables: Sequence[Any]) -> Any:
    """Put the tables of index files below each other, with the same types, and number the recordings anew."""
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    text, number, whole = arrow.string(), arrow.float64(), arrow.int64()
    columns = {"id": arrow.array(np.arange(sum(table.num_rows for table in tables)))}
    for name in tables[0].column_names:
        if name in INDEX_TEXTS:
            columns[name] = _joined_texts([table[name] for table in tables])
        elif name != "id":
            kind = text if name == DIGEST else number if name in ("rate_hz", "start_time") else whole
            columns[name] = arrow.concat_arrays(
                [chunk for table in tables for chunk in table[name].cast(kind).chunks]
            )
    return arrow.table(columns)


def _joined_texts(columns: Sequence[Any]) -> Any:
    """Join columns of texts with a dictionary each to one with one; a text that repeats is never written out."""
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    compute = need("pyarrow.compute", extra="app", why="to read Parquet files")
    codes, values, n_values = [], [], 0
    for chunk in (chunk for column in columns for chunk in _coded(column).chunks):
        codes.append(compute.add(chunk.indices.cast(arrow.int64()), n_values))
        values.append(chunk.dictionary.cast(arrow.large_string()))  # together they may have more than 2 GB
        n_values += len(chunk.dictionary)
    once = arrow.concat_arrays(values).dictionary_encode()
    return arrow.DictionaryArray.from_arrays(once.indices.take(arrow.concat_arrays(codes)), once.dictionary)


def _coded(column: Any) -> Any:
    return column if str(column.type).startswith("dictionary") else column.dictionary_encode()


class RowDigests:
    """The rows of an index as bytes of one length, so that those of a row group are digested at once."""

    def __init__(self, index: Any) -> None:
        numbers = [integers(index, name).astype("<i8") for name in ("n_samples", "trigger_index")]
        numbers += [index[name].to_numpy().astype("<f8") for name in ("rate_hz", "start_time")]
        self._columns = [column.view("V8") for column in numbers]
        for name in ("name", "label", "session", "meta"):
            codes, values = coded_texts(index[name])
            self._columns.append(_short(values)[codes])
        self._columns.append(_short(index[DIGEST].to_pylist()))

    def of(self, start: int, stop: int) -> str:
        """Return the digest of some rows."""
        mark = hashlib.sha256()
        for column in self._columns:
            mark.update(np.ascontiguousarray(column[start:stop]).data)
        return mark.hexdigest()


def _short(texts: Sequence[str | None]) -> NDArray[Any]:
    """Return 16 bytes for each text, different ones for an empty cell and an empty text."""
    nothing = bytes(16)
    some = [nothing if text is None else hashlib.sha256(text.encode()).digest()[:16] for text in texts]
    return np.array(some, "V16")


def hashed(texts: Sequence[str]) -> str:
    """Return 32 hexadecimal digits of some texts."""
    return hashlib.sha256(json.dumps(texts).encode()).hexdigest()[:32]


def coded_texts(column: Any) -> tuple[NDArray[np.int64], list[str | None]]:
    """Return a column of texts as codes and what they mean; the last one, None, is an empty cell."""
    whole = _coded(column).unify_dictionaries().combine_chunks()
    values: list[str | None] = whole.dictionary.to_pylist()
    codes = whole.indices.fill_null(len(values)).to_numpy(zero_copy_only=False)
    return codes.astype(np.int64), [*values, None]


def integers(table: Any, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers; -1 where a cell is empty."""
    return np.asarray(table[name].fill_null(NO_TRIGGER).to_numpy(), np.int64)


def texts(table: Any, name: str) -> list[str | None]:
    """Return a column of texts, equal ones being one object, so that a long one is held once."""
    codes, values = coded_texts(table[name])
    return [values[code] for code in codes.tolist()]
