"""What the footer of a Parquet file says: row groups, where their columns lie, and texts about the whole.

It is read here, and not asked of pyarrow, because some damaged footers make pyarrow end the whole process (seen with
version 26: an exception of C++ that reaches nobody, while the metadata of a column is looked at).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, BinaryIO

from granular_id.io.parquet.thrift import read_struct

__all__ = ["MAGIC", "Chunk", "Footer", "read_footer"]

MAGIC = b"PAR1"

MAX_FOOTER_BYTES = 16 * 1024 * 1024
"""Footers grow with row groups times columns: a part of 64 groups needs 60 kB."""

_MOST = 1 << 56


@dataclass(frozen=True)
class Chunk:
    """One column of one row group: its path in the schema, where its pages lie, and its values."""

    column: str
    start: int
    end: int
    n_values: int


@dataclass(frozen=True)
class Footer:
    """A footer.

    Attributes
    ----------
    rows : list of int
        Rows of each row group.
    chunks : list of list of Chunk
        For each row group, its columns.
    labels : dict
        Texts about the whole, by key.
    """

    rows: list[int]
    chunks: list[list[Chunk]]
    labels: dict[str, str]


def read_footer(file: BinaryIO, n_bytes: int) -> Footer:
    """Read the footer of a file.

    Raises
    ------
    ValueError
        No Parquet file, cut off, or a footer that contradicts itself or the size of the file.
    """
    if not n_bytes:
        raise ValueError("is empty (0 bytes)")
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError("is not a Parquet file: it does not begin with PAR1")
    file.seek(max(0, n_bytes - 8))
    end = file.read(8)
    if n_bytes < 12 or end[4:] != MAGIC:
        raise ValueError(f"is cut off: its {n_bytes} bytes do not end with PAR1, as Parquet files do")
    size = int.from_bytes(end[:4], "little")
    most = min(n_bytes - 12, MAX_FOOTER_BYTES)
    if size > most:
        raise ValueError(f"says that its footer has {size} bytes; wanted at most {most}")
    file.seek(n_bytes - 8 - size)
    data = file.read(size)
    file.seek(0)
    try:
        fields, used = read_struct(data)
    except ValueError as error:
        raise ValueError(f"has a damaged footer: {error}") from error
    if used != size:
        raise ValueError(f"has a damaged footer: {size} bytes, of which {used} are used")
    return _footer(fields, n_bytes - 8 - size)


def _footer(fields: dict[int, Any], data_end: int) -> Footer:
    groups = [_get(group, 1, list) for group in _structs(fields, 4)]
    rows = [_number(group, 3, "rows of a row group") for group in _structs(fields, 4)]
    if sum(rows) != _number(fields, 3, "rows"):
        raise ValueError(f"has a damaged footer: {sum(rows)} rows in row groups, {fields[3]} in all")
    labels = {}
    for pair in _structs(fields, 5) if 5 in fields else []:
        key, value = _get(pair, 1, bytes), pair.get(2, b"")
        labels[key.decode("utf-8", "replace")] = (
            value.decode("utf-8", "replace") if isinstance(value, bytes) else ""
        )
    return Footer(rows, [[_chunk(column, data_end) for column in group] for group in groups], labels)


def _chunk(column: Any, data_end: int) -> Chunk:
    if not isinstance(column, dict) or column.get(1):
        raise ValueError("keeps a column in another file, which is not opened")
    about = _get(column, 3, dict)
    path = b".".join(part for part in _get(about, 3, list) if isinstance(part, bytes)).decode(
        "utf-8", "replace"
    )
    n_values = _number(about, 5, f"values of column {path[:40]}")
    if not n_values:  # a row group without rows has no pages, and says nothing about where they are
        return Chunk(path, 0, 0, 0)
    start = _number(about, 9, f"place of column {path[:40]}")
    dictionary = about.get(11)
    if isinstance(dictionary, int) and 0 < dictionary < start:
        start = dictionary
    end = start + _number(about, 7, f"size of column {path[:40]}")
    if start < len(MAGIC) or end > data_end:
        raise ValueError(f"has a damaged footer: column {path[:40]} in bytes {start} to {end} of {data_end}")
    return Chunk(path, start, end, n_values)


def _structs(fields: dict[int, Any], number: int) -> list[dict[int, Any]]:
    items: list[dict[int, Any]] = _get(fields, number, list)
    if not all(isinstance(item, dict) for item in items):
        raise ValueError(f"has a damaged footer: field {number} is no list of structs")
    return items


def _get(fields: dict[int, Any], number: int, kind: type) -> Any:
    value = fields.get(number)
    if not isinstance(value, kind):
        raise ValueError(f"has a damaged footer: field {number} is {value!r:.40}")  # noqa: TRY004 (a file's fault)
    return value


def _number(fields: dict[int, Any], number: int, name: str) -> int:
    value = fields.get(number)
    if not isinstance(value, int) or not 0 <= value < _MOST:
        raise ValueError(f"has a damaged footer: {name} {value!r:.40}")
    return value
