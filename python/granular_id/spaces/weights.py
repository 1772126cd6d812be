"""How much each block of a union counts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["BlockWeights", "check_block_weights", "fixed_weights", "row_norms", "unit_weight", "weigh"]

FloatArray = npt.NDArray[np.float64]
BlockWeights = str | Sequence[float] | npt.NDArray[Any] | None


def check_block_weights(block_weights: Any, names: Sequence[str]) -> str | tuple[float, ...] | None:
    """Return None, "unit", or one number per block; refuse anything else."""
    if block_weights is None or (isinstance(block_weights, str) and block_weights == "unit"):
        return block_weights
    wanted = f"None, 'unit' or {len(names)} numbers, one for each of {', '.join(names)}"
    try:
        numbers = np.asarray(block_weights, dtype=np.float64)
    except (TypeError, ValueError):
        kind = ValueError if isinstance(block_weights, str) else TypeError
        raise kind(f"block_weights must be {wanted}, got {block_weights!r}") from None
    if numbers.shape != (len(names),):
        raise ValueError(f"block_weights must be {wanted}, got {block_weights!r}")
    if not (np.isfinite(numbers).all() and (numbers > 0).all()):
        raise ValueError(f"block_weights must be positive and finite, got {block_weights!r}")
    return tuple(numbers.tolist())


def fixed_weights(checked: str | tuple[float, ...] | None, n_blocks: int) -> FloatArray | None:
    """Return the weights where they do not depend on data: None for "unit"."""
    if checked == "unit":
        return None
    return np.ones(n_blocks) if checked is None else np.asarray(checked, dtype=np.float64)


def row_norms(rows: FloatArray) -> FloatArray:
    """Euclidean norms (n,) of rows, without overflow where the norm itself has none."""
    reach = float(max(rows.max(initial=0.0), -rows.min(initial=0.0)))
    if reach == 0.0:
        return np.zeros(len(rows))
    norms = np.empty(len(rows))
    for i, row in enumerate(rows):  # a copy of one row at a time, not of all
        scaled = row / reach
        norms[i] = reach * np.sqrt(scaled @ scaled)
    return norms


def weigh(features: FloatArray, columns: slice, weight: float) -> None:
    """Multiply columns of features by the weight of their block, in place."""
    if weight == 1.0:
        return
    with np.errstate(over="ignore"):  # reported below
        features[:, columns] *= weight
    if not np.isfinite(features[:, columns]).all():
        raise ValueError(
            f"block_weights must keep features in the range of float64, got a weight of {weight:g}"
        )


def unit_weight(norms: npt.ArrayLike) -> float:
    """Factor that brings training rows with these norms to a mean norm of one.

    Parameters
    ----------
    norms : array-like, shape (n,)
        Euclidean norms of the training rows of one block; the square roots of the diagonal of their Gram matrix.

    Returns
    -------
    float
        1 over the mean; 1 for a block that is zero in all rows, which no factor changes.

    Raises
    ------
    ValueError
        The factor does not fit into float64.

    Examples
    --------
    >>> unit_weight([3.0, 5.0])
    0.25
    """
    mean = float(np.mean(np.asarray(norms, dtype=np.float64)))
    if mean == 0.0:
        return 1.0
    weight = 1.0 / mean if mean > 0.0 else np.nan
    if not (np.isfinite(mean) and np.isfinite(weight) and weight > 0.0):
        raise ValueError(
            f"block_weights='unit' needs features in the range of float64, got a mean norm of {mean:g}"
        )
    return float(weight)
