"""NPY files: one numpy array, which says nothing about its rate or labels."""

from __future__ import annotations

from granular_id.io.array_layouts import recordings_of
from granular_id.io.files import open_bounded
from granular_id.io.npy_stream import read_header, read_values
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource


def read_npy(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an array of shape (samples, 6), or of several recordings, (recordings, samples, 6).

    A structured array with the fields fx, fy, fz, tx, ty, tz, and perhaps time, is a table of samples. Other orders of
    the axes are recognised where they can be told, see ``array_layouts``; what was guessed is noted.

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
        array = read_values(file, read_header(file, n_bytes, path), path)
    fields = array.dtype.names
    tree = {"values": array} if fields is None else {field: array[field] for field in fields}
    return recordings_of(tree, source, options, "array" if fields is None else "field")
