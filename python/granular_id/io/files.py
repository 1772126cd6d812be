"""Files from outside: listed in natural order, read within bounds, never followed out of their folder."""

from __future__ import annotations

import os
import re
import stat
import sys
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from granular_id.io.errors import RecordingFileError
from granular_id.io.options import MIN_LINE_BYTES

FREE_BYTES = 64 * 1024 * 1024
"""What any file may expand to."""

MAX_EXPANSION = 64
"""How many times its size on disk a larger file may expand to; quantised recordings reach about 10."""

_DIGITS = re.compile(r"([0-9]+)")


def natural_key(text: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key by which ``rice_2`` comes before ``rice_10``."""
    parts = (part for part in _DIGITS.split(text) if part)
    return tuple((0, int(part)) if _DIGITS.fullmatch(part) else (1, part) for part in parts)


def list_folder(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the files and the sub-folders of a folder in natural order, hidden ones left out."""
    files: list[Path] = []
    folders: list[Path] = []
    try:
        for path in sorted(folder.iterdir(), key=lambda p: (natural_key(p.name), p.name)):
            if not path.name.startswith("."):
                (folders if path.is_dir() else files).append(path)
    except OSError as error:
        raise RecordingFileError(folder, f"cannot be listed: {error.strerror}") from error
    return files, folders


def refuse_outside(path: Path, root: Path) -> None:
    """Raise when a path, with all its links resolved, lies outside the folder being read."""
    if os.name == "posix" and _plainly_inside(path, root):
        return  # elsewhere there are junctions, which do not look like links
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(root)):
        raise RecordingFileError(path, "is a link that leaves the folder; links out are not followed")


def _plainly_inside(path: Path, root: Path) -> bool:
    """Tell whether a path leads down from `root` without any link: true of nearly all, and quickly seen."""
    if path.parts[: len(root.parts)] != root.parts or ".." in path.parts:
        return False
    depth = len(path.parts) - len(root.parts)
    try:
        return not any(place.is_symlink() for place in (path, *path.parents[:depth])[:depth])
    except OSError:
        return False  # it cannot be looked at; opening it says why


def check_place(path: Path, root: Path) -> None:
    """Refuse a file that is not regular or lies outside `root`, and a folder that holds such, before any is opened."""
    if not os.path.isdir(path):  # noqa: PTH112 (says False of a name that is too long, where Path.is_dir raises)
        check_file(path, root, sys.maxsize)
        return
    refuse_outside(path, root)
    for folder, folders, names in os.walk(path):
        for name in folders:
            refuse_outside(Path(folder, name), path)
        for name in names:
            check_file(Path(folder, name), path, sys.maxsize)


def bytes_of(path: Path) -> int:
    """Return the size of a file, or of all files in a folder, as far as they can be seen."""
    n_bytes = 0
    for place in [Path(folder, name) for folder, _, names in os.walk(path) for name in names] or [path]:
        with suppress(OSError):
            n_bytes += place.stat().st_size
    return n_bytes


def check_file(path: Path, root: Path, max_bytes: int) -> int:
    """Return the bytes of a regular file inside `root`, without opening it."""
    refuse_outside(path, root)
    try:
        return _checked_size(path.stat(), path, max_bytes)
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror}") from error


@contextmanager
def open_bounded(path: Path, root: Path, max_bytes: int) -> Iterator[tuple[BinaryIO, int]]:
    """Open a regular file inside `root` of at most `max_bytes`; yield it and its size."""
    refuse_outside(path, root)
    try:
        # without O_NONBLOCK, opening a pipe that somebody named .csv would wait for ever
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(descriptor, "rb") as file:
            yield file, _checked_size(os.fstat(descriptor), path, max_bytes)
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror or error}") from error


def read_bounded(path: Path, root: Path, max_bytes: int) -> bytes:
    """Read a regular file inside `root` of at most `max_bytes`, checked before reading."""
    with open_bounded(path, root, max_bytes) as (file, size):
        data = file.read(size + 1)  # one more, to see a file that grows while it is read
    if len(data) > size:
        raise RecordingFileError(path, "grows while it is read; wait until the recording is complete")
    return data


