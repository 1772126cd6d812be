"""Files from outside: listed in natural order, read within bounds, never followed out of their folder."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from granular_id.io.errors import RecordingFileError
from granular_id.io.options import MIN_LINE_BYTES

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
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(root)):
        raise RecordingFileError(path, "is a link that leaves the folder; links out are not followed")


def read_bounded(path: Path, root: Path, max_bytes: int) -> bytes:
    """Read a regular file inside `root` of at most `max_bytes`, checked before reading.

    Raises
    ------
    RecordingFileError
        The file is missing, unreadable, not a regular file, larger than `max_bytes`, or reached by a link
        that leaves `root`.
    """
    refuse_outside(path, root)
    try:
        # without O_NONBLOCK, opening a pipe that somebody named .csv would wait for ever
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        try:
            return _read(descriptor, path, max_bytes)
        finally:
            os.close(descriptor)
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror}") from error


def _read(descriptor: int, path: Path, max_bytes: int) -> bytes:
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        raise RecordingFileError(path, "is not a regular file")
    if status.st_size > max_bytes:
        problem = f"has {status.st_size} bytes, more than max_file_bytes={max_bytes}"
        raise RecordingFileError(path, f"{problem}; raise max_file_bytes to read it")
    with open(descriptor, "rb", closefd=False) as file:
        data = file.read(status.st_size + 1)  # one more, to see a file that grows while it is read
    if len(data) > status.st_size:
        raise RecordingFileError(path, "grows while it is read; wait until the recording is complete")
    lines = data.count(b"\n")
    if lines * MIN_LINE_BYTES > max_bytes:
        most = max_bytes // MIN_LINE_BYTES
        problem = (
            f"has {lines} lines, more than {most} (max_file_bytes={max_bytes}, {MIN_LINE_BYTES} bytes a line)"
        )
        raise RecordingFileError(path, f"{problem}; raise max_file_bytes to read it")
    return data
