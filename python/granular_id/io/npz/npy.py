"""NumPy's arrays: what their header says, and files of one (``.npy``), which say nothing about rate or labels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.errors import naming
from granular_id.io.files import Expansion, open_bounded
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource


def header_of(stream: IO[bytes], place: str, expansion: Expansion) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type of an array, whose values may be read: no objects, and not beyond all measure.

    Raises
    ------
    RecordingFileError
        No array, an array of Python objects (they could run code), or one far larger than its file.
    """
    with naming(expansion.path, f"reading the header of {place}"):
        version = np.lib.format.read_magic(stream)
        # version 3.0 differs from 2.0 in the encoding of field names only
        of_version = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = of_version(stream)
    if dtype.hasobject:
        problem = (
            "holds Python objects (pickled), which could run code; save texts as numpy.array(texts, dtype=str), "
            "recordings of several lengths as numpy.savez(file, rice_01=first, rice_02=second), or as one array "
            "with NaN behind the shorter ones"
        )
        raise expansion.fault(place, problem)
    expansion.spend(math.prod(shape) * max(dtype.itemsize, 8), place)  # numbers become float64
    return shape, dtype


def read_npy(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an array of shape (samples, 6), or of several recordings, (recordings, samples, 6).

    A structured array with the fields fx, fy, fz, tx, ty, tz, and perhaps time, is a table of samples. Other orders of
    the axes are recognised where they can be told, see ``arrays.layouts``; what was guessed is noted.

    Raises
    ------
    RecordingFileError
        No array, one of Python objects, one that is cut off or claims another size, or one that cannot be understood.
    """
    with open_bounded(source.path, source.root, options.max_binary_bytes) as (file, n_bytes):
        leaf = _Unread(file, *header_of(file, "the array", Expansion(source.path, n_bytes)))
        if leaf.dtype.names is None:
            return recordings_of({"values": leaf}, source, options, "array", single=True)
        array = leaf.read()
    return recordings_of({field: array[field] for field in leaf.dtype.names}, source, options, "field")


@dataclass
class _Unread:
    """The array behind a header, read when it is wanted: one of no use, of any size, is refused without."""

    file: BinaryIO
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def read(self) -> NDArray[Any]:
        self.file.seek(0)
        return np.asarray(np.load(self.file, allow_pickle=False))