def read_text_bounded(path: Path, root: Path, max_bytes: int) -> bytes:
    """Read a text file as `read_bounded` does, a line counting as at least 40 bytes; ``.gz`` is expanded."""
    data = read_bounded(path, root, max_bytes)
    if path.suffix.lower() == ".gz":
        data = _gunzipped(data, path, max_bytes)
    lines = data.count(b"\n")
    if lines * MIN_LINE_BYTES > max_bytes:
        most = max_bytes // MIN_LINE_BYTES
        problem = (
            f"has {lines} lines, more than {most} (max_file_bytes={max_bytes}, {MIN_LINE_BYTES} bytes a line)"
        )
        needed = lines * MIN_LINE_BYTES
        raise RecordingFileError(path, f"{problem}; raise max_file_bytes to {needed} to read it")
    return data


def _gunzipped(data: bytes, path: Path, max_bytes: int) -> bytes:
    """Expand one gzip member within the bounds of its file and of all texts."""
    most = min(max_bytes, max(FREE_BYTES, MAX_EXPANSION * len(data)))
    unpacker = zlib.decompressobj(wbits=31)  # gzip, its checksum verified
    try:
        text = unpacker.decompress(data, most + 1)
    except zlib.error as error:
        raise RecordingFileError(path, f"cannot be decompressed (gzip: {error})") from error
    if len(text) > most:
        problem = f"expands from {len(data)} to more than {most} bytes (max_file_bytes={max_bytes})"
        raise RecordingFileError(path, f"{problem}; raise max_file_bytes to read it")
    if not unpacker.eof:
        raise RecordingFileError(path, "is cut off: the end of its gzip stream is missing")
    if unpacker.unused_data.strip(b"\0"):
        raise RecordingFileError(
            path, "holds several gzip streams, one after the other; wanted one file in it"
        )
    return text


@dataclass
class Expansion:
    """The bytes that one file has been given in memory, counted before they are taken."""

    path: Path
    n_bytes: int
    expanded: int = 0

    def spend(self, n_bytes: int, place: str) -> None:
        """Count bytes about to be allocated; refuse what bombs need and recordings do not."""
        self.expanded += n_bytes
        if self.expanded > max(FREE_BYTES, MAX_EXPANSION * self.n_bytes):
            problem = (
                f"would expand from {self.n_bytes} to {self.expanded} bytes, more than {MAX_EXPANSION} times as many; "
                "recordings do not compress like that"
            )
            raise self.fault(place, problem)

    def fault(self, place: str, problem: str) -> RecordingFileError:
        """Return the error to raise about one place of the file."""
        return RecordingFileError(self.path, problem, place=place)


def _checked_size(status: os.stat_result, path: Path, max_bytes: int) -> int:
    if not stat.S_ISREG(status.st_mode):
        raise RecordingFileError(path, "is not a regular file")
    if status.st_size > max_bytes:
        problem = f"has {status.st_size} bytes, more than max_file_bytes={max_bytes}"
        raise RecordingFileError(path, f"{problem}; raise max_file_bytes to {status.st_size} to read it")
    return status.st_size


_MOST_PARTS = 200_000
"""Lists, objects and eighths of items; each takes about 100 bytes and 4 microseconds to become a frozen tree."""

_PARTS_PER_RECORDING = 64
_ITEMS_PER_PART = 8


def check_parts(texts: Iterable[str], name: str, n_recordings: int = 0) -> None:
    """Refuse JSON that would become many times its size in memory: ``[{},{},{}, ...]`` becomes thirty times."""
    parts = items = 0
    for text in texts:
        parts += text.count("{") + text.count("[")
        items += text.count(",") + text.count(":")
    most = max(_MOST_PARTS, _PARTS_PER_RECORDING * n_recordings)
    if parts + items // _ITEMS_PER_PART > most:
        came = f"{name} holds {parts} lists and objects with {items} items"
        raise ValueError(f"{came}; wanted at most {most} lists and objects")
