"""Many linear learners: each column of a coding matrix trains on scalar products of the rows it sees."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.exceptions import ConvergenceWarning

from granular_id.ecoc.coding import CodingMatrix, check_coding_matrix, onevsone
from granular_id.ecoc.dual_svm import BinarySolution, NotSeparableError, one_vs_one_guess, solve_binary
from granular_id.ecoc.training import checked_cost, checked_weights

__all__ = ["DualLearners", "LinearLearner", "fit_dual", "fit_learners"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


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
        rows = np.asarray(gram, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != self.dual_coef.shape[1]:
            raise ValueError(
                f"gram must have shape (m, {self.dual_coef.shape[1]}), one column per training row, "
                f"got shape {rows.shape}"
            )
        scores: FloatArray = rows @ self.dual_coef.T + self.intercept
        return scores


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
    >>> from granular_id.ecoc.coding import onevsone
    >>> from granular_id.gram import linear_gram
    >>> from granular_id.ecoc.learners import fit_dual
    >>> X = [[0.0], [1.0], [3.0], [4.0]]
    >>> learners = fit_dual(linear_gram(X), [0, 0, 1, 1], onevsone(2), hard_margin=True)
    >>> learners.scores(linear_gram([[2.0], [1.0]], X)).round(9)
    array([[0.],
           [1.]])
    """
    products = _check_gram(gram)
    task = _checked_task(
        len(products),
        codes,
        coding_matrix,
        C=C,
        hard_margin=hard_margin,
        weights=sample_weight,
        names=class_names,
    )
    guess = None
    if np.array_equal(task.matrix, onevsone(len(task.matrix))):
        # One call of libsvm for all pairs: 55 calls cost more in checks of their arguments than in work.
        rows = task.counted
        guess = np.zeros((task.matrix.shape[1], len(products)))
        bounds = None if task.bounds is None else task.bounds[rows]
        shared = products if len(rows) == len(products) else products[np.ix_(rows, rows)]
        guess[:, rows] = one_vs_one_guess(shared, task.index[rows], bounds)
    return _train(task, lambda rows: products[np.ix_(rows, rows)], guess)


def fit_learners(
    gram_of: Callable[[IntArray], FloatArray],
    n_rows: int,
    codes: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    C: float = 1.0,
    *,
    hard_margin: bool = False,
    sample_weight: npt.ArrayLike | None = None,
    class_names: Sequence[object] | None = None,
) -> DualLearners:
    """Train each learner on the Gram matrix that `gram_of` gives for its rows; see `fit_dual`.

    Parameters
    ----------
    gram_of : callable
        From the indices (r,) of a learner's rows to their scalar products (r, r), which may be in units of
        this learner alone. Called once for each learner, in order.
    n_rows : int
        Number of training rows.
    codes, coding_matrix, C, hard_margin, sample_weight, class_names
        As in `fit_dual`.
    """
    task = _checked_task(
        n_rows, codes, coding_matrix, C=C, hard_margin=hard_margin, weights=sample_weight, names=class_names
    )
    return _train(task, gram_of, None)


@dataclass(frozen=True)
class _Task:
    """Checked input: `bounds` (n,) of the multipliers or None (hard margin), rows that count."""

    matrix: CodingMatrix
    index: IntArray
    bounds: FloatArray | None
    counted: IntArray
    names: Sequence[object]


def _checked_task(
    n_rows: int,
    codes: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    *,
    C: float,
    hard_margin: bool,
    weights: npt.ArrayLike | None,
    names: Sequence[object] | None,
) -> _Task:
    matrix = check_coding_matrix(coding_matrix)
    index = np.asarray(codes)
    if index.shape != (n_rows,) or index.dtype.kind not in "iu":
        raise ValueError(f"codes must be {n_rows} integers, got shape {index.shape} of {index.dtype}")
    if index.min() < 0 or index.max() >= len(matrix):
        raise ValueError(f"codes must lie in 0..{len(matrix) - 1}, the rows of coding_matrix")
    factors = np.ones(n_rows) if weights is None else checked_weights(weights, n_rows)
    cost = checked_cost(C)
    called = range(len(matrix)) if names is None else names
    counted = np.flatnonzero(factors)
    present = np.isin(np.arange(len(matrix)), index[counted])
    if not present.all():
        absent = called[int(np.argmin(present))]
        raise ValueError(f"class {str(absent)!r} has no training rows, or none with a weight above 0")
    return _Task(matrix, index.astype(np.intp), None if hard_margin else cost * factors, counted, called)


def _train(task: _Task, gram_of: Callable[[IntArray], FloatArray], guess: FloatArray | None) -> DualLearners:
    dual_coef = np.zeros((task.matrix.shape[1], len(task.index)))
    intercept = np.zeros(task.matrix.shape[1])
    bounded = trained = 0
    for learner, column in enumerate(task.matrix.T):
        rows = task.counted[column[task.index[task.counted]] != 0]
        solution = _solve(
            gram_of(rows),
            column[task.index[rows]].astype(np.float64),
            None if task.bounds is None else task.bounds[rows],
            None if guess is None else guess[learner, rows],
            _sides(column, task.names),
        )
        dual_coef[learner, rows] = solution.dual_coef
        intercept[learner] = solution.intercept
        bounded += solution.at_bound
        trained += len(rows)
    return DualLearners(dual_coef, intercept, bounded / trained)


def _check_gram(gram: npt.ArrayLike) -> FloatArray:
    products = np.asarray(gram, dtype=np.float64)
    if products.ndim != 2 or products.shape[0] != products.shape[1] or products.size == 0:
        raise ValueError(
            f"gram must be square, one row and column per training row, got shape {products.shape}"
        )
    if not np.isfinite(products).all():
        raise ValueError("gram must be finite: it contains NaN or inf")
    # Products from `linear_gram` are equal to the last bit and need no tolerance, nor the copies that it takes.
    symmetric = np.array_equal(products, products.T)
    if not symmetric and np.abs(products - products.T).max() > 1e-9 * np.abs(products).max():
        raise ValueError("gram must be symmetric: element (i, j) is the scalar product of rows i and j")
    return products


def _sides(column: npt.NDArray[np.int8], names: Sequence[object]) -> tuple[str, str]:
    """Classes on the positive and on the negative side of a learner, as text for messages."""
    positive, negative = (
        ", ".join(repr(str(names[int(k)])) for k in np.flatnonzero(column == side)) for side in (1, -1)
    )
    return positive, negative


def _solve(
    gram: FloatArray,
    targets: FloatArray,
    bounds: FloatArray | None,
    guess: FloatArray | None,
    sides: tuple[str, str],
) -> BinarySolution:
    """Train one learner; errors and warnings name its classes."""
    positive, negative = sides
    try:
        solution = solve_binary(gram, targets, bounds, guess=guess)
    except NotSeparableError as reason:
        raise NotSeparableError(
            f"hard_margin=True, but classes {positive} and {negative} cannot be separated: {reason}; "
            "use hard_margin=False"
        ) from None
    if not solution.converged:
        warnings.warn(
            f"the learner of {positive} against {negative} did not converge; scale the features or lower C",
            ConvergenceWarning,
            stacklevel=2,
        )
    return solution
