"""An explanation in the multi-band space: shares of blocks, bands, axes and couplings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import whole_number
from granular_id._text import fixed
from granular_id.explanation.result import Explanation
from granular_id.spaces import BandColumn, BandColumns, FrequencyBand

FloatArray = npt.NDArray[np.float64]

_WORDS = {
    "coupling": "how axes move together",
    "quantiles": "how values are distributed",
    "envelope": "when the energy comes",
    "spectrum": "the whole spectrum",
    "level": "the level of the signal",
}

_MOST_LISTED = 6
_MOST_COUPLINGS = 3


@dataclass(frozen=True, eq=False)
class BandExplanation(Explanation):
    """What decides between two materials in the multi-band space, from `granular_id.explain`.

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
            By first axis, second axis and how many samples of its band the second is earlier: 0, 1 or 2. The same axis
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

        Features that say one thing are added up: size and distribution of an axis in a band, whichever blocks say it;
        each pair of axes, at the same instant or with one of them earlier. What speaks against has no part in them:
        together they may hold more than the difference.

        Parameters
        ----------
        n : int, default 5
        coupled : bool, optional
            True: couplings alone, of two axes or of one with itself earlier; False: all but them. Default: all.
        """
        n = whole_number("n", n, least=0)
        columns, labels = self.columns, (str(self.first), str(self.second))
        groups: dict[tuple[int | str | None, int, int, int], list[int]] = {}
        for number, column in enumerate(columns.columns):
            if coupled is not None and coupled != (column.first != column.second or column.lag > 0):
                continue
            key = (_place(columns, column), column.first, column.second, column.lag)
            groups.setdefault(key, []).append(number)
        sums = {key: float(self.contributions[members].sum()) for key, members in groups.items()}
        strongest = sorted((key for key, total in sums.items() if total > 0), key=lambda key: -sums[key])[:n]
        found = []
        for key in strongest:
            place, first, second, lag = key
            best = groups[key][int(np.argmax(self.contributions[groups[key]]))]
            band = columns.bands[place] if isinstance(place, int) else None
            one, other = columns.axes[first], columns.axes[second]
            found.append(
                Finding(
                    band=band,
                    axes=(one, other) if lag or one != other else (one,),
                    lag_s=lag / band.rate_hz if band is not None else 0.0,
                    contribution=sums[key],
                    feature=columns.names[best],
                    words=said(columns, self.means, labels, best),
                )
            )
        return tuple(found)

    def strongest_couplings(self) -> tuple[Finding, ...]:
        """Return the few couplings that the text lists by themselves, and of whose bands a figure shows all."""
        return self.findings(_MOST_COUPLINGS, coupled=True)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text, ready for ``json.dumps``."""
        return super().to_dict() | {
            "by_band": self.by_band(),
            "by_band_and_axis": self.by_band_and_axis(),
            "by_pair": [
                {"axis": first, "with": second, "samples_earlier": lag, "contribution": value}
                for (first, second, lag), value in self.by_pair().items()
            ],
            "bands": [
                {
                    "number": number,
                    "low_hz": band.low_hz,
                    "high_hz": band.high_hz,
                    "rate_hz": band.rate_hz,
                }
                for number, band in enumerate(self.columns.bands)
            ],
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

    def _strongest(self, n: int) -> tuple[Finding, ...]:
        return self.findings(n)

    def _share(self, contribution: float) -> str:
        """As of any explanation, with a digit more for small ones: many bands share the difference."""
        if self.difference <= 0:
            return super()._share(contribution)
        share = 100 * contribution / self.difference
        return f"{fixed(share, 0)} %" if abs(share) >= 9.95 else f"{round(share, 1) + 0.0:.1f} %"

    def _of_axes(self, spread: FloatArray) -> dict[str, float]:
        return dict(zip(self.columns.axes, spread.sum(axis=0).tolist(), strict=True))


def coupled_bands(explanation: BandExplanation) -> list[int]:
    """Return which bands to show couplings of: of the strongest, then those that hold most; highest band first."""
    columns = explanation.columns
    totals = {
        number: float(explanation.contributions[members].sum())
        for number in range(len(columns.bands))
        if (members := columns.of(block="coupling", band=number)).size
    }
    strongest = (one.band for one in explanation.strongest_couplings() if one.band is not None)
    order = [*map(columns.bands.index, strongest), *sorted(totals, key=lambda number: -totals[number])]
    return sorted(list(dict.fromkeys(order))[:_MOST_COUPLINGS])


def _largest(sums: dict[str, float], n: int | None = None) -> list[tuple[str, float]]:
    return sorted(sums.items(), key=lambda item: -item[1])[:n]


_OPPOSITE = 0.05
"""A correlation nearer to zero is none that could be called opposite."""


def said(columns: BandColumns, means: FloatArray, labels: tuple[str, str], number: int) -> str:
    """Say how the mean of a feature differs between two materials."""
    column = columns.columns[number]
    first, second = (float(value) for value in means[:, number])
    axis, unit = columns.axes[column.first], columns.units[column.first]
    if column.block == "coupling":
        return _coupling(columns, means, labels, column)
    if column.block == "quantiles" and column.detail != "logrms":
        scale = columns.scales[column.band or 0, column.first]
        what = f"{_ordinal(int(column.detail[1:]))} percentile of {axis} in {_band(columns, column)}"
        return _values(what, np.sinh([first, second]) * scale, unit, labels)
    if column.block == "level":
        what = f"mean of {axis} {_stretch(*columns.stretch_s('level', column.detail))}"
        values = np.sinh([first, second]) * columns.level_scales[column.first]
        return _values(what, values, unit, labels)
    where = f"on {axis}"
    if column.block == "spectrum":
        return _energy(
            f"{where} near {columns.frequencies_hz[int(column.detail)]:.3g} Hz", first - second, labels
        )
    where += f" in {_band(columns, column)}"
    if column.block == "envelope":
        stretch = _stretch(*columns.stretch_s("envelope", column.detail))
        return _energy(f"{where} {stretch}", first - second, labels)
    return _energy(where, 2 * (first - second), labels)


_SHIFTS = (0.03, 3.0)
"""Of the resolvents: a moment v becomes the sum over c of (v - c) / (v + c)."""


_HIGHEST = 2 - 1e-9
"""Of that sum; the least is its negative. A moment is infinite at 2, and 0 at -2, by which nothing can be divided."""


def moments(columns: BandColumns, means: FloatArray, band: int) -> FloatArray:
    """Second moments of one material in one band: those of which the features are the means of the material."""
    own = means[columns.of(block="coupling", band=band)]
    n = len(columns.axes)
    rows, across = np.triu_indices(n)
    now, earlier = np.zeros((n, n)), own[-n * n :].reshape(n, n)
    now[rows, across] = now[across, rows] = own[: -n * n]
    values, vectors = np.linalg.eigh(np.block([[now, earlier], [earlier.T, now]]))
    values = np.clip(values, -_HIGHEST, _HIGHEST)
    linear, product = values * sum(_SHIFTS), 4 * _SHIFTS[0] * _SHIFTS[1]
    values = (linear + np.sqrt(linear**2 + product * (4 - values**2))) / (4 - 2 * values)
    made: FloatArray = (vectors * values) @ vectors.T
    return made


def _coupling(columns: BandColumns, means: FloatArray, labels: tuple[str, str], column: BandColumn) -> str:
    band = column.band or 0
    where = _band(columns, column)
    seconds = column.lag / columns.bands[band].rate_hz
    here, there = column.first, column.second + (len(columns.axes) if column.lag else 0)
    pair = [moments(columns, mean, band) for mean in means]
    one, other = columns.axes[column.first], columns.axes[column.second]
    if here == there:
        return _energy(
            f"on {one} in {where}", float(np.log(pair[0][here, here] / pair[1][here, here])), labels
        )
    both = [float(m[here, there] / np.sqrt(m[here, here] * m[there, there])) for m in pair]
    earlier = f"{other} {_milliseconds(seconds)} earlier" if column.lag else other
    return f"in {where}, {one} and {earlier} {_together(both, labels)}"


def _together(both: list[float], labels: tuple[str, str]) -> str:
    """Say what the correlation of two signals is in each material, the one that is named first in front."""
    large, small = both if abs(both[0]) >= abs(both[1]) else both[::-1]
    more, less = labels if large == both[0] else labels[::-1]
    # As many digits as tell them apart, but no more than four: near 1 the logarithm sees what two digits hide.
    digits = next((d for d in (2, 3, 4) if round(large, d) != round(small, d)), None)
    if digits is None:
        return f"move as alike in {more} as in {less} (correlation {large:+.2f})"
    how = "together" if large > 0 else "against each other"
    if large * small < 0 and abs(small) >= _OPPOSITE:
        other = "against each other" if large > 0 else "together"
        words = f"move {how} in {more}, {other} in {less}"
    else:
        words = f"move {how} more in {more} than in {less}"
    return f"{words} (correlation {large:+.{digits}f}, {small:+.{digits}f})"


def _energy(where: str, log_ratio: float, labels: tuple[str, str]) -> str:
    more, less = labels if log_ratio > 0 else labels[::-1]
    ratio = float(np.exp(min(abs(log_ratio), 700.0)))
    if ratio < 1.005:
        return f"as much energy {where} in {labels[0]} as in {labels[1]}"
    return f"more energy {where} in {more} than in {less} ({_size(ratio)})"


def _values(what: str, values: FloatArray, unit: str, labels: tuple[str, str]) -> str:
    first, second = (f"{value:+.3g} {unit}".rstrip() for value in values.tolist())
    return f"{what}: {first} in {labels[0]}, {second} in {labels[1]}"


def _band(columns: BandColumns, column: BandColumn) -> str:
    return str(columns.bands[column.band or 0])


def _size(ratio: float) -> str:
    if ratio < 2:
        return f"{100 * (ratio - 1):.0f} % more"
    if ratio >= 1e4:
        return "10,000 times as much, or more"
    return f"{float(f'{ratio:.2g}'):,g} times as much"


def _stretch(low: float, high: float) -> str:
    """Give both ends in seconds: to hundredths, or what the stretch holds two of."""
    digits = max(2, math.ceil(math.log10(2 / (high - low)) - 1e-9))
    return f"from {fixed(low, digits)} to {fixed(high, digits)} s"


def _ordinal(number: int) -> str:
    endings = {1: "st", 2: "nd", 3: "rd"}
    ending = "th" if number % 100 in (11, 12, 13) else endings.get(number % 10, "th")
    return f"{number}{ending}"


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"


@dataclass(frozen=True)
class Finding:
    """What one axis, or the coupling of two, contributes in one band.

    Attributes
    ----------
    band : FrequencyBand or None
        None: the level of the signal, or frequencies beyond all bands.
    axes : tuple of str
        One, or two that are coupled.
    lag_s : float
        How much earlier the second axis is; 0 at the same instant. With a lag an axis may be coupled to itself.
    contribution : float
        Sum over all features that say it, in units of the score.
    feature : str
        The one of them that contributes most.
    words : str
        What that feature says.
    """

    band: FrequencyBand | None
    axes: tuple[str, ...]
    lag_s: float
    contribution: float
    feature: str
    words: str

    def __str__(self) -> str:
        """Give words and feature, for instance ``more energy on fz in 15-31 Hz ... [b5_logrms_fz]``."""
        return f"{self.words} [{self.feature}]"


def _place(columns: BandColumns, column: BandColumn) -> int | str | None:
    """Return the number of the band, "level", or None beyond all; a bin of the spectrum is in its octave."""
    if column.block == "level":
        return "level"
    if column.block != "spectrum":
        return column.band
    frequency = columns.frequencies_hz[int(column.detail)]
    octaves = enumerate(columns.bands[1:], 1)
    return next((number for number, band in octaves if band.low_hz <= frequency < band.high_hz), None)
