"""Decoding of error-correcting output codes: the scores of all learners against the codes of each class.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141 (loss-based decoding);
Escalera, Pujol, Radeva (2010), "On the decoding process in ternary error-correcting output codes", IEEE TPAMI
32:120-134 (loss-weighted decoding).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from granular_id._arrays import float_array
from granular_id.ecoc.coding_matrix import CodingMatrix, check_coding_matrix
from granular_id.ecoc.losses import LOSSES, BinaryLoss
from granular_id.ecoc.training import named

__all__ = ["DECODINGS", "class_values", "decode"]

FloatArray = npt.NDArray[np.float64]

# Losses are made for as many rows at a time.
_BLOCK_BYTES = 10_000_000


def _weights_of_row(matrix: CodingMatrix) -> FloatArray:
    weights: FloatArray = np.abs(matrix).sum(axis=1, dtype=np.float64)
    return weights


def _number_of_learners(matrix: CodingMatrix) -> FloatArray:
    return np.full(matrix.shape[0], float(matrix.shape[1]))


DECODINGS: Mapping[str, Callable[[CodingMatrix], FloatArray]] = MappingProxyType(
    {"loss_weighted": _weights_of_row, "loss_based": _number_of_learners}
)
"""By what the summed loss of each class is divided, by the name of the decoding."""


def decode(
    scores: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    loss: str = "hinge",
    decoding: str = "loss_weighted",
) -> FloatArray:
    """Decision value of each class: minus its mean binary loss.

    The largest value wins. Take the first of equal ones (`numpy.argmax` does): ties go to the class that
    comes first. Losses are added in the order of the learners, so that a row gives the same bits alone
    and within any batch.

    Parameters
    ----------
    scores : array-like, shape (n, L)
        Scores of the L binary learners; positive (above 1/2 for "quadratic") speaks for the classes with
        code +1.
    coding_matrix : array-like, shape (K, L)
        Codes -1, 0, +1.
    loss : str, default "hinge"
        A key of `granular_id.ecoc.losses.LOSSES`. The hinge belongs to support vector machines, and is what
        the paper uses.
    decoding : {"loss_weighted", "loss_based"}, default "loss_weighted"
        Divide the summed loss of a class by the number of learners that saw it, or by that of all
        learners. Learners with code 0 count in neither sum. Where each class is seen by as many learners
        (one-vs-one) both name the same classes; the paper uses "loss_weighted".

    Returns
    -------
    ndarray of float64, shape (n, K)

    Raises
    ------
    ValueError
        Unknown `loss` or `decoding`, scores of the wrong shape, not finite, or out of the range of the loss.

    Examples
    --------
    >>> from granular_id.ecoc.codings import onevsone
    >>> from granular_id.ecoc.decoding import decode
    >>> decode([[2.0, 0.5, -1.0]], onevsone(3))
    array([[-0.125, -1.25 , -0.375]])
    """
    rule = named(LOSSES, "loss", loss)
    named(DECODINGS, "decoding", decoding)
    matrix = check_coding_matrix(coding_matrix)
    values = float_array("scores", scores)
    if values.ndim != 2 or values.shape[1] != matrix.shape[1]:
        raise ValueError(
            f"scores must have shape (n, {matrix.shape[1]}), one column per learner, got shape {values.shape}"
        )
    return class_values(values, matrix, rule, decoding)


def class_values(
    scores: FloatArray, coding_matrix: CodingMatrix, loss: BinaryLoss, decoding: str
) -> FloatArray:
    """`decode` for arguments whose names and shapes are checked already; looks at the scores only."""
    _check_scores(scores, loss)
    n_classes, n_learners = coding_matrix.shape
    steps, divisor = _steps(coding_matrix), DECODINGS[decoding](coding_matrix)
    values = np.empty((len(scores), n_classes))
    size = max(1, _BLOCK_BYTES // (16 * n_learners))
    for start in range(0, len(scores), size):
        block = scores[start : start + size]
        # Row l: the loss of a class with code +1 at learner l. Then the same for -1, then a row of zeros.
        costs = np.concatenate((loss(1, block).T, loss(-1, block).T, np.zeros((1, len(block)))))
        total = np.zeros((n_classes, len(block)))
        # One step adds the next learner of every class: as many steps as the busiest class has learners.
        for taken in steps:
            total += costs[taken]
        values[start : start + size] = -total.T / divisor
    return values


def _steps(matrix: CodingMatrix) -> npt.NDArray[np.intp]:
    """For each step and class the row of the cost of its next learner, or of the zeros when it has none."""
    n_classes, n_learners = matrix.shape
    classes, learners = np.nonzero(matrix)
    counts = np.bincount(classes, minlength=n_classes)
    step = np.arange(len(classes)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.full((int(counts.max()), n_classes), 2 * n_learners)
    rows[step, classes] = np.where(matrix[classes, learners] > 0, learners, n_learners + learners)
    return rows


def _check_scores(scores: FloatArray, loss: BinaryLoss) -> None:
    wrong = ~np.isfinite(scores) if loss.scores == "real" else ~((scores >= 0.0) & (scores <= 1.0))
    if wrong.any():
        row, learner = np.argwhere(wrong)[0]
        wanted = "finite" if loss.scores == "real" else f"in [0, 1] for loss={loss.name!r}"
        raise ValueError(f"scores must be {wanted}: scores[{row}, {learner}] is {scores[row, learner]}")
