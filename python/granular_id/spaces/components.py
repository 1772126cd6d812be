"""Principal components of few rows with many columns, through the scalar products of the rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import float_array, whole_number
from granular_id._estimators import origin_of, traced
from granular_id._parallel import single_threaded_blas
from granular_id.gram import check_symmetric, linear_gram
from granular_id.spaces.base import check_input_names

FloatArray = npt.NDArray[np.float64]

# Of equal rows, rounding leaves eigenvalues up to this times n * eps * the largest product: 12 in trials with 2 to
# 550 rows of 1 to 2,000 columns and offsets up to 1e6.
_ROUNDING = 32.0

# Scores this close to the largest of a component share the vote on its sign: rounding must not decide.
_SIGN_MARGIN = 1e-6


class PrincipalComponents(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Scores on the principal components of the training rows.

    Equal to ``sklearn.decomposition.PCA(n_components, svd_solver="full")`` up to signs. A few hundred rows of
    10,000 columns have their components in the span of the rows: the eigenvectors of the (n, n) matrix of their
    scalar products tell all. An evaluation over many partitions hands slices of one such matrix to `fit_gram`
    and `transform_gram`, and never touches the columns again.

    Parameters
    ----------
    n_components : int, default 100
        Components to keep, those with the largest variance; the paper's number. Rows that do not have so many
        give fewer: never more than ``min(n - 1, D)``, and none without variance.

    Attributes
    ----------
    n_components_ : int
        Components kept, N.
    explained_variance_, explained_variance_ratio_, singular_values_ : ndarray, shape (N,)
        Of each component, largest first: variance of the scores over the training rows (divisor n - 1), its
        share of the variance of all columns, and the square root of the sum of squared scores.
    components_ : ndarray, shape (N, D)
        Unit rows. Only after `fit`.
    mean_ : ndarray, shape (D,)
        Mean of the training rows. Only after `fit`.
    n_features_in_ : int
        D. Only after `fit`.

    Notes
    -----
    Signs are such that the largest score of each component over the training rows, by magnitude, is positive;
    between scores that differ by rounding the first row decides. So both ways to fit give the same signs.

    Scalar products hold squares: what has a singular value below about 1e-6 of the largest drowns in rounding and
    is left out. Measured from an origin far away, the distance to it counts as the largest.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import PrincipalComponents
    >>> X = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [6.0, 8.0, 1.0]])
    >>> pca = PrincipalComponents().fit(X)
    >>> pca.n_components_
    2
    >>> np.allclose(pca.transform(X), PrincipalComponents().fit_gram(X @ X.T).transform_gram(X @ X.T))
    True
    """

    n_components_: int
    explained_variance_: FloatArray
    explained_variance_ratio_: FloatArray
    singular_values_: FloatArray
    components_: FloatArray
    mean_: FloatArray
    n_features_in_: int

    # What `transform_gram` needs: scores are centred products times the dual vectors.
    _dual: FloatArray
    _column_means: FloatArray
    _grand_mean: float

    def __init__(self, n_components: int = 100) -> None:
        self.n_components = n_components

    @property
    def learns(self) -> bool:
        """True: components come from the rows given to `fit`."""
        return True

    def fit(self, X: npt.ArrayLike, y: object = None) -> PrincipalComponents:  # noqa: ARG002
        """Find the components of rows.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Training rows, at least two of them.
        y : ignored

        Returns
        -------
        self

        Raises
        ------
        ValueError
            Fewer than two rows, all rows equal, NaN or infinity, or scalar products beyond float64.
        """
        self._fit_rows(X)
        return self

    def fit_transform(self, X: npt.ArrayLike, y: object = None) -> FloatArray:  # noqa: ARG002
        """`fit` and `transform` of the same rows."""
        scores: FloatArray = traced(self._fit_rows(X) @ self.components_.T, origin_of(X), blocks=None)
        return scores

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (m, N) of rows (m, D)."""
        check_is_fitted(self, "n_components_")
        if not hasattr(self, "components_"):
            raise ValueError("PrincipalComponents was fitted on scalar products: use transform_gram")
        rows = validate_data(self, X, reset=False, dtype=np.float64)
        scores: FloatArray = traced((rows - self.mean_) @ self.components_.T, origin_of(X), blocks=None)
        return scores

    def fit_gram(self, gram: npt.ArrayLike, y: object = None) -> PrincipalComponents:  # noqa: ARG002
        """Find the components from the scalar products of the training rows with each other.

        Parameters
        ----------
        gram : array-like, shape (n, n)
            Scalar products, about any origin: the mean is taken out here.
        y : ignored

        Returns
        -------
        self
            Without `components_`, which only the rows themselves can tell.
        """
        products = _finite("gram", gram)
        if products.ndim != 2 or products.shape[0] != products.shape[1] or len(products) < 2:
            raise ValueError(f"gram must have shape (n, n) with n >= 2, got {products.shape}")
        check_symmetric(products)
        for name in ("components_", "mean_", "n_features_in_", "feature_names_in_"):  # of an earlier fit
            self.__dict__.pop(name, None)
        self._fit_products(products, limit=len(products) - 1)
        return self

    def transform_gram(self, cross: npt.ArrayLike) -> FloatArray:
        """Scores (m, N) from the scalar products (m, n) of rows with the training rows.

        Parameters
        ----------
        cross : array-like, shape (m, n)
            About the same origin as the products given to `fit_gram` (about `mean_` after `fit`); training rows in
            the same order.
        """
        check_is_fitted(self, "n_components_")
        products = _finite("cross", cross)
        n = len(self._dual)
        if products.ndim != 2 or products.shape[1] != n:
            raise ValueError(
                f"cross must have shape (m, {n}), one column per training row, got {products.shape}"
            )
        # The dual vectors sum to zero, but only up to rounding: the mean of each row goes first.
        centred = products - self._column_means - products.mean(axis=1, keepdims=True) + self._grand_mean
        with single_threaded_blas():  # the steps behind may start from these bits: see RICA
            scores: FloatArray = centred @ self._dual
        return scores

    def get_feature_names_out(self, input_features: npt.ArrayLike | None = None) -> npt.NDArray[Any]:
        """Names ``pca_00 ...`` of the scores.

        Parameters
        ----------
        input_features : array-like of str, shape (D,), optional
            Must equal the names seen by `fit`, if there were any. The names given out do not depend on it.
        """
        check_is_fitted(self, "n_components_")
        if hasattr(self, "n_features_in_"):
            check_input_names(self, input_features)
        width = max(2, len(str(self.n_components_ - 1)))
        return np.array([f"pca_{k:0{width}d}" for k in range(self.n_components_)], dtype=object)

    def _fit_rows(self, X: npt.ArrayLike) -> FloatArray:
        rows = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        with np.errstate(over="ignore", invalid="ignore"):  # their scalar products are refused below
            self.mean_ = rows.mean(axis=0)
            centred: FloatArray = rows - self.mean_
        self._fit_products(linear_gram(centred), limit=min(len(rows) - 1, rows.shape[1]))
        self.components_ = self._dual.T @ centred
        return centred

    def _fit_products(self, gram: FloatArray, *, limit: int) -> None:
        wanted = whole_number("n_components", self.n_components)
        n = len(gram)
        self._column_means = gram.mean(axis=1)  # symmetric: along rows numpy adds in pairs, and rounds less
        self._grand_mean = float(self._column_means.mean())
        centred = gram - self._column_means - self._column_means[:, np.newaxis] + self._grand_mean
        keep = min(wanted, limit)
        with single_threaded_blas():
            squares, vectors = scipy.linalg.eigh(centred, subset_by_index=[n - keep, n - 1])
        squares, vectors = squares[::-1], vectors[:, ::-1]
        noise = _ROUNDING * n * np.finfo(np.float64).eps * max(squares[0], np.abs(gram).max())
        kept = int(np.count_nonzero(squares > noise))
        if kept == 0:
            raise ValueError("X must vary: all rows are equal, so that there is no component to find")
        squares, vectors = squares[:kept], vectors[:, :kept]
        vectors = vectors * _signs(vectors)
        self.n_components_ = kept
        self.singular_values_ = np.sqrt(squares)
        self.explained_variance_ = squares / (n - 1)
        self.explained_variance_ratio_ = squares / np.trace(centred)
        self._dual = vectors / self.singular_values_


def _signs(vectors: FloatArray) -> FloatArray:
    """+1 or -1 for each column: its first entry within rounding of the largest magnitude becomes positive."""
    magnitude = np.abs(vectors)
    first = (magnitude >= (1.0 - _SIGN_MARGIN) * magnitude.max(axis=0)).argmax(axis=0)
    return np.where(vectors[first, np.arange(vectors.shape[1])] < 0, -1.0, 1.0)


def _finite(argument: str, values: npt.ArrayLike) -> FloatArray:
    products = float_array(argument, values)
    if not np.isfinite(products).all():
        raise ValueError(f"{argument} must be finite, got NaN or infinity")
    return products
