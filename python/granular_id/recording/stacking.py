"""Make one array of many recordings, where they share a rate and a length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granular_id.recording._values import FloatArray
from granular_id.recording.axes import common_axes
from granular_id.recording.one import Recording


def common_rate(recordings: Sequence[Recording]) -> float:
    """Return the rate that all recordings share, Hz, or raise ValueError naming the method that makes one."""
    irregular = [r.name for r in recordings if r.rate_hz is None]
    if irregular:
        raise ValueError(
            f"{len(irregular)} of {len(recordings)} recordings are irregularly sampled (the first is "
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
    block = _shared_block(recordings)
    if block is None:
        block = np.stack([r.wrench for r in recordings])
        block.flags.writeable = False
    return block


def _shared_block(recordings: Sequence[Recording]) -> FloatArray | None:
    """Return the array whose rows the recordings are, in order and without a rest, if there is one."""
    first = recordings[0].wrench
    block = first.base
    shape = (len(recordings), *first.shape)
    if not isinstance(block, np.ndarray) or block.nbytes != len(recordings) * first.nbytes:
        return None
    if block.dtype != first.dtype or not block.flags.c_contiguous:
        return None
    address = block.__array_interface__["data"][0]
    for i, recording in enumerate(recordings):
        wrench = recording.wrench
        if wrench.base is not block or wrench.__array_interface__["data"][0] != address + i * first.nbytes:
            return None
    return block if block.shape == shape else block.reshape(shape)
