"""Coding matrices, binary losses and decodings of error-correcting output codes.

A coding matrix has one row per class and one column per binary learner. Its entry says what a learner
makes of a class: +1 positive, -1 negative, 0 not shown to this learner. To decode, the scores of all
learners are compared with each row; the class whose row costs least wins.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141 (ternary codes,
loss-based decoding); Escalera, Pujol, Radeva (2010), "On the decoding process in ternary error-correcting
output codes", IEEE TPAMI 32:120-134 (loss-weighted decoding).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["DECODINGS", "LOSSES", "BinaryLoss", "check_coding_matrix", "decode", "named", "onevsone"]

FloatArray = npt.NDArray[np.float64]
CodingMatrix = npt.NDArray[np.int8]

# exp() is continued along its tangent from here on: exp(650) times any score of a float64 learner up to 1e6,
# summed over a million learners, still is a finite number.
_EXP_TANGENT_FROM = 650.0


def onevsone(n_classes: int) -> CodingMatrix:
    """Coding matrix of the one-vs-one design: one learner for each pair of classes.

    Parameters
    ----------
    n_classes : int
        Number of classes K, at least 2.

    Returns
    -------
    ndarray of int8, shape (K, K (K - 1) / 2)
        Columns in the order (0, 1), (0, 2), ..., (1, 2), ...: +1 for the lower class index, -1 for the
        higher.

    Raises
    ------
    ValueError
        `n_classes` is below 2.

    Examples
    --------
    >>> from granular_id.ecoc.coding import onevsone
    >>> onevsone(3)
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    """
    if n_classes < 2:
        raise ValueError(f"n_classes must be at least 2, got {n_classes}")
    pairs = np.array(list(combinations(range(n_classes), 2)))
    matrix = np.zeros((n_classes, len(pairs)), dtype=np.int8)
    learner = np.arange(len(pairs))
    matrix[pairs[:, 0], learner] = 1
    matrix[pairs[:, 1], learner] = -1
    return matrix


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
    if not np.isin(given, (-1, 0, 1)).all():
        raise ValueError("coding_matrix must hold -1, 0 and +1 only")
    matrix = given.astype(np.int8)
    for learner in range(matrix.shape[1]):
        if matrix[:, learner].max() != 1 or matrix[:, learner].min() != -1:
            raise ValueError(f"coding_matrix column {learner} must hold both +1 and -1")
    for row in range(matrix.shape[0]):
        if not matrix[row].any():
            raise ValueError(f"coding_matrix row {row} is all 0: no learner ever sees this class")
    return matrix


@dataclass(frozen=True)
class BinaryLoss:
    """What a score costs a class whose code is `m`: `g(m, s)`, 1/2 at ``m * s = 0``.

    Attributes
    ----------
    name : str
        Name in `LOSSES`.
    formula : str
        The definition, with z = m * s.
    of_agreement : callable
        The loss as a function of the agreement z = m * s.
    """

    name: str
    formula: str
    of_agreement: Callable[[FloatArray], FloatArray]

    def __call__(self, code: int, scores: FloatArray) -> FloatArray:
        """Loss of each of `scores` for the code +1 or -1."""
        return self.of_agreement(code * scores)


def _hamming(z: FloatArray) -> FloatArray:
    return (1.0 - np.sign(z)) / 2.0


def _linear(z: FloatArray) -> FloatArray:
    return (1.0 - z) / 2.0


def _hinge(z: FloatArray) -> FloatArray:
    return np.maximum(0.0, 1.0 - z) / 2.0


def _exponential(z: FloatArray) -> FloatArray:
    beyond = np.maximum(-z - _EXP_TANGENT_FROM, 0.0)
    inside: FloatArray = np.exp(np.minimum(-z, _EXP_TANGENT_FROM))
    return inside * (1.0 + beyond) / 2.0


def _logit(z: FloatArray) -> FloatArray:
    loss: FloatArray = np.logaddexp(0.0, -z) / (2.0 * np.log(2.0))
    return loss


def _binodeviance(z: FloatArray) -> FloatArray:
    loss: FloatArray = np.logaddexp(0.0, -2.0 * z) / (2.0 * np.log(2.0))
    return loss


LOSSES: Mapping[str, BinaryLoss] = MappingProxyType(
    {
        loss.name: loss
        for loss in (
            BinaryLoss("hinge", "max(0, 1 - z) / 2", _hinge),
            BinaryLoss("hamming", "(1 - sign(z)) / 2", _hamming),
            BinaryLoss("linear", "(1 - z) / 2", _linear),
            BinaryLoss("exponential", "exp(-z) / 2, along its tangent below z = -650", _exponential),
            BinaryLoss("logit", "log(1 + exp(-z)) / (2 log 2)", _logit),
            BinaryLoss("binodeviance", "log(1 + exp(-2 z)) / (2 log 2)", _binodeviance),
        )
    }
)
"""Binary losses by name; each is finite for scores up to 1e6."""


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
        Scores of the L binary learners; positive speaks for the classes with code +1.
    coding_matrix : array-like, shape (K, L)
        Codes -1, 0, +1.
    loss : str, default "hinge"
        A key of `LOSSES`. The hinge belongs to support vector machines, and is what the paper uses.
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
        Unknown `loss` or `decoding`, scores of the wrong shape, or not finite.

    Examples
    --------
    >>> from granular_id.ecoc.coding import decode, onevsone
    >>> decode([[2.0, 0.5, -1.0]], onevsone(3))
    array([[-0.125, -1.25 , -0.375]])
    """
    rule = named(LOSSES, "loss", loss)
    divisor_of = named(DECODINGS, "decoding", decoding)
    matrix = check_coding_matrix(coding_matrix)
    values = np.asarray(scores, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != matrix.shape[1]:
        raise ValueError(
            f"scores must have shape (n, {matrix.shape[1]}), one column per learner, got shape {values.shape}"
        )
    if not np.isfinite(values).all():
        row, learner = np.argwhere(~np.isfinite(values))[0]
        raise ValueError(f"scores must be finite: scores[{row}, {learner}] is {values[row, learner]}")
    agree, differ = rule(1, values), rule(-1, values)
    total = np.zeros((values.shape[0], matrix.shape[0]))
    for learner in range(matrix.shape[1]):
        codes = matrix[:, learner]
        total[:, codes == 1] += agree[:, learner, None]
        total[:, codes == -1] += differ[:, learner, None]
    mean_loss: FloatArray = total / divisor_of(matrix)
    return -mean_loss


def named(table: Mapping[str, Any], argument: str, name: object) -> Any:
    """Return an entry of `LOSSES` or `DECODINGS`, or raise a ValueError that lists the names."""
    if not isinstance(name, str) or name not in table:
        raise ValueError(f"{argument} must be one of {', '.join(map(repr, table))}, got {name!r}")
    return table[name]
