"""Mean and deviation of features, as each learner sees them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["mean_and_deviation"]

FloatArray = npt.NDArray[np.float64]


def mean_and_deviation(rows: FloatArray, weights: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Weighted mean and population standard deviation of each column; infinite for a constant column.

    Divided by infinity, a feature that says nothing becomes exactly 0, and so does its weight.

    Raises
    ------
    ValueError
        Columns whose sum is beyond the range of float64.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        mean = np.average(rows, axis=0, weights=weights)
    if not np.isfinite(mean).all():
        raise ValueError(
            f"X is too large to standardize (up to {np.abs(rows).max():.3g}): its sums leave the range of float64"
        )
    # Rounding leaves a constant column a deviation that is not quite 0.
    constant = rows.min(axis=0) == rows.max(axis=0)
    relative = rows - mean
    # In units of the largest, so that squares neither overflow nor vanish.
    largest = np.maximum(relative.max(axis=0), -relative.min(axis=0))
    constant |= largest == 0
    largest[constant] = np.inf
    relative /= largest
    np.square(relative, out=relative)
    deviation = largest * np.sqrt(
        np.average(relative, axis=0, weights=weights), where=~constant, out=np.ones_like(mean)
    )
    return mean, deviation
