"""Linear learners: a support vector machine for each column of a coding matrix, trained on the rows that it sees."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from joblib import effective_n_jobs
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.multiclass import check_classification_targets

from granular_id._checks import float_array
from granular_id._parallel import in_threads
from granular_id.ecoc.codings import CodingMatrix, onevsone
from granular_id.ecoc.svm import one_vs_one_guess, solve_binary
from granular_id.gram import check_symmetric

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Result = TypeVar("Result")

# Larger scalar products overflow in the sums that centre them.
_LARGEST_PRODUCT = 1e300
# Sums and ratios of weights beyond this, or below one over it, would leave the range of float64.
_EXTREME_WEIGHT = 1e100


@dataclass(frozen=True)
class Task:
    """Rows and the learners that see them.

    `matrix` (K, L) holds the codes, `index` (n,) the class index of each row, `weights` (n,) are not negative, None
    for all alike. `counted` are the indices of the rows with a weight above 0; `names` of the K classes serve messages.
    """

    matrix: CodingMatrix
    index: IntArray
    weights: FloatArray | None
    counted: IntArray
    names: Sequence[object]

    @classmethod
    def of(
        cls, matrix: CodingMatrix, index: IntArray, weights: FloatArray | None, names: Sequence[object]
    ) -> Task:
        """Task of all rows whose weight is above 0."""
        counted = np.arange(len(index)) if weights is None else np.flatnonzero(weights)
        return cls(matrix, index, weights, counted, names)

    @property
    def n_learners(self) -> int:
        """Number of columns L."""
        return int(self.matrix.shape[1])

    def of_rows(self, rows: IntArray) -> Task:
        """Task of some of the rows."""
        weights = None if self.weights is None else self.weights[rows]
        return Task.of(self.matrix, self.index[rows], weights, self.names)

    def rows(self, learner: int) -> IntArray:
        """Return the indices of the rows that a learner is trained on."""
        shown = self.matrix[self.index[self.counted], learner] != 0
        rows: IntArray = self.counted[shown]
        return rows

    def targets(self, learner: int, rows: IntArray) -> FloatArray:
        """+1.0 or -1.0 for each of the rows of a learner."""
        targets: FloatArray = self.matrix[self.index[rows], learner].astype(np.float64)
        return targets

    def described(self, learner: int) -> str:
        """Classes on the positive and on the negative side of a learner, as text for messages."""
        codes = self.matrix[:, learner]
        sides = ((self.names[k] for k in np.flatnonzero(codes == side).tolist()) for side in (1, -1))
        return " against ".join(", ".join(repr(str(name)) for name in side) for side in sides)


def class_indices(labels: npt.NDArray[Any], weights: FloatArray | None) -> tuple[npt.NDArray[Any], IntArray]:
    """Sorted classes of the rows that count, and the class index of each row (any for a row of weight 0)."""
    if labels.dtype.kind == "f" and np.isnan(labels).any():
        raise ValueError("y must hold a label for each row, got NaN")
    if labels.dtype.kind == "O" and None in labels.tolist():
        raise ValueError("y must hold a label for each row, got None")
    try:
        check_classification_targets(labels)
    except ValueError as reason:
        different = list(dict.fromkeys(map(repr, labels[:100].tolist())))
        raise ValueError(
            f"y must hold labels of one kind, text or whole numbers, got {', '.join(different[:3])}: {reason}"
        ) from None
    classes = np.unique(labels if weights is None else labels[weights > 0])
    if len(classes) < 2:
        raise ValueError(f"y holds one class only ({classes.tolist()[0]!r}): nothing to tell apart")
    return classes, np.minimum(np.searchsorted(classes, labels), len(classes) - 1)


def checked_weights(sample_weight: npt.ArrayLike, n_rows: int) -> FloatArray:
    """Return the weights of rows as float64, or say in a ValueError what is wrong with them."""
    weights = float_array("sample_weight", sample_weight)
    if weights.shape != (n_rows,):
        raise ValueError(f"sample_weight must have shape ({n_rows},), one per row, got shape {weights.shape}")
    if not np.isfinite(weights).all():
        raise ValueError("sample_weight must be finite: it contains NaN or inf")
    if weights.min() < 0:
        raise ValueError(f"sample_weight must not be negative, got {weights.min()}")
    if not weights.any():
        raise ValueError("sample_weight must not be zero for every row")
    least, most = float(weights[weights > 0].min()), float(weights.max())
    if least < 1.0 / _EXTREME_WEIGHT or most > _EXTREME_WEIGHT:
        raise ValueError(
            f"sample_weight must be 0 or from {1.0 / _EXTREME_WEIGHT:g} to {_EXTREME_WEIGHT:g}, "
            f"got {least:g} to {most:g}"
        )
    return weights


def checked_gram(products: FloatArray) -> FloatArray:
    """Return scalar products (n, n) of training rows, or say in a ValueError what is wrong with them."""
    if products.ndim != 2 or products.shape[0] != products.shape[1] or products.size == 0:
        raise ValueError(
            f"gram must be square, one row and column per training row, got shape {products.shape}"
        )
    if not np.isfinite(products).all():
        raise ValueError("gram must be finite: it contains NaN or inf")
    largest = float(np.abs(products).max())
    if largest > _LARGEST_PRODUCT:
        raise ValueError(
            f"gram must be within {_LARGEST_PRODUCT:g}, got up to {largest:g}: give the features another unit"
        )
    check_symmetric(products)
    return products


@dataclass(frozen=True)
class DualLearners:
    """Learners as weighted sums (L, n) of training rows; `intercept` (L,) is the score at the Gram matrix's origin."""

    dual_coef: FloatArray
    intercept: FloatArray
    alpha_at_bound: float

    def scores(self, gram: FloatArray) -> FloatArray:
        """Scores (m, L) of rows given as their scalar products (m, n) with the training rows."""
        return line_scores("gram", gram, self.dual_coef, self.intercept)


