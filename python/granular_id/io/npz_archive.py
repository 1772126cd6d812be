"""The archive around NPZ files: a zip of arrays, whose directory is checked before anything is unpacked."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.expansion import Expansion
from granular_id.io.files import open_bounded
from granular_id.io.npy_stream import ArrayHeader, read_header, read_values

_MAX_DIRECTORY_BYTES = 4 * 1024 * 1024
"""Bytes of the list of members: about 40,000 arrays, read within a second."""

_SUFFIX = ".npy"


class NpzArchive:
    """Arrays of an open NPZ file by name; each is read when asked for.

    Attributes
    ----------
    arrays : dict
        Name to :class:`NpzMember`.
    others : list of str
        Members that are no arrays, which numpy does not read as such either.
    """

    def __init__(self, file: zipfile.ZipFile, path: Path, n_bytes: int) -> None:
        self.path = path
        self.expansion = Expansion(path, n_bytes)
        self.arrays: dict[str, NpzMember] = {}
        self.others: list[str] = []
        for info in file.infolist():
            name = _checked_name(info, path)
            if not name.endswith(_SUFFIX):
                self.others.append(name)
            elif (key := name[: -len(_SUFFIX)]) in self.arrays:
                raise RecordingFileError(path, f"holds two arrays called {key!r}")
            else:
                self.arrays[key] = NpzMember(self, file, info, key)


@dataclass(frozen=True)
class _Opened:
    stream: IO[bytes]
    header: ArrayHeader


class NpzMember:
    """One array of an archive; its header is read when the archive is opened, its values by :meth:`read`."""

    def __init__(self, archive: NpzArchive, file: zipfile.ZipFile, info: zipfile.ZipInfo, key: str) -> None:
        self._archive, self._file, self._info = archive, file, info
        self.place = f"array {key}"
        archive.expansion.spend(info.file_size, self.place)
        with self._open() as opened:
            self.shape: tuple[int, ...] = opened.header.shape
            self.dtype: np.dtype[Any] = opened.header.dtype

    def read(self) -> NDArray[Any]:
        """Return the values.

        Raises
        ------
        RecordingFileError
            They are damaged or cut off.
        """
        with self._open() as opened:
            values = read_values(opened.stream, opened.header, self._archive.path, self.place)
            opened.stream.read(1)  # the checksum is compared when the end is met
        return values

    @contextmanager
    def _open(self) -> Iterator[_Opened]:
        path = self._archive.path
        with _zip_faults(path, self.place), self._file.open(self._info) as stream:
            yield _Opened(stream, read_header(stream, self._info.file_size, path, self.place))


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
            yield NpzArchive(archive, path, n_bytes)


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
        problem = f"is no whole NPZ archive: {str(error)[:200] or type(error).__name__}"
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
