"""Bytes of MATLAB files that no library would write, by what is wrong with them."""

from __future__ import annotations

import struct
import zlib

import numpy as np

INT8, INT32, UINT32, DOUBLE, MATRIX, COMPRESSED = 1, 5, 6, 9, 14, 15
CELL, STRUCT, CHAR, DOUBLES, FUNCTION, OPAQUE = 1, 2, 4, 6, 16, 17


def element(kind: int, data: bytes, size: int | None = None) -> bytes:
    """An element of version 5, with the size it has or the one it is to claim."""
    return struct.pack("<II", kind, len(data) if size is None else size) + data + bytes(-len(data) % 8)


def head(array_class: int, dims: tuple[int, ...], name: str = "", flags: int = 0) -> bytes:
    """Flags, size and name of an array."""
    sizes = struct.pack(f"<{len(dims)}i", *dims)
    return (
        element(UINT32, struct.pack("<II", array_class | flags, 0))
        + element(INT32, sizes)
        + element(INT8, name.encode())
    )


def doubles(values: list[float], dims: tuple[int, ...], name: str = "") -> bytes:
    return head(DOUBLES, dims, name) + element(DOUBLE, np.array(values, "<f8").tobytes())


def packed(matrix: bytes, claims: int | None = None) -> bytes:
    """A compressed variable; `claims` is the size it states inside."""
    inner = struct.pack("<II", MATRIX, len(matrix) if claims is None else claims) + matrix
    data = zlib.compress(inner, 1)
    return struct.pack("<II", COMPRESSED, len(data)) + data


def header(version: int = 0x0100, mark: bytes = b"IM") -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", version) + mark


def mat(*elements: bytes) -> bytes:
    return header() + b"".join(elements)


def nest(depth: int) -> bytes:
    """Cells within cells."""
    inner = doubles([1.0], (1, 1))
    for _ in range(depth):
        inner = head(CELL, (1, 1)) + element(MATRIX, inner)
    return element(MATRIX, inner)


def array(data: bytes, claims: int | None = None) -> bytes:
    """A variable, or what a cell or field holds."""
    return element(MATRIX, data, claims)


X = doubles([1.0], (1, 1), "X")
BOMB = zlib.compress(struct.pack("<II", MATRIX, 1 << 30) + bytes(1 << 22))
_2_31 = 2**31 - 1

MAT_FILES: dict[str, tuple[bytes]] = {
    "empty": (b"",),
    "no MAT file": (b"PK\3\4" + bytes(600),),
    "text": (b"time,fx,fy,fz\n" * 40,),
    "header cut off": (header()[:90],),
    "byte order": (header(mark=b"XX") + array(X),),
    "order of the other machine": (header(mark=b"MI") + array(X),),
    "version": (header(version=0x0300) + array(X),),
    "7.3 without HDF5": (b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(500),),
    "no variables": (mat(),),
    "tag cut off": (mat(array(X))[:133],),
    "variable cut off": (mat(array(X))[:-8],),
    "longer than the file": (mat(array(X, 1 << 31)),),
    "no array": (mat(element(DOUBLE, bytes(8))),),
    "empty variable": (mat(array(b"")),),
    "no flags": (mat(array(element(INT32, bytes(8)) + bytes(40))),),
    "flags cut off": (mat(array(X[:8])),),
    "no size": (mat(array(X[:16] + element(INT8, b"X" * 8))),),
    "one dimension": (mat(array(head(DOUBLES, (1,)))),),
    "negative size": (mat(array(head(DOUBLES, (-1, 2)))),),
    "many dimensions": (mat(array(head(DOUBLES, (1,) * 33))),),
    "sizes overflow": (mat(array(head(DOUBLES, (_2_31,) * 4))),),
    "empty but huge": (mat(array(head(DOUBLES, (0, *(_2_31,) * 4)))),),
    "numbers missing": (mat(array(head(DOUBLES, (1000, 1000), "X") + element(DOUBLE, bytes(80)))),),
    "part longer than the whole": (
        mat(array(head(DOUBLES, (1, 1), "X") + element(DOUBLE, bytes(8), 1 << 20))),
    ),
    "no numbers": (mat(array(head(DOUBLES, (1, 1), "X") + array(bytes(8)))),),
    "doubles as int": (mat(array(head(10, (1, 1), "X") + element(DOUBLE, bytes(8)))),),
    "no characters": (mat(array(head(CHAR, (1, 1), "X") + element(DOUBLE, bytes(8)))),),
    "characters missing": (mat(array(head(CHAR, (1, 9), "X") + element(INT8, b"abc"))),),
    "unknown class": (mat(array(head(99, (1, 1), "X"))),),
    "name too long": (mat(array(head(DOUBLES, (1, 1), "n" * 500))),),
    "small element": (mat(array(X[:16] + struct.pack("<HH", 5, 8) + bytes(20))),),
    "two of one name": (mat(array(X) * 2),),
    "2^31 cells": (mat(array(head(CELL, (_2_31, 1), "c"))),),
    "many cells": (mat(packed(head(CELL, (60_000, 1), "c") + array(b"") * 60_000)),),
    "no matrix in a cell": (mat(array(head(CELL, (1, 1), "c") + element(DOUBLE, bytes(8)))),),
    "1000 deep": (mat(nest(1000)),),
    "1000 deep, packed": (mat(packed(nest(1000)[8:])),),
    "structs without fields": (
        mat(array(head(STRUCT, (_2_31, 1), "s") + element(INT32, struct.pack("<i", 8)) + element(INT8, b""))),
    ),
    "width of field names": (
        mat(array(head(STRUCT, (1, 1), "s") + element(INT32, bytes(4)) + element(INT8, b"abc"))),
    ),
    "fields of one name": (
        mat(
            array(head(STRUCT, (0, 1), "s") + element(INT32, struct.pack("<i", 2)) + element(INT8, b"a\0a\0"))
        ),
    ),
    "bomb": (mat(struct.pack("<II", COMPRESSED, len(BOMB)) + BOMB),),
    "larger bomb": (mat(packed(bytes(1 << 27))),),
    "claims less": (mat(packed(X, claims=48)),),
    "claims more": (mat(packed(X, claims=900)),),
    "compressed array cut off": (mat(struct.pack("<II", COMPRESSED, 20) + zlib.compress(array(X))[:20]),),
    "compressed nothing": (mat(struct.pack("<II", COMPRESSED, 0)),),
    "no zlib": (mat(struct.pack("<II", COMPRESSED, 24) + b"x" * 24),),
    "numbers grow": (mat(packed(head(DOUBLES, (1 << 13, 1 << 13), "X") + element(2, bytes(1 << 26)))),),
    "version 4, too short": (struct.pack("<5i", 0, 1600, 6, 0, 2) + b"X\0" + bytes(800),),
    "version 4, negative": (struct.pack("<5i", 0, -5, 6, 0, 2) + b"X\0" + bytes(800),),
    "version 4, no name": (struct.pack("<5i", 0, 1, 1, 0, 0) + bytes(8),),
    "version 4, header cut off": (struct.pack("<5i", 0, 1, 1, 0, 2)[:18],),
    "version 4, no text": (struct.pack("<5i2s", 1, 1, 1, 0, 2, b"t\0") + struct.pack("<d", -3),),
    "version 4, other machine": (struct.pack("<5i", 2000, 1, 1, 0, 2) + bytes(10),),
    "version 4, twice": ((struct.pack("<5i2s", 0, 1, 1, 0, 2, b"X\0") + bytes(8)) * 2,),
}
