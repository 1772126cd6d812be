"""An explanation: how much each block, band, axis and time has of the difference between two materials."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from granular_id._core import GranularIdError
from granular_id._text import fixed, in_columns
from granular_id.explanation.columns import Columns
from granular_id.spaces import FeatureBlock

FloatArray = npt.NDArray[np.float64]

_STRETCHES = 8
"""Of time: a stretch of 0.4 s of the paper's recordings holds the start of the motion or not."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """What decides between two materials, from `granular_id.explain`.

    Nothing is estimated: each table, and all contributions together, sum to `difference`, up to rounding. ``print`` it
    for the tables, in per cent of the difference.

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
    columns : Columns
        What each of D features stands for.
    weights : ndarray, shape (D,)
        Score per unit of each feature, as the feature space gives it; all that stands behind it is folded in.
    contributions : ndarray, shape (D,)
        Weight times the mean of the feature for the first material minus that for the second.
    """

    first: Any
    second: Any
    scores: tuple[float, float]
    counts: tuple[int, int]
    factors: FloatArray
    columns: Columns = field(repr=False)
    weights: FloatArray = field(repr=False)
    contributions: FloatArray = field(repr=False)

    @property
    def difference(self) -> float:
        """Mean score of the first material minus that of the second."""
        return self.scores[0] - self.scores[1]

    def table(self, by: Literal["block", "band", "time"]) -> dict[str, dict[str, float]]:
        """Sum the contributions of each axis in each block, band or stretch of time.

        Parameters
        ----------
        by : {"block", "band", "time"}
            What the rows are. Features without a band, or without a time, have the row of their block.

        Returns
        -------
        dict of dict
            Rows by name, such as "hfmh", "61-122 Hz" or "0.40-0.80 s"; in each the axes by name. Of two axes that are
            coupled each has a half. Time is cut into eight stretches of equal length, or fewer where the shortest
            feature that contributes is longer than one; a feature that lies in several is shared by how long it is in
            each.

        Raises
        ------
        ValueError
            Another `by`.
        """
        if by not in ("block", "band", "time"):
            raise GranularIdError(f"by must be 'block', 'band' or 'time', got {by!r}")
        spread = self.contributions[:, np.newaxis] * self.columns.axis_shares
        rows = dict[str, FloatArray]()
        left = np.ones(len(spread), np.bool_)
        if by == "time":
            left = np.isnan(self.columns.spans[:, 0])
            if not left.all():
                rows = self._over_time(spread[~left], self.columns.spans[~left])
        names = self.columns.bands if by == "band" else self.columns.blocks
        for name in dict.fromkeys(names[left].tolist()):
            rows[name] = spread[left & (names == name)].sum(axis=0)
        return {name: dict(zip(self.columns.axes, row.tolist(), strict=True)) for name, row in rows.items()}

    def _over_time(self, spread: FloatArray, spans: FloatArray) -> dict[str, FloatArray]:
        whole, lengths = float(np.ptp(spans)), np.diff(spans)[spread.any(axis=1)]
        n_stretches = min(_STRETCHES, math.floor(whole / lengths.min(initial=whole) + 1e-9))
        edges = np.linspace(spans.min(), spans.max(), n_stretches + 1)
        start, stop = spans.T[:, :, np.newaxis]
        shares = np.diff(np.clip((edges - start) / (stop - start), 0.0, 1.0), axis=1)
        # A tenth of a stretch: names of two stretches must differ.
        digits = max(0, 1 - math.floor(math.log10(edges[1] - edges[0])))
        names = [
            f"{fixed(low, digits)}-{fixed(high, digits)} {self.columns.time_unit}"
            for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        ]
        return dict(zip(names, shares.T @ spread, strict=True))

    def sums(self, by: Literal["axis", "block", "band", "time"]) -> dict[str, float]:
        """Sum the contributions of each axis, block, band or stretch of time.

        Parameters
        ----------
        by : {"axis", "block", "band", "time"}
            As the rows of `table`; or each axis, of which a coupling counts half for each of its two.

        Returns
        -------
        dict of float
            By name, such as "fz", "hfmh", "61-122 Hz" or "0.40-0.80 s"; they add up to `difference`.

        Raises
        ------
        ValueError
            Another `by`.
        """
        if by == "axis":
            sums = self.contributions @ self.columns.axis_shares
            return dict(zip(self.columns.axes, sums.tolist(), strict=True))
        return {name: sum(row.values()) for name, row in self.table(by).items()}

    def along(self, block: FeatureBlock) -> FloatArray:
        """Return the contributions (n_axes, m) of one of ``columns.along``, over its coordinate."""
        return self.contributions[block.columns].reshape(len(block.axes), -1)

    def tables(self) -> dict[str, dict[str, dict[str, float]]]:
        """Return `table` by block, by band where there are bands, and by time where features are about a time."""
        every = {"block": self.table("block"), "band": self.table("band"), "time": self.table("time")}
        return {
            by: table for by, table in every.items() if by == "block" or table.keys() != every["block"].keys()
        }

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text, ready for ``json.dumps``."""
        return {
            "first": str(self.first),
            "second": str(self.second),
            "scores": list(self.scores),
            "counts": list(self.counts),
            "difference": self.difference,
            "factors": self.factors.tolist(),
            "by_axis": self.sums("axis"),
            "tables": self.tables(),
            "features": {
                "names": list(self.columns.names),
                "weights": self.weights.tolist(),
                "contributions": self.contributions.tolist(),
            },
        }

    def __str__(self) -> str:
        """Give the scores and the tables."""
        materials = [["material", "recordings", "mean score"]]
        for label, count, score in zip((self.first, self.second), self.counts, self.scores, strict=True):
            materials.append([str(label), str(count), f"{score:+.3g}"])
        lines = [*in_columns(materials, right=True), "", f"Contributions, in {self.scale()[1]}:"]
        for by, table in self.tables().items():
            shown = [[by, *self.columns.axes, "sum"]]
            for name, row in [*table.items(), ("sum", self.sums("axis"))]:
                shown.append([name, *map(self.shown, (*row.values(), sum(row.values())))])
            lines += ["", *in_columns(shown, right=True)]
        return "\n".join(lines)

    def scale(self) -> tuple[float, str]:
        """Return what contributions are multiplied with to be shown, and their unit; no share of nothing."""
        if self.difference > 0:
            return 100.0 / self.difference, "% of the difference"
        return 1.0, f"units of the score, which is not higher for {self.first} here"

    def shown(self, contribution: float) -> str:
        """Return a contribution as a rounded number in the unit of `scale`, without a minus before zero."""
        digits = 1 if self.difference > 0 else 3
        return fixed(round(self.scale()[0] * contribution, digits) + 0.0, digits)
