"""Between features of many kinds and a linear classifier: columns of one scale, blocks of one weight, whitening."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
from sklearn.decomposition import PCA
from sklearn.preprocessing import StandardScaler
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import argument_error, positive_number, whole_number
from granular_id._core import GranularIdError
from granular_id.rica import RICA

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BlockSizes = Mapping[str, int] | None

# A column whose spread is this small a share of its magnitude holds rounding, no signal.
_CONSTANT = 1e-9

# Eigenvalues below this times n * eps * the largest are what rounding leaves of zeros.
_ROUNDING = 32.0


class BlockScaler(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Standardise every column, and give every block of columns the same weight.

    Each column is centred and divided by its standard deviation over the training rows. Then each block is
    multiplied by one factor, such that it has the same mean squared norm over the training rows as every other
    block, however many columns it has, and that those of all blocks add up to 1: a cost ``C`` of a linear
    classifier behind it means the same for any number of columns and blocks.

    Parameters
    ----------
    blocks : mapping of name to number of columns, or None, default None
        Columns of each block, from left to right, for instance ``{"coupling": 624, "spectrum": 192}``. They must
        add up to the number of columns, as ``block_sizes_`` of a fitted `MultiBand`. None: one block, "all".

    Attributes
    ----------
    mean_ : ndarray, shape (D,)
        Of each column over the training rows.
    factor_ : ndarray, shape (D,)
        What a centred column is multiplied by; 0 for a column that is constant in the training rows, of which
        nothing is known.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: blocks that do not add up to the columns, NaN or infinity.

    Notes
    -----
    A column counts as constant when its standard deviation is at most 1e-9 of its largest magnitude. A block of
    constant columns has no weight, and the others share it.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import BlockScaler
    >>> X = np.array([[1.0, 10.0, 0.0], [3.0, 10.0, 4.0], [5.0, 10.0, 2.0]])
    >>> scaler = BlockScaler({"left": 2, "right": 1}).fit(X)
    >>> rows = scaler.transform(X)
    >>> (rows**2).mean(axis=0).round(12).tolist()
    [0.5, 0.0, 0.5]
    """

    mean_: FloatArray
    factor_: FloatArray
    n_features_in_: int

    def __init__(self, blocks: BlockSizes = None) -> None:
        self.blocks = blocks

    def fit(self, X: npt.ArrayLike, y: object = None) -> BlockScaler:  # noqa: ARG002
        """Learn the mean and the factor of each column.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Training rows, finite.
        y : ignored

        Returns
        -------
        self
        """
        rows = validate_data(self, X, dtype=np.float64)
        slices = block_slices(self.blocks, rows.shape[1])
        self.mean_, deviation = column_moments(rows)
        self.factor_ = block_factors(deviation, slices)
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Scale rows (m, D)."""
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        scaled: FloatArray = (rows - self.mean_) * self.factor_
        return scaled


def block_slices(blocks: BlockSizes, n_columns: int) -> dict[str, slice]:
    """Columns of each block by its name, in their order; refuse blocks that do not add up to `n_columns`."""
    sizes = {"all": n_columns} if blocks is None else blocks
    if not isinstance(sizes, Mapping):
        raise argument_error(
            TypeError, "blocks", f"must be None or {{name: number of columns}}, got {blocks!r}"
        )
    ends = np.cumsum([0, *(whole_number(f"blocks[{name!r}]", size) for name, size in sizes.items())]).tolist()
    if ends[-1] != n_columns:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items()) or "none"
        problem = f"must add up to the {n_columns} columns of X, got {ends[-1]} ({listed})"
        raise argument_error(GranularIdError, "blocks", problem)
    return {name: slice(*span) for name, span in zip(sizes, pairwise(ends), strict=True)}


def column_moments(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation of each column (population); 0 for one that is constant but for rounding."""
    deviation = rows.std(axis=0)
    least = np.maximum(_CONSTANT * np.abs(rows).max(axis=0), np.finfo(np.float64).tiny)
    return rows.mean(axis=0), np.where(deviation > least, deviation, 0.0)


def block_factors(deviation: FloatArray, slices: Mapping[str, slice]) -> FloatArray:
    """Factor (D,) of each column that gives it unit spread, and blocks equal weight; 0 of a constant one."""
    factors = np.zeros_like(deviation)
    living = [columns for columns in slices.values() if deviation[columns].any()]
    for columns in living:
        own = np.flatnonzero(deviation[columns]) + columns.start
        factors[own] = 1.0 / (deviation[own] * np.sqrt(own.size * len(living)))
    return factors


