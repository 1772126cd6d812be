"""What the pages of a Parquet file claim to hold, read from their headers without decoding anything.

A footer says how many rows a column has; how much memory decoding takes is said by the header of each page, and
a few bytes there can ask for gigabytes. So the headers are walked first: they must fill their column exactly,
their values must add up to what the footer says, and the sum of their sizes is what a caller can check.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from granular_id.io.parquet.footer import Chunk
from granular_id.io.parquet.thrift import CutOffError, read_struct

__all__ = ["unpacked_bytes"]

_FIRST_READ = 512
_LONGEST_HEADER = 1 << 20
_DATA, _INDEX, _DICTIONARY, _DATA_V2 = range(4)
_VALUES_FIELD = {_DATA: 5, _DICTIONARY: 7, _DATA_V2: 8}  # where the struct with the number of values stands


@dataclass(frozen=True)
class _Page:
    """One page: its kind, the bytes of its header, of its body packed and unpacked, and its values."""

    kind: int
    header_bytes: int
    packed_bytes: int
    unpacked_bytes: int
    n_values: int


def unpacked_bytes(read_at: Callable[[int, int], bytes], chunk: Chunk) -> int:
    """Walk the pages of one column of one row group.

    Parameters
    ----------
    read_at : callable
        ``read_at(offset, n)`` gives up to n bytes of the file.
    chunk : Chunk

    Returns
    -------
    int
        Bytes that all its pages unpack to.

    Raises
    ------
    ValueError
        Pages that do not fit into each other, or to the footer.
    """
    place = chunk.start
    total = values = dictionaries = 0
    while place < chunk.end:
        page = _page_at(read_at, place, chunk.end)
        place += page.header_bytes + page.packed_bytes
        if place > chunk.end:
            raise ValueError(f"a page reaches {place - chunk.end} bytes past the end of its column")
        total += page.unpacked_bytes
        if page.kind == _DICTIONARY:
            dictionaries += 1
            if page.n_values > page.unpacked_bytes:
                raise ValueError(
                    f"a dictionary of {page.unpacked_bytes} bytes is said to hold {page.n_values} values"
                )
        elif page.kind != _INDEX:
            values += page.n_values
    if dictionaries > 1:
        raise ValueError(f"{dictionaries} dictionaries in one column; wanted at most one")
    if values != chunk.n_values:
        raise ValueError(f"the pages hold {values} values, the footer says {chunk.n_values}")
    return total


def _page_at(read_at: Callable[[int, int], bytes], place: int, end: int) -> _Page:
    size = _FIRST_READ
    while True:
        size = min(size, end - place)
        try:
            return _page(*read_struct(read_at(place, size)))
        except CutOffError:
            if size == end - place or size >= _LONGEST_HEADER:
                raise ValueError(f"the page header at byte {place} is cut off") from None
        size *= 16  # statistics of text columns make some headers long


def _page(fields: dict[int, Any], header_bytes: int) -> _Page:
    kind = _number(fields, 1, "kind")
    if kind not in (_DATA, _INDEX, _DICTIONARY, _DATA_V2):
        raise ValueError(f"a page of the unknown kind {kind}")
    inner = {1: 0} if kind == _INDEX else fields.get(_VALUES_FIELD[kind])
    return _Page(
        kind=kind,
        header_bytes=header_bytes,
        packed_bytes=_number(fields, 3, "size"),
        unpacked_bytes=_number(fields, 2, "unpacked size"),
        n_values=_number(inner if isinstance(inner, dict) else {}, 1, "number of values"),
    )


def _number(fields: dict[int, Any], number: int, name: str) -> int:
    value = fields.get(number)
    if not isinstance(value, int) or not 0 <= value < 1 << 31:
        raise ValueError(f"a page with the {name} {value!r:.40}")
    return value
