"""Make one array of many recordings, where they share a rate and a length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granular_id._words import counted, verb
from granular_id.recording._values import FloatArray
from granular_id.recording.axes import common_axes
from granular_id.recording.one import Recording


def common_rate(recordings: Sequence[Recording]) -> float:
    """Return the rate that all recordings share, Hz, or raise ValueError naming the method that makes one."""
    irregular = [r.name for r in recordings if r.rate_hz is None]
    if irregular:
        raise ValueError(
            f"{len(irregular)} of {counted(len(recordings))} "
            f"{verb(len(irregular), 'is', 'are')} irregularly sampled (the first is "
            f"{irregular[0]!r}); call .resample(rate_hz) first, nothing is resampled silently"
        )
    rates = sorted({r.rate_hz for r in recordings if r.rate_hz is not None})
    if len(rates) > 1:
        raise ValueError(
            f"recordings differ in rate ({rates[0]:g} to {rates[-1]:g} Hz); call .resample(rate_hz) first, "
            "nothing is resampled silently"
        )
    return rates[0]


def stack(recordings: Sequence[Recording]) -> FloatArray:
    """Return the samples as one read-only array, shape (n, T, C), or raise naming the method that helps."""
    common_rate(recordings)
    common_axes(recordings)
    lengths = [r.n_samples for r in recordings]
    if len(set(lengths)) > 1:
        raise ValueError(
            f"recordings differ in length ({min(lengths)} to {max(lengths)} samples); call "
            ".align(n_samples=...) or .align(duration_s=...) first, nothing is cropped silently"
        )
    parts = [r.wrench for r in recordings]
    block = shared_base(parts)
    if block is None:
        block = np.stack(parts)
        block.flags.writeable = False
        return block
    shape = (len(parts), *parts[0].shape)
    return block if block.shape == shape else block.reshape(shape)


def shared_base(parts: Sequence[FloatArray]) -> FloatArray | None:
    """Return the array that the parts fill, one after the other and without a rest, if there is one.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording.stacking import shared_base
    >>> block = np.zeros((2, 1600, 6))
    >>> shared_base(list(block)) is block, shared_base([block[1], block[0]]) is None
    (True, True)
    """
    base = parts[0].base
    if not isinstance(base, np.ndarray) or base.nbytes != sum(part.nbytes for part in parts):
        return None
    # of another type where the parts view its bytes as numbers
    if base.dtype != parts[0].dtype or not base.flags.c_contiguous:
        return None
    address = base.__array_interface__["data"][0]
    for part in parts:
        if part.base is not base or not part.flags.c_contiguous:
            return None
        if part.__array_interface__["data"][0] != address:
            return None
        address += part.nbytes
    return base
