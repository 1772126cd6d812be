"""Files from outside: listed in natural order, regular, never followed out of their folder."""

from __future__ import annotations

import os
import re
import stat
from contextlib import suppress
from pathlib import Path

from granular_id.io.errors import RecordingFileError

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


def check_place(path: Path, root: Path) -> None:
    """Refuse a file that is not regular or lies outside `root`, and a folder that holds such, before any is opened."""
    if not os.path.isdir(path):  # noqa: PTH112 (says False of a name that is too long, where Path.is_dir raises)
        check_file(path, root)
        return
    refuse_outside(path, root)
    for folder, folders, names in os.walk(path):
        for name in folders:
            refuse_outside(Path(folder, name), path)
        for name in names:
            check_file(Path(folder, name), path)


def check_file(path: Path, root: Path) -> None:
    """Refuse what lies outside `root`, is no regular file (a pipe is not opened), or cannot be opened."""
    refuse_outside(path, root)
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise RecordingFileError(path, "is not a regular file")
        with path.open("rb"):
            pass
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror or error}") from error


def bytes_of(path: Path) -> int:
    """Return the size of a file, or of all files in a folder, as far as they can be seen."""
    n_bytes = 0
    for place in [Path(folder, name) for folder, _, names in os.walk(path) for name in names] or [path]:
        with suppress(OSError):
            n_bytes += place.stat().st_size
    return n_bytes
