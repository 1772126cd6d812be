"""Compressed parts of a bag, expanded within a budget that the size of the file on disk sets."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from pathlib import Path

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.files import FREE_BYTES, MAX_EXPANSION, check_expansion

__all__ = ["Unpacker", "unpack_zstd"]

LARGEST_PART = 64 * 1024 * 1024
"""Bytes of one chunk, packed or not, whatever the size of the bag; recorders make chunks of 1 to 4 MB."""

_RECORD_BYTES = 256
"""A record counts as this many bytes at least: millions of empty ones take as long to walk as full ones. Four bytes on
disk allow a record, less than the stamps of a message compress to."""


class Unpacker:
    """Expands the parts of one bag and keeps count of what it costs.

    Parameters
    ----------
    path : Path
        The file or folder that errors name.
    n_bytes : int
        Bytes on disk, from which the limits follow (see `check_expansion`).
    """

    def __init__(self, path: Path, n_bytes: int) -> None:
        self._path = path
        self._n_bytes = n_bytes
        self._expanded = 0
        self.records_left = self.limit // _RECORD_BYTES

    @property
    def limit(self) -> int:
        """Bytes that the bag may expand to."""
        return max(FREE_BYTES, MAX_EXPANSION * self._n_bytes)

    def spend(self, n_bytes: int, place: str) -> None:
        """Count bytes that are about to be made; raise where the bag would need too many."""
        self._expanded += n_bytes
        check_expansion(self._path, self._n_bytes, self._expanded, place=place)

    def walked(self, n_records: int, place: str) -> None:
        """Count records that were walked over; raise where there are more than the bag has room for."""
        self.records_left -= n_records
        if self.records_left < 0:
            problem = f"holds millions of records of next to no bytes; wanted {_RECORD_BYTES} bytes a record"
            raise RecordingFileError(self._path, problem, place=place)

    def check_part(self, n_bytes: int, place: str) -> None:
        """Refuse a chunk, or a message outside of chunks, that is too large to be held; before it is read."""
        if n_bytes > LARGEST_PART:
            problem = f"has a chunk or message of {n_bytes} bytes; at most {LARGEST_PART} are read at once"
            raise RecordingFileError(self._path, problem, place=place)

    def unpack(self, data: bytes, compression: str, n_bytes: int, place: str) -> bytes:
        """Expand a part that states its compression and how many bytes it makes.

        Raises
        ------
        RecordingFileError
            Unknown compression, damaged data, another size than stated, or a bomb.
        """
        decoder = _DECODERS.get(compression)
        if decoder is None:
            wanted = ", ".join(name for name in _DECODERS if name)
            problem = f"is compressed by {compression[:40]!r}; wanted {wanted} or no compression"
            raise RecordingFileError(self._path, problem, place=place)
        self.spend(n_bytes, place)
        self.check_part(n_bytes, place)
        try:
            raw = decoder(data, n_bytes)
        except ImportError:
            raise
        except Exception as error:  # every library raises its own kinds; damaged is what they all mean
            problem = f"cannot be decompressed ({compression}: {error})"
            raise RecordingFileError(self._path, problem, place=place) from error
        if len(raw) != n_bytes:
            came = f"more than {n_bytes}" if len(raw) > n_bytes else str(len(raw))
            problem = f"states {n_bytes} bytes but expands to {came}"
            raise RecordingFileError(self._path, problem, place=place)
        return raw


def unpack_zstd(data: bytes, most: int) -> bytes:
    """Expand a zstd frame to at most `most` bytes; ValueError or the library's own error where it is larger."""
    zstandard = need("zstandard", extra="ros", why="to read zstd chunks")
    stated = zstandard.frame_content_size(data)  # a frame that states its size is not held to max_output_size
    if stated > most:
        raise ValueError(f"a frame of {stated} bytes where at most {most} are wanted")
    # max_output_size=0 would mean no limit
    return bytes(zstandard.ZstdDecompressor().decompress(data, max_output_size=max(most, 1)))


def _unpack_lz4(data: bytes, most: int) -> bytes:
    frame = need("lz4.frame", extra="ros", why="to read lz4 chunks")
    return bytes(frame.LZ4FrameDecompressor().decompress(data, max_length=most + 1))


def _unpack_bz2(data: bytes, most: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, max_length=most + 1)


def _as_is(data: bytes, _: int) -> bytes:
    return data


_DECODERS: dict[str, Callable[[bytes, int], bytes]] = {
    "": _as_is,
    "none": _as_is,
    "zstd": unpack_zstd,
    "lz4": _unpack_lz4,
    "bz2": _unpack_bz2,
}
