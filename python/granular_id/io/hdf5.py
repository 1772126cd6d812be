"""HDF5: files of groups and arrays that other programs wrote, read by the convention for arrays."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from granular_id.io.arrays import content_of
from granular_id.io.files import RecordingFileError, need
from granular_id.io.leaves import MOST_DEEP, Leaf, Opening
from granular_id.io.source import FileContent, FileSource, LoadOptions

_OPENING = Opening("data set", "h5py.File({})", "[()]", "numpy.ravel({}.asstr()[()])")


def read_hdf5(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the groups and arrays of an HDF5 file; attributes count as what stands beside. Links are not followed."""
    with opened(source, "to read .h5 files") as file:
        tree = _group(file, source, "", 0)
        return content_of(tree, source, options, _OPENING)


@contextmanager
def opened(source: FileSource, why: str) -> Iterator[Any]:
    """Open a file; `why` ends the sentence about a missing h5py."""
    h5py = need("h5py", extra="hdf5", why=why)
    # a lock would make files on read-only and network drives unreadable; nothing is written
    with h5py.File(source.path, "r", locking=False) as file:
        yield file


def _group(group: Any, source: FileSource, place: str, depth: int) -> dict[str, Any]:
    """Return a mapping per group, a leaf per data set; what holds neither numbers nor texts is passed over."""
    import h5py

    if depth > MOST_DEEP:
        raise RecordingFileError(
            source.path, f"groups lie in each other deeper than {MOST_DEEP}", place=place[:200]
        )
    found: dict[str, Any] = _attributes(group)
    for name in group:
        inner = f"{place}/{name}" if place else str(name)
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise RecordingFileError(source.path, "is a link, which is not followed", place=inner)
        item = group[name]
        if hasattr(item, "keys"):
            found[name] = _group(item, source, inner, depth + 1)
            continue
        if getattr(item, "external", None) or getattr(item, "is_virtual", False):
            raise RecordingFileError(
                source.path, "keeps its values in other files, which are not opened", place=inner
            )
        if getattr(item, "shape", None) is None:
            continue
        if h5py.check_string_dtype(item.dtype) is not None:
            found[name] = Leaf(np.asarray(item.asstr(errors="replace")[()], np.str_))
        elif item.dtype.kind in "iufb":
            found[name] = Leaf(item, _attributes(item))
        elif item.dtype.names is not None:  # columns of a table
            columns = {column: _of_table(item[column]) for column in item.dtype.names}
            found[name] = {
                column: leaf for column, leaf in columns.items() if leaf is not None
            } | _attributes(item)
    return found


def _of_table(cells: Any) -> Leaf | None:
    """Return a column, bytes as texts; nothing where it holds neither numbers nor texts."""
    if cells.dtype.kind == "O" and not all(isinstance(cell, (bytes, str)) for cell in cells.ravel()):
        return None
    if cells.dtype.kind not in "OS":
        return Leaf(cells)
    return Leaf(
        np.char.decode(cells.astype("S"), errors="replace"), texts="numpy.char.decode({}.astype('S'))"
    )


def _attributes(item: Any) -> dict[str, Any]:
    """Return the attributes that are numbers or texts."""
    found: dict[str, Any] = {}
    for name, value in item.attrs.items():
        array = np.asarray(value.decode("utf-8", "replace") if isinstance(value, bytes) else value)
        if array.dtype.kind == "O" and all(isinstance(text, (str, bytes)) for text in array.ravel()):
            array = np.array([text.decode() if isinstance(text, bytes) else text for text in array.ravel()])
        if array.dtype.kind in "iufUS":
            found[str(name)] = Leaf(array, is_attribute=True)
    return found
