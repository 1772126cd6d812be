"""Linear learners in the space of their features: dual solutions turned into weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id.ecoc.coding import CodingMatrix
from granular_id.ecoc.learners import DualLearners, fit_dual, fit_learners
from granular_id.gram import linear_gram

__all__ = ["PrimalLearners", "fit_features"]

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


def fit_features(
    rows: FloatArray,
    codes: IntArray,
    coding_matrix: CodingMatrix,
    *,
    standardize: bool,
    sample_weight: FloatArray | None,
    **options: Any,
) -> PrimalLearners:
    """Train each column of a coding matrix on features.

    Parameters
    ----------
    rows : ndarray, shape (n, D)
        Features, finite.
    codes : ndarray of int, shape (n,)
        Class index of each row.
    coding_matrix : ndarray of int8, shape (K, L)
        Codes -1, 0, +1.
    standardize : bool
        Centre and scale the features within the rows of each learner.
    sample_weight : ndarray, shape (n,), or None
        Non-negative weights.
    **options
        C, hard_margin, class_names of `granular_id.ecoc.learners.fit_dual`.

    Returns
    -------
    PrimalLearners
        In the units of `rows`, standardised or not.
    """
    n_learners = coding_matrix.shape[1]
    options["sample_weight"] = sample_weight
    if standardize:
        moments: list[tuple[FloatArray, FloatArray]] = []

        def gram_of(members: IntArray) -> FloatArray:
            own = rows[members]
            moments.append(
                _mean_and_deviation(own, None if sample_weight is None else sample_weight[members])
            )
            return linear_gram(own, center=moments[-1][0], scale=moments[-1][1])

        dual = fit_learners(gram_of, len(rows), codes, coding_matrix, **options)
    else:
        origin = rows.mean(axis=0)
        dual = fit_dual(linear_gram(rows, center=origin), codes, coding_matrix, **options)
        moments = [(origin, np.ones(1))] * n_learners
    coef = dual.dual_coef @ rows
    intercept = dual.intercept.copy()
    for learner, (mean, deviation) in enumerate(moments):
        # The multipliers sum to 0 up to rounding: taking off the rest keeps a large offset harmless.
        coef[learner] -= dual.dual_coef[learner].sum() * mean
        coef[learner] /= deviation  # once for each factor of a scaled product: a square could underflow
        coef[learner] /= deviation
        intercept[learner] -= coef[learner] @ mean
    return PrimalLearners(coef, intercept, dual)


def _mean_and_deviation(rows: FloatArray, weights: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Weighted mean and population standard deviation of each column; infinite for a constant column.

    Divided by infinity, a feature that says nothing becomes exactly 0, and so does its weight.
    """
    mean = np.average(rows, axis=0, weights=weights)
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
