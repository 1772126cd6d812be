"""What the pages of a Parquet file claim to hold, read from their headers without decoding anything.

A footer says how many rows a column has; how much memory decoding takes is said by the header of each page, and
a few bytes there can ask for gigabytes. So the headers are walked first: they must fill their column exactly,
their values must add up to what the footer says, and the sum of their sizes is what a caller can check.

Headers are Thrift structs in the compact protocol (the "PageHeader" of the Parquet format description).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

MAGIC = b"PAR1"

_FIRST_READ = 512
_LONGEST_HEADER = 1 << 20
_DEEPEST = 8
_DATA, _INDEX, _DICTIONARY, _DATA_V2 = range(4)
_VALUES_FIELD = {
    _DATA: 5,
    _DICTIONARY: 7,
    _DATA_V2: 8,
}  # where the struct with num_values stands, by type of page
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = range(1, 13)


@dataclass(frozen=True)
class PageHeader:
    """One page: its kind, the bytes of its header, of its body packed and unpacked, and its values."""

    kind: int
    header_bytes: int
    packed_bytes: int
    unpacked_bytes: int
    n_values: int


def unpacked_bytes(read_at: Callable[[int, int], bytes], chunk: Any, file_bytes: int) -> int:
    """Walk the pages of one column of one row group.

    Parameters
    ----------
    read_at : callable
        ``read_at(offset, n)`` gives up to n bytes of the file.
    chunk : pyarrow.parquet.ColumnChunkMetaData
        What the footer says of the column.
    file_bytes : int
        Size of the file.

    Returns
    -------
    int
        Bytes that all its pages unpack to.

    Raises
    ------
    ValueError
        Pages that do not fit into each other, into the file, or to the footer.
    """
    place = chunk.data_page_offset
    if chunk.has_dictionary_page and 0 < (chunk.dictionary_page_offset or 0) < place:
        place = chunk.dictionary_page_offset
    end = place + chunk.total_compressed_size
    if place < len(MAGIC) or chunk.total_compressed_size < 0 or end > file_bytes:
        raise ValueError(f"bytes {place} to {end} are said to hold the column; the file has {file_bytes}")
    total = values = dictionaries = 0
    while place < end:
        page = _read_header(read_at, place, end)
        place += page.header_bytes + page.packed_bytes
        if place > end:
            raise ValueError(f"a page reaches {place - end} bytes past the end of its column")
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
    if values != chunk.num_values:
        raise ValueError(f"the pages hold {values} values, the footer says {chunk.num_values}")
    return total


def _read_header(read_at: Callable[[int, int], bytes], place: int, end: int) -> PageHeader:
    size = _FIRST_READ
    while True:
        size = min(size, end - place)
        try:
            return _Compact(read_at(place, size)).page_header()
        except IndexError:
            if size == end - place or size >= _LONGEST_HEADER:
                raise ValueError(f"the page header at byte {place} is cut off") from None
        size *= 16  # statistics of text columns make some headers long


class _Compact:
    """Reads one page header; IndexError where the bytes end."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def page_header(self) -> PageHeader:
        fields = self._struct(0)
        kind = _number(fields, 1, "kind")
        if kind not in (_DATA, _INDEX, _DICTIONARY, _DATA_V2):
            raise ValueError(f"a page of the unknown kind {kind}")
        inner = {1: 0} if kind == _INDEX else fields.get(_VALUES_FIELD[kind])
        return PageHeader(
            kind=kind,
            header_bytes=self.at,
            packed_bytes=_number(fields, 3, "size"),
            unpacked_bytes=_number(fields, 2, "unpacked size"),
            n_values=_number(inner if isinstance(inner, dict) else {}, 1, "number of values"),
        )

    def _struct(self, depth: int) -> dict[int, Any]:
        if depth > _DEEPEST:
            raise ValueError("a page header is nested too deeply")
        fields: dict[int, Any] = {}
        number = 0
        while (head := self._byte()) != 0:
            step = head >> 4
            number = number + step if step else self._whole()
            fields[number] = self._value(head & 15, depth, in_struct=True)
        return fields

    def _value(self, kind: int, depth: int, *, in_struct: bool) -> Any:
        if kind in (_TRUE, _FALSE):
            return kind == _TRUE if in_struct else self._byte() == _TRUE
        if kind in (_I16, _I32, _I64):
            return self._whole()
        if kind == _STRUCT:
            return self._struct(depth + 1)
        if kind in (_BYTE, _DOUBLE, _BINARY):
            self._skip({_BYTE: 1, _DOUBLE: 8}[kind] if kind != _BINARY else self._natural())
            return None
        if kind in (_LIST, _SET):
            head = self._byte()
            for _ in range(head >> 4 if head >> 4 != 15 else self._natural()):
                self._value(head & 15, depth + 1, in_struct=False)
            return None
        raise ValueError(f"a page header with a field of the unknown type {kind}")  # maps do not occur in one

    def _byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def _skip(self, n: int) -> None:
        self.at += n
        if self.at > len(self.data):
            raise IndexError

    def _natural(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7
            if shift > 63:
                raise ValueError("a page header with a number of more than 64 bits")

    def _whole(self) -> int:
        value = self._natural()
        return value >> 1 ^ -(value & 1)  # zigzag: the sign is the lowest bit


def _number(fields: dict[int, Any], number: int, name: str) -> int:
    value = fields.get(number)
    if not isinstance(value, int) or not 0 <= value < 1 << 31:
        raise ValueError(f"a page with the {name} {value!r}")
    return value
