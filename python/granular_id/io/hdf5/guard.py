"""HDF5 files from outside, read within bounds: nothing outside the file, no size on trust.

The HDF5 library follows links to other files, maps datasets onto other files, loads filters as plug-ins, and
unpacks a chunk to whatever it expands to (a chunk of 1 MB to 1 GB, in eleven seconds). Here every link,
storage, filter and size is looked at first, and chunks packed by gzip are unpacked to their own size at most.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.expansion import Expansion
from granular_id.io.extras import need
from granular_id.io.hdf5.chunks import DEFLATE, FLETCHER32, MAX_CHUNKS, SHUFFLE, PackedChunks

_FILTERS = (DEFLATE, SHUFFLE, FLETCHER32)

MAX_MEMBERS = 50_000
"""Members of one group."""

MAX_ATTRIBUTE_BYTES = 1 << 16
"""Size of one attribute; the HDF5 library's own limit for attributes within a header."""


@contextmanager
def translated(expansion: Expansion, place: str) -> Iterator[None]:
    """Turn what the HDF5 library says about a damaged file into RecordingFileError.

    The library and its Python binding have no exception of their own: damage is reported as any of these.
    """
    try:
        yield
    except RecordingFileError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # of the system, not of the file
            problem = f"cannot be read: {os.strerror(error.errno)}"
            raise RecordingFileError(expansion.path, problem) from error
        text = str(error.args[0] if error.args else error) or type(error).__name__
        raise expansion.fault(place, f"is damaged, or no HDF5 that can be read ({text[:200]})") from error


