"""Chunks of an HDF5 dataset, unpacked to the size they should have and no further."""

from __future__ import annotations

import math
import zlib
from operator import add, mod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._parallel import spread
from granular_id.io.bulk import bulk_threads
from granular_id.io.expansion import Expansion

DEFLATE, SHUFFLE, FLETCHER32, LZF = 1, 2, 3, 32000

MAX_CHUNKS = 20_000
"""Chunks of one dataset, each of which takes time however small it is."""

_LARGE = 1 << 18
"""Bytes of a chunk that take longer to unpack than Python takes around it."""


class PackedChunks:
    """The chunks of one dataset.

    Parameters
    ----------
    dataset : h5py.h5d.DatasetID
    dtype, shape
        Of the dataset.
    chunk : tuple of int
        Shape of a chunk.
    filters : list of int
        Numbers of the filters, in the order of writing: gzip or lzf, shuffle, fletcher32, each where it was used.
    expansion : Expansion
        Size of the file, and its name for errors.
    place : str
        How errors call the dataset.
    """

    def __init__(
        self,
        dataset: Any,
        dtype: np.dtype[Any],
        shape: tuple[int, ...],
        chunk: tuple[int, ...],
        filters: list[int],
        expansion: Expansion,
        place: str,
    ) -> None:
        self._dataset, self._expansion, self._place = dataset, expansion, place
        self._dtype, self._shape, self._chunk = dtype, shape, chunk
        self._size = math.prod(self._chunk) * self._dtype.itemsize
        at = next((i for i, number in enumerate(filters) if number in (DEFLATE, LZF)), len(filters))
        self._packer = 1 << at
        self._gzip = DEFLATE in filters
        self._shuffle = 1 << filters.index(SHUFFLE) if SHUFFLE in filters[:at] else 0
        # a checksum made before packing is packed with the values; one made after stands behind the stream
        self._checksum = 1 << filters.index(FLETCHER32) if FLETCHER32 in filters[:at] else 0
        self._tail = 1 << filters.index(FLETCHER32) if FLETCHER32 in filters[at:] else 0
        self._found: list[Any] = []
        dataset.chunk_iter(self._note)
        packed_bytes = sum(info.size for info in self._found)
        if len(self._found) > MAX_CHUNKS or packed_bytes > expansion.n_bytes:
            came = f"{len(self._found)} chunks of {packed_bytes} bytes"
            raise expansion.fault(place, f"has {came} in a file of {expansion.n_bytes}")

    def _note(self, info: Any) -> bool | None:
        self._found.append(info)
        return True if len(self._found) > MAX_CHUNKS else None  # a damaged index may go round in circles

    def check(self) -> None:
        """Refuse chunks that unpack to another size than they should have, without unpacking those of lzf."""
        for info in self._found:
            mask, packed = self._dataset.read_direct_chunk(info.chunk_offset)
            if self._gzip or mask & self._packer:
                self.unpacked(packed, mask)
                continue
            size = self._size + (4 if self._checksum & ~mask else 0)
            if lzf_size(packed[: -4 if self._tail & ~mask else None]) != size:
                raise self._expansion.fault(self._place, f"a chunk of {size} bytes unpacks to another size")

    def unpacked(self, packed: bytes, mask: int) -> bytes:
        """Return the bytes of one chunk that is packed by gzip or not at all."""
        data = packed
        size = self._size + (4 if self._checksum & ~mask else 0)
        if self._gzip and not mask & self._packer:
            stream = zlib.decompressobj()
            try:
                data = stream.decompress(packed, size + 1)
            except zlib.error as error:
                raise self._expansion.fault(self._place, f"a chunk is damaged ({error})") from error
            if not stream.eof and len(data) <= size:
                raise self._expansion.fault(self._place, "a chunk is cut off")
        elif self._tail & ~mask:
            data = data[:-4]
        if len(data) != size:
            came = f"{len(data)} bytes" if len(data) <= size else "more"
            raise self._expansion.fault(self._place, f"a chunk of {size} bytes unpacks to {came}")
        data = data[: self._size]  # the checksum of gzip covers what that of fletcher32 would
        if self._shuffle & ~mask and self._dtype.itemsize > 1:
            data = np.frombuffer(data, np.uint8).reshape(self._dtype.itemsize, -1).T.tobytes()
        return data

    def whole(self) -> NDArray[Any]:
        """Return the values of the dataset."""
        n_chunks = math.prod(-(-n // size) for n, size in zip(self._shape, self._chunk, strict=True))
        if len(self._found) == n_chunks:
            values = np.empty(self._shape, self._dtype)
        else:
            fill = np.zeros((), self._dtype)
            if self._dtype.kind != "V":  # what stands for a text: nothing, as h5py fills it
                self._dataset.get_create_plist().get_fill_value(fill)
            values = np.full(self._shape, fill, self._dtype)
        # small chunks are work for the interpreter, which does one thing at a time
        n_threads = bulk_threads() if self._size >= _LARGE else 1
        filled = set(spread(lambda info: self._fill(values, info.chunk_offset), self._found, n_threads))
        if len(filled - {None}) < len(self._found):  # values may be left as they were in memory
            raise self._expansion.fault(self._place, "has chunks over each other or outside the dataset")
        return values

    def _fill(self, values: NDArray[Any], offset: tuple[int, ...]) -> tuple[int, ...] | None:
        """Put the values of one chunk into their place; return it, None where there is no place for a chunk."""
        mask, packed = self._dataset.read_direct_chunk(offset)
        chunk = np.frombuffer(self.unpacked(packed, mask), self._dtype).reshape(self._chunk)
        part = values[tuple(map(slice, offset, map(add, offset, self._chunk)))]
        # chunks at the border are larger than what is left of the dataset
        part[...] = chunk if part.shape == self._chunk else chunk[tuple(map(slice, part.shape))]
        return offset if part.size and not any(map(mod, offset, self._chunk)) else None


def lzf_size(packed: bytes) -> int:
    """Return how many bytes a stream of lzf makes, -1 where it is cut off.

    Examples
    --------
    >>> lzf_size(bytes([2, 65, 66, 67, 0x20, 2]))  # ABC, then ABC again
    6
    """
    at = made = 0
    end = len(packed)
    while at < end:
        code = packed[at]
        if code < 32:  # so many bytes as they are
            made += code + 1
            at += code + 2
        elif code < 224:
            made += (code >> 5) + 2
            at += 2
        else:  # a long one, whose length goes on in the next byte
            made += packed[min(at + 1, end - 1)] + 9
            at += 3
    return made if at == end else -1
