"""A coding matrix, checked: its learners can be trained, and the classes told apart."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["CodingMatrix", "check_coding_matrix", "own_coding"]

CodingMatrix = npt.NDArray[np.int8]


def check_coding_matrix(coding_matrix: npt.ArrayLike) -> CodingMatrix:
    """Return `coding_matrix` as int8 after checking that it can be learned and decoded.

    Parameters
    ----------
    coding_matrix : array-like, shape (K, L)
        Entries -1, 0, +1; each column with both signs, each row with at least one entry that is not 0.

    Raises
    ------
    ValueError
        Wrong rank, other entries, a column without both signs, an empty row.
    """
    given = np.asarray(coding_matrix)
    if given.ndim != 2 or given.shape[0] < 2 or given.shape[1] < 1:
        raise ValueError(
            f"coding_matrix must have shape (n_classes >= 2, n_learners >= 1), got shape {given.shape}"
        )
    if given.dtype.kind not in "biuf" or not ((given == 1) | (given == 0) | (given == -1)).all():
        raise ValueError("coding_matrix must hold -1, 0 and +1 only")
    matrix = given.astype(np.int8)
    one_sided = (matrix.max(axis=0) != 1) | (matrix.min(axis=0) != -1)
    if one_sided.any():
        raise ValueError(f"coding_matrix column {one_sided.argmax()} must hold both +1 and -1")
    unseen = ~matrix.any(axis=1)
    if unseen.any():
        raise ValueError(f"coding_matrix row {unseen.argmax()} is all 0: no learner ever sees this class")
    return matrix


def own_coding(coding: object, n_classes: int) -> CodingMatrix:
    """Check a user's coding matrix against the number of classes; rows and columns must differ.

    Raises
    ------
    TypeError
        Not a matrix of numbers.
    ValueError
        As `check_coding_matrix`; another number of rows than classes; equal rows (classes that are never told
        apart); columns that are equal, or the negative of each other (the same learner twice).
    """
    try:
        given = np.asarray(coding)
        is_matrix = given.dtype.kind in "biuf" and given.ndim > 0
    except ValueError:  # rows of different lengths
        is_matrix = False
    if not is_matrix:
        raise TypeError(f"coding must be the name of a design or a matrix of -1, 0 and +1, got {coding!r}")
    matrix = check_coding_matrix(given)
    if len(matrix) != n_classes:
        raise ValueError(f"coding must have {n_classes} rows, one per class, got shape {matrix.shape}")
    # A column and its negative make the same learner: compare them with their first sign +.
    leading = matrix[(matrix != 0).argmax(axis=0), np.arange(matrix.shape[1])]
    for what, lines, why in (
        ("rows", matrix, "these classes are never told apart"),
        ("columns", (matrix * leading).T, "the same learner twice, but for the sign"),
    ):
        first, again = _first_repeated(lines)
        if again >= 0:
            raise ValueError(f"coding {what} {first} and {again} are alike: {why}")
    return matrix


def _first_repeated(lines: CodingMatrix) -> tuple[int, int]:
    """Return the indices of a line and of its first repetition, (-1, -1) when all differ."""
    _, first, inverse = np.unique(lines, axis=0, return_index=True, return_inverse=True)
    original = first[inverse.ravel()]  # numpy 2.0.0 shaped the inverse differently
    repeated = np.flatnonzero(original != np.arange(len(lines)))
    return (int(original[repeated[0]]), int(repeated[0])) if len(repeated) else (-1, -1)
