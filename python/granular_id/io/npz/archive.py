"""The archive around NPZ files: a zip of arrays, whose directory is checked before anything is unpacked."""

from __future__ import annotations

import io
import math
import struct
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Any, BinaryIO, cast

from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.expansion import Expansion
from granular_id.io.files import open_bounded
from granular_id.io.npz.array_stream import read_header, read_values
from granular_id.io.npz.checksum import Checksum

_MAX_DIRECTORY_BYTES = 4 * 1024 * 1024
"""Bytes of the list of members: about 40,000 arrays, read within a second."""

_FREE_MEMBERS = 2000
"""Arrays that any file may hold: their headers take 0.1 ms each."""

_MEMBER_BYTES = 1000
"""A larger file may hold an array for as many bytes; a recording has more."""

_TEXT_BYTES = 64
"""What a short text costs in memory."""

_SUFFIX = ".npy"

_LOCAL_HEADER = struct.Struct("<4s22xHH")
"""Before each member: its magic number, and the lengths of its name and of an extra field."""


class NpzArchive:
    """Arrays of an open NPZ file by name; each is read when asked for.

    Attributes
    ----------
    path : Path
    file : binary file
        The archive's bytes.
    arrays : dict
        Name to :class:`NpzMember`.
    others : list of str
        Members that are no arrays, which numpy does not read as such either.
    """

    def __init__(self, archive: zipfile.ZipFile, file: BinaryIO, path: Path, n_bytes: int) -> None:
        self.path = path
        self.file = file
        self.expansion = Expansion(path, n_bytes)
        self.arrays: dict[str, NpzMember] = {}
        self.others: list[str] = []
        members = archive.infolist()
        most = max(_FREE_MEMBERS, n_bytes // _MEMBER_BYTES)
        if len(members) > most:
            problem = f"holds {len(members)} arrays in {n_bytes} bytes, more than {most}"
            raise RecordingFileError(
                path, f"{problem}; save recordings as one array (recordings, samples, 6)"
            )
        for info in members:
            name = _checked_name(info, path)
            if not name.endswith(_SUFFIX):
                self.others.append(name)
            elif (key := name[: -len(_SUFFIX)]) in self.arrays:
                raise RecordingFileError(path, f"holds two arrays called {key!r}")
            else:
                self.arrays[key] = NpzMember(self, archive, info, key)


class NpzMember:
    """One array of an archive; its header is read when the archive is opened, its values by :meth:`read`."""

    def __init__(self, archive: NpzArchive, file: zipfile.ZipFile, info: zipfile.ZipInfo, key: str) -> None:
        self._archive, self._file, self._info = archive, file, info
        self.place = f"array {key}"
        with self._open() as stream:
            self._header = read_header(stream, info.file_size, archive.path, self.place)
        # numbers become float64, texts become Python's
        n_bytes = math.prod(self._header.shape) * (_TEXT_BYTES if self._header.dtype.kind in "US" else 8)
        archive.expansion.spend(max(n_bytes, info.file_size), self.place)
        self.shape = self._header.shape
        self.dtype = self._header.dtype

    def read(self) -> NDArray[Any]:
        """Return the values.

        Raises
        ------
        RecordingFileError
            They are damaged or cut off.
        """
        with self._open() as stream:
            stream.read(self._info.file_size - self._header.n_bytes)
            values = read_values(stream, self._header, self._archive.path, self.place)
            if stream.read(1):  # the checksum is compared when the end is met
                raise RecordingFileError(self._archive.path, "is longer than it claims", place=self.place)
        return values

    @contextmanager
    def _open(self) -> Iterator[IO[bytes]]:
        stored = self._info.compress_type == zipfile.ZIP_STORED
        with (
            _zip_faults(self._archive.path, self.place),
            # zipfile would copy every byte twice
            _Stored(self._archive.file, self._info) if stored else self._file.open(self._info) as stream,
        ):
            yield cast("IO[bytes]", stream)


@contextmanager
def open_npz(path: Path, root: Path, max_bytes: int) -> Iterator[NpzArchive]:
    """Open an NPZ file within bounds.

    Raises
    ------
    RecordingFileError
        No zip archive, or one that is damaged, encrypted, compressed in a way that numpy does not use, or would expand
        beyond all measure; members that share a name or have one that leads elsewhere.
    """
    with open_bounded(path, root, max_bytes) as (file, n_bytes):
        with _zip_faults(path, None):
            archive = zipfile.ZipFile(_SmallReads(file))
        with archive:
            yield NpzArchive(archive, file, path, n_bytes)


class _Stored(io.RawIOBase):
    """A member that is not compressed, read from the file into its place."""

    def __init__(self, file: BinaryIO, info: zipfile.ZipInfo) -> None:
        self._checksum = Checksum(info.file_size)
        file.seek(info.header_offset)
        header = file.read(_LOCAL_HEADER.size)
        if len(header) < _LOCAL_HEADER.size or info.compress_size != info.file_size:
            raise zipfile.BadZipFile("its directory does not fit what is there")
        magic, name_length, extra_length = _LOCAL_HEADER.unpack(header)
        if magic != b"PK\3\4":
            raise zipfile.BadZipFile("no member begins where the directory says")
        self._file, self._info = file, info
        self._start = info.header_offset + len(header) + name_length + extra_length
        self._done = 0

    def readable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._done

    def close(self) -> None:
        self._checksum.close()
        super().close()

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer)[: self._info.file_size - self._done]
        self._file.seek(self._start + self._done)
        count = self._file.readinto(view) if len(view) else 0  # type: ignore[attr-defined]
        self._checksum.add(view[:count])
        self._done += count
        if self._done == self._info.file_size and self._checksum.value() != self._info.CRC:
            raise zipfile.BadZipFile("its checksum is wrong")
        return int(count)


class _SmallReads(io.RawIOBase):
    """A file of which nobody reads much at once: a zip's directory is read whole, whatever size it claims."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(
            _MAX_DIRECTORY_BYTES + 1 if size is None or size < 0 else min(size, _MAX_DIRECTORY_BYTES + 1)
        )
        if len(data) > _MAX_DIRECTORY_BYTES:
            raise zipfile.BadZipFile(f"its directory has more than {_MAX_DIRECTORY_BYTES} bytes")
        return data


@contextmanager
def _zip_faults(path: Path, place: str | None) -> Iterator[None]:
    try:
        yield
    except (RecordingFileError, OSError):
        raise
    except Exception as error:  # zipfile, zlib and struct raise errors of many kinds over damaged archives
        said = str(error)[:200] or type(error).__name__
        if place is None and "not a zip file" in said:
            said = "its end, which lists the arrays, is missing (cut off, or another kind of file)"
        problem = f"is no whole NPZ archive: {said}"
        raise RecordingFileError(path, problem, place=place) from error


def _checked_name(info: zipfile.ZipInfo, path: Path) -> str:
    name = info.filename
    parts = PurePosixPath(name)
    if not name.isprintable() or "\\" in name or ":" in name or parts.is_absolute() or ".." in parts.parts:
        raise RecordingFileError(path, f"holds a member called {name[:80]!r}, which is no name of an array")
    if info.flag_bits & 1:
        raise RecordingFileError(
            path, f"the member {name[:80]!r} is encrypted; wanted an archive without a password"
        )
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        problem = f"the member {name[:80]!r} is compressed by method {info.compress_type}; wanted stored or deflated"
        raise RecordingFileError(path, f"{problem}, as numpy.savez and savez_compressed do")
    return name
