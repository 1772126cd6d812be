"""Multi-band features that say one thing, taken together: an axis, or a pair of axes, in a band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from granular_id.explanation.band_words import said
from granular_id.spaces.band_columns import Band, BandColumn, BandColumns

__all__ = ["Finding", "findings_of"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """What one axis, or the coupling of two, contributes in one band.

    Attributes
    ----------
    band : Band or None
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

    band: Band | None
    axes: tuple[str, ...]
    lag_s: float
    contribution: float
    feature: str
    words: str

    def __str__(self) -> str:
        """Give words and feature, for instance ``more energy on fz in 15-31 Hz ... [b5_logrms_fz]``."""
        return f"{self.words} [{self.feature}]"


def findings_of(
    columns: BandColumns,
    contributions: FloatArray,
    means: FloatArray,
    labels: tuple[str, str],
    n: int,
    *,
    coupled: bool | None = None,
) -> tuple[Finding, ...]:
    """Group features that say one thing and return the `n` groups that speak most for the first material.

    Size and distribution of an axis in a band are one thing, whichever blocks say it; so is each pair of axes, at
    the same instant or with one of them earlier.

    Parameters
    ----------
    columns : BandColumns
    contributions : ndarray, shape (D,)
    means : ndarray, shape (2, D)
        Of every feature, for each material.
    labels : (str, str)
    n : int
    coupled : bool, optional
        True: couplings alone; False: all but them.

    Returns
    -------
    tuple of Finding
        Strongest first; fewer where fewer speak for the first.
    """
    groups: dict[tuple[int | str | None, int, int, int], list[int]] = {}
    for number, column in enumerate(columns.columns):
        if coupled is not None and coupled != (column.first != column.second or column.lag > 0):
            continue
        place = _place(columns, column)
        groups.setdefault((place, column.first, column.second, column.lag), []).append(number)
    sums = {key: float(contributions[members].sum()) for key, members in groups.items()}
    strongest = sorted((key for key, total in sums.items() if total > 0), key=lambda key: -sums[key])[:n]
    found = []
    for key in strongest:
        place, first, second, lag = key
        members = groups[key]
        best = members[int(np.argmax(contributions[members]))]
        band = columns.bands[place] if isinstance(place, int) else None
        one, other = columns.axes[first], columns.axes[second]
        found.append(
            Finding(
                band=band,
                axes=(one, other) if lag or one != other else (one,),
                lag_s=lag / band.rate_hz if band is not None else 0.0,
                contribution=sums[key],
                feature=columns.names[best],
                words=said(columns, means, labels, best),
            )
        )
    return tuple(found)


def _place(columns: BandColumns, column: BandColumn) -> int | str | None:
    """Return the number of the band, "level", or None beyond all; a bin of the spectrum is in its octave."""
    if column.block == "level":
        return "level"
    if column.block != "spectrum":
        return column.band
    frequency = columns.frequencies_hz[int(column.detail)]
    inside = (band.number for band in columns.bands[1:] if band.low_hz <= frequency < band.high_hz)
    return next(inside, None)
