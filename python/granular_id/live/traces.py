"""What a view draws of a stream: its last rows, what the high-pass leaves of them, and the histogram of that."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from granular_id import _core
from granular_id.signal import butter, sosfilt, sosfilt_zi

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.features import FeatureSpec

__all__ = ["GrowingHistogram", "HighPass", "RecentRows", "outline"]


class RecentRows:
    """A fixed memory of the last rows, one per instant; instants without a row are NaN."""

    def __init__(self, capacity: int, n_columns: int) -> None:
        self._ring = np.full((capacity, n_columns), math.nan)
        self.total = 0
        """Instants so far, those included that are forgotten."""

    def add(self, rows: NDArray[np.float64]) -> None:
        """Append rows, shape (k, n_columns); the oldest make room."""
        capacity = len(self._ring)
        kept = rows[-capacity:]
        at = (self.total + len(rows) - len(kept)) % capacity
        first = min(len(kept), capacity - at)
        self._ring[at : at + first] = kept[:first]
        self._ring[: len(kept) - first] = kept[first:]
        self.total += len(rows)

    def skip(self, n_instants: int) -> None:
        """Append instants of which there is nothing."""
        capacity = len(self._ring)
        self.add(np.full((min(n_instants, capacity), self._ring.shape[1]), math.nan))
        # All is NaN then: where the ring begins is all the same.
        self.total += max(n_instants - capacity, 0)

    def last(self, n: int) -> NDArray[np.float64]:
        """Return a copy of the last `n` rows, or of as many as there are, oldest first."""
        n = min(n, self.total, len(self._ring))
        return self._ring[np.arange(self.total - n, self.total) % len(self._ring)]


def outline(
    rows: NDArray[np.float64], first: int, step: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keep the smallest and the largest value of every `step` rows (n, C), in the order in which they came.

    `first` is the number of the first row in the whole stream: pieces begin at multiples of `step` of that numbering,
    so that a trace which moves on keeps its shape; an unfinished piece at the beginning is left out. Returns where the
    kept values stand, in rows from `rows[0]` (a quarter and three quarters into their piece), and the values (m, C);
    NaN where a piece has none at all.
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
    return np.clip(places, start, start + len(rows) - 1).ravel(), kept


class HighPass:
    """The high-pass of a specification, which goes on from block to block.

    It starts from zero, or `steady`: as if the first row had lasted for ever.
    """

    def __init__(self, spec: FeatureSpec, *, steady: bool) -> None:
        self._sections = butter(spec.order, spec.cutoff_hz, "highpass", fs=spec.rate_hz)
        self._at_rest = sosfilt_zi(self._sections)[:, :, None] * float(steady)
        self._state: NDArray[np.float64] | None = None

    def restart(self) -> None:
        """Forget what was filtered."""
        self._state = None

    def filter(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Filter the next rows, shape (k, C), and return what is left of them."""
        if not len(rows):
            return rows
        state: NDArray[np.float64] = self._at_rest * rows[0] if self._state is None else self._state
        left, self._state = sosfilt(self._sections, rows, axis=0, zi=state)
        return left


class GrowingHistogram:
    """The histogram of the high-passed rows of one capture, row by row.

    When the capture is complete the counts are those of ``extract_features(recording, spec)``: the filter starts
    as the specification says, and values outside the bins are dropped or put into the outer ones.
    """

    def __init__(self, spec: FeatureSpec, n_axes: int) -> None:
        ranges = np.broadcast_to(np.asarray(spec.bin_range, np.float64), (n_axes, 2))
        self._ranges = [(float(low), float(high)) for low, high in ranges]
        self._clip = spec.outside == "clip"
        self._n_bins = spec.n_bins
        self._filter = HighPass(spec, steady=spec.initial == "steady")
        self.edges = np.array([np.linspace(low, high, spec.n_bins + 1) for low, high in self._ranges])
        self.counts = np.zeros((n_axes, spec.n_bins), np.int64)

    def restart(self) -> None:
        """Begin anew, for the next capture."""
        self._filter.restart()
        self.counts = np.zeros_like(self.counts)

    def add(self, rows: NDArray[np.float64]) -> None:
        """Count the next rows, shape (k, n_axes)."""
        left = self._filter.filter(rows)
        counts = self.counts.copy()  # the old ones may be on show
        for axis, (low, high) in enumerate(self._ranges):
            values = np.clip(left[:, axis], low, high) if self._clip else left[:, axis]
            counts[axis] += np.asarray(_core.histogram(values, self._n_bins, low, high)[0], np.int64)
        self.counts = counts
