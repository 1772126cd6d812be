"""Linear learners in the space of their features: dual solutions turned into weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id.ecoc.coding_matrix import CodingMatrix
from granular_id.ecoc.learners import DualLearners, fit_dual, fit_learners, line_scores
from granular_id.ecoc.moments import mean_and_deviation
from granular_id.gram import linear_gram

__all__ = ["PrimalLearners", "fit_shared", "fit_standardized", "primal_of"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True)
class PrimalLearners:
    """Learners whose score is ``coef @ x + intercept``.

    Attributes
    ----------
    coef : ndarray, shape (L, D)
    intercept : ndarray, shape (L,)
    dual : DualLearners
        The same learners as weighted sums of rows (centred, and scaled when standardised).
    """

    coef: FloatArray
    intercept: FloatArray
    dual: DualLearners

    def scores(self, rows: FloatArray) -> FloatArray:
        """Scores (m, L) of features (m, D)."""
        return line_scores("X", rows, self.coef, self.intercept)


def primal_of(
    dual: DualLearners,
    rows: FloatArray,
    moments: Sequence[tuple[FloatArray, FloatArray]],
) -> PrimalLearners:
    """Learners in the units of the features, from their dual form.

    Parameters
    ----------
    dual : DualLearners
        Trained on the scalar products of ``(rows - mean) / deviation``.
    rows : ndarray, shape (n, D)
        Training rows.
    moments : sequence of (mean, deviation)
        For each learner, shapes (D,) or what broadcasts to it.
    """
    coef = dual.dual_coef @ rows
    intercept = dual.intercept.copy()
    for learner, (mean, deviation) in enumerate(moments):
        # The multipliers sum to 0 up to rounding: taking off the rest keeps a large offset harmless.
        coef[learner] -= dual.dual_coef[learner].sum() * mean
        coef[learner] /= deviation  # once for each factor of a scaled product: a square could underflow
        coef[learner] /= deviation
        intercept[learner] -= coef[learner] @ mean
    return PrimalLearners(coef, intercept, dual)


def fit_shared(
    rows: FloatArray,
    origin: FloatArray,
    gram: FloatArray,
    codes: IntArray,
    matrix: CodingMatrix,
    **options: Any,
) -> PrimalLearners:
    """Train each column of a coding matrix on one Gram matrix.

    Parameters
    ----------
    rows : ndarray, shape (n, D)
        Features, finite.
    origin : ndarray, shape (D,)
        Point about which the products are taken.
    gram : ndarray, shape (n, n)
        ``linear_gram(rows, center=origin)``.
    codes : ndarray of int, shape (n,)
        Class index of each row.
    matrix : ndarray of int8, shape (K, L)
        Codes -1, 0, +1.
    **options
        Of `granular_id.ecoc.learners.fit_dual`.
    """
    dual = fit_dual(gram, codes, matrix, **options)
    return primal_of(dual, rows, [(origin, np.ones(1))] * matrix.shape[1])


def fit_standardized(
    rows: FloatArray,
    codes: IntArray,
    matrix: CodingMatrix,
    *,
    sample_weight: FloatArray | None,
    **options: Any,
) -> PrimalLearners:
    """Train each column of a coding matrix on features centred and scaled within the rows of that learner.

    Parameters
    ----------
    rows, codes, matrix
        As in `fit_shared`.
    sample_weight : ndarray, shape (n,), or None
        Non-negative weights, of the moments too.
    **options
        Others of `granular_id.ecoc.learners.fit_dual`.

    Returns
    -------
    PrimalLearners
        In the units of `rows`.
    """
    moments: dict[int, tuple[FloatArray, FloatArray]] = {}

    def gram_of(learner: int, members: IntArray) -> FloatArray:
        own = rows[members]
        weights = None if sample_weight is None else sample_weight[members]
        mean, deviation = moments[learner] = mean_and_deviation(own, weights)
        return linear_gram(own, center=mean, scale=deviation)

    dual = fit_learners(gram_of, len(rows), codes, matrix, sample_weight=sample_weight, **options)
    return primal_of(dual, rows, [moments[learner] for learner in range(matrix.shape[1])])
