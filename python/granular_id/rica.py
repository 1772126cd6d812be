"""Reconstruction independent component analysis: features to fewer or more, as independent as can be.

Source: Le, Karpenko, Ngiam, Ng, "ICA with Reconstruction Cost for Efficient Overcomplete Feature Learning",
NIPS 2011. Objective and defaults are those of `rica` in MATLAB, which the paper uses
(arXiv 2403.17606: 80 components of 100 principal components).
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, minimize
from sklearn.base import BaseEstimator, ClassNamePrefixFeaturesOutMixin, TransformerMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import finite_number, whole_number
from granular_id._core import GranularIdError
from granular_id._parallel import single_threaded_blas

FloatArray = npt.NDArray[np.float64]

# The search ends when an iteration lowers the objective by less than this share of it.
_TOLERANCE = 1e-6


class RICA(ClassNamePrefixFeaturesOutMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Reconstruction independent component analysis.

    Finds unit vectors w_j such that the projections ``x @ w_j`` are far from Gaussian while all of them together
    still rebuild x. With the rows of X and the w_j as columns of W the objective is

        alpha * ||X W W' - X||^2  +  sum over i, j of log(cosh(2 x_i @ w_j)) / 2

    with plain sums: twice the rows weigh both terms twice, while larger units favour the reconstruction (it
    grows with the square). There may be more components than features. X is not centred.

    Parameters
    ----------
    n_components : int
        Number of components p. The paper uses 80.
    alpha : float, default 1.0
        Weight of the reconstruction, not negative. 1 is MATLAB's default (its `Lambda`).
    max_iter : int, default 1000
        Iterations of L-BFGS. 550 rows of 100 principal components in newtons, reduced to 80, converge after
        some 3,000 and end 2 % lower than after 1000; after 500 the objective is 3 % higher, after 300 7 %.
    random_state : int, RandomState or None, default None
        Seed of the vectors to start from. The objective has many local minima: compare `objective_` of a few seeds.

    Attributes
    ----------
    components_ : ndarray, shape (p, D)
        The w_j as rows of unit length.
    objective_ : float
        Where the search ended.
    n_iter_ : int
        Iterations.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    ValueError, TypeError
        From `fit`: a parameter outside its range, NaN or infinity in X, or X of zeros only.

    Warns
    -----
    ConvergenceWarning
        The search ended at `max_iter`.

    Notes
    -----
    Each w_j is ``v / ||v||`` of a free vector v; the gradient is that of v (its part along w_j removed). Linear
    algebra runs on one thread, so that results do not depend on the number of threads.

    Examples
    --------
    Two sources with long tails, mixed; their directions are found again.

    >>> import numpy as np
    >>> from granular_id import RICA
    >>> sources = np.random.default_rng(0).laplace(size=(2000, 2))
    >>> mixing = np.array([[0.6, 0.8], [-0.8, 0.6]])
    >>> rica = RICA(2, random_state=0).fit(sources @ mixing)
    >>> np.abs(rica.components_ @ mixing.T).round(1).max(axis=1)
    array([1., 1.])
    """

    components_: FloatArray
    objective_: float
    n_iter_: int

    def __init__(
        self,
        n_components: int,
        *,
        alpha: float = 1.0,
        max_iter: int = 1000,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_components = n_components
        self.alpha = alpha
        self.max_iter = max_iter
        self.random_state = random_state

    def fit(self, X: npt.ArrayLike, y: object = None) -> RICA:  # noqa: ARG002 - scikit-learn passes y
        """Find the components of features (n, D)."""
        n_components = whole_number("n_components", self.n_components)
        max_iter = whole_number("max_iter", self.max_iter)
        alpha = finite_number("alpha", self.alpha, least=0)
        rows: FloatArray = validate_data(self, X, dtype=np.float64)
        if not rows.any():
            raise GranularIdError(f"X must vary: every feature is zero (n_samples = {len(rows)})")
        start = check_random_state(self.random_state).standard_normal((rows.shape[1], n_components))
        with single_threaded_blas():
            end = descend(rows, start, alpha, max_iter)
        vectors = end.x.reshape(start.shape)
        self.components_ = np.ascontiguousarray((vectors / np.linalg.norm(vectors, axis=0)).T)
        self.objective_, self.n_iter_ = float(end.fun), max(1, int(end.nit))
        if end.status == 1:
            message = f"RICA reached max_iter ({self.n_iter_}) before it converged: raise max_iter"
            warnings.warn(message, ConvergenceWarning, stacklevel=2)
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Projections (n, p) of features (n, D) onto the components."""
        check_is_fitted(self)
        rows: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        projections: FloatArray = rows @ self.components_.T
        return projections

    def get_feature_names_out(self, input_features: npt.ArrayLike | None = None) -> npt.NDArray[Any]:
        """Names (p,) of the projections: ``rica00``, ``rica01``, ..."""
        count = len(super().get_feature_names_out(input_features))  # checks input_features
        width = max(2, len(str(count - 1)))
        return np.asarray([f"rica{number:0{width}d}" for number in range(count)], dtype=object)

    @property
    def _n_features_out(self) -> int:
        return len(self.components_)


def objective(
    rows: FloatArray, moments: FloatArray, units: FloatArray, alpha: float
) -> tuple[float, FloatArray]:
    """Objective of W (D, p) with unit columns, and its gradient as if these were free; `moments` are X' X."""
    # ||X W W' - X||^2 and its gradient depend on X' X alone, which has fewer rows than X.
    projected, overlaps = moments @ units, units.T @ units
    energies = units.T @ projected
    lost = np.trace(moments) - 2.0 * np.trace(energies) + np.vdot(overlaps, energies)
    # log(cosh(2 z)) / 2 and its slope tanh(2 z) from exp(-4 |z|), which cannot overflow
    projections = rows @ units
    size = np.abs(projections)
    decay = np.exp(-4.0 * size)
    contrast = size.sum() + 0.5 * np.log(1.0 + decay).sum() - 0.5 * math.log(2.0) * size.size
    slopes = np.copysign((1.0 - decay) / (1.0 + decay), projections)
    gradient = 2.0 * alpha * (projected @ overlaps + units @ energies - 2.0 * projected) + rows.T @ slopes
    return float(alpha * lost + contrast), gradient


def descend(
    rows: FloatArray, start: FloatArray, alpha: float, max_iter: int, tolerance: float = _TOLERANCE
) -> OptimizeResult:
    """Follow the objective downhill by L-BFGS, from free vectors (D, p) whose directions are the components."""
    moments = rows.T @ rows

    def of_free_vectors(flat: FloatArray) -> tuple[float, FloatArray]:
        vectors = flat.reshape(start.shape)
        norms = np.linalg.norm(vectors, axis=0)
        units = vectors / norms
        value, gradient = objective(rows, moments, units, alpha)
        gradient -= units * np.einsum("ij,ij->j", units, gradient)
        return value, (gradient / norms).ravel()

    # Each iteration asks for about one value; the limit on values must never be the one that stops.
    options = {"maxiter": max_iter, "ftol": tolerance, "gtol": 1e-6, "maxfun": 100 * max_iter + 100}
    flat = (start / np.linalg.norm(start, axis=0)).ravel()
    return minimize(of_free_vectors, flat, jac=True, method="L-BFGS-B", options=options)
