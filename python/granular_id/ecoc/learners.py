"""Linear learners: a support vector machine for each column of a coding matrix."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.exceptions import ConvergenceWarning

from granular_id.ecoc.codings import onevsone
from granular_id.ecoc.svm import NotSeparableError, one_vs_one_guess, solve_binary
from granular_id.ecoc.task import Task, over_learners
from granular_id.gram import linear_gram

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True)
class LinearLearner:
    """One binary learner of a fitted `ECOCClassifier`.

    Attributes
    ----------
    positive, negative : tuple
        Labels of the classes with code +1 and with code -1.
    support : ndarray of int
        Indices of its support vectors among the training rows.
    dual_coef : ndarray
        Weight of each support vector; its sign is the code of the row's class.
    intercept : float
        Score at the origin.
    """

    positive: tuple[Any, ...]
    negative: tuple[Any, ...]
    support: IntArray
    dual_coef: FloatArray
    intercept: float


@dataclass(frozen=True)
class DualLearners:
    """Learners as weighted sums (L, n) of training rows; `intercept` (L,) is the score at the Gram matrix's origin."""

    dual_coef: FloatArray
    intercept: FloatArray
    alpha_at_bound: float

    def scores(self, gram: FloatArray) -> FloatArray:
        """Scores (m, L) of rows given as their scalar products (m, n) with the training rows."""
        return line_scores("gram", gram, self.dual_coef, self.intercept)


@dataclass(frozen=True)
class PrimalLearners:
    """The same learners in the units of the features: a score is ``coef @ x + intercept``."""

    coef: FloatArray
    intercept: FloatArray
    dual: DualLearners

    def scores(self, rows: FloatArray) -> FloatArray:
        """Scores (m, L) of features (m, D)."""
        return line_scores("X", rows, self.coef, self.intercept)


def line_scores(argument: str, rows: FloatArray, coef: FloatArray, intercept: FloatArray) -> FloatArray:
    """Scores (m, L) of rows (m, D) from weights (L, D) and intercepts (L,); a ValueError where they overflow."""
    with np.errstate(over="ignore", invalid="ignore"):  # reported below, with the argument's name
        scores: FloatArray = rows @ coef.T + intercept
    if not np.isfinite(scores).all():
        raise ValueError(f"{argument} must be finite, with scores in the range of float64")
    return scores


def fit_dual(gram: FloatArray, task: Task, cost: float | None, n_jobs: int | None = None) -> DualLearners:
    """Train each learner on its slice of one Gram matrix (n, n); a cost of None asks for hard margins."""
    bounds = _bounds(task, cost)
    guess = None
    if np.array_equal(task.matrix, onevsone(len(task.matrix))):
        # One call of libsvm for all pairs: 55 calls cost more in checks of their arguments than in work.
        rows = task.counted
        shared = gram if len(rows) == len(gram) else gram[np.ix_(rows, rows)]
        guess = one_vs_one_guess(shared, task.index[rows], None if bounds is None else bounds[rows])
    return _train(task, bounds, lambda _, rows: gram[np.ix_(rows, rows)], guess, n_jobs)


def fit_standardized(
    rows: FloatArray, task: Task, cost: float | None, n_jobs: int | None = None
) -> PrimalLearners:
    """Train each learner on features (n, D) centred and scaled within its own rows."""
    moments: dict[int, tuple[FloatArray, FloatArray]] = {}

    def gram_of(learner: int, members: IntArray) -> FloatArray:
        own = rows[members]
        mean, deviation = moments[learner] = mean_and_deviation(own, task.weights_of(members))
        return linear_gram(own, center=mean, scale=deviation)

    dual = _train(task, _bounds(task, cost), gram_of, None, n_jobs)
    return in_features(dual, rows, [moments[learner] for learner in range(task.n_learners)])


def in_features(
    dual: DualLearners, rows: FloatArray, moments: Sequence[tuple[FloatArray, FloatArray]]
) -> PrimalLearners:
    """Learners trained on ``(rows - mean) / deviation``, with moments of their own, in the units of the features."""
    coef = dual.dual_coef @ rows
    intercept = dual.intercept.copy()
    for learner, (mean, deviation) in enumerate(moments):
        # The multipliers sum to 0 up to rounding: taking off the rest keeps a large offset harmless.
        coef[learner] -= dual.dual_coef[learner].sum() * mean
        coef[learner] /= deviation  # once for each factor of a scaled product: a square could underflow
        coef[learner] /= deviation
        intercept[learner] -= coef[learner] @ mean
    return PrimalLearners(coef, intercept, dual)


def mean_and_deviation(rows: FloatArray, weights: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Weighted mean and population standard deviation of each column; infinite for a constant column.

    Divided by infinity, a feature that says nothing becomes exactly 0, and so does its weight.
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


def _bounds(task: Task, cost: float | None) -> FloatArray | None:
    """Upper bound (n,) of each multiplier; None for a hard margin."""
    if cost is None:
        return None
    with np.errstate(over="ignore"):  # `solve_binary` makes it finite
        return cost * (np.ones(len(task.index)) if task.weights is None else task.weights)


def _train(
    task: Task,
    bounds: FloatArray | None,
    gram_of: Callable[[int, IntArray], FloatArray],
    guess: Callable[[int, IntArray], FloatArray] | None,
    n_jobs: int | None,
) -> DualLearners:
    """Train each learner on the scalar products that `gram_of` gives for its number and its rows."""
    dual_coef = np.zeros((task.n_learners, len(task.index)))
    intercept = np.zeros(task.n_learners)

    def train(learner: int) -> tuple[int, int]:
        rows = task.rows(learner)
        own_bounds = None if bounds is None else bounds[rows]
        start = None if guess is None else guess(learner, np.searchsorted(task.counted, rows))
        try:
            solution = solve_binary(
                gram_of(learner, rows), task.targets(learner, rows), own_bounds, guess=start
            )
        except NotSeparableError as reason:
            raise NotSeparableError(
                f"hard_margin=True, but classes {task.described(learner, ' and ')} cannot be separated: {reason}; "
                "use hard_margin=False"
            ) from None
        if not solution.converged:
            warnings.warn(
                f"the learner of {task.described(learner)} did not converge; scale the features or lower C",
                ConvergenceWarning,
                stacklevel=2,
            )
        dual_coef[learner, rows] = solution.dual_coef
        intercept[learner] = solution.intercept
        return solution.at_bound, len(rows)

    bounded, trained = np.sum(over_learners(train, task.n_learners, n_jobs), axis=0)
    return DualLearners(dual_coef, intercept, float(bounded / trained))
