"""An explanation: what each feature contributes to the difference between two materials."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count, islice
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import whole_number
from granular_id._text import fixed
from granular_id.spaces import FeatureBlock

FloatArray = npt.NDArray[np.float64]

_WORDS = {"time": "signal over time", "magnitude": "histograms", "frequency": "spectrum"}


@dataclass(frozen=True, eq=False)
class ExplainedBlock:
    """Weights and contributions of one block of features.

    Attributes
    ----------
    block : FeatureBlock
        Name, axes and coordinates of the columns.
    weights : ndarray, shape (n_axes, m)
        Score per unit of each feature, as the feature space gives it (after the weight of its block, if any).
    contributions : ndarray, shape (n_axes, m)
        Weight times the mean of the feature for the first material minus that for the second.
    """

    block: FeatureBlock
    weights: FloatArray
    contributions: FloatArray

    @classmethod
    def of(cls, block: FeatureBlock, weights: FloatArray, contributions: FloatArray) -> ExplainedBlock:
        """Cut the columns of a block out of vectors (D,) over all columns."""
        shape = (len(block.axes), len(block.coordinates))
        return cls(block, weights[block.columns].reshape(shape), contributions[block.columns].reshape(shape))

    @property
    def group(self) -> str:
        """Name of the feature space the block is from: histograms with a range per axis are a block per axis."""
        (*_, axis) = self.block.axes
        return self.block.name.removesuffix(f"_{axis}") if len(self.block.axes) == 1 else self.block.name


@dataclass(frozen=True, eq=False)
class Explanation:
    """What decides between two materials, from `granular_id.explain`.

    Attributes
    ----------
    first, second : label
        The two materials; the score is positive for `first`.
    scores : (float, float)
        Mean score of the recordings of each.
    counts : (int, int)
        How many recordings of each.
    factors : ndarray, shape (L,)
        Factor of each learner in the score; one that is not zero with one-vs-one.
    blocks : tuple of ExplainedBlock
        All contributions together sum to `difference`, up to rounding.
    """

    first: Any
    second: Any
    scores: tuple[float, float]
    counts: tuple[int, int]
    factors: FloatArray
    blocks: tuple[ExplainedBlock, ...] = field(repr=False)

    @property
    def difference(self) -> float:
        """Mean score of the first material minus that of the second."""
        return self.scores[0] - self.scores[1]

    def by_axis(self) -> dict[str, float]:
        """Sum of the contributions of each axis, over all blocks."""
        sums: dict[str, float] = {}
        for of_axis in self.by_block_and_axis().values():
            for axis, total in of_axis.items():
                sums[axis] = sums.get(axis, 0.0) + total
        return sums

    def by_block(self) -> dict[str, float]:
        """Sum of the contributions of each block; histograms of one space with a range per axis count as one."""
        return {group: sum(of_axis.values()) for group, of_axis in self.by_block_and_axis().items()}

    def by_block_and_axis(self) -> dict[str, dict[str, float]]:
        """Sum of the contributions of each axis in each block of `by_block`."""
        sums: dict[str, dict[str, float]] = {}
        for part in self.blocks:
            of_axis = sums.setdefault(part.group, {})
            for axis, contributions in zip(part.block.axes, part.contributions, strict=True):
                of_axis[axis] = of_axis.get(axis, 0.0) + float(contributions.sum())
        return sums

    def regions(self, n: int = 5) -> tuple[Region, ...]:
        """Return the `n` stretches of time, bins or frequencies that say most for `first`, strongest first.

        What speaks against has no part in them: together they may hold more than the difference.
        """
        n = whole_number("n", n, least=0)
        every = [
            region for part in self.blocks for region in islice(regions_of(part.block, part.contributions), n)
        ]
        return tuple(sorted(every, key=lambda region: -region.contribution)[:n])

    def top(self, n: int = 5) -> tuple[str, ...]:
        """Return the strongest regions, or findings in the multi-band space, each with its share of the difference."""
        pair = f"between {self.first} and {self.second}"
        return tuple(
            f"{self._share(one.contribution)} of the difference {pair}: {one}" for one in self._strongest(n)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text, ready for ``json.dumps``."""
        return {
            "first": str(self.first),
            "second": str(self.second),
            "scores": list(self.scores),
            "counts": list(self.counts),
            "difference": self.difference,
            "factors": self.factors.tolist(),
            "by_axis": self.by_axis(),
            "by_block": self.by_block(),
            "top": list(self.top()),
            "blocks": [
                {
                    "name": part.block.name,
                    "kind": part.block.kind,
                    "axes": list(part.block.axes),
                    "unit": part.block.unit,
                    "coordinates": part.block.coordinates.tolist(),
                    "weights": part.weights.tolist(),
                    "contributions": part.contributions.tolist(),
                }
                for part in self.blocks
            ],
        }

    def __str__(self) -> str:
        """Give the main points in words."""
        lines = self._heading()
        words = {part.group: _WORDS.get(part.block.kind, part.block.kind) for part in self.blocks}
        by_axis = self.by_block_and_axis()
        lines.append("Of the difference come")
        for group, total in sorted(self.by_block().items(), key=lambda item: -item[1]):
            largest = sorted(by_axis[group].items(), key=lambda item: -abs(item[1]))[:3]
            axes = ", ".join(f"{axis} {self._share(part)}" for axis, part in largest)
            lines.append(f"  {self._share(total)} from the {words[group]} ({group}): {axes}")
        strongest = (f"  {self._share(region.contribution)}: {region}" for region in self.regions())
        return "\n".join([*lines, "Strongest:", *strongest])

    def _strongest(self, n: int) -> tuple[Any, ...]:
        return self.regions(n)

    def _heading(self) -> list[str]:
        each = "1 recording each" if self.counts == (1, 1) else "{} and {} recordings".format(*self.counts)
        lines = [
            f"{self.first} against {self.second}, {each}: mean scores "
            f"{self.scores[0]:+.3g} and {self.scores[1]:+.3g}."
        ]
        single = [str(name) for name, n in zip((self.first, self.second), self.counts, strict=True) if n == 1]
        if single:
            lines.append(
                f"This rests on one recording of {' and one of '.join(single)}: it may hold for no other recording."
            )
        if self.difference <= 0:
            lines.append(f"The model does not score {self.first} above {self.second} here.")
        return lines

    def _share(self, contribution: float) -> str:
        """Per cent of the difference; in units of the score where there is none to speak of."""
        if self.difference <= 0:
            return f"{contribution:+.3g}"
        return f"{fixed(100 * contribution / self.difference, 0)} %"


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
    """Yield stretches of a block that speak for the first material, strongest first, without overlap."""
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
    """Return the unit of one axis, also where bins of a block are in several."""
    return block.units[block.axes.index(axis)] if block.units else block.unit
