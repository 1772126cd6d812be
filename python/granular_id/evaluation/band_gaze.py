"""Where a linear model looks in the multi-band space: influence of each band and axis, block by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granular_id.spaces.band_columns import BandColumns

__all__ = ["BandWeights", "band_weights"]

Floats = NDArray[np.float64]

BandWeights = tuple[str, str, Floats, Floats, Floats]
"""Name, kind, coordinates (m,), size (C, m) and influence (C, m) of a block."""


def band_weights(columns: BandColumns, size: Floats, influence: Floats) -> list[BandWeights]:
    """Gather what single features weigh: bands for most blocks, frequencies and instants for spectrum and level.

    Parameters
    ----------
    columns : BandColumns
    size, influence : (D,) float arrays
        Of each feature, see `granular_id.evaluation.gaze.WeightBlock`.

    Returns
    -------
    list of BandWeights
        Bands from the lowest to the highest, at their geometric middle in hertz, after the whole signal at 0.
        Influence is the sum over the features of a cell, with those of two axes half for each; size is their
        mean. Both are 0 where a band is too short for the block.
    """
    spread, sizes = columns.over_axes(influence), columns.over_axes(size)
    counts = columns.over_axes(np.ones(len(size)))
    along = {block.name: block for block in columns.read_along()}
    order = [0, *range(len(columns.bands) - 1, 0, -1)]
    middles = np.array(
        [0.0, *(np.sqrt(columns.bands[k].low_hz * columns.bands[k].high_hz) for k in order[1:])]
    )
    found: list[BandWeights] = []
    for name in columns.blocks:
        if name in along:
            block = along[name]
            shape = (len(block.axes), len(block.coordinates))
            own = (size[block.columns].reshape(shape), influence[block.columns].reshape(shape))
            found.append((name, block.kind, block.coordinates, *own))
            continue
        cells = [columns.of(block=name, band=band) for band in order]
        sums = [
            np.stack([values[cell].sum(axis=0) for cell in cells], axis=1)
            for values in (sizes, counts, spread)
        ]
        weights = np.divide(sums[0], sums[1], out=np.zeros_like(sums[0]), where=sums[1] > 0)
        found.append((name, "band", middles, weights, sums[2]))
    return found
