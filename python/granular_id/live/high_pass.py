"""The high-pass of a feature specification over a stream, and the histogram of what it leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from granular_id import _core
from granular_id.signal import butter, sosfilt, sosfilt_zi

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.features import FeatureSpec

__all__ = ["GrowingHistogram", "HighPass"]


class HighPass:
    """The high-pass of `spec`, which goes on from block to block.

    Parameters
    ----------
    spec : FeatureSpec
        Rate, cut-off and order.
    steady : bool
        Start as if the first row had lasted for ever; False: from zero, where an offset rings for a while.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import FeatureSpec
    >>> from granular_id.live.high_pass import HighPass
    >>> still = np.full((4, 6), 7.0)
    >>> bool(abs(HighPass(FeatureSpec(), steady=True).filter(still)).max() < 1e-9)
    True
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

    Parameters
    ----------
    spec : FeatureSpec
        Filter and bins.
    n_axes : int
        Columns of the rows.

    Examples
    --------
    >>> import numpy as np
    >>> import granular_id as gid
    >>> from granular_id.live.high_pass import GrowingHistogram
    >>> wrench = np.random.default_rng(0).normal(size=(1600, 6))
    >>> growing = GrowingHistogram(gid.FeatureSpec(), 6)
    >>> for block in np.split(wrench, 100):
    ...     growing.add(block)
    >>> np.array_equal(growing.counts.ravel(), gid.extract_features(wrench, raw=False))
    True
    """

    def __init__(self, spec: FeatureSpec, n_axes: int) -> None:
        ranges = np.broadcast_to(np.asarray(spec.bin_range, np.float64), (n_axes, 2))
        self._ranges = [(float(low), float(high)) for low, high in ranges]
        self._clip = spec.outside == "clip"
        self._n_bins = spec.n_bins
        self._filter = HighPass(spec, steady=spec.initial == "steady")
        self.edges = np.array([np.linspace(low, high, spec.n_bins + 1) for low, high in self._ranges])
        """Edges of the bins, shape (n_axes, n_bins + 1)."""
        self.counts = np.zeros((n_axes, spec.n_bins), np.int64)
        """Rows in each bin, shape (n_axes, n_bins)."""

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
