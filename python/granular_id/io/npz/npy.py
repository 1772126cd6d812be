"""NPY files: one numpy array, which says nothing about its rate or labels."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

from numpy.typing import NDArray

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.files import open_bounded
from granular_id.io.npz.array_stream import ArrayHeader, read_file_values, read_header
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource


def read_npy(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an array of shape (samples, 6), or of several recordings, (recordings, samples, 6).

    A structured array with the fields fx, fy, fz, tx, ty, tz, and perhaps time, is a table of samples. Other orders of
    the axes are recognised where they can be told, see ``arrays.layouts``; what was guessed is noted.

    Parameters
    ----------
    source : FileSource
    options : LoadOptions
        ``rate_hz`` must be stated here or in `source`, unless the array has a field ``time``.

    Raises
    ------
    RecordingFileError
        No array, one of Python objects, one that is cut off or claims another size, or one that cannot be understood.
    """
    path = source.path
    with open_bounded(path, source.root, options.max_binary_bytes) as (file, n_bytes):
        leaf = _Unread(file, read_header(file, n_bytes, path), path)
        if leaf.dtype.names is None:
            return recordings_of({"values": leaf}, source, options, "array", single=True)
        array = leaf.read()
    return recordings_of({field: array[field] for field in leaf.dtype.names}, source, options, "field")


class _Unread:
    """The array behind a header, read when it is wanted: one of no use, of any size, is refused without."""

    def __init__(self, file: BinaryIO, header: ArrayHeader, path: Path) -> None:
        self._file, self._header, self._path = file, header, path
        self._start = file.tell()
        self.shape, self.dtype = header.shape, header.dtype
        self.finite = False
        """Whether values that were read are known to be finite."""

    def read(self) -> NDArray[Any]:
        self._file.seek(self._start)
        values, self.finite = read_file_values(self._file, self._header, self._path)
        return values
