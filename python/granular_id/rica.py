"""Reconstruction independent component analysis: features to fewer or more, as independent as can be.

Source: Le, Karpenko, Ngiam, Ng, "ICA with Reconstruction Cost for Efficient Overcomplete Feature Learning",
NIPS 2011. Objective, contrasts and defaults are those of `rica` in MATLAB, which the paper uses
(arXiv 2403.17606: 80 components of 100 principal components).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, minimize
from sklearn.base import BaseEstimator, ClassNamePrefixFeaturesOutMixin, TransformerMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.preprocessing import StandardScaler
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import checked_flag, finite_number, float_array, named, whole_number
from granular_id._estimators import origin_of, traced
from granular_id._parallel import in_threads, single_threaded_blas

FloatArray = npt.NDArray[np.float64]
Contrast = Callable[[FloatArray, FloatArray], FloatArray]

# A product of so many factors from 1 to 2 stays in the range of float64.
_FACTORS = 1000
# Sums of squares of larger numbers overflow.
_LARGEST_SQUARED = 1e150
# Status of scipy's L-BFGS-B.
_REACHED_MAX_ITER = 1


class RICA(ClassNamePrefixFeaturesOutMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Reconstruction independent component analysis.

    Finds unit vectors w_j such that the projections ``x @ w_j`` are far from Gaussian while all of them together
    still rebuild x. With the rows of X and the w_j as columns of W the objective is

        alpha * ||X W W' - X||^2  +  sum over i, j of sigma_j * g(x_i @ w_j)

    with plain sums: twice the rows weigh both terms twice, while larger units favour the reconstruction (it
    grows with the square). There may be more components than features. X is not centred.

    Parameters
    ----------
    n_components : int or None, default None
        Number of components p; None takes as many as there are features. The paper uses 80.
    alpha : float, default 1.0
        Weight of the reconstruction, not negative. 1 is MATLAB's default (its `Lambda`).
    contrast : {"logcosh", "exp", "sqrt"}, default "logcosh"
        g(z): ``log(cosh(2 z)) / 2``, ``-exp(-z**2 / 2)`` or ``sqrt(z**2 + 1e-8)``.
    non_gaussianity : None, or 1 or -1 for each component, default None
        sigma: 1 looks for a projection that is peaked with long tails (super-Gaussian), -1 for a flat one
        (sub-Gaussian). None is 1 for all.
    standardize : bool, default False
        Centre each feature and divide by its population standard deviation first; a constant one becomes 0.
        MATLAB divides by the sample standard deviation instead.
    n_init : int, default 1
        Starts from random vectors; the lowest end is kept. The objective has many local minima:
        `objectives_` shows how far apart they lie. Starts run in the threads of ``joblib.parallel_config``.
    max_iter : int, default 1000
        Iterations of L-BFGS. 550 rows of 100 principal components in newtons, reduced to 80, end by `tol` after
        some 3,000 and 2 % lower than after 1000; after 500 the objective is 3 % higher, after 300 7 %.
    gtol : float, default 1e-6
        Stop when no element of the gradient is larger.
    tol : float, default 1e-6
        Stop when an iteration lowers the objective by less than this share of it (of 1, where it is smaller).
    init : array-like, shape (p, D), optional
        Vectors to start from, as rows, of any length but 0, instead of random ones.
    random_state : int, RandomState or None, default None
        Seed of the starts. Start k is the same however many there are.

    Attributes
    ----------
    components_ : ndarray, shape (p, D)
        The w_j as rows of unit length, for features standardised if asked for.
    mean_, scale_ : ndarray, shape (D,), or None
        What standardising subtracts and then divides by.
    objective_ : float
        The lowest end.
    objectives_ : ndarray, shape (n_init,)
        The end of each start, in their order: the spread tells how much a single one is worth.
    n_iter_ : int
        Iterations of the start that was kept.
    converged_ : bool
        Whether it ended by `tol` or `gtol`.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    ValueError, TypeError
        From `fit`: a parameter outside its range, NaN or infinity in X, X of zeros only (or constant, with
        `standardize`), or so large (some 1e70) that the search would overflow.

    Warns
    -----
    ConvergenceWarning
        The start that was kept ended at `max_iter`, or where rounding hides any descent.

    Notes
    -----
    Each w_j is ``v / ||v||`` of a free vector v; the gradient is that of v (its part along w_j removed). Linear
    algebra is kept to one thread for the time of `fit`, so that results do not depend on the number of threads.

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
    mean_: FloatArray | None
    scale_: FloatArray | None
    objective_: float
    objectives_: FloatArray
    n_iter_: int
    converged_: bool

    def __init__(
        self,
        n_components: int | None = None,
        *,
        alpha: float = 1.0,
        contrast: str = "logcosh",
        non_gaussianity: float | Sequence[float] | None = None,
        standardize: bool = False,
        n_init: int = 1,
        max_iter: int = 1000,
        gtol: float = 1e-6,
        tol: float = 1e-6,
        init: npt.ArrayLike | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_components = n_components
        self.alpha = alpha
        self.contrast = contrast
        self.non_gaussianity = non_gaussianity
        self.standardize = standardize
        self.n_init = n_init
        self.max_iter = max_iter
        self.gtol = gtol
        self.tol = tol
        self.init = init
        self.random_state = random_state

    def fit(self, X: npt.ArrayLike, y: object = None) -> RICA:  # noqa: ARG002 - scikit-learn passes y
        """Find the components.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Features, finite.
        y : ignored

        Returns
        -------
        RICA
            This estimator.
        """
        options = self._checked_options()
        rows: FloatArray = validate_data(self, X, dtype=np.float64)
        n_components = rows.shape[1] if self.n_components is None else int(self.n_components)
        signs = _signs(self.non_gaussianity, n_components)
        starts = self._starts(n_components, rows.shape[1])
        self.mean_ = self.scale_ = None
        if self.standardize:
            largest = float(np.abs(rows).max())
            if largest > _LARGEST_SQUARED:
                raise ValueError(f"X is too large to standardize (up to {largest:.3g}); use other units")
            scaler = StandardScaler().fit(rows)
            self.mean_, self.scale_ = scaler.mean_, scaler.scale_
            rows = scaler.transform(rows)
        if not rows.any():
            constant = "is constant" if self.standardize else "is zero"
            raise ValueError(f"X must vary: every feature {constant} (n_samples = {len(rows)})")
        with single_threaded_blas():
            terms = (float(self.alpha), self.contrast, signs)
            ends = in_threads(lambda start: descend(Objective(rows, *terms), start, options), starts, None)
        self.objectives_ = np.array([float(end.fun) for end in ends])
        best = ends[int(np.argmin(self.objectives_))]
        vectors = best.x.reshape(rows.shape[1], n_components)
        self.components_ = np.ascontiguousarray(unit_columns(vectors).T)
        self.objective_, self.n_iter_ = float(best.fun), max(1, int(best.nit))
        self.converged_ = best.status == 0
        if not self.converged_:
            warnings.warn(_early_end(self.n_iter_, best.status), ConvergenceWarning, stacklevel=2)
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Projections (n, p) of features (n, D) onto the components."""
        check_is_fitted(self)
        rows: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        if self.mean_ is not None and self.scale_ is not None:
            rows = (rows - self.mean_) / self.scale_
        projections: FloatArray = traced(rows @ self.components_.T, origin_of(X), blocks=None)
        return projections

    def get_feature_names_out(self, input_features: npt.ArrayLike | None = None) -> npt.NDArray[Any]:
        """Names (p,) of the projections: ``rica00``, ``rica01``, ..."""
        count = len(super().get_feature_names_out(input_features))  # checks input_features
        width = max(2, len(str(count - 1)))
        return np.asarray([f"rica{number:0{width}d}" for number in range(count)], dtype=object)

    @property
    def _n_features_out(self) -> int:
        return len(self.components_)

    def _checked_options(self) -> dict[str, float]:
        if self.n_components is not None:
            whole_number("n_components", self.n_components)
        whole_number("n_init", self.n_init)
        whole_number("max_iter", self.max_iter)
        for name in ("alpha", "gtol", "tol"):
            finite_number(name, getattr(self, name), least=0)
        checked_flag("standardize", self.standardize)
        named(CONTRASTS, "contrast", self.contrast)
        return {"maxiter": int(self.max_iter), "gtol": float(self.gtol), "ftol": float(self.tol)}

    def _starts(self, n_components: int, n_features: int) -> list[FloatArray]:
        """Free vectors as columns, of unit length, one matrix (D, p) per start."""
        if self.init is None:
            random = check_random_state(self.random_state)
            seeds = random.randint(np.iinfo(np.int32).max, size=int(self.n_init))
            shape = (n_features, n_components)
            return [unit_columns(np.random.RandomState(seed).standard_normal(shape)) for seed in seeds]
        if self.n_init != 1:
            raise ValueError(f"n_init must be 1 where init says where to start, got {self.n_init}")
        vectors = float_array("init", self.init)
        if vectors.shape != (n_components, n_features):
            wanted = f"({n_components}, {n_features}), one row per component"
            raise ValueError(f"init must have shape {wanted}, got {vectors.shape}")
        if not (np.isfinite(vectors).all() and vectors.any(axis=1).all()):
            raise ValueError("init must hold finite vectors, none of them zero")
        return [unit_columns(vectors.T)]


