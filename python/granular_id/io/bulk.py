"""Large arrays, piece by piece: a piece stays in the cache of the processor while it is worked on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_PIECE_BYTES = 1 << 20
_SLAB = 32
"""Samples copied at a time: 32 x 6 float64 are a few cache lines per recording."""


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