class GuardedFile:
    """An open HDF5 file of which only what has been checked is read.

    Parameters
    ----------
    expansion : Expansion
        Path and size of the file (checked by ``files.check_file``), and what was spent on it.
    why : str
        What h5py is needed for, should it be missing.

    Examples
    --------
    >>> import tempfile, pathlib, h5py
    >>> from granular_id.io.expansion import Expansion
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "x.h5"
    ...     with h5py.File(path, "w") as file:
    ...         file["X"] = [1.0, 2.0]
    ...     with GuardedFile(Expansion(path, path.stat().st_size), "to read .h5 files") as guarded:
    ...         guarded.values(guarded.member(guarded.root, "X", "X"), "X")
    array([1., 2.])
    """

    def __init__(self, expansion: Expansion, why: str) -> None:
        self._h5 = need("h5py", extra="hdf5", why=why)
        self.expansion = expansion
        with translated(expansion, "header"):
            # a lock would make files on read-only and network drives unreadable; nothing is written
            self._file = self._h5.File(expansion.path, "r", locking=False)
            try:
                self.root = self._file["/"]
            except BaseException:
                self._file.close()  # left open, the library would take any later file at this place for the same
                raise

    def __enter__(self) -> GuardedFile:
        return self

    def __exit__(self, *_: object) -> None:
        with translated(self.expansion, "end of file"):
            self._file.close()

    def names(self, group: Any, place: str) -> list[str]:
        """Return the names in a group."""
        with translated(self.expansion, place):
            n_members = group.id.get_num_objs()
            if n_members > MAX_MEMBERS:
                raise self.expansion.fault(place, f"has {n_members} members, more than {MAX_MEMBERS}")
            return [name.decode("utf-8", "surrogateescape") for name in group.id]

    def member(self, group: Any, name: str, place: str) -> Any:
        """Return a group or dataset that is itself in the group: links by name may lead anywhere."""
        key = name.encode("utf-8", "surrogateescape")
        with translated(self.expansion, place):
            kind = group.id.links.get_info(key).type
            if kind != self._h5.h5l.TYPE_HARD:
                what = "by name" if kind == self._h5.h5l.TYPE_SOFT else "to another file"
                raise self.expansion.fault(place, f"is a link {what}, which is not followed")
            return self._known(self._h5.h5o.open(group.id, key), place)

    def target(self, reference: Any, place: str) -> Any:
        """Return what a reference leads to; references stay within the file."""
        with translated(self.expansion, place):
            if not reference:
                raise self.expansion.fault(place, "is a reference to nothing")
            return self._known(self._h5.h5r.dereference(reference, self._file.id), place)

    def _known(self, found: Any, place: str) -> Any:
        if isinstance(found, self._h5.h5g.GroupID):
            return self._h5.Group(found)
        if isinstance(found, self._h5.h5d.DatasetID):
            return self._h5.Dataset(found)
        raise self.expansion.fault(place, "is neither a group nor a dataset")

    def is_group(self, item: Any) -> bool:
        """Tell a group from a dataset."""
        return isinstance(item, self._h5.Group)

    def is_reference(self, dtype: np.dtype[Any]) -> bool:
        """Tell whether values lead to other members of the file."""
        return self._h5.check_ref_dtype(dtype) is self._h5.Reference

    def address(self, item: Any, place: str) -> int:
        """Return what tells whether two references lead to the same group or dataset."""
        with translated(self.expansion, place):
            return int(self._h5.h5o.get_info(item.id).addr)

    def has_attribute(self, item: Any, name: str, place: str) -> bool:
        """Tell whether an attribute is there."""
        with translated(self.expansion, place):
            return bool(self._h5.h5a.exists(item.id, name.encode()))

    def attribute(self, item: Any, name: str, place: str) -> Any:
        """Return the value of a small attribute (a single text as str), None where there is none."""
        if not self.has_attribute(item, name, place):
            return None
        with translated(self.expansion, place):
            found = self._h5.h5a.open(item.id, name.encode())
            dtype, shape = found.dtype, found.shape
            size = math.prod(shape or ()) * dtype.itemsize
            if dtype.hasobject:  # a length of 2 GB in 16 bytes is seen only when the memory is taken
                raise self.expansion.fault(place, f"the attribute {name} has no fixed width, and is not read")
            if shape is None or size > MAX_ATTRIBUTE_BYTES:
                raise self.expansion.fault(place, f"the attribute {name} is no small number or text")
            values = np.empty(shape, dtype)
            found.read(values)
            value = values if shape else values[()]
            return value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value

    def values(self, dataset: Any, place: str) -> NDArray[Any]:
        """Return all values of a dataset of numbers, text of fixed width or references.

        Raises
        ------
        RecordingFileError
            Values that lie outside the file, are packed by anything but gzip and shuffle, have no fixed width, or
            expand beyond measure.
        """
        with translated(self.expansion, place):
            dtype, shape = dataset.id.dtype, dataset.id.shape
            if shape is None:
                raise self.expansion.fault(place, "holds nothing")
            if dtype.hasobject and not self.is_reference(dtype):
                raise self.expansion.fault(place, "holds values of changing length; wanted numbers")
            filters, chunk = self._checked_storage(dataset.id, dtype, shape, place)
            # references become Python objects, samples float64 in the end
            width = 64 if dtype.hasobject else max(dtype.itemsize, 8)
            size = math.prod(shape)
            self.expansion.spend(size * width, place)
            if DEFLATE in filters:
                chunks = PackedChunks(dataset.id, dtype, shape, chunk, filters, self.expansion, place)
                if size and not dtype.hasobject:
                    return chunks.whole()
                for _, mask, packed in chunks:  # what is no bomb may be unpacked by the library
                    chunks.unpacked(packed, mask)
            values = np.empty(shape, dtype)
            if size:
                dataset.id.read(self._h5.h5s.ALL, self._h5.h5s.ALL, values)
            return values

    def _checked_storage(
        self, dataset: Any, dtype: np.dtype[Any], shape: tuple[int, ...], place: str
    ) -> tuple[list[int], tuple[int, ...]]:
        """Return filters, in the order of writing, and shape of chunks, after looking at where the values are."""
        created = dataset.get_create_plist()
        layout = created.get_layout()
        if layout == self._h5.h5d.VIRTUAL or created.get_external_count():
            raise self.expansion.fault(place, "keeps its values in other files, which are not opened")
        if layout != self._h5.h5d.CHUNKED:
            return [], ()
        filters = [created.get_filter(i)[0] for i in range(created.get_nfilters())]
        for number in filters:
            if number not in _FILTERS or filters.count(number) > 1:
                problem = f"is packed with filter {number} of HDF5; wanted gzip, shuffle, or nothing"
                raise self.expansion.fault(place, problem)
        chunk = created.get_chunk()
        n_chunks = math.prod(-(-n // size) for n, size in zip(shape, chunk, strict=True))
        if n_chunks > MAX_CHUNKS:
            raise self.expansion.fault(place, f"lies in {n_chunks} chunks, more than {MAX_CHUNKS}")
        # chunks at the border are stored whole, and may be larger than the dataset
        self.expansion.spend(math.prod(chunk) * dtype.itemsize, place)
        return filters, chunk
