"""HDF5 files from outside, read within bounds: nothing outside the file, no size on trust.

The HDF5 library follows links to other files, maps datasets onto other files, loads filters as plug-ins, and
unpacks a chunk to whatever it expands to (a chunk of 1 MB to 1 GB, in eleven seconds). Here every link,
storage, filter and size is looked at first, chunks are unpacked to their own size at most, and texts of changing
length are read from the bytes of the file.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.bulk import MOST_THREADS, read_at
from granular_id.io.errors import RecordingFileError
from granular_id.io.expansion import Expansion
from granular_id.io.extras import need
from granular_id.io.hdf5.chunks import DEFLATE, FLETCHER32, LZF, MAX_CHUNKS, SHUFFLE, PackedChunks
from granular_id.io.hdf5.heap import REFERENCE_BYTES, TextHeap

_FILTERS = (DEFLATE, SHUFFLE, FLETCHER32, LZF)
_REFERENCE = np.dtype((np.void, REFERENCE_BYTES))

MAX_MEMBERS = 50_000
"""Members of one group."""

_LARGE = 1 << 20
"""Bytes of a dataset worth a way of their own."""

MAX_TEXTS = 100_000
"""Texts of changing length in one dataset."""

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
            self._file = self._h5.File(expansion.path, "r", driver="sec2", locking=False)
            try:
                self.root = self._file["/"]
            except BaseException:
                self._file.close()  # left open, the library would take any later file at this place for the same
                raise
        self._heap = TextHeap(expansion)
        self._finite: set[int] = set()

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
        """Return the value of a small attribute, texts as str where they are single or of changing length.

        None where there is none.
        """
        if not self.has_attribute(item, name, place):
            return None
        with translated(self.expansion, place):
            found = self._h5.h5a.open(item.id, name.encode())
            dtype, shape = found.dtype, found.shape
            is_text = dtype.hasobject and self._h5.check_string_dtype(dtype) is not None
            size = math.prod(shape or ()) * (REFERENCE_BYTES if is_text else dtype.itemsize)
            if shape is None or size > MAX_ATTRIBUTE_BYTES or (dtype.hasobject and not is_text):
                raise self.expansion.fault(place, f"the attribute {name} is no small number or text")
            if is_text:
                return self._attribute_texts(item, name, shape, place)
            values = np.empty(shape, dtype)
            found.read(values)
            value = values if shape else values[()]
            return value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value

    def _attribute_texts(self, item: Any, name: str, shape: tuple[int, ...], place: str) -> Any:
        """Return texts of changing length: the library would take as much memory as they claim."""
        try:
            references = self._heap.attribute(self.address(item, place), name.encode())
            values = self._texts(references, shape, place)
        except ValueError as error:
            problem = (
                f"the attribute {name} cannot be read ({error}); write it as np.bytes_(...) or as a data set"
            )
            raise self.expansion.fault(place, problem) from error
        return values if shape else str(values[()])

    def values(self, dataset: Any, place: str) -> NDArray[Any]:
        """Return all values of a dataset of numbers, texts or references.

        Raises
        ------
        RecordingFileError
            Values that lie outside the file, are packed by anything but gzip, lzf and shuffle, have no fixed width
            and are no texts, or expand beyond measure.
        """
        with translated(self.expansion, place):
            dtype, shape = dataset.id.dtype, dataset.id.shape
            if shape is None:
                raise self.expansion.fault(place, "holds nothing")
            if dtype.hasobject and self._h5.check_string_dtype(dtype) is not None:
                return self._dataset_texts(dataset.id, shape, place)
            if dtype.hasobject and not self.is_reference(dtype):
                raise self.expansion.fault(place, "holds values of changing length; wanted numbers or texts")
            filters, chunk = self._checked_storage(dataset.id, dtype, shape, place)
            # references become Python objects, samples float64 in the end
            width = 64 if dtype.hasobject else max(dtype.itemsize, 8)
            size = math.prod(shape)
            self.expansion.spend(size * width, place)
            if DEFLATE in filters or LZF in filters:
                chunks = PackedChunks(dataset.id, dtype, shape, chunk, filters, self.expansion, place)
                if size and not dtype.hasobject and LZF not in filters:
                    return chunks.whole()
                chunks.check()  # what is no bomb may be unpacked by the library
            values = np.empty(shape, dtype)
            if size and not (values.nbytes >= _LARGE and self._read_bytes(dataset.id, values, place)):
                dataset.id.read(self._h5.h5s.ALL, self._h5.h5s.ALL, values)
            return values

    def _read_bytes(self, dataset: Any, values: NDArray[Any], place: str) -> bool:
        """Fill `values` from the bytes of the file, if they lie there in one piece as they are wanted.

        The library does it with one thread, and needs half as long again.
        """
        offset = dataset.get_offset()  # None where there is not one piece
        if offset is None or not dataset.get_type().equal(self._h5.h5t.NATIVE_DOUBLE):
            return False
        found = read_at(self._file.id.get_vfd_handle(), offset, values)
        if found.n_bytes < values.nbytes:
            raise self.expansion.fault(
                place, f"is cut off: {found.n_bytes} of {values.nbytes} bytes are there"
            )
        if found.finite:
            self._finite.add(offset)
        return True

    def known_finite(self, dataset: Any) -> bool:
        """Tell whether the values of a dataset were seen to be finite while they were read."""
        return dataset.id.get_offset() in self._finite

    def _dataset_texts(self, dataset: Any, shape: tuple[int, ...], place: str) -> NDArray[np.str_]:
        """Return texts of changing length, one for each of the references that are the values in the file."""
        count = math.prod(shape)
        if count > MAX_TEXTS:
            raise self.expansion.fault(place, f"holds {count} texts; at most {MAX_TEXTS} are read")
        filters, chunk = self._checked_storage(dataset, _REFERENCE, shape, place)
        if dataset.get_create_plist().get_layout() == self._h5.h5d.COMPACT or LZF in filters:
            raise self.expansion.fault(
                place, "keeps texts packed by lzf or in its header; wanted a plain data set"
            )
        self.expansion.spend(count * REFERENCE_BYTES, place)
        if not chunk:
            offset = dataset.get_offset()  # None where nothing was ever written
            references = b"" if offset is None else self._heap.read(offset, count * REFERENCE_BYTES)
        elif count:
            references = (
                PackedChunks(dataset, _REFERENCE, shape, chunk, filters, self.expansion, place)
                .whole()
                .tobytes()
            )
        return self._texts(references, shape, place)

    def _texts(self, references: bytes, shape: tuple[int, ...], place: str) -> NDArray[np.str_]:
        """Return the texts of changing length that references stand for; ValueError where they lead nowhere."""
        created = self._file.id.get_create_plist()
        if created.get_sizes()[0] != 8 or created.get_userblock():
            raise ValueError("addresses are not of eight bytes from the beginning of the file")
        texts = [
            text.decode("utf-8", "backslashreplace")
            for text in self._heap.texts(references, math.prod(shape))
        ]
        # as an array of one width, all become as wide as the longest
        self.expansion.spend((4 * max(map(len, texts), default=0) + 64) * len(texts), place)
        return np.array(texts, dtype=np.str_).reshape(shape)

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
        chunk = created.get_chunk()
        n_chunk_bytes = math.prod(chunk) * dtype.itemsize
        found = [created.get_filter(i) for i in range(created.get_nfilters())]
        filters = [number for number, *_ in found]
        for number, _, values, name in found:
            # lzf takes as much memory as its values say
            trap = number == LZF and (DEFLATE in filters or values[2:3] not in ((), (n_chunk_bytes,)))
            if number not in _FILTERS or filters.count(number) > 1 or trap:
                called = f"{name.decode('utf-8', 'replace')[:40]} (filter {number} of HDF5)"
                problem = (
                    f"is packed with {called}; wanted gzip, lzf or nothing: h5repack -f GZIP=4 OLD.h5 NEW.h5"
                )
                raise self.expansion.fault(place, problem)
        n_chunks = math.prod(-(-n // size) for n, size in zip(shape, chunk, strict=True))
        if n_chunks > MAX_CHUNKS:
            raise self.expansion.fault(place, f"lies in {n_chunks} chunks, more than {MAX_CHUNKS}")
        # chunks at the border are stored whole, and may be larger than the dataset; threads unpack one each
        self.expansion.spend(n_chunk_bytes * min(n_chunks, MOST_THREADS), place)
        return filters, chunk
