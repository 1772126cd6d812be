"""An explanation in the multi-band space: shares of blocks, bands, axes and couplings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._core import AXES
from granular_id._numbers import whole_number
from granular_id._words import fixed
from granular_id.explanation.findings import Finding, findings_of
from granular_id.explanation.result import Explanation
from granular_id.spaces.band_columns import BandColumns

__all__ = ["BandExplanation"]

FloatArray = npt.NDArray[np.float64]

_WORDS = {
    "coupling": "how axes move together",
    "quantiles": "how values are distributed",
    "envelope": "when the energy comes",
    "spectrum": "the whole spectrum",
    "level": "the level of the signal",
}

_MOST_LISTED = len(AXES)
_MOST_COUPLINGS = 3


@dataclass(frozen=True, eq=False)
class BandExplanation(Explanation):
    """What decides between two materials in the multi-band space, from `granular_id.explanation.explain`.

    As `Explanation`; what is added up is exact, and each ``by_*`` but `by_pair` sums to `difference`, up to rounding.
    `blocks` and `regions` hold spectrum and level only, which are read along frequency and time.

    Attributes
    ----------
    columns : BandColumns
        What each of D features stands for.
    means : ndarray, shape (2, D)
        Mean feature of each material.
    weights : ndarray, shape (D,)
        Score per unit of each feature, as `MultiBand` gives it: scaling and whitening behind it are folded in.
    contributions : ndarray, shape (D,)
        Weight times the difference of the means.
    """

    columns: BandColumns = field(repr=False, kw_only=True)
    means: FloatArray = field(repr=False, kw_only=True)
    weights: FloatArray = field(repr=False, kw_only=True)
    contributions: FloatArray = field(repr=False, kw_only=True)

    def by_block(self) -> dict[str, float]:
        """Sum of the contributions of each block."""
        return {
            block: float(self.contributions[self.columns.of(block=block)].sum())
            for block in self.columns.blocks
        }

    def by_axis(self) -> dict[str, float]:
        """Sum of the contributions of each axis; a coupling counts half for each of its two."""
        return self._of_axes(self.columns.over_axes(self.contributions))

    def by_block_and_axis(self) -> dict[str, dict[str, float]]:
        """Sum of the contributions of each axis in each block, couplings half for each axis."""
        spread = self.columns.over_axes(self.contributions)
        return {block: self._of_axes(spread[self.columns.of(block=block)]) for block in self.columns.blocks}

    def by_band(self) -> dict[str, float]:
        """Sum of the contributions of each band, over coupling, quantiles and envelope.

        Returns
        -------
        dict
            Bands by their edges, such as "61-122 Hz", the whole signal first; then "spectrum" and "level", which
            belong to no band.
        """
        return {name: sum(of_axis.values()) for name, of_axis in self.by_band_and_axis().items()}

    def by_band_and_axis(self) -> dict[str, dict[str, float]]:
        """Sum of the contributions of each axis in each band of `by_band`, couplings half for each axis."""
        spread = self.columns.over_axes(self.contributions)
        places = np.array(
            [
                column.block if column.band is None else str(self.columns.bands[column.band])
                for column in self.columns.columns
            ]
        )
        return {place: self._of_axes(spread[places == place]) for place in dict.fromkeys(places.tolist())}

    def by_pair(self, band: int | None = None) -> dict[tuple[str, str, int], float]:
        """Sum of the contributions of each coupling of axes.

        Parameters
        ----------
        band : int, optional
            Number of the band; default: all bands together.

        Returns
        -------
        dict
            By first axis, second axis and how many samples of its band the second is earlier: 0 or 2. The same axis
            twice and 0 is its energy. All together sum to the "coupling" of `by_block`.
        """
        sums: dict[tuple[str, str, int], float] = {}
        axes = self.columns.axes
        for number in self.columns.of(block="coupling", band=band).tolist():
            column = self.columns.columns[number]
            key = (axes[column.first], axes[column.second], column.lag)
            sums[key] = sums.get(key, 0.0) + float(self.contributions[number])
        return sums

    def findings(self, n: int = 5, *, coupled: bool | None = None) -> tuple[Finding, ...]:
        """Return the `n` things that say most for `first`, strongest first.

        Features that say one thing are added up, see `granular_id.explanation.findings.findings_of`. What speaks
        against has no part in them: together they may hold more than the difference.

        Parameters
        ----------
        n : int, default 5
        coupled : bool, optional
            True: couplings alone, of two axes or of one with itself earlier; False: all but them. Default: all.
        """
        n = whole_number("n", n, least=0)
        labels = (str(self.first), str(self.second))
        return findings_of(self.columns, self.contributions, self.means, labels, n, coupled=coupled)

    def strongest_couplings(self) -> tuple[Finding, ...]:
        """Return the few couplings that the text lists by themselves, and of whose bands a figure shows all."""
        return self.findings(_MOST_COUPLINGS, coupled=True)

    def top(self, n: int = 5) -> tuple[str, ...]:
        """Return `findings` in words, each with its share of the difference."""
        pair = f"between {self.first} and {self.second}"
        return tuple(
            f"{self._share(one.contribution)} of the difference {pair}: {one}" for one in self.findings(n)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text, ready for ``json.dumps``."""
        return super().to_dict() | {
            "by_band": self.by_band(),
            "by_band_and_axis": self.by_band_and_axis(),
            "by_pair": [
                {"axis": first, "with": second, "samples_earlier": lag, "contribution": value}
                for (first, second, lag), value in self.by_pair().items()
            ],
            "bands": [band._asdict() for band in self.columns.bands],
            "features": {
                "names": list(self.columns.names),
                "means": self.means.tolist(),
                "weights": self.weights.tolist(),
                "contributions": self.contributions.tolist(),
            },
        }

    def __str__(self) -> str:
        """Give the main points in words."""
        lines = [*self._heading(), "Of the difference come"]
        of_axes = self.by_block_and_axis()
        for block, total in _largest(self.by_block()):
            if not any(of_axes[block].values()):
                lines.append(f"  nothing from {_WORDS[block]} ({block})")
                continue
            axes = ", ".join(f"{axis} {self._share(part)}" for axis, part in _largest(of_axes[block], 3))
            lines.append(f"  {self._share(total)} from {_WORDS[block]} ({block}): {axes}")
        for what, sums in (("bands", self.by_band()), ("axes", self.by_axis())):
            listed = _largest(sums, _MOST_LISTED)
            parts = ", ".join(f"{name} {self._share(part)}" for name, part in listed)
            lines.append(f"{'Strongest' if len(listed) < len(sums) else 'All'} {what}: {parts}")
        lines.append("Strongest of all:")
        lines += [f"  {self._share(one.contribution)}: {one}" for one in self.findings()]
        coupled = self.strongest_couplings()
        if coupled:
            lines.append("Strongest couplings:")
            lines += [f"  {self._share(one.contribution)}: {one}" for one in coupled]
        return "\n".join(lines)

    def _share(self, contribution: float) -> str:
        """As of any explanation, with a digit more for small ones: many bands share the difference."""
        if self.difference <= 0:
            return super()._share(contribution)
        share = 100 * contribution / self.difference
        return f"{fixed(share, 0)} %" if abs(share) >= 9.95 else f"{round(share, 1) + 0.0:.1f} %"

    def _of_axes(self, spread: FloatArray) -> dict[str, float]:
        return dict(zip(self.columns.axes, spread.sum(axis=0).tolist(), strict=True))


def _largest(sums: dict[str, float], n: int | None = None) -> list[tuple[str, float]]:
    return sorted(sums.items(), key=lambda item: -item[1])[:n]