class WithinClassWhitening(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Multiply rows by the inverse square root of their covariance within classes.

    ``A = (S + shrinkage * trace(S) * I)^(-1/2)`` with ``S`` the covariance (D, D) of the rows about the mean of
    their class. A direction in which recordings of the same material differ much (a drift, a posture, a person)
    is turned down, before a classifier with few rows takes it for a difference between materials.

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
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: a shrinkage that is not positive, labels that are no classes, NaN or infinity.

    Notes
    -----
    ``A`` is symmetric. So each output column belongs to the input column of its name, and weights of a linear
    classifier behind it fold into weights for plain rows by the same transformation: ``transform(coef)``.

    A is never made. With fewer rows than columns the directions come from the scalar products of the rows, and
    everything at right angles to them is multiplied by ``ridge_ ** -0.5``.

    Rows that do not vary within classes (one row of each) tell nothing: they are left as they are.

    References
    ----------
    Hatch and Stolcke, "Generalized linear kernels for one-versus-all classification: application to speaker
    recognition" (ICASSP 2006); Hatch, Kajarekar, Stolcke, "Within-class covariance normalization for SVM-based speaker
    recognition" (Interspeech 2006).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import WithinClassWhitening
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
    n_features_in_: int

    def __init__(self, shrinkage: float = 1e-3) -> None:
        self.shrinkage = shrinkage

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
        within = _within_class(rows, np.unique(labels, return_inverse=True)[1])
        # Equal rows leave the rounding of their mean.
        within[np.abs(within) <= _ROUNDING * np.finfo(np.float64).eps * np.abs(rows).max(axis=0)] = 0.0
        self.variances_, self.components_ = _directions(within)
        self.ridge_ = shrinkage * float(self.variances_.sum())
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Whiten rows (m, D); also folds weights (L, D) of a linear classifier behind, see the notes."""
        check_is_fitted(self)
        rows: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        if self.ridge_ == 0.0:
            return np.array(rows)
        still = self.ridge_**-0.5
        moved = (self.variances_ + self.ridge_) ** -0.5 - still
        whitened: FloatArray = rows * still + ((rows @ self.components_.T) * moved) @ self.components_
        return whitened

    def __sklearn_tags__(self) -> Any:
        """Tags of scikit-learn: labels are needed."""
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


def _within_class(rows: FloatArray, codes: IntArray) -> FloatArray:
    """Rows (n, m) minus the mean row of their class; `codes` (n,) count classes from 0."""
    counts = np.bincount(codes)
    sums = np.zeros((len(counts), rows.shape[1]))
    np.add.at(sums, codes, rows)
    centred: FloatArray = rows - (sums / np.maximum(counts, 1)[:, np.newaxis])[codes]
    return centred


def whitened_grams(
    gram: FloatArray, cross: FloatArray, codes: IntArray, shrinkage: float
) -> tuple[FloatArray, FloatArray]:
    """`gram` (n, n) and `cross` (m, n) with rows as `WithinClassWhitening` gives them, times its ``ridge_``.

    With W (n, D) the class-centred rows, ``ridge A A = I - W' (W W' + n ridge I)^-1 W`` (Woodbury): a tenth of the time
    of the directions themselves where columns outnumber rows.
    """
    n = len(gram)
    to_within = _within_class(gram, codes).T  # products of all rows with the class-centred ones
    within = _within_class(to_within, codes)
    trace = float(np.trace(within)) / n
    if not trace > 1e-12 * float(np.trace(gram)) / n:
        return gram, cross  # no variance within classes
    within[np.diag_indices(n)] += n * shrinkage * trace
    factor = scipy.linalg.cho_factor((within + within.T) / 2, lower=True, check_finite=False)
    taken = scipy.linalg.cho_solve(factor, to_within.T, check_finite=False)
    return gram - to_within @ taken, cross - _within_class(cross.T, codes).T @ taken


def _directions(within: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances (r,) and unit directions (r, D) of centred rows (n, D), largest first, without those of rounding."""
    n, n_columns = within.shape
    squares, vectors = scipy.linalg.eigh(within @ within.T if n < n_columns else within.T @ within)
    squares, vectors = squares[::-1], vectors[:, ::-1]
    noise = _ROUNDING * n * np.finfo(np.float64).eps * max(float(squares[0]), 0.0)
    rank = int(np.count_nonzero(squares > noise))
    squares, vectors = squares[:rank], vectors[:, :rank]
    directions = (vectors / np.sqrt(squares)).T @ within if n < n_columns else vectors.T
    return squares / n, np.ascontiguousarray(directions)


LINEAR_STEPS = (RICA, PCA, StandardScaler, BlockScaler, WithinClassWhitening)
"""Steps of the form ``L (x - mean)``: what stands behind them can be folded back."""


def folded_back(
    steps: Sequence[Any], weights: npt.ArrayLike, intercept: npt.ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Turn weights (L, D') or (D',) behind fitted `LINEAR_STEPS`, first to last, into weights in front of them."""
    folded, constant = np.asarray(weights, dtype=np.float64), np.asarray(intercept, dtype=np.float64)
    for step in reversed(steps):
        if isinstance(step, WithinClassWhitening):  # symmetric: (A x) w = x (A w)
            folded = step.transform(np.atleast_2d(folded)).reshape(folded.shape)
        elif isinstance(step, BlockScaler):
            folded = folded * step.factor_
        elif isinstance(step, StandardScaler):
            folded = folded if step.scale_ is None else folded / step.scale_
        else:
            if getattr(step, "whiten", False):  # as PCA.transform does it, with the same floor
                folded = folded / np.maximum(np.sqrt(step.explained_variance_), np.finfo(np.float64).eps)
            folded = folded @ step.components_
        mean = getattr(step, "mean_", None)
        if mean is not None and getattr(step, "with_mean", True):
            constant = constant - folded @ mean
    return folded, constant
