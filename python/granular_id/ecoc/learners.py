"""Many linear learners: each column of a coding matrix trains on scalar products of the rows it sees."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.exceptions import ConvergenceWarning

from granular_id._checks import float_array
from granular_id.ecoc.codings import CodingMatrix, onevsone
from granular_id.ecoc.svm import (
    BinarySolution,
    NotSeparableError,
    OneVsOneGuess,
    one_vs_one_guess,
    solve_binary,
)
from granular_id.ecoc.training import Task, checked_cost, checked_gram, checked_task, over_learners
from granular_id.gram import linear_gram

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


def line_scores(argument: str, rows: FloatArray, coef: FloatArray, intercept: FloatArray) -> FloatArray:
    """Scores (m, L) of rows (m, D) from weights (L, D) and intercepts (L,); a ValueError where they overflow."""
    with np.errstate(over="ignore", invalid="ignore"):  # reported below, with the argument's name
        scores: FloatArray = rows @ coef.T + intercept
    if not np.isfinite(scores).all():
        raise ValueError(f"{argument} must be finite, with scores in the range of float64")
    return scores


@dataclass(frozen=True)
class DualLearners:
    """Linear learners as weighted sums of training rows.

    Attributes
    ----------
    dual_coef : ndarray, shape (L, n)
        Weight of each training row in each learner; a row of zeros elsewhere than at the support vectors.
    intercept : ndarray, shape (L,)
        Score of each learner at the origin of the Gram matrix.
    alpha_at_bound : float
        Share of the dual variables of all learners that sit at their upper bound.
    """

    dual_coef: FloatArray
    intercept: FloatArray
    alpha_at_bound: float

    @property
    def support(self) -> npt.NDArray[np.bool_]:
        """Mask (L, n) of the support vectors."""
        mask: npt.NDArray[np.bool_] = self.dual_coef != 0
        return mask

    def scores(self, gram: npt.ArrayLike) -> FloatArray:
        """Scores (m, L) of rows given as their scalar products (m, n) with the training rows."""
        rows = float_array("gram", gram)
        if rows.ndim != 2 or rows.shape[1] != self.dual_coef.shape[1]:
            raise ValueError(
                f"gram must have shape (m, {self.dual_coef.shape[1]}), one column per training row, "
                f"got shape {rows.shape}"
            )
        return line_scores("gram", rows, self.dual_coef, self.intercept)


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

    @classmethod
    def of_column(
        cls, classes: npt.NDArray[Any], codes: CodingMatrix, dual_coef: FloatArray, intercept: float
    ) -> LinearLearner:
        """Name the classes (K,) behind a column of codes (K,), and keep the support vectors of (n,) rows."""
        positive, negative = (tuple(classes[codes == side].tolist()) for side in (1, -1))
        support = np.flatnonzero(dual_coef)
        return cls(positive, negative, support, dual_coef[support], intercept)


def fit_dual(
    gram: npt.ArrayLike,
    codes: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    C: float = 1.0,
    *,
    hard_margin: bool = False,
    sample_weight: npt.ArrayLike | None = None,
    class_names: Sequence[object] | None = None,
    n_jobs: int | None = None,
) -> DualLearners:
    """Train each column of a coding matrix on its slice of a shared Gram matrix.

    Parameters
    ----------
    gram : array-like, shape (n, n)
        Scalar products of the training rows, see `linear_gram`.
    codes : array-like of int, shape (n,)
        Class index of each row, a row of `coding_matrix`.
    coding_matrix : array-like, shape (K, L)
        Codes -1, 0, +1.
    C : float, default 1.0
        Cost of a violated margin; not used when `hard_margin` is True.
    hard_margin : bool, default False
        Allow no violation at all. An error when two classes overlap.
    sample_weight : array-like, shape (n,), optional
        Non-negative factors of C; a whole number equals as many repetitions of the row, 0 leaves it out.
    class_names : sequence, optional
        K names for messages; the class indices when not given.
    n_jobs : int, optional
        Threads, as in joblib; the numbers do not depend on it.

    Returns
    -------
    DualLearners

    Raises
    ------
    TypeError, ValueError
        Shapes that do not fit, a Gram matrix that is not finite and symmetric, a class index without a row in
        `coding_matrix`, a learner without rows of both signs, a cost or weights out of range, or
        `hard_margin` and classes that overlap.

    Examples
    --------
    >>> from granular_id.ecoc.codings import onevsone
    >>> from granular_id.gram import linear_gram
    >>> from granular_id.ecoc.learners import fit_dual
    >>> X = [[0.0], [1.0], [3.0], [4.0]]
    >>> learners = fit_dual(linear_gram(X), [0, 0, 1, 1], onevsone(2), hard_margin=True)
    >>> learners.scores(linear_gram([[2.0], [1.0]], X)).round(9)
    array([[0.],
           [1.]])
    """
    products = checked_gram(gram)
    task = checked_task(len(products), codes, coding_matrix, sample_weight, class_names)
    bounds = _bounds(task, C, hard_margin)
    guess = None
    if np.array_equal(task.matrix, onevsone(len(task.matrix))):
        # One call of libsvm for all pairs: 55 calls cost more in checks of their arguments than in work.
        rows = task.counted
        shared = products if len(rows) == len(products) else products[np.ix_(rows, rows)]
        guess = one_vs_one_guess(shared, task.index[rows], None if bounds is None else bounds[rows])
    return _train(task, bounds, lambda _, rows: products[np.ix_(rows, rows)], guess, n_jobs)


def fit_learners(
    gram_of: Callable[[int, IntArray], FloatArray],
    n_rows: int,
    codes: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    C: float = 1.0,
    *,
    hard_margin: bool = False,
    sample_weight: npt.ArrayLike | None = None,
    class_names: Sequence[object] | None = None,
    n_jobs: int | None = None,
) -> DualLearners:
    """Train each learner on the Gram matrix that `gram_of` gives for its rows; see `fit_dual`.

    Parameters
    ----------
    gram_of : callable
        From the number of a learner and the indices (r,) of its rows to their scalar products (r, r), which may
        be in units of this learner alone. Called once for each learner, from any thread.
    n_rows : int
        Number of training rows.
    codes, coding_matrix, C, hard_margin, sample_weight, class_names, n_jobs
        As in `fit_dual`.
    """
    task = checked_task(n_rows, codes, coding_matrix, sample_weight, class_names)
    return _train(task, _bounds(task, C, hard_margin), gram_of, None, n_jobs)


def _bounds(task: Task, C: float, hard_margin: bool) -> FloatArray | None:
    """Upper bound (n,) of each multiplier; None for a hard margin."""
    cost = checked_cost(C)
    if hard_margin:
        return None
    with np.errstate(over="ignore"):  # `upper_bounds` makes it finite
        return cost * (np.ones(len(task.index)) if task.weights is None else task.weights)


def _train(
    task: Task,
    bounds: FloatArray | None,
    gram_of: Callable[[int, IntArray], FloatArray],
    guess: OneVsOneGuess | None,
    n_jobs: int | None,
) -> DualLearners:
    dual_coef = np.zeros((task.n_learners, len(task.index)))
    intercept = np.zeros(task.n_learners)

    def train(learner: int) -> tuple[int, int]:
        rows = task.rows(learner)
        solution = _solve(
            gram_of(learner, rows),
            task.targets(learner, rows),
            None if bounds is None else bounds[rows],
            None if guess is None else guess.of_rows(learner, np.searchsorted(task.counted, rows)),
            lambda: task.sides(learner),
        )
        dual_coef[learner, rows] = solution.dual_coef
        intercept[learner] = solution.intercept
        return solution.at_bound, len(rows)

    bounded, trained = np.sum(over_learners(train, task.n_learners, n_jobs), axis=0)
    return DualLearners(dual_coef, intercept, float(bounded / trained))


def _solve(
    gram: FloatArray,
    targets: FloatArray,
    bounds: FloatArray | None,
    guess: FloatArray | None,
    sides: Callable[[], tuple[str, str]],
) -> BinarySolution:
    """Train one learner; errors and warnings name its classes."""
    try:
        solution = solve_binary(gram, targets, bounds, guess=guess)
    except NotSeparableError as reason:
        positive, negative = sides()
        raise NotSeparableError(
            f"hard_margin=True, but classes {positive} and {negative} cannot be separated: {reason}; "
            "use hard_margin=False"
        ) from None
    if not solution.converged:
        positive, negative = sides()
        warnings.warn(
            f"the learner of {positive} against {negative} did not converge; scale the features or lower C",
            ConvergenceWarning,
            stacklevel=2,
        )
    return solution


# Linear learners in the space of their features: dual solutions turned into weights.


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


# Mean and deviation of features, as each learner sees them.


def mean_and_deviation(rows: FloatArray, weights: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Weighted mean and population standard deviation of each column; infinite for a constant column.

    Divided by infinity, a feature that says nothing becomes exactly 0, and so does its weight.

    Raises
    ------
    ValueError
        Columns whose sum is beyond the range of float64.
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
