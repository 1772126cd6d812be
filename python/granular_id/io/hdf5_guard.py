"""HDF5 files from outside, read within bounds: nothing outside the file, no size on trust.

The HDF5 library follows links to other files, maps datasets onto other files, loads filters as plug-ins, and
unpacks a chunk to whatever it expands to (a chunk of 1 MB to 1 GB, in eleven seconds). Here every link,
storage, filter and size is looked at first, and chunks packed by gzip are unpacked to their own size at most.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.expansion import Expansion
from granular_id.io.extras import need

_DEFLATE, _SHUFFLE, _FLETCHER32 = 1, 2, 3
_FILTERS = {_DEFLATE: "gzip", _SHUFFLE: "shuffle", _FLETCHER32: "fletcher32"}

MAX_CHUNKS = 20_000
"""Chunks of one dataset, each of which takes time however small it is."""

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
        self._h5py = need("h5py", extra="hdf5", why=why)
        self.expansion = expansion
        with translated(expansion, "header"):
            # a lock would make files on read-only and network drives unreadable; nothing is written
            self.root: Any = self._h5py.File(expansion.path, "r", locking=False)

    def __enter__(self) -> GuardedFile:
        return self

    def __exit__(self, *_: object) -> None:
        with translated(self.expansion, "end of file"):
            self.root.close()

    def names(self, group: Any, place: str) -> list[str]:
        """Return the names in a group."""
        with translated(self.expansion, place):
            if len(group) > MAX_MEMBERS:
                raise self.expansion.fault(place, f"has {len(group)} members, more than {MAX_MEMBERS}")
            return list(group)

    def member(self, group: Any, name: str, place: str) -> Any:
        """Return a group or dataset that is itself in the group: links by name may lead anywhere."""
        with translated(self.expansion, place):
            link = group.get(name, getlink=True)
            if not isinstance(link, self._h5py.HardLink):
                what = "to another file" if isinstance(link, self._h5py.ExternalLink) else "by name"
                raise self.expansion.fault(place, f"is a link {what}, which is not followed")
            return self._known(group[name], place)

    def target(self, reference: Any, place: str) -> Any:
        """Return what a reference leads to; references stay within the file."""
        with translated(self.expansion, place):
            return self._known(self.root[reference], place)

    def _known(self, item: Any, place: str) -> Any:
        if not isinstance(item, (self._h5py.Group, self._h5py.Dataset)):
            raise self.expansion.fault(place, "is neither a group nor a dataset")
        return item

    def is_group(self, item: Any) -> bool:
        """Tell a group from a dataset."""
        return isinstance(item, self._h5py.Group)

    def attribute_names(self, item: Any, place: str) -> list[str]:
        """Return the names of all attributes."""
        with translated(self.expansion, place):
            return list(item.attrs)

    def address(self, item: Any, place: str) -> Any:
        """Return what tells whether two references lead to the same group or dataset."""
        with translated(self.expansion, place):
            return self._h5py.h5o.get_info(item.id).addr

    def attribute(self, item: Any, name: str, place: str) -> Any:
        """Return the value of a small attribute (text as str), None where there is none."""
        with translated(self.expansion, place):
            if name not in item.attrs:
                return None
            found = item.attrs.get_id(name)
            size = math.prod(found.shape or ()) * found.dtype.itemsize
            is_text = self._h5py.check_string_dtype(found.dtype) is not None
            if size > MAX_ATTRIBUTE_BYTES or (found.dtype.hasobject and not (is_text and not found.shape)):
                raise self.expansion.fault(place, f"the attribute {name} is no small number or text")
            value = item.attrs[name]
            return value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value

    def is_reference(self, dataset: Any, place: str) -> bool:
        """Tell whether a dataset holds references to other members of the file."""
        with translated(self.expansion, place):
            return self._h5py.check_ref_dtype(dataset.dtype) is self._h5py.Reference

    def values(self, dataset: Any, place: str) -> NDArray[Any]:
        """Return all values of a dataset of numbers, text of fixed width or references.

        Raises
        ------
        RecordingFileError
            Values that lie outside the file, are packed by anything but gzip and shuffle, have no fixed width, or
            expand beyond measure.
        """
        with translated(self.expansion, place):
            dtype = dataset.dtype
            if dataset.shape is None:
                raise self.expansion.fault(place, "holds nothing")
            if dtype.hasobject and not self.is_reference(dataset, place):
                raise self.expansion.fault(place, "holds values of changing length; wanted numbers")
            filters = self._checked_storage(dataset, place)
            # references become Python objects, samples float64 in the end
            width = 64 if dtype.hasobject else max(dtype.itemsize, 8)
            self.expansion.spend(math.prod(dataset.shape) * width, place)
            if _DEFLATE not in filters:
                return np.asarray(dataset[()])
            if dtype.hasobject or set(filters) - {_DEFLATE, _SHUFFLE} or not dataset.size:
                for _, mask, packed in self._chunks(dataset, place):
                    self._unpacked(packed, dataset, filters, mask, place)
                return np.asarray(dataset[()])
            return self._unpacked_dataset(dataset, filters, place)

    def _checked_storage(self, dataset: Any, place: str) -> list[int]:
        """Return the filters of a dataset, in the order of writing, after looking at where its values are."""
        if dataset.is_virtual or dataset.external:
            raise self.expansion.fault(place, "keeps its values in other files, which are not opened")
        created = dataset.id.get_create_plist()
        filters = [created.get_filter(i)[0] for i in range(created.get_nfilters())]
        unknown = [number for number in filters if number not in _FILTERS]
        if unknown or filters.count(_DEFLATE) > 1:
            what = dataset.compression or f"filter {unknown[0] if unknown else filters}"
            raise self.expansion.fault(place, f"is packed with {what}; wanted gzip, shuffle, or nothing")
        if dataset.chunks is not None:
            n_chunks = math.prod(-(-n // size) for n, size in zip(dataset.shape, dataset.chunks, strict=True))
            if n_chunks > MAX_CHUNKS:
                raise self.expansion.fault(place, f"lies in {n_chunks} chunks, more than {MAX_CHUNKS}")
            # chunks at the border are stored whole, and may be larger than the dataset
            self.expansion.spend(math.prod(dataset.chunks) * dataset.dtype.itemsize, place)
        return filters

    def _chunks(self, dataset: Any, place: str) -> Iterator[tuple[tuple[int, ...], int, bytes]]:
        """Yield offset, mask of filters left out, and bytes of each chunk that is there."""
        found: list[Any] = []

        def note(info: Any) -> bool | None:
            found.append(info)
            return True if len(found) > MAX_CHUNKS else None  # a damaged index may go round in circles

        dataset.id.chunk_iter(note)
        packed_bytes = sum(info.size for info in found)
        if len(found) > MAX_CHUNKS or packed_bytes > self.expansion.n_bytes:
            problem = f"has {len(found)} chunks of {packed_bytes} bytes in a file of {self.expansion.n_bytes}"
            raise self.expansion.fault(place, problem)
        for info in found:
            mask, packed = dataset.id.read_direct_chunk(info.chunk_offset)
            yield info.chunk_offset, mask, packed

    def _unpacked(self, packed: bytes, dataset: Any, filters: list[int], mask: int, place: str) -> bytes:
        """Return the bytes of one chunk, shuffled as they may be."""
        size = math.prod(dataset.chunks) * dataset.dtype.itemsize
        at = filters.index(_DEFLATE)
        if mask & (1 << at):
            return packed
        checksums = 4 if _FLETCHER32 in filters[:at] and not mask & (1 << filters.index(_FLETCHER32)) else 0
        stream = zlib.decompressobj()
        try:
            data = stream.decompress(packed, size + checksums + 1)
        except zlib.error as error:
            raise self.expansion.fault(place, f"a chunk is damaged ({error})") from error
        if len(data) != size + checksums or not stream.eof:
            came = f"{len(data)} bytes" if len(data) <= size + checksums else "more"
            raise self.expansion.fault(place, f"a chunk of {size} bytes unpacks to {came}")
        return data

    def _unpacked_dataset(self, dataset: Any, filters: list[int], place: str) -> NDArray[Any]:
        values = np.full(dataset.shape, dataset.fillvalue, dataset.dtype)
        shape, width = dataset.chunks, dataset.dtype.itemsize
        for offset, mask, packed in self._chunks(dataset, place):
            data = self._unpacked(packed, dataset, filters, mask, place)
            if len(data) != math.prod(shape) * width:
                raise self.expansion.fault(
                    place, f"a chunk has {len(data)} bytes, not those of {shape} values"
                )
            if _SHUFFLE in filters and not mask & (1 << filters.index(_SHUFFLE)) and width > 1:
                data = np.frombuffer(data, np.uint8).reshape(width, -1).T.tobytes()
            chunk = np.frombuffer(data, dataset.dtype).reshape(shape)
            ends = [min(at + n, end) for at, n, end in zip(offset, shape, dataset.shape, strict=True)]
            place_in_whole = tuple(slice(at, end) for at, end in zip(offset, ends, strict=True))
            part = tuple(slice(0, end - at) for at, end in zip(offset, ends, strict=True))
            values[place_in_whole] = chunk[part]
        return values
