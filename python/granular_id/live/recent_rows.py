"""The last rows of a stream, and their outline for a screen that has fewer columns than there are rows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["RecentRows", "outline"]


class RecentRows:
    """A fixed memory of the last rows, one per instant; instants without a row are NaN.

    Parameters
    ----------
    capacity : int
        Rows that are kept.
    n_columns : int
        Numbers per row.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live.recent_rows import RecentRows
    >>> rows = RecentRows(3, 1)
    >>> rows.add(np.array([[1.0], [2.0]]))
    >>> rows.skip(1)
    >>> rows.add(np.array([[4.0]]))
    >>> rows.total, rows.last(3).ravel()
    (4, array([ 2., nan,  4.]))
    """

    def __init__(self, capacity: int, n_columns: int) -> None:
        self._ring = np.full((capacity, n_columns), math.nan)
        self.total = 0
        """Instants so far, those included that are forgotten."""

    @property
    def capacity(self) -> int:
        """Rows that are kept."""
        return len(self._ring)

    def add(self, rows: NDArray[np.float64]) -> None:
        """Append rows, shape (k, n_columns); the oldest make room."""
        kept = rows[-self.capacity :]
        at = (self.total + len(rows) - len(kept)) % self.capacity
        first = min(len(kept), self.capacity - at)
        self._ring[at : at + first] = kept[:first]
        self._ring[: len(kept) - first] = kept[first:]
        self.total += len(rows)

    def skip(self, n_instants: int) -> None:
        """Append instants of which there is nothing."""
        self.add(np.full((min(n_instants, self.capacity), self._ring.shape[1]), math.nan))
        # All is NaN then: where the ring begins is all the same.
        self.total += max(n_instants - self.capacity, 0)

    def last(self, n: int) -> NDArray[np.float64]:
        """Return a copy of the last `n` rows, or of as many as there are, oldest first."""
        n = min(n, self.total, self.capacity)
        places = np.arange(self.total - n, self.total) % self.capacity
        return self._ring[places]


def outline(
    rows: NDArray[np.float64], first: int, step: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keep the smallest and the largest value of every `step` rows, in the order in which they came.

    Parameters
    ----------
    rows : ndarray, shape (n, C)
        Rows, one per instant; NaN where there is nothing.
    first : int
        Number of the first row in the whole stream. Pieces begin at multiples of `step` of that numbering, so
        that a trace which moves on keeps its shape; an unfinished piece at the beginning is left out.
    step : int
        Length of a piece. 1 keeps all rows.

    Returns
    -------
    places : ndarray, shape (m,)
        Where the kept values stand, in rows from `rows[0]`: a quarter and three quarters into their piece.
    kept : ndarray, shape (m, C)
        NaN where a piece has no value at all.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live.recent_rows import outline
    >>> places, kept = outline(np.array([[0.0], [5.0], [-1.0], [2.0], [3.0], [9.0]]), first=0, step=3)
    >>> places, kept.ravel()
    (array([0.25, 1.75, 3.25, 4.75]), array([ 5., -1.,  2.,  9.]))
    """
    if step == 1:
        return np.arange(len(rows), dtype=np.float64), rows
    start = -first % step
    rows = rows[start:]
    n_axes = rows.shape[1]
    pieces = np.concatenate([rows, np.full((-len(rows) % step, n_axes), math.nan)]).reshape(-1, step, n_axes)
    unknown = np.isnan(pieces)
    low = np.where(unknown, math.inf, pieces).argmin(axis=1, keepdims=True)
    high = np.where(unknown, -math.inf, pieces).argmax(axis=1, keepdims=True)
    both = np.concatenate([np.minimum(low, high), np.maximum(low, high)], axis=1)
    kept = np.take_along_axis(pieces, both, axis=1).reshape(-1, n_axes)
    middle = (step - 1) / 2
    places = start + step * np.arange(len(pieces))[:, None] + middle + np.array([-0.25, 0.25]) * step
    places = np.clip(places, start, start + len(rows) - 1)
    return places.ravel(), kept
