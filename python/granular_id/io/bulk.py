"""What takes long with large arrays, done by a few threads at once: reading, finding what is not finite, reordering.

All of it waits for memory or the system: on two cores, two threads take about two thirds of the time of one. Small
arrays are done by the caller's own thread.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from granular_id._core import available_cores
from granular_id._parallel import spread

__all__ = ["MOST_THREADS", "Filled", "all_finite", "bulk_threads", "read_at", "row_major"]

Result = TypeVar("Result")

MOST_THREADS = 4
"""Threads that work on one file; all wait for the same memory, and more of them hold more of it."""

_PART_BYTES = 8 << 20
"""Bytes that a thread takes at a time, which lasts much longer than the taking."""

_SLAB = 32
"""Samples copied at a time at least: 32 x 6 float64 are a few cache lines per recording."""

_PIECE_BYTES = 2 << 20
"""Bytes that are read and looked at together: they and what is found about them stay in the cache of one core."""


@dataclass(frozen=True)
class Filled:
    """What `read_at` found.

    Attributes
    ----------
    n_bytes : int
        Bytes that were there; fewer than the array has where the file ends before.
    finite : bool
        Whether the values are known to be finite: looked at only where they are float64 of this machine.
    """

    n_bytes: int
    finite: bool


def read_at(descriptor: int, offset: int, target: NDArray[Any]) -> Filled:
    """Fill a C-contiguous array from an open file, whose own position stays where it is.

    Values are looked at while they are still in the processor's cache, which is cheaper than a second walk.

    Parameters
    ----------
    descriptor : int
    offset : int
        Where its bytes begin in the file.
    target : ndarray

    Returns
    -------
    Filled
    """
    values = target.reshape(-1)
    if not values.size:
        return Filled(0, finite=True)
    room = values.view(np.uint8).data
    floats = values if values.dtype == np.float64 else None

    def fill(start: int, stop: int) -> Filled:
        done, finite = start, floats is not None
        while done < stop:
            count = _read_into(descriptor, room[done : min(done + _PIECE_BYTES, stop)], offset + done)
            if not count:
                break
            if floats is not None and finite:
                finite = bool(np.isfinite(floats[done // 8 : -(-(done + count) // 8)]).all())
            done += count
        return Filled(done - start, finite)

    parts = _in_parts(fill, target.nbytes, 1)
    return Filled(sum(part.n_bytes for part in parts), all(part.finite for part in parts))


def all_finite(values: NDArray[Any]) -> bool:
    """Tell whether an array has neither NaN nor infinity.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.io.bulk import all_finite
    >>> all_finite(np.zeros((3, 6))), all_finite(np.array([1.0, np.nan]))
    (True, False)
    """
    if not values.flags.c_contiguous:
        return bool(np.isfinite(values).all())
    flat = values.reshape(-1)

    def look(start: int, stop: int) -> bool:
        return bool(np.isfinite(flat[start:stop]).all())

    return all(_in_parts(look, len(flat), flat.itemsize))


def row_major(block: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a block (n, T, C) in row-major order, copied only where it is not.

    Column-major samples, as MATLAB keeps them, lie far apart for each recording: a few samples of all recordings at a
    time use what the cache holds, and take half as long as the whole in one go.
    """
    if block.flags.c_contiguous:
        return block
    copied = np.empty(block.shape)

    def copy(start: int, stop: int) -> None:
        copied[:, start:stop] = block[:, start:stop]

    # where there are many recordings, a part would be few samples, and threads would write to the same cache lines
    _in_parts(copy, block.shape[1], min(block.nbytes // max(1, block.shape[1]), _PART_BYTES // _SLAB))
    return copied


def _in_parts(work: Callable[[int, int], Result], n: int, item_bytes: int) -> list[Result]:
    """Call ``work(start, stop)`` for parts that make up ``range(n)``."""
    step = max(1, _PART_BYTES // max(1, item_bytes))
    starts = range(0, n, step)
    return spread(lambda start: work(start, min(start + step, n)), starts, bulk_threads())


def bulk_threads() -> int:
    """Return how many threads may work on one file."""
    return min(MOST_THREADS, available_cores())


_POSITION = Lock()


def _read_into(descriptor: int, room: memoryview, offset: int) -> int:
    if hasattr(os, "preadv"):
        return os.preadv(descriptor, [room], offset)
    with _POSITION:  # where files are read at their own position only
        own = os.lseek(descriptor, 0, os.SEEK_CUR)
        try:
            os.lseek(descriptor, offset, os.SEEK_SET)
            data = os.read(descriptor, len(room))
        finally:
            os.lseek(descriptor, own, os.SEEK_SET)
    room[: len(data)] = data
    return len(data)
