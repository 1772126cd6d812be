"""Time stamps: whether they form a uniform grid, and what to do where they do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granular_id.recording._values import FloatArray
from granular_id.recording.one import Recording

UNIFORM_TOLERANCE = 0.01
"""Stamps within this part of a step of an even grid count as uniform: finer than clocks jitter."""

STATED_TOLERANCE = 0.5
"""A rate the user states holds while every stamp is nearer to its own place than to its neighbours'."""


def uniform_rate(time_s: FloatArray, resolution_s: float = 0.0) -> float | None:
    """Find the rate of evenly spaced stamps: the shortest decimal number that fits them all.

    Parameters
    ----------
    time_s : ndarray, shape (T,)
        Strictly increasing stamps, the first one 0.
    resolution_s : float
        What the stamps can be off by rounding (large absolute stamps in float64 are).

    Returns
    -------
    float or None
        The rate in Hz; None for a single stamp and for stamps further than 1 % of a step from an even grid.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording.timing import uniform_rate
    >>> uniform_rate(np.arange(1600) / 500)
    500.0
    """
    if len(time_s) < 2:
        return None
    mean = (len(time_s) - 1) / float(time_s[-1])
    if largest_offset(time_s, mean) > 2 * (UNIFORM_TOLERANCE / mean + resolution_s) * (1 + 1e-6):
        return None  # the mean rate fits at least half as well as the best one: no rate will do
    for digits in range(1, 18):
        rate = float(f"{mean:.{digits}g}")
        if largest_offset(time_s, rate) <= UNIFORM_TOLERANCE / rate + resolution_s:
            return rate
    return None


def largest_offset(time_s: FloatArray, rate_hz: float) -> float:
    """Seconds between the stamps and the places an even grid would give them, at worst."""
    return float(np.abs(time_s - np.arange(len(time_s)) / rate_hz).max())


def largest_gap_s(recording: Recording) -> float:
    """Longest time between two neighbouring samples, seconds (0 for a single sample)."""
    if recording.rate_hz is not None:
        return 1 / recording.rate_hz if recording.n_samples > 1 else 0.0
    steps = np.diff(recording.times())
    return float(steps.max()) if len(steps) else 0.0


def median_step_s(recording: Recording) -> float:
    """Median time between neighbouring samples, seconds (0 for a single sample)."""
    if recording.rate_hz is not None or recording.n_samples < 2:
        return largest_gap_s(recording)
    return float(np.median(np.diff(recording.times())))


@dataclass(frozen=True)
class RepairedTime:
    """Stamps put in order by :func:`repair_time`.

    Attributes
    ----------
    stamps : ndarray, shape (M,)
        Strictly increasing stamps, M <= T.
    values : ndarray, shape (M, C)
        The samples in that order, those with the same stamp averaged.
    touched : ndarray of bool, shape (M,)
        Which samples were moved or merged.
    order : ndarray of int, shape (T,)
        The sort: ``stamps[order]`` ascends.
    first : ndarray of int, shape (M,)
        Where in that order each merged sample begins (for ``ufunc.reduceat`` on other columns).
    n_moved, n_merged : int
        How many samples came later than one with a later stamp, and how many were merged into another one.
    """

    stamps: FloatArray
    values: FloatArray
    touched: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    order: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    first: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    n_moved: int
    n_merged: int


def repair_time(stamps: FloatArray, values: FloatArray) -> RepairedTime:
    """Sort samples by their stamps and average those that share one.

    The sort is stable. Averaging is the only choice that does not prefer one of two measurements of the same
    instant; repeated messages (equal values) come out unchanged.

    Parameters
    ----------
    stamps : ndarray, shape (T,)
        Finite stamps in the order of recording.
    values : ndarray, shape (T, C)
        The samples.
    """
    late = stamps < np.maximum.accumulate(stamps)
    order = np.argsort(stamps, kind="stable")
    late, stamps, values = late[order], stamps[order], values[order]
    first = np.flatnonzero(np.concatenate([[True], stamps[1:] > stamps[:-1]]))
    counts = np.diff(first, append=len(stamps))
    lowest = np.minimum.reduceat(values, first, axis=0)
    equal = lowest == np.maximum.reduceat(values, first, axis=0)
    means = np.add.reduceat(values, first, axis=0) / counts[:, None]
    touched = np.logical_or.reduceat(late, first) | (counts > 1)
    return RepairedTime(
        stamps=stamps[first],
        values=np.where(equal, lowest, means),  # a mean of equal values may differ from them in the last bit
        touched=touched,
        order=order,
        first=first,
        n_moved=int(late.sum()),
        n_merged=int((counts - 1).sum()),
    )
