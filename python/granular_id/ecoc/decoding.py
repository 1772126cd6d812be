"""Decoding: the scores of all learners against the codes of each class, by a binary loss.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141 (loss-based decoding);
Escalera, Pujol, Radeva (2010), "On the decoding process in ternary error-correcting output codes", IEEE TPAMI
32:120-134 (loss-weighted decoding). Names, scale and score ranges of the losses are those of MATLAB's `fitcecoc`,
but for "root", which is ours: half way from votes (the power 0 of a score) to the hinge (the power 1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from granular_id._checks import float_array, named
from granular_id.ecoc.codings import CodingMatrix, check_coding_matrix

FloatArray = npt.NDArray[np.float64]

# Losses are made for as many rows at a time.
_BLOCK_BYTES = 10_000_000
# exp() is continued along its tangent from here on: exp(650) times any score of a float64 learner up to 1e6,
# summed over a million learners, still is a finite number.
_EXP_TANGENT_FROM = 650.0
# ... as far as the sum over any allowed number of learners is finite, and level from there.
_EXP_TANGENT_TO = 1e20


@dataclass(frozen=True)
class BinaryLoss:
    """What a score costs a class of code m: a function of the agreement z, 1/2 where the score says nothing.

    z is m * s for real scores, m * (2 s - 1) for scores in [0, 1] ("unit").
    """

    name: str
    of_agreement: Callable[[FloatArray], FloatArray]
    scores: str = "real"

    def __call__(self, code: int, scores: FloatArray) -> FloatArray:
        """Loss of each of `scores` for the code +1 or -1."""
        return self.of_agreement(code * (scores if self.scores == "real" else 2.0 * scores - 1.0))


def _root(z: FloatArray) -> FloatArray:
    graded: FloatArray = np.copysign(np.sqrt(np.abs(np.minimum(z, 1.0))), z)
    return (1.0 - graded) / 2.0


def _exponential(z: FloatArray) -> FloatArray:
    """``exp(-z) / 2``, along its tangent below z = -650."""
    beyond = np.clip(-z - _EXP_TANGENT_FROM, 0.0, _EXP_TANGENT_TO)
    inside: FloatArray = np.exp(np.minimum(-z, _EXP_TANGENT_FROM))
    return inside * (1.0 + beyond) / 2.0


LOSSES: Mapping[str, BinaryLoss] = MappingProxyType(
    {
        loss.name: loss
        for loss in (
            BinaryLoss("hinge", lambda z: np.maximum(0.0, 1.0 - z) / 2.0),
            BinaryLoss("hamming", lambda z: (1.0 - np.sign(z)) / 2.0),
            BinaryLoss("root", _root),
            BinaryLoss("linear", lambda z: (1.0 - z) / 2.0),
            BinaryLoss("exponential", _exponential),
            BinaryLoss("logit", lambda z: np.logaddexp(0.0, -z) / (2.0 * np.log(2.0))),
            BinaryLoss("binodeviance", lambda z: np.logaddexp(0.0, -2.0 * z) / (2.0 * np.log(2.0))),
            BinaryLoss("quadratic", lambda z: np.square(1.0 - z) / 2.0, scores="unit"),
        )
    }
)
"""Binary losses by name; each is finite for scores up to 1e6."""

SCORE_RANGES: Mapping[str, str] = MappingProxyType(
    {"real": "any real number, as decision_function gives", "unit": "a probability in [0, 1]"}
)
"""Ranges that scores of learners have, by the name in `BinaryLoss.scores`."""

DECODINGS: Mapping[str, Callable[[CodingMatrix], FloatArray]] = MappingProxyType(
    {
        "loss_weighted": lambda matrix: np.abs(matrix).sum(axis=1, dtype=np.float64),
        "loss_based": lambda matrix: np.full(matrix.shape[0], float(matrix.shape[1])),
    }
)
"""By what the summed loss of each class is divided, by the name of the decoding."""


def fitting_loss(loss: object, scores: str | None) -> BinaryLoss:
    """Loss of a name, if it fits the range of the scores (None: not known yet); "auto" is that range's default."""
    if isinstance(loss, str) and loss == "auto":
        return LOSSES["quadratic" if scores == "unit" else "hinge"]
    rule: BinaryLoss = named({"auto": None, **LOSSES}, "loss", loss)
    if scores is not None and rule.scores != scores:
        fitting = ", ".join(repr(name) for name, other in LOSSES.items() if other.scores == scores)
        raise ValueError(
            f"loss={loss!r} does not fit the learners: their score is {SCORE_RANGES[scores]}; "
            f"use 'auto' or one of {fitting}"
        )
    return rule


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
        A key of `granular_id.ecoc.LOSSES`. The hinge belongs to support vector machines, and is what the paper
        uses.
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
    >>> from granular_id.ecoc import decode, onevsone
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
    """`decode` for arguments whose names and shapes are checked already; refuses scores out of range only."""
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
