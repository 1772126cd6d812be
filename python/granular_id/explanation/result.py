"""An explanation: what each feature contributes to the difference between two materials."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._numbers import whole_number
from granular_id._words import fixed
from granular_id.explanation.regions import Region, regions_of
from granular_id.spaces import FeatureBlock

__all__ = ["ExplainedBlock", "Explanation"]

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
    """What decides between two materials, from `granular_id.explanation.explain`.

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
        """Return `regions` in words, each with its share of the difference."""
        pair = f"between {self.first} and {self.second}"
        return tuple(
            f"{self._share(region.contribution)} of the difference {pair}: {region}"
            for region in self.regions(n)
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
