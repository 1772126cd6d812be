"""What learners are trained with, checked: names of options, cost of a violated margin, weights of rows, classes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from joblib import effective_n_jobs
from sklearn.utils.multiclass import check_classification_targets

from granular_id._checks import float_array, real_number
from granular_id._parallel import in_threads
from granular_id.ecoc.codings import CodingMatrix, check_coding_matrix
from granular_id.gram import check_symmetric

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_EXTREME_WEIGHT = 1e100


def checked_cost(C: object) -> float:
    """Return the cost `C` of a violated margin as a float, or say what is wrong with it.

    Raises
    ------
    TypeError
        `C` is not a number.
    ValueError
        `C` is not positive and finite.
    """
    cost = real_number("C", C)
    if not 0 < cost < math.inf:
        raise ValueError(f"C must be positive and finite, got {cost!r}; for no limit hard_margin=True")
    return cost


def checked_weights(sample_weight: npt.ArrayLike, n_rows: int) -> FloatArray:
    """Return the weights of rows, shape (n_rows,), as float64.

    Raises
    ------
    ValueError
        Another shape, NaN, infinity, a negative weight, none above 0, or one so large or small that sums and
        ratios of weights would leave the range of float64.
    """
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


def _examples(labels: npt.NDArray[Any]) -> str:
    """Text of the first few different labels, for a message."""
    different = dict.fromkeys(map(repr, labels[:100].tolist()))
    return ", ".join(list(different)[:3])


def class_indices(labels: npt.NDArray[Any], weights: FloatArray | None) -> tuple[npt.NDArray[Any], IntArray]:
    """Return the classes of the rows that count, sorted, and the index of each row's class.

    Parameters
    ----------
    labels : ndarray, shape (n,)
        One label per row.
    weights : ndarray, shape (n,), or None
        From `checked_weights`.

    Returns
    -------
    classes : ndarray, shape (K,)
        Labels of the rows with a weight above 0.
    codes : ndarray of int, shape (n,)
        Class index of each row; any index for a row of weight 0, which training leaves out.

    Raises
    ------
    ValueError
        Labels that are no classes, or fewer than two of them.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc.training import class_indices
    >>> class_indices(np.array(["rice", "oat", "rice"]), None)
    (array(['oat', 'rice'], dtype='<U4'), array([1, 0, 1]))
    """
    if labels.dtype.kind == "f" and np.isnan(labels).any():
        raise ValueError("y must hold a label for each row, got NaN")
    try:
        check_classification_targets(labels)
    except ValueError as reason:
        raise ValueError(
            f"y must hold labels of one kind, text or whole numbers, got {_examples(labels)}: {reason}"
        ) from None
    classes = np.unique(labels if weights is None else labels[weights > 0])
    if len(classes) < 2:
        raise ValueError(f"y holds one class only ({classes.tolist()[0]!r}): nothing to tell apart")
    return classes, np.minimum(np.searchsorted(classes, labels), len(classes) - 1)


# What many learners are trained on, checked once: classes, weights, which rows each learner sees.

Result = TypeVar("Result")

_LARGEST_PRODUCT = 1e300
"""Larger scalar products overflow in the sums that centre them."""


@dataclass(frozen=True)
class Task:
    """Rows and learners that fit together; made by `checked_task`.

    Attributes
    ----------
    matrix : ndarray of int8, shape (K, L)
        Codes -1, 0, +1.
    index : ndarray of int, shape (n,)
        Class index of each row.
    weights : ndarray, shape (n,), or None
        Non-negative weights of the rows.
    counted : ndarray of int
        Indices of the rows with a weight above 0.
    names : sequence
        K names of classes, for messages.
    """

    matrix: CodingMatrix
    index: IntArray
    weights: FloatArray | None
    counted: IntArray
    names: Sequence[object]

    @property
    def n_learners(self) -> int:
        """Number of columns L."""
        return int(self.matrix.shape[1])

    def rows(self, learner: int) -> IntArray:
        """Return the indices of the rows that a learner is trained on."""
        shown = self.matrix[self.index[self.counted], learner] != 0
        rows: IntArray = self.counted[shown]
        return rows

    def targets(self, learner: int, rows: IntArray) -> FloatArray:
        """+1.0 or -1.0 for each of the rows of a learner."""
        targets: FloatArray = self.matrix[self.index[rows], learner].astype(np.float64)
        return targets

    def sides(self, learner: int) -> tuple[str, str]:
        """Classes on the positive and on the negative side of a learner, as text for messages."""
        column = self.matrix[:, learner]
        positive, negative = (
            ", ".join(repr(str(self.names[int(k)])) for k in np.flatnonzero(column == side))
            for side in (1, -1)
        )
        return positive, negative


def checked_task(
    n_rows: int,
    codes: npt.ArrayLike,
    coding_matrix: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    names: Sequence[object] | None = None,
) -> Task:
    """Check that rows, classes, weights and coding matrix belong together.

    Parameters
    ----------
    n_rows : int
        Number of training rows n.
    codes : array-like of int, shape (n,)
        Class index of each row.
    coding_matrix : array-like, shape (K, L)
        Codes -1, 0, +1.
    weights : array-like, shape (n,), optional
        Non-negative weights; 0 leaves a row out.
    names : sequence, optional
        K names for messages; the class indices when not given.

    Raises
    ------
    ValueError
        Shapes that do not fit, a class index without a row in `coding_matrix`, weights out of range, a class
        without rows that count.
    """
    matrix = check_coding_matrix(coding_matrix)
    index = np.asarray(codes)
    if index.shape != (n_rows,) or index.dtype.kind not in "iu":
        raise ValueError(f"codes must be {n_rows} integers, got shape {index.shape} of {index.dtype}")
    if index.min() < 0 or index.max() >= len(matrix):
        raise ValueError(f"codes must lie in 0..{len(matrix) - 1}, the rows of coding_matrix")
    factors = None if weights is None else checked_weights(weights, n_rows)
    called = range(len(matrix)) if names is None else names
    counted = np.arange(n_rows) if factors is None else np.flatnonzero(factors)
    present = np.isin(np.arange(len(matrix)), index[counted])
    if not present.all():
        absent = called[int(np.argmin(present))]
        raise ValueError(f"class {str(absent)!r} has no training rows, or none with a weight above 0")
    return Task(matrix, index.astype(np.intp), factors, counted, called)


def checked_gram(gram: npt.ArrayLike) -> FloatArray:
    """Return scalar products (n, n) of training rows as float64, or say in a ValueError what is wrong."""
    products = float_array("gram", gram)
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


def over_learners(work: Callable[[int], Result], n_learners: int, n_jobs: int | None) -> list[Result]:
    """Do some work for each learner, in threads; results in the order of the learners.

    Parameters
    ----------
    work : callable
        From the number of a learner to a result.
    n_learners : int
        L.
    n_jobs : int or None
        Threads, as in joblib.
    """
    n_threads = min(effective_n_jobs(n_jobs), n_learners)
    if n_threads == 1:
        return [work(learner) for learner in range(n_learners)]

    def several(learners: IntArray) -> list[Result]:
        return [work(int(learner)) for learner in learners]

    # A linear learner takes less time than to hand it out: whole runs of them, a few for each thread.
    runs = np.array_split(np.arange(n_learners), min(n_learners, 4 * n_threads))
    done = in_threads(several, runs, n_threads)
    return [result for results in done for result in results]
