"""Large arrays, piece by piece: a piece stays in the cache of the processor while it is worked on."""

from __future__ import annotations

import os
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import available_cores

__all__ = ["MOST_THREADS", "Filled", "all_finite", "bulk_threads", "read_at", "row_major"]

MOST_THREADS = 4
"""Threads that work on one file; all wait for the same memory, and more of them hold more of it."""

_PIECE_BYTES = 1 << 20
_SLAB = 32
"""Samples copied at a time: 32 x 6 float64 are a few cache lines per recording."""


@dataclass(frozen=True)
class Filled:
    """Bytes that `read_at` found, and whether they are float64 of this machine that are all finite."""

    n_bytes: int
    finite: bool


def read_at(descriptor: int, offset: int, target: NDArray[Any]) -> Filled:
    """Fill a C-contiguous array from a place in an open file."""
    values = target.reshape(-1)
    if not values.size:
        return Filled(0, finite=True)
    room, done = values.view(np.uint8).data, 0
    floats = values if values.dtype == np.float64 else None
    finite = floats is not None
    while count := _read_into(descriptor, room[done : done + _PIECE_BYTES], offset + done):
        if floats is not None and finite:
            finite = bool(np.isfinite(floats[done // 8 : -(-(done + count) // 8)]).all())
        done += count
    return Filled(done, finite)


_POSITION = Lock()


def _read_into(descriptor: int, room: memoryview, offset: int) -> int:
    if not room:
        return 0
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


def all_finite(values: NDArray[Any]) -> bool:
    """Tell whether an array has neither NaN nor infinity."""
    if not values.flags.c_contiguous:
        return bool(np.isfinite(values).all())
    flat = values.reshape(-1)
    step = _PIECE_BYTES // max(1, flat.itemsize)
    return all(np.isfinite(flat[i : i + step]).all() for i in range(0, len(flat), step))


def row_major(block: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a block (n, T, C) in row-major order, copied only where it is not.

    Column-major samples, as MATLAB keeps them, lie far apart for each recording: a few samples of all recordings at a
    time use what the cache holds, and take half as long as the whole in one go.
    """
    if block.flags.c_contiguous:
        return block
    copied = np.empty(block.shape)
    for start in range(0, block.shape[1], _SLAB):
        copied[:, start : start + _SLAB] = block[:, start : start + _SLAB]
    return copied


def bulk_threads() -> int:
    """Return how many threads may work on one file."""
    return min(MOST_THREADS, available_cores())