def _logcosh(projections: FloatArray, work: FloatArray) -> FloatArray:
    """``log(cosh(2 z)) / 2`` with slope ``tanh(2 z)``, from one exponential which cannot overflow.

    With e = exp(-4 |z|) the value is ``|z| + log(1 + e) / 2 - log(2) / 2``, and the slope ``2 / (1 + e) - 1`` with
    the sign of z. The logarithms of a column are taken together, as that of a product: each costs as much as
    all the rest.
    """
    np.abs(projections, out=work)
    sums: FloatArray = work.sum(axis=0)
    work *= -4.0
    np.exp(work, out=work)
    work += 1.0
    products = np.multiply.reduceat(work, np.arange(0, len(work), _FACTORS), axis=0)
    sums += 0.5 * np.log(products).sum(axis=0) - 0.5 * math.log(2.0) * len(work)
    np.divide(2.0, work, out=work)
    work -= 1.0
    np.copysign(work, projections, out=projections)
    return sums


def _exp(projections: FloatArray, work: FloatArray) -> FloatArray:
    """``-exp(-z**2 / 2)`` with slope ``z * exp(-z**2 / 2)``."""
    np.square(projections, out=work)
    work *= -0.5
    np.exp(work, out=work)
    projections *= work
    sums: FloatArray = -work.sum(axis=0)
    return sums


