"""Which rows are repetitions of one another, told by their scalar products."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["first_equal"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Squared distance at which rows count as equal, on the scale of their mean squared distance from the centre: products
# of equal rows can differ in their last bits.
_SAME = 1e-10


def first_equal(gram: FloatArray, labels: npt.NDArray[np.generic] | None = None) -> IntArray:
    """For each row the index of the first row that equals it.

    Parameters
    ----------
    gram : ndarray, shape (n, n)
        Scalar products of the rows, about any origin.
    labels : ndarray, shape (n,), optional
        Rows with other labels differ.

    Returns
    -------
    ndarray of int, shape (n,)

    Examples
    --------
    >>> from granular_id.ecoc.equal_rows import first_equal
    >>> from granular_id.gram import linear_gram
    >>> first_equal(linear_gram([[1.0, 2.0], [0.0, 5.0], [1.0, 2.0]]))
    array([0, 1, 0])
    """
    squares = np.diag(gram)
    distance = squares[:, None] + squares - 2.0 * gram
    spread = max(float(np.trace(gram)) / len(gram) - float(gram.mean()), 0.0)
    same = distance <= _SAME * spread
    np.fill_diagonal(same, val=True)  # rounding of large products may deny that a row equals itself
    if labels is not None:
        same &= labels[:, None] == labels
    first: IntArray = same.argmax(axis=1)
    return first
