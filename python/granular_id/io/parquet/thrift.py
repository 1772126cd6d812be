"""Structs of the Thrift compact protocol, in which Parquet writes its footers and page headers.

A struct becomes a dict from field number to value: int, bytes, bool, dict, list. What stands in it is bounded by
the bytes that are there: no list is longer, nothing is nested deeper than Parquet's own structs.
"""

from __future__ import annotations

from typing import Any

__all__ = ["CutOffError", "read_struct"]

_DEEPEST = 12
_MOST_VALUES = 1_000_000
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = range(1, 13)
_WHOLE = frozenset((_I16, _I32, _I64))


class CutOffError(ValueError):
    """The bytes end within a struct."""


def read_struct(data: bytes) -> tuple[dict[int, Any], int]:
    """Read the struct at the beginning of some bytes.

    Returns
    -------
    fields : dict
        From field number to value; numbers with a fraction are None.
    size : int
        Bytes it takes.

    Raises
    ------
    CutOffError
        The bytes end before the struct does.
    ValueError
        They are no struct.

    Examples
    --------
    >>> from granular_id.io.parquet.thrift import read_struct
    >>> read_struct(bytes([0x15, 0x06, 0x18, 0x02]) + b"ab" + bytes([0]))
    ({1: 3, 2: b'ab'}, 7)
    """
    reader = _Reader(data)
    try:
        return reader.struct(0), reader.at
    except IndexError:
        raise CutOffError("the bytes end within a struct") from None


class _Reader:
    """A file may have thousands of pages: what most fields are, whole numbers, is read with few calls."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0
        self._values = 0

    def struct(self, depth: int) -> dict[int, Any]:
        if depth > _DEEPEST:
            raise ValueError("structs are nested too deeply")
        data = self.data
        fields: dict[int, Any] = {}
        number = 0
        while head := data[self.at]:
            self.at += 1
            self._count(1)
            number = number + (head >> 4) if head >> 4 else self._whole()
            kind = head & 15
            if kind in _WHOLE:
                fields[number] = self._whole()
            else:
                fields[number] = kind == _TRUE if kind in (_TRUE, _FALSE) else self._value(kind, depth)
        self.at += 1
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in _WHOLE:
            return self._whole()
        if kind == _BINARY:
            return self._bytes(self._natural())
        if kind == _STRUCT:
            return self.struct(depth + 1)
        if kind in (_LIST, _SET):
            return self._list(depth + 1)
        if kind in (_TRUE, _FALSE, _BYTE):  # truth values take a byte within lists
            byte = self._bytes(1)[0]
            return byte if kind == _BYTE else byte == _TRUE
        if kind != _DOUBLE:
            raise ValueError(f"a field of the unknown type {kind}")  # maps do not occur in Parquet's structs
        self._bytes(8)
        return None

    def _list(self, depth: int) -> list[Any]:
        if depth > _DEEPEST:
            raise ValueError("lists are nested too deeply")
        head = self._bytes(1)[0]
        n = head >> 4 if head >> 4 != 15 else self._natural()
        if n > len(self.data) - self.at:
            raise IndexError
        self._count(n)
        return [self._value(head & 15, depth) for _ in range(n)]

    def _count(self, n: int) -> None:
        self._values += n
        if self._values > _MOST_VALUES:
            raise ValueError(f"holds more than {_MOST_VALUES} values")

    def _bytes(self, n: int) -> bytes:
        start = self.at
        self.at += n
        if self.at > len(self.data):
            raise IndexError
        return self.data[start : self.at]

    def _natural(self) -> int:
        data, at = self.data, self.at
        byte = data[at]
        value, shift = byte & 127, 7
        while byte > 127:
            at += 1
            byte = data[at]
            value |= (byte & 127) << shift
            shift += 7
            if shift > 70:
                raise ValueError("a number of more than 64 bits")
        self.at = at + 1
        return value

    def _whole(self) -> int:
        value = self._natural()
        return value >> 1 ^ -(value & 1)  # zigzag: the sign is the lowest bit
