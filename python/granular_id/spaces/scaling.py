"""Columns of one scale, and blocks of one weight: what stands between features of many kinds and a linear machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._numbers import whole_number
from granular_id.spaces.ordered import BlockSizes, SizesParameter

__all__ = ["BlockScaler", "block_slices", "column_moments"]

FloatArray = npt.NDArray[np.float64]

# A column whose spread is this small a share of its magnitude holds rounding, no signal.
_CONSTANT = 1e-9


class BlockScaler(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Standardise every column, and give every block of columns the same weight.

    Each column is centred and divided by its standard deviation over the training rows. Then each block is
    multiplied by one factor, such that it has the same mean squared norm over the training rows as every other
    block, however many columns it has, and that those of all blocks add up to 1: a cost ``C`` of a linear machine
    behind it means the same for any number of columns and blocks.

    Parameters
    ----------
    blocks : mapping of name to number of columns, sequence of int, or None, default None
        Columns of each block, from left to right, for instance ``{"coupling": 624, "spectrum": 192}``. They must
        add up to the number of columns. None: one block.

    Attributes
    ----------
    mean_ : ndarray, shape (D,)
        Of each column over the training rows.
    factor_ : ndarray, shape (D,)
        What a centred column is multiplied by; 0 for a column that is constant in the training rows, of which
        nothing is known.
    block_slices_ : dict of str to slice
        Columns of each block. Blocks without a name are called ``block0 ...``.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: blocks that do not add up to the columns, NaN or infinity, or a spread beyond float64.

    Notes
    -----
    A column counts as constant when its standard deviation is at most 1e-9 of its largest magnitude. A block of
    constant columns has no weight, and the others share it.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import BlockScaler
    >>> X = np.array([[1.0, 10.0, 0.0], [3.0, 10.0, 4.0], [5.0, 10.0, 2.0]])
    >>> scaler = BlockScaler({"left": 2, "right": 1}).fit(X)
    >>> rows = scaler.transform(X)
    >>> (rows**2).mean(axis=0).round(12).tolist()
    [0.5, 0.0, 0.5]
    """

    blocks = SizesParameter()
    mean_: FloatArray
    factor_: FloatArray
    block_slices_: dict[str, slice]
    n_features_in_: int

    def __init__(self, blocks: BlockSizes = None) -> None:
        self.blocks = blocks

    @property
    def learns(self) -> bool:
        """True: means and factors come from the rows given to `fit`."""
        return True

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
        self.block_slices_ = block_slices(self.blocks, rows.shape[1])
        self.mean_, deviation = column_moments(rows)
        self.factor_ = np.zeros(rows.shape[1])
        varying = deviation > 0
        living = [columns for columns in self.block_slices_.values() if varying[columns].any()]
        for columns in living:
            own = np.flatnonzero(varying[columns]) + columns.start
            self.factor_[own] = 1.0 / (deviation[own] * np.sqrt(own.size * len(living)))
        return self

    def transform(self, X: npt.ArrayLike) -> FloatArray:
        """Scale rows (m, D).

        Raises
        ------
        ValueError
            Another number of columns, NaN, infinity, or values so far from the training rows that they leave
            float64.
        """
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        with np.errstate(over="ignore", invalid="ignore"):  # reported below
            scaled: FloatArray = (rows - self.mean_) * self.factor_
        if not np.isfinite(scaled).all():
            raise ValueError(
                "X must be in reach of the training rows: scaled, it leaves the range of float64"
            )
        return scaled


def block_slices(blocks: BlockSizes, n_columns: int) -> dict[str, slice]:
    """Columns of each block by its name, in their order.

    Parameters
    ----------
    blocks : mapping, sequence of int, or None
        As in `BlockScaler`.
    n_columns : int
        Which they must add up to.

    Raises
    ------
    TypeError, ValueError
        Neither, no block, names that are no text, sizes that are no positive whole numbers, or another sum.

    Examples
    --------
    >>> block_slices([2, 3], 5)
    {'block0': slice(0, 2, None), 'block1': slice(2, 5, None)}
    """
    wanted = "blocks must be None, {name: number of columns} or a sequence of numbers of columns"
    if blocks is None:
        return {"block0": slice(0, n_columns)}
    if isinstance(blocks, Mapping):
        pairs = list(blocks.items())
    elif isinstance(blocks, (str, bytes)) or not isinstance(blocks, (Sequence, np.ndarray)):
        raise TypeError(f"{wanted}, got {blocks!r}")
    else:
        pairs = [(f"block{k}", size) for k, size in enumerate(blocks)]
    slices: dict[str, slice] = {}
    start = 0
    for name, size in pairs:
        if not isinstance(name, str) or not name:
            raise TypeError(f"{wanted}, got the name {name!r}")
        stop = start + whole_number(f"blocks[{name!r}]", size)
        slices[name] = slice(start, stop)
        start = stop
    if start != n_columns:
        sizes = ", ".join(f"{name} {size}" for name, size in pairs) or "none"
        raise ValueError(f"blocks must add up to the {n_columns} columns of X, got {start} ({sizes})")
    return slices


def column_moments(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation of each column (population); 0 for one that is constant but for rounding.

    Raises
    ------
    ValueError
        A spread that float64 does not hold.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # reported below
        mean = rows.mean(axis=0)
        deviation = rows.std(axis=0)
    if not (np.isfinite(mean).all() and np.isfinite(deviation).all()):
        raise ValueError("X must have columns whose spread is in the range of float64")
    deviation[deviation <= _CONSTANT * np.abs(rows).max(axis=0)] = 0.0
    with np.errstate(over="ignore", divide="ignore"):
        deviation[~np.isfinite(1.0 / np.where(deviation > 0, deviation, 1.0))] = 0.0  # denormal: no inverse
    return mean, deviation
