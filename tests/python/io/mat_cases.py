"""Bytes of MAT files, made by hand where no library would write them so."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.io.matlab.mat import read_variables
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource

GOLDEN = Path(__file__).parents[2] / "data" / "mat"
INT8, INT32, UINT32, DOUBLE, MATRIX, COMPRESSED = 1, 5, 6, 9, 14, 15
CELL, STRUCT, CHAR, DOUBLES, FUNCTION, OPAQUE = 1, 2, 4, 6, 16, 17


def push(i: int, n_samples: int = 24) -> np.ndarray:
    """Recording i of the golden files: see make_mat.m."""
    t, c = np.meshgrid(np.arange(1, n_samples + 1), np.arange(1, 7), indexing="ij")
    return 1000.0 * i + t + c / 8


def variables(path: Path) -> dict:
    return read_variables(FileSource.alone(path), LoadOptions())[0]


def left_out(path: Path) -> list[str]:
    return read_variables(FileSource.alone(path), LoadOptions())[1].left_out


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


def assert_refused(path: Path, message: str, most_bytes: int) -> None:
    """Loading ends in one error that names the file, without more memory than that."""
    tracemalloc.start()
    try:
        with pytest.raises(RecordingFileError, match=message) as caught:
            load(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert str(caught.value).startswith(str(path))
    assert peak < most_bytes
