"""``recordings.parquet``: what an archive says of each recording, and where its samples lie."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.flat_checks import NO_TRIGGER
from granular_id.io.parquet.file import CheckedParquet
from granular_id.io.parquet.layout import INDEX_COLUMNS, is_part_name

_MOST_SAMPLES = 1 << 40
_KINDS = {str: ("string", "large_string"), float: ("double",), int: ("int64", "int32")}


@dataclass(frozen=True)
class Partition:
    """A row group of a file of samples, and the rows of the index (`start` to `stop`) that describe it."""

    file: str
    row_group: int
    start: int
    stop: int
    n_samples: int


def read_index(parquet: CheckedParquet) -> Any:
    """Return the index as a ``pyarrow.Table``, its columns and their types checked.

    Raises
    ------
    RecordingFileError
        A column is missing, has another type, or holds nothing where something must be.
    """
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    kinds = {name: _KINDS[kind] for name, kind in INDEX_COLUMNS.items()}
    for name, wanted in kinds.items():
        if name not in parquet.columns:
            raise RecordingFileError(parquet.path, f"column {name!r} is missing; wanted {', '.join(kinds)}")
        kind = parquet.columns[name]
        kind = kind.value_type if arrow.types.is_dictionary(kind) else kind
        if str(kind) not in wanted:
            raise RecordingFileError(parquet.path, f"holds {kind}; wanted {wanted[0]}", column=name)
    if not sum(parquet.rows):
        raise RecordingFileError(parquet.path, "lists no recordings")
    table = arrow.concat_tables([parquet.read(i, tuple(kinds)) for i in range(len(parquet.rows))])
    for name in ("id", "n_samples", "file", "row_group"):
        if table.column(name).null_count:
            raise RecordingFileError(
                parquet.path, "holds empty cells; wanted a value per recording", column=name
            )
    wrong = np.flatnonzero(integers(table, "id") != np.arange(table.num_rows))
    if len(wrong):
        problem = f"row {wrong[0]} has the id {integers(table, 'id')[wrong[0]]}; wanted 0, 1, 2 ... in order"
        raise RecordingFileError(parquet.path, problem, column="id")
    return table.unify_dictionaries()


def partitions(table: Any, path: Path) -> tuple[Partition, ...]:
    """Return the row groups that the index names, in its order.

    Raises
    ------
    RecordingFileError
        A file that is none of the archive's, row groups out of order, or a number of samples that cannot be.
    """
    lengths, groups, files = integers(table, "n_samples"), integers(table, "row_group"), texts(table, "file")
    wrong = np.flatnonzero((lengths < 1) | (lengths > _MOST_SAMPLES))
    if len(wrong):
        problem = f"row {wrong[0]} is said to have {lengths[wrong[0]]} samples; wanted at least 1"
        raise RecordingFileError(path, problem, column="n_samples")
    names = np.array(files, dtype=object)
    changes = np.flatnonzero((names[1:] != names[:-1]) | (groups[1:] != groups[:-1])) + 1
    bounds = [0, *changes.tolist(), len(files)]
    found: list[Partition] = []
    seen: set[str] = set()
    for start, stop in pairwise(bounds):
        file, group = files[start], int(groups[start])
        if not is_part_name(file):
            problem = f"row {start} names the file {file!r:.80}; wanted one like samples/part-00000.parquet"
            raise RecordingFileError(path, problem, column="file")
        assert file is not None
        follows = bool(found) and found[-1].file == file
        wanted = found[-1].row_group + 1 if follows else 0
        if group != wanted or (file in seen and not follows):
            problem = (
                f"row {start} is said to lie in row group {group} of {file}; wanted every row group in order"
            )
            raise RecordingFileError(path, problem, column="row_group")
        seen.add(file)
        found.append(Partition(file, group, start, stop, sum(lengths[start:stop].tolist())))
    return tuple(found)


def integers(table: Any, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers; -1 where a cell is empty."""
    filled = table.column(name).fill_null(NO_TRIGGER)
    return np.asarray(filled.to_numpy(), np.int64)


def floats(table: Any, name: str) -> NDArray[np.float64]:
    """Return a column of numbers; NaN where a cell is empty."""
    return np.asarray(table.column(name).to_numpy(), np.float64)


def texts(table: Any, name: str) -> list[str | None]:
    """Return a column of texts, equal ones being one object, so that a long one is held once."""
    codes, values = coded_texts(table, name)
    return [values[code] for code in codes.tolist()]


def coded_texts(table: Any, name: str) -> tuple[NDArray[np.int64], list[str | None]]:
    """Return a dictionary-encoded column as codes and what they mean; the last one, None, is an empty cell."""
    found: list[NDArray[np.int64]] = []
    known: dict[str, int] = {}
    for chunk in table.column(name).chunks:
        codes = np.asarray(chunk.indices.fill_null(-1).to_numpy(zero_copy_only=False), np.int64)
        kept, places = np.unique(codes[codes >= 0], return_inverse=True)
        own = [known.setdefault(text, len(known)) for text in chunk.dictionary.take(kept).to_pylist()]
        codes[codes >= 0] = np.array(own, np.int64)[places]
        found.append(codes)
    codes = np.concatenate(found)
    codes[codes < 0] = len(known)
    return codes, [*known, None]
