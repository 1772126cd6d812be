"""One multi-band feature in physical words: what is more, where, and in which of two materials."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from granular_id._core import AXES, UNITS
from granular_id._words import fixed
from granular_id.spaces.band_columns import BandColumn, BandColumns

__all__ = ["moments", "said"]

FloatArray = npt.NDArray[np.float64]
_OPPOSITE = 0.05
"""A correlation nearer to zero is none that could be called opposite."""


def said(columns: BandColumns, means: FloatArray, labels: tuple[str, str], number: int) -> str:
    """Say how the mean of a feature differs between two materials.

    Parameters
    ----------
    columns : BandColumns
    means : ndarray, shape (2, D)
        Of every feature, for each material.
    labels : (str, str)
        The two materials.
    number : int
        Which feature.

    Returns
    -------
    str
        For instance ``in 61-122 Hz, fx and tz move together more in rice than in salt (correlation +0.62, +0.10)``.
        Factors of energy are ratios of geometric means over recordings, and correlations those of the log-Euclidean
        mean of the second moments: what the features themselves say, not another statistic.
    """
    column = columns.columns[number]
    first, second = (float(value) for value in means[:, number])
    axis = columns.axes[column.first]
    if column.block == "coupling":
        return _coupling(columns, means, labels, column)
    if column.block == "quantiles" and column.detail != "logrms":
        scale = columns.scales[column.band or 0, column.first]
        what = f"{_ordinal(int(column.detail[1:]))} percentile of {axis} in {_band(columns, column)}"
        return _values(what, np.sinh([first, second]) * scale, axis, labels)
    if column.block == "level":
        what = f"mean of {axis} {_stretch(*columns.stretch_s('level', column.detail))}"
        values = np.sinh([first, second]) * columns.level_scales[column.first]
        return _values(what, values, axis, labels)
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


def moments(columns: BandColumns, means: FloatArray, band: int) -> FloatArray:
    """Second moments of one material in one band: the exponential of the mean of the matrix logarithms.

    Parameters
    ----------
    columns : BandColumns
        With the coupling block.
    means : ndarray, shape (D,)
        Of every feature, for one material.
    band : int

    Returns
    -------
    ndarray, shape (2 C, 2 C)
        Of the scaled axes now, then of the same axes earlier.
    """
    n = 2 * len(columns.axes)
    rows, across = np.triu_indices(n)
    logarithm = np.zeros((n, n))
    logarithm[rows, across] = means[columns.of(block="coupling", band=band)]
    logarithm[rows, across] /= np.where(rows == across, 1.0, np.sqrt(2.0))
    logarithm[across, rows] = logarithm[rows, across]
    values, vectors = np.linalg.eigh(logarithm)
    product: FloatArray = (vectors * np.exp(values)) @ vectors.T
    return product


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


def _values(what: str, values: FloatArray, axis: str, labels: tuple[str, str]) -> str:
    unit = f" {UNITS[AXES.index(axis)]}" if axis in AXES else ""
    first, second = (f"{value:+.3g}{unit}" for value in values.tolist())
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
