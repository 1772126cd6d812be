"""One array of a MAT file of version 5, from bytes to numbers, text, dicts and lists.

Source: "MAT-File Format" (The MathWorks), Level 5. Every size is compared with the bytes that are there before
anything is made of it. One walk both checks and reads: were the file checked here and read by another library,
a file that the two understand differently would pass the check and do harm in the reading.
"""

from __future__ import annotations

import struct
from operator import itemgetter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.matlab.tree import (
    COMPLEX,
    FUNCTION,
    LEFT_OUT,
    MAX_NAME,
    SPARSE,
    MatReading,
    decoded,
    empty_matrix,
    holds,
    in_class,
    name_of,
    nested,
    text_of,
)

MATRIX, COMPRESSED = 14, 15
_UINT32, _INT32 = 6, 5
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_CLASSES: dict[int, np.dtype[Any]] = {
    6: np.dtype(np.float64),
    7: np.dtype(np.float32),
    8: np.dtype(np.int8),
    9: np.dtype(np.uint8),
    10: np.dtype(np.int16),
    11: np.dtype(np.uint16),
    12: np.dtype(np.int32),
    13: np.dtype(np.uint32),
    14: np.dtype(np.int64),
    15: np.dtype(np.uint64),
}
_UNREADABLE = {_SPARSE: SPARSE, _FUNCTION: FUNCTION}
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_STORED_TEXT = {1: "u1", 2: "u1", 4: "u2", 16: "u1", 17: "u2", 18: "u4"}
_DTYPES = {  # made once: a file may hold thousands of arrays
    order: tuple(
        {kind: np.dtype(order + code) for kind, code in codes.items()} for codes in (_STORED, _STORED_TEXT)
    )
    for order in "<>"
}
_USUAL = [_UINT32, 8, _INT32, 8, 1, 0]  # tags of flags, size and an empty name
_in_order = itemgetter(0, 1, 4, 5, 8, 9, 2, 6, 7)
_IS_COMPLEX, _IS_LOGICAL = 0x0800, 0x0200


