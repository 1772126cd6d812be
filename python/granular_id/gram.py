"""Scalar products of many rows, made once.

With 10,200 features and 550 rows all the work of a linear support vector machine sits in its scalar products.
Every binary learner trains on a slice of them, and an evaluation over many partitions slices them again and again.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from granular_id._checks import float_array
from granular_id._memory import is_large, large_bytes

FloatArray = npt.NDArray[np.float64]

# Columns are centred and multiplied in blocks of this size, so that no copy of X is ever made.
_BLOCK_BYTES = 2_000_000


def linear_gram(
    X: npt.ArrayLike,
    Y: npt.ArrayLike | None = None,
    *,
    center: npt.ArrayLike | None = None,
) -> FloatArray:
    """Scalar products of the rows of `X` with each other, or with the rows of `Y`.

    Parameters
    ----------
    X : array-like, shape (n, D)
        One row per recording.
    Y : array-like, shape (m, D), optional
        Other rows; `X` itself when not given.
    center : array-like, shape (D,), optional
        Subtracted from each row first. A linear learner with an intercept gives the same scores for
        any origin, so this changes rounding only; take the mean of all rows when columns carry large offsets.

    Returns
    -------
    ndarray of float64, shape (n, n) or (n, m)

    Raises
    ------
    ValueError
        Wrong rank or sizes that do not fit; NaN, infinity or products beyond the range of float64.

    Examples
    --------
    >>> from granular_id.gram import linear_gram
    >>> linear_gram([[1.0, 2.0], [3.0, 4.0]])
    array([[ 5., 11.],
           [11., 25.]])
    """
    left = _rows("X", X)
    right = left if Y is None else _rows("Y", Y)
    n_columns = left.shape[1]
    if right.shape[1] != n_columns:
        raise ValueError(f"Y must have {n_columns} columns as X has, got {right.shape[1]}")
    origin = None if center is None else float_array("center", center)
    if origin is not None and origin.shape != (n_columns,):
        raise ValueError(f"center must have shape ({n_columns},), got shape {origin.shape}")
    step = max(64, _BLOCK_BYTES // (8 * max(len(left), len(right))))
    gram = np.zeros((len(left), len(right)))
    product = np.empty_like(gram)
    wide = _columns_at_a_time(left, right, step)
    with np.errstate(over="ignore", invalid="ignore"):  # reported below, with the argument's name
        for first in range(0, n_columns, wide):
            near = _copied(left, first, wide)
            far = near if right is left else _copied(right, first, wide)
            for start in range(first, min(first + wide, n_columns), step):
                columns = slice(start, min(start + step, n_columns))
                block = _moved(near, columns, first, origin)
                other = block if right is left else _moved(far, columns, first, origin)
                np.matmul(block, other.T, out=product)
                gram += product
                del block, other  # before the next ones are made: two of each would double the memory
            del near, far
    if not np.isfinite(gram).all():
        arguments = "X" if Y is None else "X and Y"
        raise ValueError(
            f"{arguments} must be finite (no NaN, no inf), with scalar products in the range of float64"
        )
    return gram


def check_symmetric(gram: FloatArray) -> None:
    """Raise a ValueError where scalar products (n, n) differ across the diagonal by more than 1e-9 of the largest."""
    # Products from `linear_gram` are equal to the last bit and need no tolerance, nor the copies that it takes.
    if not np.array_equal(gram, gram.T) and np.abs(gram - gram.T).max() > 1e-9 * np.abs(gram).max():
        raise ValueError("gram must be symmetric: element (i, j) is the scalar product of rows i and j")


def spread(gram: FloatArray) -> float:
    """Mean squared distance of rows from their mean, by their scalar products (n, n); 0 where all are equal."""
    # The diagonal about zero bounds what rounding can leave of rows that are equal.
    squares = float(np.trace(gram)) / len(gram)
    found = squares - float(gram.mean())
    return found if found > 1e-12 * squares else 0.0


def _rows(argument: str, values: npt.ArrayLike) -> FloatArray:
    rows = float_array(argument, values)
    if rows.ndim != 2 or 0 in rows.shape:
        raise ValueError(f"{argument} must have shape (n >= 1, D >= 1), got shape {rows.shape}")
    return rows


def _columns_at_a_time(left: FloatArray, right: FloatArray, step: int) -> int:
    """Return how many columns are copied at once: of rows in files a block is but an eighth of each page read."""
    if not is_large(max(left.nbytes, right.nbytes)):
        return int(left.shape[1])
    fit = large_bytes() // (16 * max(len(left), len(right)))
    return max(1, fit // step) * step


def _copied(rows: FloatArray, first: int, wide: int) -> FloatArray:
    return rows if wide >= rows.shape[1] else rows[:, first : first + wide].copy(order="C")


def _moved(rows: FloatArray, columns: slice, first: int, origin: FloatArray | None) -> FloatArray:
    block = rows[:, columns.start - first : columns.stop - first]
    return block - (0.0 if origin is None else origin[columns])
