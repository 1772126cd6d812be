"""Texts of changing length in HDF5 files, read from the bytes of the file.

h5py writes every ``str`` so. In place of the text stands its length and where it lies in a global heap; the HDF5
library takes as much memory as the length says before it looks at the heap. Here a text is at most what the heap
has, and the heap lies within the file.

Source: "HDF5 File Format Specification Version 3.0" (The HDF Group), III.E, IV.A.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from granular_id.io.expansion import Expansion

__all__ = ["REFERENCE_BYTES", "TextHeap"]

_REFERENCE = struct.Struct("<IQI")
REFERENCE_BYTES = _REFERENCE.size
"""Of what stands for a text: its length, a heap, a number in the heap."""

_ATTRIBUTE, _CONTINUED = 0x0C, 0x10
_IN_V1, _IN_V2 = struct.Struct("<HHB3x"), struct.Struct("<BHB")
_MOST_HEADER_BYTES = 1 << 20
_MOST_OBJECTS = 400_000
"""In all heaps that are looked at, each of which takes time: four for each text that a data set may have."""


class TextHeap:
    """Finds texts in a file whose addresses have eight bytes and count from its beginning.

    Every method raises ValueError where the file is not as it should be.

    Parameters
    ----------
    expansion : Expansion
        Path and size of the file, and what was spent on it.
    """

    def __init__(self, expansion: Expansion) -> None:
        self._expansion = expansion
        self._attributes: dict[int, dict[bytes, bytes]] = {}
        self._heaps: dict[int, dict[int, bytes]] = {}
        self._heap_bytes = self._n_objects = 0

    def attribute(self, address: int, name: bytes) -> bytes:
        """Return the references that an attribute of the object at `address` holds."""
        if address not in self._attributes:  # a header is walked once, however many lead to it
            self._attributes[address] = dict(self._values(address))
        if name not in self._attributes[address]:
            raise ValueError("it lies outside the header of its object")
        return self._attributes[address][name]

    def texts(self, references: bytes, count: int) -> Iterator[bytes]:
        """Yield `count` texts: empty ones where references are missing, as nothing was written there."""
        for i in range(count):
            part = references[i * REFERENCE_BYTES : (i + 1) * REFERENCE_BYTES]
            length, heap, number = _REFERENCE.unpack(part.ljust(REFERENCE_BYTES, b"\0"))
            yield self._text(length, heap, number) if length else b""

    def read(self, address: int, n_bytes: int) -> bytes:
        """Return bytes of the file."""
        left = self._expansion.n_bytes - address
        if n_bytes > left:
            raise ValueError(f"{n_bytes} bytes are wanted at byte {address} where {max(left, 0)} are left")
        with self._expansion.path.open("rb") as file:
            file.seek(address)
            return file.read(n_bytes)

    def _values(self, address: int) -> Iterator[tuple[bytes, bytes]]:
        """Yield names and values of the attributes in the header of an object."""
        for kind, body in self._messages(address):
            if kind != _ATTRIBUTE or len(body) < 8:
                continue
            version, flags, *sizes = struct.unpack_from("<BB3H", body)
            if version not in (1, 2, 3) or (flags and version > 1):
                continue  # of a kind that is kept elsewhere, which h5py never writes
            step = 8 if version == 1 else 1
            start = 9 if version == 3 else 8
            name = body[start : start + sizes[0]].split(b"\0", 1)[0]
            yield name, body[start + sum(-(-size // step) * step for size in sizes) :]

    def _messages(self, address: int) -> Iterator[tuple[int, bytes]]:
        """Yield kind and content of each message in the header of an object."""
        head = self.read(address, 16)
        if head.startswith(b"OHDR"):
            form, flags = _IN_V2, head[5]
            start = address + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
            width = 1 << (flags & 3)
            blocks = [(start + width, int.from_bytes(self.read(start, width), "little"))]
            extra = 2 if flags & 4 else 0  # the order of creation
        else:
            form, extra = _IN_V1, 0
            blocks = [(address + 16, int.from_bytes(head[8:12], "little"))]
        room = _MOST_HEADER_BYTES
        for start, size in blocks:
            room -= size + form.size  # blocks that lead to each other end too
            if room < 0:
                raise ValueError(f"the header of its object has more than {_MOST_HEADER_BYTES} bytes")
            data, at = self.read(start, size), 0
            while at + form.size + extra <= len(data):
                kind, length, _ = form.unpack_from(data, at)
                at += form.size + extra
                body = data[at : at + length]
                at += length
                if kind == _CONTINUED and length >= 16:
                    there, long = struct.unpack_from("<QQ", body)
                    # in version 2 a signature stands before the messages, a checksum behind them
                    blocks.append((there + 4, max(long - 8, 0)) if form is _IN_V2 else (there, long))
                yield kind, body

    def _text(self, length: int, heap: int, number: int) -> bytes:
        if heap not in self._heaps:
            self._heaps[heap] = self._objects(heap)
        found = self._heaps[heap].get(number, b"")
        if length > len(found):
            raise ValueError(f"a text claims {length} bytes where {len(found)} are")
        self._expansion.spend(4 * length, f"byte {heap}")  # as text; many references may lead to one
        return found[:length]

    def _objects(self, heap: int) -> dict[int, bytes]:
        """Return the objects of a heap by their numbers."""
        head = self.read(heap, 16)
        (end,) = struct.unpack_from("<Q", head, 8)
        self._heap_bytes += end
        if not head.startswith(b"GCOL\1") or self._heap_bytes > self._expansion.n_bytes:
            raise ValueError(f"there is no heap of texts at byte {heap}")
        self._expansion.spend(2 * end, f"byte {heap}")
        data, at = self.read(heap, end), 16
        found: dict[int, bytes] = {}
        while at + 16 <= end:
            number, size = struct.unpack_from("<H6xQ", data, at)
            if not number:  # the rest is free
                break
            self._n_objects += 1
            if size > end - at - 16 or self._n_objects > _MOST_OBJECTS:
                raise ValueError(f"the heap of texts at byte {heap} is damaged")
            found[number] = data[at + 16 : at + 16 + size]
            at += 16 + -(-size // 8) * 8
        return found
