"""Fewer points and fewer digits: what is drawn need not be longer than a figure is wide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["POINTS", "rounded", "thinned", "window_starts"]

POINTS = 200
"""Most points a curve keeps: a panel is a few hundred pixels wide."""

DIGITS = 5
"""Significant digits kept, more than a figure shows: a result of 20 classes stays below a few megabytes."""


def window_starts(n: int, most: int = POINTS) -> NDArray[np.intp]:
    """First index of each of at most `most` adjoining windows over `n` points, as equal as can be.

    Examples
    --------
    >>> window_starts(7, 3).tolist()
    [0, 2, 4]
    """
    return np.arange(min(n, most)) * n // min(n, most)


def thinned(values: NDArray[np.float64], most: int = POINTS) -> NDArray[np.float64]:
    """Mean over each of at most `most` windows along the last axis; shorter input is returned as it is.

    Examples
    --------
    >>> thinned(np.array([1.0, 3.0, 5.0, 7.0]), most=2).tolist()
    [2.0, 6.0]
    """
    n = values.shape[-1]
    starts = window_starts(n, most)
    sums = np.add.reduceat(values, starts, axis=-1)
    means: NDArray[np.float64] = sums / np.diff(starts, append=n)
    return means


def rounded(values: NDArray[np.float64], digits: int = DIGITS) -> NDArray[np.float64]:
    """Round to significant digits.

    Examples
    --------
    >>> rounded(np.array([1.23456789, 0.000987654321, 0.0])).tolist()
    [1.2346, 0.00098765, 0.0]
    """
    return np.array([float(f"{value:.{digits}g}") for value in values.ravel().tolist()]).reshape(values.shape)
