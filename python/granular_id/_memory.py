"""Arrays that are too large for memory: they lie in temporary files without a name, and are used like any other."""

from __future__ import annotations

import errno
import math
import mmap
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from granular_id._core import GranularIdError

FloatArray = npt.NDArray[np.float64]

LARGE_ARRAY_MB = "GRANULAR_ID_LARGE_ARRAY_MB"
"""Environment variable: arrays of more than so many MB lie in temporary files. Default: an eighth of the memory that
the process may use, as samples, features and scalar products are there at the same time, and once more while they are
worked on."""

_SHARE = 8
_PIECE_BYTES = 64 * 1024 * 1024
"""Recordings that are worked on at a time where not all fit: so many that threads and disks have enough to do."""


class TemporaryMap(mmap.mmap):
    """Memory of a file that nobody else can open."""


def large_bytes() -> int:
    """Return from how many bytes on an array is large."""
    stated = os.environ.get(LARGE_ARRAY_MB, "")
    if not stated:
        return _memory_bytes() // _SHARE
    try:
        megabytes = float(stated)
    except ValueError:
        megabytes = math.nan
    if not 0 < megabytes < math.inf:
        raise GranularIdError(f"{LARGE_ARRAY_MB}={stated!r} must be a positive number of megabytes")
    return int(megabytes * 1e6)


def is_large(n_bytes: int) -> bool:
    """Whether an array of so many bytes lies in a file."""
    return n_bytes > large_bytes()


def empty(shape: tuple[int, ...], what: str) -> FloatArray:
    """Return an array to be filled, in a temporary file where it is large; `what` it holds is for the error.

    The room is taken at once: a disk that fills up later would end the process.
    """
    n_bytes = 8 * math.prod(shape)
    if not is_large(n_bytes):
        return np.empty(shape)
    folder = tempfile.gettempdir()
    if _file_system(folder) in ("tmpfs", "ramfs"):
        warnings.warn(
            f"{what}: the temporary files in {folder} take memory, too ({_file_system(folder)}): set TMPDIR to a "
            "folder on a disk",
            stacklevel=3,
        )
    with tempfile.TemporaryFile(prefix="granular-id-", dir=folder) as file:
        try:
            _take_room(file.fileno(), n_bytes)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise _no_room(n_bytes, what, folder) from error
            raise
        mapped = TemporaryMap(file.fileno(), n_bytes)
    array: FloatArray = np.ndarray(shape, np.float64, buffer=mapped)
    return array


def stacked(arrays: Sequence[FloatArray], what: str) -> FloatArray:
    """Return arrays of one shape as one, in a temporary file where it is large."""
    stack: FloatArray = np.stack(arrays, out=empty((len(arrays), *arrays[0].shape), what))
    return stack


def taken(array: FloatArray, rows: npt.NDArray[np.intp], what: str) -> FloatArray:
    """Return ``array[rows]``, in a temporary file where it is large."""
    row_bytes = array[:1].nbytes
    if not is_large(len(rows) * row_bytes):
        return array[rows]
    copy = empty((len(rows), *array.shape[1:]), what)
    for span in spans(len(rows), row_bytes):
        copy[span] = array[rows[span]]
    return copy


def spans(n_rows: int, row_bytes: int) -> Iterator[slice]:
    """Cut rows into runs that are worked on one after the other."""
    step = max(1, _PIECE_BYTES // max(1, row_bytes))
    return (slice(start, min(start + step, n_rows)) for start in range(0, n_rows, step))


def _no_room(n_bytes: int, what: str, folder: str) -> OSError:
    free = shutil.disk_usage(folder).free
    text = (
        f"{what}: temporary files of {n_bytes / 1e9:.3g} GB are needed, {folder} has room for {free / 1e9:.3g} GB: "
        f"set TMPDIR to a folder with more, or {LARGE_ARRAY_MB} to keep larger arrays in memory"
    )
    return OSError(errno.ENOSPC, text)


def _take_room(descriptor: int, n_bytes: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, n_bytes)
        return
    zeros = bytes(min(n_bytes, 1 << 24))
    for start in range(0, n_bytes, len(zeros)):
        os.write(descriptor, zeros[: n_bytes - start])


def _file_system(folder: str) -> str:
    """Name the kind of file system that a folder is on; "" where nobody says."""
    device = Path(folder).stat().st_dev
    number = f"{os.major(device)}:{os.minor(device)}" if hasattr(os, "major") else ""
    with suppress(OSError):
        for line in Path("/proc/self/mountinfo").read_text(encoding="utf-8").splitlines():
            fields, _, kind = line.partition(" - ")
            if fields.split()[2] == number:
                return kind.split()[0]
    return ""


@lru_cache(maxsize=1)
def _memory_bytes() -> int:
    """Return how much memory the process may use: what the machine has or, if less, the limit of its group."""
    try:
        found = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        found = 8 << 30
    return min([found, *_limits(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))])


def _limits(own: Path, root: Path) -> Iterator[int]:
    """Yield the limits of memory of the control groups that the process is in, as clusters and containers set them."""
    with suppress(OSError):
        for line in own.read_text(encoding="utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers not in ("", "memory"):
                continue
            base, name = (root / "memory", "memory.limit_in_bytes") if controllers else (root, "memory.max")
            group = base / path.lstrip("/")
            for folder in (group, *group.parents):
                with suppress(OSError, ValueError):
                    yield int((folder / name).read_text(encoding="utf-8"))
                if folder == base:
                    break
