"""One array in numpy's file format, read from a stream: what its header asks for is checked before allocating."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from granular_id.io.bulk import read_at
from granular_id.io.errors import RecordingFileError

_CHUNK_BYTES = 1 << 20
"""Bytes read at once: many more than it takes to hand them to the thread that makes the checksum."""

_MAX_HEADER_BYTES = 10_000
"""Longest header that is parsed, as numpy's own default."""

_MAX_AXES = 32
"""As numpy 1.26 has it."""

_MAX_EXTENT = 2**60
"""Bytes that no array has."""


@dataclass(frozen=True)
class ArrayHeader:
    """What the header of an array says.

    Attributes
    ----------
    shape : tuple of int
    dtype : numpy.dtype
        Holds no Python objects.
    fortran_order : bool
        Whether the first index varies fastest.
    n_bytes : int
        Bytes of the values that follow.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran_order: bool
    n_bytes: int


def read_header(stream: IO[bytes], n_bytes: int, path: Path, place: str | None = None) -> ArrayHeader:
    """Read the header of an array and compare it with the bytes that are there.

    Parameters
    ----------
    stream : binary stream
        At its first byte; left at the first value.
    n_bytes : int
        Bytes of the stream in all, header included.
    path, place
        What errors name.

    Raises
    ------
    RecordingFileError
        No array, an array of Python objects (they could run code), or one that needs more or fewer bytes.
    """
    try:
        version = np.lib.format.read_magic(stream)
        # version 3.0 differs from 2.0 in the encoding of field names only
        read = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, fortran_order, dtype = read(stream, max_header_size=_MAX_HEADER_BYTES)
    except OSError:
        raise
    except Exception as error:  # the header is Python text: parsing what is none raises errors of many kinds
        problem = (
            f"is no array in numpy's format: {str(error).splitlines()[0][:200] if str(error) else 'cut off'}"
        )
        raise RecordingFileError(path, problem, place=place) from error
    if dtype.hasobject:
        problem = (
            "holds Python objects (pickled), which could run code; save texts as numpy.array(texts, dtype=str), "
            "recordings of several lengths as numpy.savez(file, rice_01=first, rice_02=second), or as one array "
            "with NaN behind the shorter ones"
        )
        raise RecordingFileError(path, problem, place=place)
    extent = math.prod(max(1, length) for length in shape)  # numpy counts those of empty arrays too
    impossible = any(length < 0 for length in shape) or len(shape) > _MAX_AXES or not dtype.itemsize
    if impossible or extent * dtype.itemsize >= _MAX_EXTENT:
        raise RecordingFileError(
            path, f"is an impossible array: shape {_short(shape)} of {dtype}", place=place
        )
    wanted, there = math.prod(shape) * dtype.itemsize, n_bytes - stream.tell()
    if wanted != there:
        problem = f"shape {_short(shape)} of {dtype} needs {wanted} bytes, but there are {there}"
        raise RecordingFileError(path, problem, place=place)
    return ArrayHeader(shape, dtype, fortran_order, wanted)


def read_values(stream: IO[bytes], header: ArrayHeader, path: Path, place: str) -> NDArray[Any]:
    """Read the values that follow a header from a stream, in pieces, into one array.

    Raises
    ------
    RecordingFileError
        The stream ends before they do.
    """
    values = np.empty(math.prod(header.shape), header.dtype)
    buffer = values.view(np.uint8).data if values.size else memoryview(b"")
    done = 0
    while done < header.n_bytes:
        count = stream.readinto(buffer[done : done + _CHUNK_BYTES])  # type: ignore[attr-defined]
        if not count:
            raise _cut_off(done, header, path, place)
        done += count
    return _shaped(values, header)


def read_file_values(file: BinaryIO, header: ArrayHeader, path: Path) -> tuple[NDArray[Any], bool]:
    """Read the values that follow a header from a file of its own, by several threads.

    Returns
    -------
    values : ndarray
    finite : bool
        Whether they are known to be finite, see ``read_at``.

    Raises
    ------
    RecordingFileError
        The file ends before they do.
    """
    values = np.empty(math.prod(header.shape), header.dtype)
    found = read_at(file.fileno(), file.tell(), values)
    if found.n_bytes < header.n_bytes:
        raise _cut_off(found.n_bytes, header, path)
    return _shaped(values, header), found.finite


def _cut_off(done: int, header: ArrayHeader, path: Path, place: str | None = None) -> RecordingFileError:
    return RecordingFileError(path, f"is cut off: {done} of {header.n_bytes} bytes are there", place=place)


def _shaped(values: NDArray[Any], header: ArrayHeader) -> NDArray[Any]:
    shape = header.shape[::-1] if header.fortran_order else header.shape
    array: NDArray[Any] = values.reshape(shape)
    return array.transpose() if header.fortran_order else array


def _short(shape: tuple[int, ...]) -> str:
    text = str(shape)
    return text if len(text) < 60 else f"{text[:50]} ... ({len(shape)} axes)"
