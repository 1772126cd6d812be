"""Whitening within classes: what varies between recordings of one class counts less.

Source: Hatch and Stolcke, "Generalized linear kernels for one-versus-all classification: application to speaker
recognition" (ICASSP 2006); Hatch, Kajarekar, Stolcke, "Within-class covariance normalization for SVM-based speaker
recognition" (Interspeech 2006).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._numbers import positive_number
from granular_id.gram import linear_gram

__all__ = ["WithinClassWhitening", "class_centred", "whitened_grams"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Eigenvalues below this times n * eps * the largest are what rounding leaves of zeros.
_ROUNDING = 32.0


class WithinClassWhitening(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Multiply rows by the inverse square root of their covariance within classes.

    ``A = (S + shrinkage * trace(S) * I)^(-1/2)`` with ``S`` the covariance (D, D) of the rows about the mean of
    their class. A direction in which recordings of the same material differ much (a drift, a posture, a person)
    is turned down, before a machine with few rows takes it for a difference between materials.

    Parameters
    ----------
    shrinkage : float, default 1e-3
        Share of the whole variance within classes that is added to the variance of each direction: a direction
        that holds more than this share is turned down, all others keep about their scale. With 1 nearly nothing
        is turned down. Positive: few rows tell nothing of most directions, and what looks still in them is not.
        Of the trace and not of its mean over columns, so that columns without variance change nothing.

    Attributes
    ----------
    components_ : ndarray, shape (r, D)
        Unit directions in which classes vary, at most ``min(n - K, D)``; those of most variance first.
    variances_ : ndarray, shape (r,)
        Variance within classes (divisor n) along each.
    ridge_ : float
        What was added to each: ``shrinkage * trace(S)``.
    classes_ : ndarray, shape (K,)
        Labels seen.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: a shrinkage that is not positive, labels that are no classes, NaN or infinity, or scalar
        products beyond float64.

    Notes
    -----
    ``A`` is symmetric. So each output column belongs to the input column of its name, and weights of a linear
    machine behind it fold into weights for plain rows by the same transformation: ``transform(coef)``.

    A is never made. With fewer rows than columns the directions come from the scalar products of the rows, and
    everything at right angles to them is multiplied by ``ridge_ ** -0.5``.

    Rows that do not vary within classes (one row of each) tell nothing: they are left as they are.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import WithinClassWhitening
    >>> rng = np.random.default_rng(0)
    >>> y = np.repeat(["oat", "rice"], 200)
    >>> X = rng.normal(size=(400, 2)) * [10.0, 1.0] + np.where(y == "oat", 1.0, -1.0)[:, None]
    >>> rows = WithinClassWhitening(1e-6).fit(X, y).transform(X)
    >>> rows[y == "oat"].std(axis=0).round(1).tolist()
    [1.0, 1.0]
    """

    components_: FloatArray
    variances_: FloatArray
    ridge_: float
    classes_: npt.NDArray[Any]
    n_features_in_: int

    def __init__(self, shrinkage: float = 1e-3) -> None:
        self.shrinkage = shrinkage

    @property
    def learns(self) -> bool:
        """True: directions come from the rows given to `fit`."""
        return True

    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike) -> WithinClassWhitening:
        """Learn how rows vary about the mean of their class.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Training rows, finite.
        y : array-like, shape (n,)
            Label of each.

        Returns
        -------
        self
        """
        shrinkage = positive_number("shrinkage", self.shrinkage)
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        self.classes_, codes = np.unique(labels, return_inverse=True)
        with np.errstate(over="ignore", invalid="ignore"):  # their scalar products are refused below
            within = class_centred(rows, codes)
        # Equal rows leave the rounding of their mean.
        within[np.abs(within) <= _ROUNDING * np.finfo(np.float64).eps * np.abs(rows).max(axis=0)] = 0.0
        self.variances_, self.components_ = _directions(within)
        trace = float(self.variances_.sum())
        self.ridge_ = shrinkage * trace
        if trace > 0 and not 0 < self.ridge_ < np.inf:
            raise ValueError(
                f"shrinkage must leave a ridge in the range of float64, got {shrinkage:g} of {trace:g}"
            )
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Whiten rows (m, D); also folds weights (L, D) of a linear machine behind, see the notes."""
        check_is_fitted(self)
        rows: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        if self.ridge_ == 0.0:
            unchanged: FloatArray = rows.copy()
            return unchanged
        still = self.ridge_**-0.5
        moved = (self.variances_ + self.ridge_) ** -0.5 - still
        whitened: FloatArray = rows * still + ((rows @ self.components_.T) * moved) @ self.components_
        return whitened

    def __sklearn_tags__(self) -> Any:
        """Tags of scikit-learn: labels are needed."""
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


def class_centred(rows: FloatArray, codes: IntArray) -> FloatArray:
    """Rows (n, m) minus the mean row of their class; `codes` (n,) count classes from 0."""
    counts = np.bincount(codes)
    sums = np.zeros((len(counts), rows.shape[1]))
    np.add.at(sums, codes, rows)
    centred: FloatArray = rows - (sums / np.maximum(counts, 1)[:, np.newaxis])[codes]
    return centred


def whitened_grams(
    gram: FloatArray, cross: FloatArray, codes: IntArray, shrinkage: float
) -> tuple[FloatArray, FloatArray]:
    """Scalar products of rows as `WithinClassWhitening` would give them, from those of plain rows.

    Parameters
    ----------
    gram : ndarray, shape (n, n)
        Of the training rows, about any origin.
    cross : ndarray, shape (m, n)
        Of other rows with them, about the same origin.
    codes : ndarray of int, shape (n,)
        Class of each training row, from 0.
    shrinkage : float
        As in `WithinClassWhitening`.

    Returns
    -------
    gram, cross : ndarrays of the same shapes
        Times ``ridge_``, so that what does not vary within classes keeps its scale.

    Notes
    -----
    With W (n, D) the class-centred rows, ``ridge A A = I - W' (W W' + n ridge I)^-1 W`` (Woodbury).

    Examples
    --------
    >>> import numpy as np
    >>> X, y = np.array([[1.0, 0.0], [3.0, 1.0], [0.0, 5.0]]), np.array([0, 0, 1])
    >>> whitening = WithinClassWhitening(0.1).fit(X, y)
    >>> A = whitening.transform(X)
    >>> got, _ = whitened_grams(X @ X.T, X @ X.T, y, 0.1)
    >>> np.allclose(got, whitening.ridge_ * A @ A.T)
    True
    """
    n = len(gram)
    to_within = class_centred(gram, codes).T  # products of all rows with the class-centred ones
    within = class_centred(to_within, codes)
    trace = float(np.trace(within)) / n
    if not trace > _ROUNDING * np.finfo(np.float64).eps * float(np.abs(np.diagonal(gram)).max()):
        return gram, cross  # no variance within classes
    within[np.diag_indices(n)] += n * shrinkage * trace
    factor = scipy.linalg.cho_factor(
        (within + within.T) / 2, lower=True, overwrite_a=True, check_finite=False
    )
    taken = scipy.linalg.cho_solve(factor, to_within.T, check_finite=False)
    whitened = gram - to_within @ taken
    cross_within = class_centred(cross.T, codes).T
    return (whitened + whitened.T) / 2, cross - cross_within @ taken


def _directions(within: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances (r,) and unit directions (r, D) of centred rows (n, D), largest first, without those of rounding."""
    n, n_columns = within.shape
    if n < n_columns:
        products = linear_gram(within)
        squares, vectors = scipy.linalg.eigh(products)
    else:
        squares, vectors = scipy.linalg.eigh(linear_gram(within.T))
    squares, vectors = squares[::-1], vectors[:, ::-1]
    noise = _ROUNDING * n * np.finfo(np.float64).eps * max(float(squares[0]), 0.0)
    kept = int(np.count_nonzero(squares > noise))
    squares, vectors = squares[:kept], vectors[:, :kept]
    directions = (vectors / np.sqrt(squares)).T @ within if n < n_columns else vectors.T
    return squares / n, np.ascontiguousarray(directions)
