"""MATLAB files of every version: which one it is, what is in it, and what that means.

Versions 4 and 5 (``save -v4``, ``-v6``, ``-v7``) are read here, version 7.3 through h5py. What the variables hold
is guessed as for any other file of named arrays (see ``arrays.layouts.recordings_of``), and the guess is said.
"""

from __future__ import annotations

from typing import Any, BinaryIO

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import open_bounded
from granular_id.io.matlab.tree import MatReading
from granular_id.io.matlab.v4 import read_v4
from granular_id.io.matlab.v5 import HEADER_BYTES, read_v5
from granular_id.io.matlab.v73 import read_v73
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource

_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_HDF5_AT = 512  # behind MATLAB's own header


def read_mat(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the recordings of one MATLAB file.

    Parameters
    ----------
    source : FileSource
    options : LoadOptions
        `max_file_bytes` is 2 GiB by default; `rate_hz` is for files that do not say their rate.

    Returns
    -------
    FileContent
        Its notes say what was guessed, and what was left out (objects, sparse and complex arrays, functions).

    Raises
    ------
    RecordingFileError
        Naming the variable: damage, sizes beyond reason, no recordings, or recordings without labels beside a
        variable that may hold them but cannot be read (string, categorical, table).
    ImportError
        h5py is missing, for a file of version 7.3.
    """
    variables, reading = read_variables(source, options)
    try:
        content = recordings_of(variables, source, options, "variable")
    except RecordingFileError as error:
        if not reading.left_out:
            raise
        problem = f"{error.problem}; {'; '.join(reading.left_out)}"
        raise RecordingFileError(error.path, problem, place=error.place) from error
    stated = source.label or source.folder_label
    if reading.may_be_labels and not stated and any(r.label is None for r in content.recordings):
        problem = f"has recordings without a label, but {'; '.join(reading.may_be_labels)}"
        raise RecordingFileError(source.path, problem)
    content.notes.extend(reading.left_out)
    return content


def read_variables(source: FileSource, options: LoadOptions) -> tuple[dict[str, Any], MatReading]:
    """Read all variables of a MATLAB file as plain Python values.

    Returns
    -------
    variables : dict
        By name: numpy arrays of at least two dimensions, shaped as MATLAB shows them; str, or list of str for char
        arrays of several rows; dict for a struct; list for cells and struct arrays (lists of rows where they have
        rows and columns).
    reading : MatReading
        What was left out.
    """
    with open_bounded(source.path, source.root, options.max_binary_bytes) as (file, n_bytes):
        reading = MatReading(source.path, n_bytes)
        version = _version(file, reading)
        if version == 4:
            variables = read_v4(file, reading)
        elif version == 5:
            variables = read_v5(file, reading)
        else:
            variables = read_v73(reading)
    if not variables:
        left_out = f": {'; '.join(reading.left_out)}" if reading.left_out else ""
        raise RecordingFileError(source.path, f"holds no variable that can be read{left_out}")
    return variables, reading


def _version(file: BinaryIO, reading: MatReading) -> int:
    """Return 4, 5 or 7 (for 7.3)."""
    head = file.read(_HDF5_AT + len(_HDF5_MARK))
    if head.startswith(_HDF5_MARK) or head[_HDF5_AT:] == _HDF5_MARK:
        return 7
    if not head:
        raise RecordingFileError(reading.path, "is empty")
    if head.startswith(b"# Created by Octave"):
        raise reading.fault("header", "is text as Octave's save writes it by default; save it with -v7")
    if head.startswith(b"MATLAB 7.3"):
        raise reading.fault("header", "says MATLAB 7.3, but no HDF5 file follows: it is cut off or damaged")
    if head.startswith(b"MATLAB") or head[HEADER_BYTES - 2 : HEADER_BYTES] in (b"IM", b"MI"):
        return 5
    if 0 in head[:4]:  # version 4 begins with a small number, the others with text
        return 4
    shown = head[:20]
    raise reading.fault("header", f"begins with {shown!r}; wanted a MATLAB file of version 4, 5 or 7.3")