def _sqrt(projections: FloatArray, work: FloatArray) -> FloatArray:
    """``sqrt(z**2 + 1e-8)``, an absolute value with a round corner, with slope ``z / sqrt(z**2 + 1e-8)``."""
    np.square(projections, out=work)
    work += 1e-8
    np.sqrt(work, out=work)
    projections /= work
    sums: FloatArray = work.sum(axis=0)
    return sums


CONTRASTS: dict[str, Contrast] = {"logcosh": _logcosh, "exp": _exp, "sqrt": _sqrt}
"""Each takes projections (n, p), returns their sums (p,) over rows, and leaves slopes in their place.

The second array, of the same shape, is room to work in: to ask for new memory takes longer than to fill it.
"""


class Objective:
    """``alpha * ||X W W' - X||^2 + sum of signs * g(X W)`` for W of unit columns, and its gradient.

    The reconstruction needs the rows only through S = X' X: it is ``<W'W, W'SW> - 2 trace(W'SW) + trace(S)``, which
    never makes the n x D residual. With more features than rows S would be the larger, and S W is made from X W.
    It holds room for its work: one for each thread.
    """

    def __init__(self, rows: FloatArray, alpha: float, contrast: str, signs: FloatArray) -> None:
        with np.errstate(over="ignore"):
            self._total = float(np.einsum("ij,ij->", rows, rows))
        # The search squares gradients, which are as large as the total.
        if not self._total < 1e-10 * math.sqrt(np.finfo(np.float64).max):
            raise ValueError(
                f"X is too large (up to {np.abs(rows).max():.3g}): the search would overflow; use other units"
            )
        self._rows = rows
        self._scatter = rows.T @ rows if rows.shape[1] <= len(rows) else None
        self._alpha = alpha
        self._contrast = CONTRASTS[contrast]
        self._signs = signs
        self._projections = np.empty((len(rows), len(signs)))
        self._work = np.empty_like(self._projections)

    def __call__(self, units: FloatArray) -> tuple[float, FloatArray]:
        """Value, and gradient (D, p) with respect to W as if its columns were free."""
        projections = np.matmul(self._rows, units, out=self._projections)
        image = self._rows.T @ projections if self._scatter is None else self._scatter @ units
        between = units.T @ units
        energy = units.T @ image
        rebuilt = float(np.vdot(between, energy)) - 2.0 * float(np.trace(energy)) + self._total
        between.flat[:: len(between) + 1] -= 2.0
        gradient: FloatArray = image @ between
        gradient += units @ energy
        gradient *= 2.0 * self._alpha
        contrasts = self._contrast(projections, self._work)
        slopes = np.multiply(projections, self._signs, out=projections)
        gradient += self._rows.T @ slopes
        return self._alpha * rebuilt + float(contrasts @ self._signs), gradient


