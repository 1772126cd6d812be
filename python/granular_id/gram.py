"""One Gram matrix, many learners.

With 10,200 features and 550 rows all the work of a linear support vector machine sits in its scalar products. They
are computed once here; every binary learner trains on a slice, and its weights come back as a weighted
sum of rows. An evaluation over many partitions slices the same matrix again and again.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from sklearn.exceptions import ConvergenceWarning

from granular_id.coding import check_coding_matrix
from granular_id.dual_svm import BinarySolution, NotSeparableError, solve_binary

__all__ = ["DualLearners", "fit_dual", "fit_learners", "linear_gram"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Columns are centred and multiplied in blocks of this size, so that no copy of X is ever made.
_BLOCK_BYTES = 4_000_000


def linear_gram(
    X: npt.ArrayLike,
    Y: npt.ArrayLike | None = None,
    *,
    center: npt.ArrayLike | None = None,
    scale: npt.ArrayLike | None = None,
) -> FloatArray:
    """Scalar products of the rows of `X` with each other, or with the rows of `Y`.

    Parameters
    ----------
    X : array-like, shape (n, D)
        One row per recording.
    Y : array-like, shape (m, D), optional
        Other rows; `X` itself when not given.
    center : array-like, shape (D,), optional
        Subtracted from each row first. A linear learner with an intercept gives the same scores for
        any origin, so this changes rounding only; take the mean of all rows when columns carry large offsets.
    scale : array-like, shape (D,), optional
        Each centred column is divided by this.

    Returns
    -------
    ndarray of float64, shape (n, n) or (n, m)

    Raises
    ------
    ValueError
        Wrong rank or sizes that do not fit; NaN, infinity or products beyond the range of float64.

    Examples
    --------
    >>> from granular_id.gram import linear_gram
    >>> linear_gram([[1.0, 2.0], [3.0, 4.0]])
    array([[ 5., 11.],
           [11., 25.]])
    """
    left = _rows("X", X)
    right = left if Y is None else _rows("Y", Y)
    n_columns = left.shape[1]
    if right.shape[1] != n_columns:
        raise ValueError(f"Y must have {n_columns} columns as X has, got {right.shape[1]}")
    origin = _per_column("center", center, n_columns)
    unit = _per_column("scale", scale, n_columns)
    if unit is not None and not (unit > 0).all():
        raise ValueError("scale must be positive in each column")
    step = max(64, _BLOCK_BYTES // (8 * max(len(left), len(right))))
    gram = np.zeros((len(left), len(right)))
    product = np.empty_like(gram)
    with np.errstate(over="ignore", invalid="ignore"):  # reported below, with the argument's name
        for start in range(0, n_columns, step):
            columns = slice(start, min(start + step, n_columns))
            block = _moved(left, columns, origin, unit)
            other = block if right is left else _moved(right, columns, origin, unit)
            np.matmul(block, other.T, out=product)
            gram += product
    if not np.isfinite(gram).all():
        raise ValueError(
            "X and Y must be finite (no NaN, no inf), with scalar products in the range of float64"
        )
    return gram


def _rows(argument: str, values: npt.ArrayLike) -> FloatArray:
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 2 or 0 in rows.shape:
        raise ValueError(f"{argument} must have shape (n >= 1, D >= 1), got shape {rows.shape}")
    return rows


def _per_column(argument: str, values: npt.ArrayLike | None, n_columns: int) -> FloatArray | None:
    if values is None:
        return None
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (n_columns,):
        raise ValueError(f"{argument} must have shape ({n_columns},), got shape {vector.shape}")
    return vector


def _moved(rows: FloatArray, columns: slice, origin: FloatArray | None, unit: FloatArray | None) -> FloatArray:
    block = rows[:, columns] - (0.0 if origin is None else origin[columns])
    if unit is not None:
        block /= unit[columns]
    return block


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
        return self.dual_coef != 0

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
    ValueError
        Shapes that do not fit, a Gram matrix that is not finite and symmetric, a class index without a row in
        `coding_matrix`, a learner without rows of both signs, or `hard_margin` and classes that overlap.

    Examples
    --------
    >>> from granular_id.coding import onevsone
    >>> from granular_id.gram import fit_dual, linear_gram
    >>> X = [[0.0], [1.0], [3.0], [4.0]]
    >>> learners = fit_dual(linear_gram(X), [0, 0, 1, 1], onevsone(2), hard_margin=True)
    >>> learners.scores(linear_gram([[2.0], [1.0]], X)).round(9)
    array([[0.],
           [1.]])
    """
    products = _check_gram(gram)
    return fit_learners(
        lambda rows: products[np.ix_(rows, rows)],
        len(products),
        codes,
        coding_matrix,
        C=C,
        hard_margin=hard_margin,
        sample_weight=sample_weight,
        class_names=class_names,
    )


