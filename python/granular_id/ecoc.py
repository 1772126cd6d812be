"""ECOCClassifier: many two-class learners, one decision.

Sources: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force Measurements" (arXiv
2403.17606): trinary one-vs-one ECOC, linear SVM, loss-weighted decoding with the hinge loss; Allwein, Schapire, Singer
(2000), "Reducing multiclass to binary", JMLR 1:113-141 (codes); Escalera, Pujol, Radeva (2010), "On the decoding
process in ternary error-correcting output codes", IEEE TPAMI 32:120-134 (loss-weighted decoding). Names and scale are
those of MATLAB's `fitcecoc`; the loss "root" is ours, half way from votes (the power 0 of a score) to the hinge (the
power 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import softmax
from sklearn import config_context
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.svm import SVC
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from granular_id._checks import argument_error, checked_n_jobs, float_array, named, positive_number
from granular_id._core import GranularIdError
from granular_id._parallel import in_threads

__all__ = ["ECOCClassifier"]

CodingMatrix = npt.NDArray[np.int8]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

MAX_LEARNERS = 100_000
"""Of more pairs of classes than this one-vs-one is refused."""

# Columns are centred and multiplied, and rows decoded, in blocks of this size: no copy of X is ever made.
_BLOCK_BYTES = 2_000_000
# libsvm's default of 1e-3 leaves errors of 0.01 in the scores.
_TOLERANCE = 1e-5
# libsvm's own limit. scikit-learn has none, and problems past the accuracy of float32 then never end.
_MAX_STEPS = 10_000_000


class ECOCClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Error-correcting output codes: K classes are separated by L learners of two sides each.

    The learners are linear support vector machines, by default one for each pair of classes. Where features outnumber
    rows, the Gram matrix of the rows is computed once and sliced for each learner.

    Scores are decoded by loss-weighted decoding, as in the paper: the summed loss of a class is divided by how many
    learners saw it.

    Parameters
    ----------
    coding : str or array-like, shape (K, L), default "onevsone"
        Which learner sees which classes on which side: "onevsone" with K (K - 1) / 2 learners (the paper), "onevsall"
        with K; or codes -1, 0, +1 of one's own, a row for each of the sorted classes.
    loss : {"hinge", "root"}, default "hinge"
        Binary loss. "hinge" belongs to support vector machines and is what the paper uses; "root", which takes the
        root of a score first, is half way between votes and the hinge.
    C : float, default 1.0
        Cost of a violated margin, positive. 1 is the default of MATLAB and scikit-learn. With 10,200 raw
        features the margin is mostly hard already.
    temperature : float, default 1.0
        What class values are divided by before the softmax of `predict_proba`, positive: the smaller, the surer. Class
        values lie within a few tenths of each other, so that 1 gives nearly equal probabilities; fit it on held-out
        rows. Changes no label, and may be set after `fit`.
    n_jobs : int, optional
        Threads over learners, as in joblib, in codings other than "onevsone", whose learners are one call of libsvm.
        The numbers do not depend on it.
    random_state : int or RandomState, optional
        Not used, present for consistency with other classifiers: nothing is drawn.

    Attributes
    ----------
    classes_ : ndarray, shape (K,)
        Sorted labels.
    coding_matrix_ : ndarray of int8, shape (K, L)
        Codes: +1 and -1 for the two sides of a learner, 0 for classes it is not shown.
    coef_, intercept_ : ndarray, shapes (L, D) and (L,)
        A score is ``coef_ @ x + intercept_``; positive speaks for the classes with code +1.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: a parameter outside its range, more than 100,000 pairs of classes, a coding matrix that does not
        fit the classes, fewer than two classes, NaN or infinity in X, negative weights.

    Warns
    -----
    ConvergenceWarning
        A learner found no solution in ten million steps: scale the features, or lower `C`.

    Notes
    -----
    Ties go to the class that comes first in `classes_`.

    `sample_weight` multiplies C: a whole number equals as many repetitions of the row, up to the tolerance of libsvm.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> clf = ECOCClassifier().fit(X, y)
    >>> clf.coding_matrix_
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    >>> round(1 - clf.score(X, y), 4)
    0.0067
    """

    classes_: npt.NDArray[Any]
    coding_matrix_: CodingMatrix
    coef_: FloatArray
    intercept_: FloatArray

    def __init__(
        self,
        coding: str | npt.ArrayLike = "onevsone",
        *,
        loss: str = "hinge",
        C: float = 1.0,
        temperature: float = 1.0,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.coding = coding
        self.loss = loss
        self.C = C
        self.temperature = temperature
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(
        self, X: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None
    ) -> ECOCClassifier:
        """Train all learners.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Features, finite.
        y : array-like, shape (n,)
            Labels: strings, integers or other values that can be sorted.
        sample_weight : array-like, shape (n,), optional
            Non-negative factors of C. A row of weight 0 is as good as absent, its label included.

        Returns
        -------
        ECOCClassifier
            This estimator.
        """
        cost = positive_number("C", self.C)
        positive_number("temperature", self.temperature)
        named(LOSSES, "loss", self.loss)
        checked_n_jobs(self.n_jobs)
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        weights = None
        if sample_weight is not None:
            weights = _check_sample_weight(sample_weight, rows, dtype=np.float64)
            counted = weights > 0
            if (weights < 0).any() or not counted.any():
                raise GranularIdError("sample_weight must not be negative, nor zero for every row")
            rows, labels, weights = rows[counted], labels[counted], weights[counted]
        self.classes_, index = class_indices(labels)
        self.coding_matrix_ = design(self.coding, len(self.classes_))
        origin: FloatArray = rows.mean(axis=0)
        wide = rows.shape[1] > len(rows)
        values = centred_gram(rows, origin) if wide else rows - origin
        kernel = "precomputed" if wide else "linear"
        learned = train_learners(values, self.coding_matrix_, index, cost, kernel, weights, self.n_jobs)
        self.coef_, self.intercept_ = learned.in_features(rows, origin)
        return self

    def binary_scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the binary learners for features (n, D); positive speaks for the code +1."""
        check_is_fitted(self, "coef_")
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        return linear_scores(rows, self.coef_, self.intercept_)

    def decision_function(self, X: npt.ArrayLike) -> FloatArray:
        """Decision value of each class for features (n, D).

        Returns
        -------
        ndarray, shape (n, K), or (n,) for two classes
            Minus the mean binary loss of each class: the largest wins. For two classes the value of the
            second minus that of the first: positive means ``classes_[1]``.
        """
        values = self._class_values(X)
        return values[:, 1] - values[:, 0] if values.shape[1] == 2 else values

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Label of each row of features (n, D); of tied classes the first in `classes_`."""
        winners = self._class_values(X).argmax(axis=1)
        labels: npt.NDArray[Any] = self.classes_[winners]
        return labels

    def predict_proba(self, X: npt.ArrayLike) -> FloatArray:
        """Probability of each class for features (n, D).

        Returns
        -------
        ndarray, shape (n, K)
            Softmax of the class values, minus the mean binary losses, divided by `temperature`. Rows sum to 1, and the
            likeliest class is the one that `predict` names.
        """
        values = self._class_values(X) / positive_number("temperature", self.temperature)
        probabilities: FloatArray = softmax(values, axis=1)
        return probabilities

    def _class_values(self, X: npt.ArrayLike) -> FloatArray:
        """Class values (n, K); the loss may have been set anew after the fit."""
        return decode(self.binary_scores(X), self.coding_matrix_, self.loss)


# Codes: a row for each class and a column for each learner, +1 positive, -1 negative, 0 not shown.


def onevsone(n_classes: int) -> CodingMatrix:
    """One learner for each pair of classes, in the order (0, 1), (0, 2), ...: +1 for the lower class index."""
    low, high = np.triu_indices(n_classes, 1)
    matrix = np.zeros((n_classes, len(low)), dtype=np.int8)
    learner = np.arange(len(low))
    matrix[low, learner] = 1
    matrix[high, learner] = -1
    return matrix


def onevsall(n_classes: int) -> CodingMatrix:
    """One learner for each class against all others, shape (K, K): +1 on the diagonal, -1 elsewhere."""
    return np.where(np.eye(n_classes, dtype=bool), 1, -1).astype(np.int8)


CODINGS: Mapping[str, Callable[[int], CodingMatrix]] = MappingProxyType(
    {"onevsone": onevsone, "onevsall": onevsall}
)
"""Designs by name."""


def design(coding: Any, n_classes: int) -> CodingMatrix:
    """Coding matrix (K, L) for K classes, from the name of a design or a matrix of one's own."""
    if not isinstance(coding, str):
        return _own_coding(coding, n_classes)
    matrix_of: Callable[[int], CodingMatrix] = named(CODINGS, "coding", coding)
    n_pairs = n_classes * (n_classes - 1) // 2
    if coding == "onevsone" and n_pairs > MAX_LEARNERS:
        raise argument_error(
            GranularIdError,
            "coding",
            f"='onevsone' needs {n_pairs:,} learners for {n_classes} classes, more than {MAX_LEARNERS:,}; "
            f"'onevsall' needs {n_classes}",
        )
    return matrix_of(n_classes)


def _own_coding(coding: npt.ArrayLike, n_classes: int) -> CodingMatrix:
    """Check a user's coding matrix: a row for each class, all rows and all learners different."""
    given = float_array("coding", coding)
    if given.ndim != 2 or len(given) != n_classes or given.shape[1] < 1:
        problem = (
            f"must have {n_classes} rows, one per class, and a column per learner, got shape {given.shape}"
        )
        raise argument_error(GranularIdError, "coding", problem)
    if not np.isin(given, (-1, 0, 1)).all():
        raise argument_error(GranularIdError, "coding", "must hold -1, 0 and +1 only")
    matrix = given.astype(np.int8)
    one_sided = (matrix.max(axis=0) != 1) | (matrix.min(axis=0) != -1)
    if one_sided.any():
        raise argument_error(
            GranularIdError, "coding", f"column {one_sided.argmax()} must hold both +1 and -1"
        )
    unseen = ~matrix.any(axis=1)
    if unseen.any():
        problem = f"row {unseen.argmax()} is all 0: no learner ever sees this class"
        raise argument_error(GranularIdError, "coding", problem)
    # A column and its negative make the same learner: compare them with their first sign +.
    leading = matrix[(matrix != 0).argmax(axis=0), np.arange(matrix.shape[1])]
    for what, lines, why in (
        ("row", matrix, "these classes are never separated"),
        ("column", (matrix * leading).T, "the same learner twice, but for the sign"),
    ):
        _, first = np.unique(lines, axis=0, return_index=True)
        again = np.setdiff1d(np.arange(len(lines)), first)
        if again.size:
            raise argument_error(GranularIdError, "coding", f"{what} {again[0]} is like one before: {why}")
    return matrix


# Decoding: a class is worth minus the mean loss of its codes, over the learners that saw it.


def _hinge(z: FloatArray) -> FloatArray:
    loss: FloatArray = np.maximum(0.0, 1.0 - z) / 2.0
    return loss


def _root(z: FloatArray) -> FloatArray:
    graded: FloatArray = np.copysign(np.sqrt(np.abs(np.minimum(z, 1.0))), z)
    return (1.0 - graded) / 2.0


LOSSES: Mapping[str, Callable[[FloatArray], FloatArray]] = MappingProxyType({"hinge": _hinge, "root": _root})
"""Binary losses by name: of the agreement z of a code with a score (code times score), 1/2 where that says nothing."""


def decode(scores: FloatArray, coding_matrix: CodingMatrix, loss: str = "hinge") -> FloatArray:
    """Value (n, K) of each class: minus its mean binary loss, for scores (n, L) of the learners.

    The largest value wins, the first of equal ones. Losses are added in the order of the learners, so that a row gives
    the same bits alone and within any batch.

    >>> decode(np.array([[2.0, 0.5, -1.0]]), onevsone(3))
    array([[-0.125, -1.25 , -0.375]])
    """
    of_agreement: Callable[[FloatArray], FloatArray] = named(LOSSES, "loss", loss)
    n_classes, n_learners = coding_matrix.shape
    steps, divisor = _steps(coding_matrix), np.abs(coding_matrix).sum(axis=1, dtype=np.float64)
    values = np.empty((len(scores), n_classes))
    size = max(1, _BLOCK_BYTES // (16 * n_learners))
    for start in range(0, len(scores), size):
        block = scores[start : start + size].T
        # Row l: the loss of a class with code +1 at learner l. Then the same for -1, then a row of zeros.
        costs = np.concatenate((of_agreement(block), of_agreement(-block), np.zeros((1, block.shape[1]))))
        total = np.zeros((n_classes, block.shape[1]))
        # One step adds the next learner of every class: as many steps as the busiest class has learners.
        for taken in steps:
            total += costs[taken]
        values[start : start + size] = -total.T / divisor
    return values


def _steps(matrix: CodingMatrix) -> IntArray:
    """For each step and class the row of the cost of its next learner, or of the zeros when it has none."""
    n_classes, n_learners = matrix.shape
    classes, learners = np.nonzero(matrix)
    counts = np.bincount(classes, minlength=n_classes)
    step = np.arange(len(classes)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.full((int(counts.max()), n_classes), 2 * n_learners)
    rows[step, classes] = np.where(matrix[classes, learners] > 0, learners, n_learners + learners)
    return rows


def linear_scores(rows: FloatArray, coef: FloatArray, intercept: FloatArray) -> FloatArray:
    """Scores (n, L) of rows (n, D); a ValueError where they overflow."""
    with np.errstate(over="ignore", invalid="ignore"):  # reported below, with the argument's name
        scores: FloatArray = rows @ coef.T + intercept
    if not np.isfinite(scores).all():
        raise GranularIdError("X must be finite, with scores in the range of float64")
    return scores


# Learners: a support vector machine for each column of a coding matrix, trained on the rows that it sees.


class Learners(NamedTuple):
    """Learners as weighted sums (L, n) of training rows; `intercept` (L,) is the score at the origin of these."""

    dual_coef: FloatArray
    intercept: FloatArray
    share_at_bound: float
    """Of the dual variables, those at C; 0 means that the margin is hard."""

    def in_features(self, rows: FloatArray, origin: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weights (L, D) and intercepts (L,) on features, of training rows (n, D) taken about `origin` (D,)."""
        # The multipliers sum to 0 up to rounding: taking off the rest keeps a large offset harmless.
        coef = self.dual_coef @ rows - np.outer(self.dual_coef.sum(axis=1), origin)
        return coef, self.intercept - coef @ origin


def class_indices(labels: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], IntArray]:
    """Sorted classes, and the class index of each row."""
    try:
        check_classification_targets(labels)
        classes, index = np.unique(labels, return_inverse=True)
    except (TypeError, ValueError) as reason:
        different = list(dict.fromkeys(map(repr, labels[:100].tolist())))
        raise GranularIdError(
            f"y must hold labels of one kind, text or whole numbers, got {', '.join(different[:3])}: {reason}"
        ) from None
    if len(classes) < 2:
        raise GranularIdError(f"y holds one class only ({classes.tolist()[0]!r}): nothing to tell apart")
    return classes, index.astype(np.intp)


def centred_gram(rows: FloatArray, origin: FloatArray) -> FloatArray:
    """Scalar products (n, n) of rows (n, D) about an origin (D,), without a copy of the rows."""
    n, n_columns = rows.shape
    step = max(64, _BLOCK_BYTES // (8 * n))
    gram = np.zeros((n, n))
    for start in range(0, n_columns, step):
        block = rows[:, start : start + step] - origin[start : start + step]
        gram += block @ block.T
    return gram


def train_learners(
    values: FloatArray,
    matrix: CodingMatrix,
    index: IntArray,
    cost: float,
    kernel: str = "precomputed",
    weights: FloatArray | None = None,
    n_jobs: int | None = None,
) -> Learners:
    """Train a learner for each column of a coding matrix.

    `values` are centred: the Gram matrix (n, n) of the rows, or with `kernel` "linear" the rows (n, D) themselves. An
    offset would cost libsvm, whose kernel is float32, its digits.
    """
    n = len(values)
    squares = np.diagonal(values) if kernel == "precomputed" else np.einsum("ij,ij->i", values, values)
    spread = float(squares.mean())
    if not math.isfinite(spread):
        raise GranularIdError("X must be finite, with scalar products in the range of float64")
    # A power of four scales rows without rounding, and keeps their products in the range of float32.
    unit = 2.0 ** (math.frexp(spread)[1] // 2) if spread > 0 else 1.0
    values = values / (unit**2 if kernel == "precomputed" else unit)
    largest = 1.0 if weights is None else float(weights.max())
    bound, factors = cost * unit**2 * largest, None if weights is None else weights / largest
    machine = SVC(C=bound, kernel=kernel, tol=_TOLERANCE, shrinking=False, max_iter=_MAX_STEPS)
    dual_coef, intercept = np.zeros((matrix.shape[1], n)), np.zeros(matrix.shape[1])

    def train(learner: int) -> None:
        codes = matrix[index, learner]
        shown = np.flatnonzero(codes)
        own = values[np.ix_(shown, shown)] if kernel == "precomputed" else values[shown]
        fitted = clone(machine).fit(own, codes[shown], None if factors is None else factors[shown])
        dual_coef[learner, shown[fitted.support_]] = fitted.dual_coef_[0]
        intercept[learner] = fitted.intercept_[0]

    with config_context(assume_finite=True, skip_parameter_validation=True):
        if np.array_equal(matrix, onevsone(len(matrix))):
            _split_pairs(machine.fit(values, index, factors), index, dual_coef, intercept)
        else:
            in_threads(train, range(matrix.shape[1]), n_jobs)
    upper = bound * (np.ones(n) if factors is None else factors) * (1 - 1e-9)
    share = np.count_nonzero(np.abs(dual_coef) >= upper) / np.count_nonzero(matrix[index])
    return Learners(dual_coef / unit**2, intercept, share)


def _split_pairs(machine: SVC, index: IntArray, dual_coef: FloatArray, intercept: FloatArray) -> None:
    """Fill in the learners of `onevsone` from one machine: 190 calls of libsvm take 30 times as long as one."""
    # Of each row against each other class: the classes below its own first, then those above.
    by_opponent = np.zeros((machine.dual_coef_.shape[0], len(index)))
    by_opponent[:, machine.support_] = machine.dual_coef_
    members = [np.flatnonzero(index == k) for k in range(len(machine.classes_))]
    for learner, (low, high) in enumerate(zip(*np.triu_indices(len(members), 1), strict=True)):
        dual_coef[learner, members[low]] = by_opponent[high - 1, members[low]]
        dual_coef[learner, members[high]] = by_opponent[low, members[high]]
    intercept[:] = machine.intercept_
    if len(members) == 2:  # scikit-learn turns the sign of a single pair
        dual_coef *= -1
        intercept *= -1