def line_scores(argument: str, rows: FloatArray, coef: FloatArray, intercept: FloatArray) -> FloatArray:
    """Scores (m, L) of rows (m, D) from weights (L, D) and intercepts (L,); a ValueError where they overflow."""
    with np.errstate(over="ignore", invalid="ignore"):  # reported below, with the argument's name
        scores: FloatArray = rows @ coef.T + intercept
    if not np.isfinite(scores).all():
        raise ValueError(f"{argument} must be finite, with scores in the range of float64")
    return scores


def fit_dual(gram: FloatArray, task: Task, cost: float, n_jobs: int | None = None) -> DualLearners:
    """Train each learner on its slice of one Gram matrix (n, n)."""
    with np.errstate(over="ignore"):  # `solve_binary` makes it finite
        bounds = cost * (np.ones(len(task.index)) if task.weights is None else task.weights)
    guess: Callable[[int, IntArray], FloatArray] | None = None
    if np.array_equal(task.matrix, onevsone(len(task.matrix))):
        # One call of libsvm for all pairs: 55 calls cost more in checks of their arguments than in work.
        rows = task.counted
        shared = gram if len(rows) == len(gram) else gram[np.ix_(rows, rows)]
        guess = one_vs_one_guess(shared, task.index[rows], bounds[rows])
    dual_coef = np.zeros((task.n_learners, len(task.index)))
    intercept = np.zeros(task.n_learners)

    def train(learner: int) -> tuple[int, int]:
        rows = task.rows(learner)
        start = None if guess is None else guess(learner, np.searchsorted(task.counted, rows))
        solution = solve_binary(
            gram[np.ix_(rows, rows)], task.targets(learner, rows), bounds[rows], guess=start
        )
        if not solution.converged:
            warnings.warn(
                f"the learner of {task.described(learner)} did not converge; scale the features or lower C",
                ConvergenceWarning,
                stacklevel=2,
            )
        dual_coef[learner, rows] = solution.dual_coef
        intercept[learner] = solution.intercept
        return solution.at_bound, len(rows)

    bounded, trained = np.sum(_over_learners(train, task.n_learners, n_jobs), axis=0)
    return DualLearners(dual_coef, intercept, float(bounded / trained))


def in_features(learned: DualLearners, rows: FloatArray, origin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weights (L, D) and intercepts (L,) on features (n, D), of learners trained on products about `origin` (D,)."""
    coef = learned.dual_coef @ rows
    intercept = learned.intercept.copy()
    for learner, own in enumerate(learned.dual_coef):
        # The multipliers sum to 0 up to rounding: taking off the rest keeps a large offset harmless.
        coef[learner] -= own.sum() * origin
        intercept[learner] -= coef[learner] @ origin
    return coef, intercept


def _over_learners(work: Callable[[int], Result], n_learners: int, n_jobs: int | None) -> list[Result]:
    """Do some work for the number of each learner, in threads; results in the order of the learners."""
    n_threads = min(effective_n_jobs(n_jobs), n_learners)
    if n_threads == 1:
        return [work(learner) for learner in range(n_learners)]

    def several(learners: IntArray) -> list[Result]:
        return [work(int(learner)) for learner in learners]

    # A linear learner takes less time than to hand it out: whole runs of them, a few for each thread.
    runs = np.array_split(np.arange(n_learners), min(n_learners, 4 * n_threads))
    done = in_threads(several, runs, n_threads)
    return [result for results in done for result in results]