def fit_learners(
    gram_of: Callable[[IntArray], FloatArray],
    n_rows: int,
    codes: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    *,
    C: float,
    hard_margin: bool,
    sample_weight: npt.ArrayLike | None,
    class_names: Sequence[object] | None,
) -> DualLearners:
    """Train each learner on the Gram matrix that `gram_of` gives for its rows; see `fit_dual`.

    Parameters
    ----------
    gram_of : callable
        From the indices (r,) of a learner's rows to their scalar products (r, r), which may be in units of
        this learner alone.
    n_rows : int
        Number of training rows.
    codes, coding_matrix, C, hard_margin, sample_weight, class_names
        As in `fit_dual`.
    """
    matrix = check_coding_matrix(coding_matrix)
    index = np.asarray(codes)
    if index.shape != (n_rows,) or index.dtype.kind not in "iu":
        raise ValueError(f"codes must be {n_rows} integers, got shape {index.shape} of {index.dtype}")
    if index.min() < 0 or index.max() >= len(matrix):
        raise ValueError(f"codes must lie in 0..{len(matrix) - 1}, the rows of coding_matrix")
    weights = None if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
    if weights is not None and (weights.shape != index.shape or not (weights >= 0).all()):
        raise ValueError(f"sample_weight must be {n_rows} numbers >= 0")
    names = range(len(matrix)) if class_names is None else class_names

    dual_coef = np.zeros((matrix.shape[1], n_rows))
    intercept = np.zeros(matrix.shape[1])
    bounded = trained = 0
    for learner, column in enumerate(matrix.T):
        shown = column[index] != 0
        if weights is not None:
            shown &= weights > 0
        rows = np.flatnonzero(shown)
        targets = column[index[rows]].astype(np.float64)
        sides = _sides(column, names)
        _check_both_sides(targets, sides)
        bounds = None
        if not hard_margin:
            bounds = np.full(len(rows), C) if weights is None else C * weights[rows]
        solution = _solve(gram_of(rows), targets, bounds, sides)
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
    if np.abs(products - products.T).max() > 1e-9 * np.abs(products).max():
        raise ValueError("gram must be symmetric: element (i, j) is the scalar product of rows i and j")
    return products


def _sides(column: npt.NDArray[np.int8], names: Sequence[object]) -> tuple[str, str]:
    """Classes on the positive and on the negative side of a learner, as text for messages."""
    positive, negative = (
        ", ".join(repr(str(names[k])) for k in np.flatnonzero(column == side)) for side in (1, -1)
    )
    return positive, negative


def _check_both_sides(targets: FloatArray, sides: tuple[str, str]) -> None:
    for side, name in zip((1.0, -1.0), sides, strict=True):
        if not (targets == side).any():
            raise ValueError(f"class {name} has no training rows, or none with a weight above 0")


def _solve(
    gram: FloatArray, targets: FloatArray, bounds: FloatArray | None, sides: tuple[str, str]
) -> BinarySolution:
    """Train one learner; errors and warnings name its classes."""
    positive, negative = sides
    try:
        solution = solve_binary(gram, targets, bounds)
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