def descend(objective: Objective, start: FloatArray, options: dict[str, float]) -> OptimizeResult:
    """Follow an objective downhill by L-BFGS, from free vectors (D, p) whose directions are the components."""
    shape = start.shape

    def of_free_vectors(flat: FloatArray) -> tuple[float, FloatArray]:
        vectors = flat.reshape(shape)
        norms = np.linalg.norm(vectors, axis=0)
        units = vectors / norms
        value, gradient = objective(units)
        gradient -= units * np.einsum("ij,ij->j", units, gradient)
        gradient /= norms
        return value, gradient.ravel()

    # Each iteration asks for about one value; the limit on values must never be the one that stops.
    return minimize(
        of_free_vectors,
        start.ravel(),
        jac=True,
        method="L-BFGS-B",
        options={**options, "maxfun": 100 * int(options["maxiter"]) + 100},
    )


def unit_columns(vectors: FloatArray) -> FloatArray:
    """Columns (D, p) divided by their length; none may be zero."""
    # By the largest element first: squares neither overflow nor vanish.
    scaled = vectors / np.abs(vectors).max(axis=0)
    columns: FloatArray = scaled / np.linalg.norm(scaled, axis=0)
    return columns


def _signs(non_gaussianity: float | Sequence[float] | None, n_components: int) -> FloatArray:
    if non_gaussianity is None:
        return np.ones(n_components)
    given = np.asarray(non_gaussianity)
    if given.shape not in {(), (n_components,)}:
        raise ValueError(
            f"non_gaussianity must be one number or {n_components}, one per component, got shape {given.shape}"
        )
    if given.dtype.kind == "b" or not np.isin(given, (-1, 1)).all():
        raise ValueError(f"non_gaussianity must hold 1 and -1 only, got {non_gaussianity!r}")
    return np.broadcast_to(given, n_components).astype(np.float64)


def _early_end(n_iter: int, status: int) -> str:
    if status == _REACHED_MAX_ITER:
        return f"RICA reached max_iter ({n_iter}) before it converged: raise max_iter or tol"
    return f"RICA stopped after {n_iter} iterations where rounding hides any descent: raise tol"
