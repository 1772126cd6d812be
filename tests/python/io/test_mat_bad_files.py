"""MAT files of versions 4 and 5 that are damaged or set a trap: one clear error each, and little memory."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from granular_id.io import RecordingFileError, load
from mat_cases import (
    CELL,
    CHAR,
    COMPRESSED,
    DOUBLE,
    DOUBLES,
    FUNCTION,
    GOLDEN,
    INT8,
    INT32,
    MATRIX,
    OPAQUE,
    STRUCT,
    UINT32,
    assert_refused,
    doubles,
    element,
    head,
    header,
    left_out,
    mat,
    nest,
    packed,
    push,
    variables,
)


def array(data: bytes, claims: int | None = None) -> bytes:
    """A variable, or what a cell or field holds."""
    return element(MATRIX, data, claims)


X = doubles([1.0], (1, 1), "X")
BOMB = zlib.compress(struct.pack("<II", MATRIX, 1 << 30) + bytes(1 << 22))
_2_31 = 2**31 - 1

BAD = {
    "empty": (b"", "is empty"),
    "no MAT file": (b"PK\3\4" + bytes(600), "is no|wanted a MATLAB file|no MAT file|damage"),
    "text": (b"time,fx,fy,fz\n" * 40, r"begins with .* wanted a MATLAB file of version 4, 5 or 7\.3"),
    "header cut off": (header()[:90], "the file ends after 90 bytes of its 128-byte header"),
    "byte order": (header(mark=b"XX") + array(X), r"the mark of byte order is b'XX'"),
    "order of the other machine": (header(mark=b"MI") + array(X), "states version 0x0001"),
    "version": (header(version=0x0300) + array(X), "states version 0x0300"),
    "7.3 without HDF5": (b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(500), "says MATLAB 7.3, but no HDF5"),
    "no variables": (mat(), "holds no variable that can be read"),
    "tag cut off": (mat(array(X))[:133], "within the tag of a variable: 5 of 8 bytes"),
    "variable cut off": (mat(array(X))[:-8], "an array claims .* bytes, but .* are left: the file is cut off"),
    "longer than the file": (mat(array(X, 1 << 31)), "an array claims 2147483648 bytes"),
    "no array": (mat(element(DOUBLE, bytes(8))), "an array is wanted, got an element of type 9"),
    "empty variable": (mat(array(b"")), "it has not even a name"),
    "no flags": (mat(array(element(INT32, bytes(8)) + bytes(40))), "flags of an array are wanted, got type 5"),
    "flags cut off": (mat(array(X[:8])), "ends within the flags of an array"),
    "no size": (mat(array(X[:16] + element(INT8, b"X" * 8))), "the size of an array is wanted, got type 1"),
    "one dimension": (mat(array(head(DOUBLES, (1,)))), "the size of an array is wanted"),
    "negative size": (mat(array(head(DOUBLES, (-1, 2)))), "has the size -1 x 2"),
    "many dimensions": (mat(array(head(DOUBLES, (1,) * 33))), "33 dimensions"),
    "sizes overflow": (mat(array(head(DOUBLES, (_2_31,) * 4))), "damage or a trap"),
    "empty but huge": (mat(array(head(DOUBLES, (0, *(_2_31,) * 4)))), "damage or a trap"),
    "numbers missing": (
        mat(array(head(DOUBLES, (1000, 1000), "X") + element(DOUBLE, bytes(80)))),
        r"variable X: 1000 x 1000 numbers take 8000000 bytes, but 80 are there \(byte 48 of the variable\)",
    ),
    "part longer than the whole": (
        mat(array(head(DOUBLES, (1, 1), "X") + element(DOUBLE, bytes(8), 1 << 20))),
        "variable X: an element claims 1048576 bytes where 8 are left",
    ),
    "no numbers": (mat(array(head(DOUBLES, (1, 1), "X") + array(bytes(8)))), "numbers are wanted"),
    "doubles as int": (mat(array(head(10, (1, 1), "X") + element(DOUBLE, bytes(8)))), "cannot be stored as"),
    "no characters": (mat(array(head(CHAR, (1, 1), "X") + element(DOUBLE, bytes(8)))), "characters are wanted"),
    "characters missing": (mat(array(head(CHAR, (1, 9), "X") + element(INT8, b"abc"))), "3 are there"),
    "unknown class": (mat(array(head(99, (1, 1), "X"))), "variable X: is an array of the unknown class 99"),
    "name too long": (mat(array(head(DOUBLES, (1, 1), "n" * 500))), "takes 500 bytes, more than 256"),
    "small element": (mat(array(X[:16] + struct.pack("<HH", 5, 8) + bytes(20))), "claims 8 bytes, 4 at most"),
    "two of one name": (mat(array(X) * 2), "variable X: occurs twice"),
    "2^31 cells": (mat(array(head(CELL, (_2_31, 1), "c"))), "variable c: 2147483647 arrays are wanted"),
    "many cells": (
        mat(packed(head(CELL, (60_000, 1), "c") + array(b"") * 60_000)),
        "more than 50000 cells, fields and variables",
    ),
    "no matrix in a cell": (
        mat(array(head(CELL, (1, 1), "c") + element(DOUBLE, bytes(8)))),
        r"variable c\{1\}: an array",
    ),
    "1000 deep": (mat(nest(1000)), "more than 32 deep"),
    "1000 deep, packed": (mat(packed(nest(1000)[8:])), "more than 32 deep"),
    "structs without fields": (
        mat(array(head(STRUCT, (_2_31, 1), "s") + element(INT32, struct.pack("<i", 8)) + element(INT8, b""))),
        "more than 50000",
    ),
    "width of field names": (
        mat(array(head(STRUCT, (1, 1), "s") + element(INT32, bytes(4)) + element(INT8, b"abc"))),
        "3 bytes are no field names of 0 bytes each",
    ),
    "fields of one name": (
        mat(array(head(STRUCT, (0, 1), "s") + element(INT32, struct.pack("<i", 2)) + element(INT8, b"a\0a\0"))),
        "has two fields of one name",
    ),
    "bomb": (mat(struct.pack("<II", COMPRESSED, len(BOMB)) + BOMB), "cannot hold the 1073741824 that are claimed"),
    "larger bomb": (mat(packed(bytes(1 << 27))), "would expand from .* to 134217728 bytes"),
    "claims less": (mat(packed(X, claims=48)), "goes on beyond|are there|ends within"),
    "claims more": (mat(packed(X, claims=900)), "ends after .* of 900 bytes"),
    "compressed array cut off": (
        mat(struct.pack("<II", COMPRESSED, 20) + zlib.compress(array(X))[:20]),
        "the compressed array ends|is damaged",
    ),
    "compressed nothing": (mat(struct.pack("<II", COMPRESSED, 0)), "ends after 0 of 8 bytes"),
    "no zlib": (mat(struct.pack("<II", COMPRESSED, 24) + b"x" * 24), "the compressed array is damaged"),
    "numbers grow": (
        # small integers that stand for doubles: eight times as many bytes in memory
        mat(packed(head(DOUBLES, (1 << 13, 1 << 13), "X") + element(2, bytes(1 << 26)))),
        "would expand|variable X",
    ),
    "version 4, too short": (
        struct.pack("<5i", 0, 1600, 6, 0, 2) + b"X\0" + bytes(800),
        "76800 bytes, 76000 more than are left",
    ),
    "version 4, negative": (struct.pack("<5i", 0, -5, 6, 0, 2) + b"X\0" + bytes(800), "has the size -5 x 6"),
    "version 4, no name": (struct.pack("<5i", 0, 1, 1, 0, 0) + bytes(8), "a name of 0 bytes"),
    "version 4, header cut off": (struct.pack("<5i", 0, 1, 1, 0, 2)[:18], "after 18 of the 20 header bytes"),
    "version 4, no text": (struct.pack("<5i2s", 1, 1, 1, 0, 2, b"t\0") + struct.pack("<d", -3), "-3.0 is no character"),
    "version 4, other machine": (struct.pack("<5i", 2000, 1, 1, 0, 2) + bytes(10), "which no MAT file does"),
    "version 4, twice": ((struct.pack("<5i2s", 0, 1, 1, 0, 2, b"X\0") + bytes(8)) * 2, "variable X: occurs twice"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_one_clear_error_and_little_memory(tmp_path: Path, name: str) -> None:
    data, message = BAD[name]
    path = tmp_path / "bad.mat"
    path.write_bytes(data)
    assert_refused(path, message, 200 << 20)


@pytest.mark.parametrize("golden", ["x_y_v7", "struct_array_v7", "int16_v6", "one_v4", "ragged_cell_v73"])
def test_cut_off_anywhere_is_refused(tmp_path: Path, golden: str) -> None:
    if golden.endswith("v73"):
        pytest.importorskip("h5py")
    data = (GOLDEN / f"{golden}.mat").read_bytes()
    path = tmp_path / "cut.mat"
    whole = variables(GOLDEN / f"{golden}.mat")
    for n_bytes in np.linspace(0, len(data) - 1, 60).astype(int):
        path.write_bytes(data[:n_bytes])
        try:
            found = variables(path)
        except RecordingFileError:
            continue
        assert found.keys() < whole.keys()  # cut between two variables, which leaves no trace


def test_objects_of_matlab_are_named_with_the_way_out(tmp_path: Path) -> None:
    flags = element(UINT32, struct.pack("<II", OPAQUE, 0))
    names = element(INT8, b"y") + element(INT8, b"MCOS") + element(INT8, b"categorical")
    opaque = array(flags + names + array(doubles([1.0], (1, 1))))
    handle = array(head(FUNCTION, (1, 1), "f") + array(b""))
    x = array(doubles(list(np.zeros(2 * 24 * 6)), (2, 24, 6), "X"))
    rate = array(doubles([500.0], (1, 1), "rate_hz"))
    path = tmp_path / "rice_1.mat"
    path.write_bytes(mat(x, rate, handle, opaque))
    assert left_out(path) == [
        "variable f is a function handle and was left out; it holds no samples",
        "variable y is a MATLAB categorical and was left out; save cellstr(...) of it",
    ]
    with pytest.raises(RecordingFileError, match="without a label, but variable y is a MATLAB categorical"):
        load(path)
    # where the folder says the label, nothing is missing
    data = load(tmp_path)
    assert [r.label for r in data] == ["rice", "rice"]
    assert any("categorical" in note for note in data.history[-1].notes)


def test_what_is_left_out_of_a_cell_leaves_out_the_cell(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"c": np.array([1.0, 1j], object), "s": {"a": 1j, "b": 2.0}, "wrench": push(1)})
    found = variables(path)
    assert set(found) == {"s", "wrench"}
    assert set(found["s"]) == {"b"}
    assert [text.split(" is ")[0] for text in left_out(path)] == ["variable c{2}", "variable s.a"]


def test_objects_of_matlab_themselves_are_skipped(tmp_path: Path) -> None:
    data = mat(array(X), array(head(9, (1, 8)) + element(2, bytes(8))))
    second = len(mat(array(X)))
    path = tmp_path / "x.mat"
    path.write_bytes(data[:116] + struct.pack("<Q", second) + data[124:])
    assert set(variables(path)) == {"X"}


def test_larger_than_the_cap(tmp_path: Path) -> None:
    with pytest.raises(RecordingFileError, match="more than max_file_bytes=100"):
        load(GOLDEN / "x_y_v7.mat", max_file_bytes=100)


def test_cells_without_columns_are_no_rows_of_nothing(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    path.write_bytes(mat(array(X), array(head(CELL, (1 << 24, 0), "c"))))
    assert variables(path)["c"] == []