class MatrixReader:
    """Reads the array that one stretch of bytes holds.

    Parameters
    ----------
    data : memoryview
        What follows the tag of a top-level array, unpacked.
    order : {"<", ">"}
        Order of bytes in numbers.
    reading : MatReading
        The file, for limits and errors.
    """

    def __init__(self, data: memoryview, order: Literal["<", ">"], reading: MatReading) -> None:
        self._data = data
        self._reading = reading
        self._two = struct.Struct(order + "II").unpack_from
        self._four = struct.Struct(order + "IIII").unpack_from
        self._usual = struct.Struct(order + "10I").unpack_from
        self._order = order
        self._stored, self._stored_text = _DTYPES[order]

    def variable(self, place: str) -> tuple[str, Any]:
        """Return the name and the value of the whole."""
        if not self._data:
            raise self._reading.fault(place, "is empty: it has not even a name")
        _, _, name, _ = self._head(0, len(self._data), place)
        return name, self._matrix(0, len(self._data), f"variable {name}" if name else place, 0)

    def _fault(self, place: str, problem: str, at: int) -> RecordingFileError:
        return self._reading.fault(place, f"{problem} (byte {at} of the variable)")

    def _tag(self, at: int, end: int, place: str) -> tuple[int, int, int, int]:
        """Return type, start, size and the place of the next element, all within `end`."""
        if end - at < 8:
            raise self._fault(place, f"ends within the tag of an element: {end - at} of 8 bytes", at)
        kind, size = self._two(self._data, at)
        if kind >> 16:  # up to four bytes stand in the tag itself
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise self._fault(place, f"an element in its own tag claims {size} bytes, 4 at most", at)
            return kind, at + 4, size, at + 8
        start = at + 8
        if size > end - start:
            raise self._fault(place, f"an element claims {size} bytes where {end - start} are left", at)
        return kind, start, size, min(start + size + (-size % 8), end)

    def _bytes(self, at: int, end: int, place: str, limit: int) -> tuple[bytes, int]:
        _, start, size, after = self._tag(at, end, place)
        if size > limit:
            raise self._fault(place, f"a name or size takes {size} bytes, more than {limit}", at)
        return bytes(self._data[start : start + size]), after

    def _head(self, at: int, end: int, place: str) -> tuple[int, tuple[int, ...], str, int]:
        """Return flags, size, name and where the values begin."""
        if end - at >= 40:  # flags, two dimensions and no name: nearly all there are, in a third of the time
            *usual, flags, rows, columns = _in_order(self._usual(self._data, at))
            if usual == _USUAL and flags & 0xFF != _OPAQUE and (rows | columns) < 1 << 31:
                return flags, (rows, columns), "", at + 40
        if end - at < 16:
            raise self._fault(place, f"ends within the flags of an array: {end - at} of 16 bytes", at)
        kind, size, flags, _ = self._four(self._data, at)
        if (kind, size) != (_UINT32, 8):
            raise self._fault(place, f"flags of an array are wanted, got type {kind} with {size} bytes", at)
        at += 16
        dims: tuple[int, ...] = (1, 1)
        if flags & 0xFF != _OPAQUE:
            kind, start, size, after = self._tag(at, end, place)
            if kind not in (_INT32, _UINT32) or size % 4 or size < 8 or size > 1024:
                raise self._fault(place, f"the size of an array is wanted, got type {kind}, {size} bytes", at)
            dims = struct.unpack_from(f"{self._order}{size // 4}i", self._data, start)
            at = after
        name, at = self._bytes(at, end, place, MAX_NAME)
        return flags, dims, name_of(name), at

    def _element(self, at: int, end: int, place: str, depth: int) -> tuple[Any, int]:
        kind, start, size, after = self._tag(at, end, place)
        if kind != MATRIX:
            raise self._fault(place, f"an array is wanted, got an element of type {kind}", at)
        return self._matrix(start, start + size, place, depth), after

    def _matrix(self, at: int, end: int, place: str, depth: int) -> Any:
        if at == end:
            return empty_matrix()
        flags, dims, _, at = self._head(at, end, place)
        array_class = flags & 0xFF
        count = self._reading.checked_dims(dims, place)
        if array_class in _CLASSES:
            return self._numbers(at, end, dims, count, flags, place)
        if array_class == _CHAR:
            return self._text(at, end, dims, count, place)
        if array_class in (_CELL, _STRUCT, _OBJECT):
            read = self._cell if array_class == _CELL else self._struct
            if array_class == _OBJECT:
                _, at = self._bytes(at, end, place, MAX_NAME)  # its class; the rest is as in a struct
            return read(at, end, dims, count, place, depth)
        return self._left_out(at, end, array_class, place)

    def _left_out(self, at: int, end: int, array_class: int, place: str) -> Any:
        if array_class == _OPAQUE:
            _, at = self._bytes(at, end, place, MAX_NAME)  # the object system, "MCOS" or "java"
            class_name, _ = self._bytes(at, end, place, MAX_NAME)
            return self._reading.leave_out_object(place, name_of(class_name))
        if array_class not in _UNREADABLE:
            raise self._fault(place, f"is an array of the unknown class {array_class}", at)
        return self._reading.leave_out(place, *_UNREADABLE[array_class])

    def _numbers(self, at: int, end: int, dims: tuple[int, ...], count: int, flags: int, place: str) -> Any:
        if flags & _IS_COMPLEX:
            return self._reading.leave_out(place, *COMPLEX)
        dtype = np.dtype(np.bool_) if flags & _IS_LOGICAL else _CLASSES[flags & 0xFF]
        if not count and at == end:  # some writers leave the empty part away
            return np.empty(dims, dtype)
        kind, start, size, _ = self._tag(at, end, place)
        stored = self._stored.get(kind)
        if stored is None:
            raise self._fault(place, f"numbers are wanted, got an element of type {kind}", at)
        if size != count * stored.itemsize:
            shape = " x ".join(map(str, dims))
            problem = f"{shape} numbers take {count * stored.itemsize} bytes, but {size} are there"
            raise self._fault(place, problem, at)
        if not holds(dtype, stored):
            raise self._fault(place, f"{dtype} numbers cannot be stored as {stored}", at)
        # samples become float64 in the end
        self._reading.spend(max(0, 8 * count - size), place)
        flat = np.frombuffer(self._data, stored, count, start)
        return in_class(flat, dtype).reshape(dims, order="F")

    def _text(self, at: int, end: int, dims: tuple[int, ...], count: int, place: str) -> str | list[str]:
        if not count:
            return ""
        self._reading.count(dims[0] - 1, place)
        kind, start, size, _ = self._tag(at, end, place)
        stored = self._stored_text.get(kind)
        if stored is None:
            raise self._fault(place, f"characters are wanted, got an element of type {kind}", at)
        self._reading.spend(max(0, 8 * count - size), place)
        if dims[0] == 1 and len(dims) == 2 and size == count * stored.itemsize:
            return decoded(bytes(self._data[start : start + size]), stored)
        codes = np.frombuffer(self._data, stored, size // stored.itemsize, start)
        if (
            len(codes) != count and kind == 16
        ):  # UTF-8: the size counts characters, or UTF-16 units, not bytes
            codes = _units(codes.tobytes(), count)
        if len(codes) != count:
            shape = " x ".join(map(str, dims))
            raise self._fault(place, f"{shape} characters are wanted, {len(codes)} are there", at)
        return text_of(codes, dims)

    def _cell(self, at: int, end: int, dims: tuple[int, ...], count: int, place: str, depth: int) -> Any:
        self._room_for(count, at, end, place)
        depth = self._reading.deeper(depth, place)
        items = []
        for i in range(count):
            value, at = self._element(at, end, f"{place}{{{i + 1}}}", depth)
            items.append(value)
        if any(value is LEFT_OUT for value in items):  # without one, the others would count wrongly
            return LEFT_OUT
        return nested(items, dims)

    def _struct(self, at: int, end: int, dims: tuple[int, ...], count: int, place: str, depth: int) -> Any:
        names, at = self._field_names(at, end, place)
        self._room_for(count * len(names), at, end, place)
        self._reading.count(count, place)
        depth = self._reading.deeper(depth, place)
        records: list[dict[str, Any]] = []
        for i in range(count):
            record = {}
            where = place if count == 1 else f"{place}({i + 1})"
            for name in names:
                value, at = self._element(at, end, f"{where}.{name}", depth)
                if value is not LEFT_OUT:
                    record[name] = value
            records.append(record)
        return records[0] if count == 1 else nested(records, dims)

    def _field_names(self, at: int, end: int, place: str) -> tuple[list[str], int]:
        length, at = self._bytes(at, end, place, 4)
        if len(length) != 4:
            raise self._fault(place, f"the length of field names takes {len(length)} bytes, not 4", at)
        (width,) = struct.unpack(self._order + "i", length)
        text, after = self._bytes(at, end, place, max(end - at, 0))
        if not 0 < width <= MAX_NAME or len(text) % width:
            raise self._fault(place, f"{len(text)} bytes are no field names of {width} bytes each", at)
        self._reading.count(len(text) // width, place)
        names = [name_of(text[i : i + width]) for i in range(0, len(text), width)]
        if len(set(names)) < len(names):
            raise self._fault(place, "has two fields of one name", at)
        return names, after

    def _room_for(self, count: int, at: int, end: int, place: str) -> None:
        if count * 8 > end - at:
            problem = f"{count} arrays are wanted, but {end - at} bytes have no room for them"
            raise self._fault(place, problem, at)
        self._reading.count(count, place)


def _units(data: bytes, count: int) -> NDArray[Any]:
    """Return UTF-8 text as characters or as UTF-16 units, whichever are `count`."""
    text = data.decode("utf-8", "replace")
    wide = np.frombuffer(text.encode("utf-16-le"), np.uint16)
    return wide if len(wide) == count else np.frombuffer(text.encode("utf-32-le"), np.uint32)
