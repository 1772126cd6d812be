"""Where contributions gather: short stretches of time, bins or frequencies that hold most of them."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
import numpy.typing as npt

from granular_id._core import AXES, UNITS
from granular_id._words import fixed
from granular_id.spaces import FeatureBlock

__all__ = ["Region", "regions_of"]

FloatArray = npt.NDArray[np.float64]

# A region holds at least this much of the best stretch of its axis: the rest are long, thin ends.
_MOST = 0.8


@dataclass(frozen=True)
class Region:
    """A stretch of one axis in one block of features.

    Attributes
    ----------
    block : str
        Name of the block, for instance "raw" or "hfmh".
    kind : {"time", "magnitude", "frequency"}
        What `low` and `high` are.
    axis : str
        Axis of the sensor.
    low, high : float
        First and last instant or frequency, or the outer edges of the bins.
    step : float
        From one coordinate to the next; 0 where there is but one.
    unit : str
        Their unit.
    either_sign : bool
        Bins around zero: those from -high to -low are included.
    contribution : float
        Sum over the stretch, in units of the score.
    """

    block: str
    kind: str
    axis: str
    low: float
    high: float
    step: float
    unit: str
    either_sign: bool
    contribution: float

    def __str__(self) -> str:
        """Describe the stretch, for instance ``fx of hfmh, 0.09 .. 0.30 N of either sign``."""
        digits = max(0, math.ceil(-math.log10(self.step) - 1e-9)) if self.step > 0 else 3
        low, high = (fixed(value, digits) for value in (self.low, self.high))
        where = low if low == high else f"{low} .. {high}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.axis} of {self.block}, {where}{unit}{' of either sign' if self.either_sign else ''}"


def regions_of(block: FeatureBlock, contributions: FloatArray) -> Iterator[Region]:
    """Yield stretches of a block that speak for the first material, strongest first, without overlap.

    Parameters
    ----------
    block : FeatureBlock
        With m coordinates.
    contributions : ndarray, shape (n_axes, m)

    Yields
    ------
    Region
        The shortest stretch that holds four fifths of the best one of what is left.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import FeatureBlock
    >>> block = FeatureBlock("raw", "time", ("fx",), np.arange(6) / 10, "s", slice(0, 6))
    >>> for region in regions_of(block, np.array([[0.1, 0.0, 2.0, 3.0, -1.0, 0.5]])):
    ...     print(region, "holds", region.contribution)
    fx of raw, 0.2 .. 0.3 s holds 5.0
    fx of raw, 0.5 s holds 0.5
    fx of raw, 0.0 s holds 0.1
    """
    coordinates = block.coordinates
    either_sign = block.kind == "magnitude" and bool(
        np.allclose(coordinates, -coordinates[::-1], rtol=0, atol=1e-9 * np.ptp(coordinates))
    )
    step = float(coordinates[1] - coordinates[0]) if len(coordinates) > 1 else 0.0
    if either_sign:
        half = len(coordinates) // 2
        coordinates = coordinates[half:]
        mirrored = contributions[:, ::-1][:, half:].copy()
        contributions = contributions[:, half:].copy()
        if len(block.coordinates) % 2:  # the bin around zero is its own mirror image
            mirrored[:, 0] = 0.0
        contributions += mirrored
    reach = step / 2 if block.kind == "magnitude" else 0.0
    # A heap of (minus the sum, a number that settles ties, axis, stretch): the strongest of all axes comes first.
    order = count()
    heap: list[tuple[float, int, int, int, int, int, int]] = []

    def offer(axis: int, start: int, stop: int) -> None:
        found = _stretch(contributions[axis, start:stop])
        if found is not None:
            low, high, total = found
            heapq.heappush(heap, (-total, next(order), axis, start, stop, start + low, start + high))

    for axis in range(len(block.axes)):
        offer(axis, 0, len(coordinates))
    while heap:
        minus, _, axis, start, stop, low, high = heapq.heappop(heap)
        yield Region(
            block=block.name,
            kind=block.kind,
            axis=block.axes[axis],
            low=max(0.0, float(coordinates[low]) - reach) if either_sign else float(coordinates[low]) - reach,
            high=float(coordinates[high - 1]) + reach,
            step=step,
            unit=_unit(block, block.axes[axis]),
            either_sign=either_sign,
            contribution=-minus,
        )
        offer(axis, start, low)
        offer(axis, high, stop)


def _stretch(values: FloatArray) -> tuple[int, int, float] | None:
    """First and one past the last index, and the sum, of the shortest stretch that holds most of the best one."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    best = float((sums - np.minimum.accumulate(sums)).max())
    if best <= 0.0:
        return None
    wanted = _MOST * best
    first, last = 0, len(values)
    # Starts with rising sums: one that comes later and starts lower is always the better.
    starts: deque[int] = deque()
    for stop, total in enumerate(sums.tolist()):
        while starts and total - sums[starts[0]] >= wanted:
            start = starts.popleft()
            if stop - start < last - first:
                first, last = start, stop
        while starts and sums[starts[-1]] >= total:
            starts.pop()
        starts.append(stop)
    return first, last, float(sums[last] - sums[first])


def _unit(block: FeatureBlock, axis: str) -> str:
    """Return the unit of one axis, also where bins of a block are in N and N m."""
    return (
        UNITS[AXES.index(axis)]
        if axis in AXES and block.unit == ", ".join(dict.fromkeys(UNITS))
        else block.unit
    )
