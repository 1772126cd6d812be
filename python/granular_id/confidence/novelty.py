"""How unlike all known materials a recording is: distances to class means, where classes differ and over all features.

Sources: Fisher, "The use of multiple measurements in taxonomic problems" (1936), for the directions; Lee, Lee, Lee,
Shin, "A simple unified framework for detecting out-of-distribution samples" (NeurIPS 2018), for the distance to the
nearest mean.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from granular_id.confidence.candidates import quantile

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Rows = npt.NDArray[np.integer]

N_BLOCKS = 4
"""Blocks in time that the limit is set on, where no sessions are known."""

N_RANDOM_FOLDS = 10
"""Models of nine tenths of the rows stand for the final one."""

_SHRINKAGE = 1e-3
"""Share of the variance within classes that is added to that of each direction."""

_WEIGHT = 0.3
"""Of the distance over all features, beside that along the directions that tell classes apart."""

_BLOCK_LEVEL = 0.8
"""Share of the blocks in time that keep the limit."""

_ROUNDING = 1e-9
_FAR = 1e100  # beyond any distance, and finite when a weight multiplies it


class Parts(NamedTuple):
    """Squared distances of rows to the mean of each named class.

    Attributes
    ----------
    d : ndarray, shape (n, K)
        Along the directions that tell classes apart.
    e : ndarray, shape (n, K)
        Over all features.
    """

    d: FloatArray
    e: FloatArray

    def score(self, weights: tuple[float, float]) -> FloatArray:
        """Novelty (n,): the weighted sum of `d` and `e` for the nearest class."""
        nearest: FloatArray = (weights[0] * self.d + weights[1] * self.e).min(axis=-1)
        return nearest

    def take(self, rows: Rows | slice) -> Parts:
        """Return the distances of some rows."""
        return Parts(self.d[rows], self.e[rows])


@dataclass(frozen=True, eq=False)
class Novelty:
    """Means of classes and the directions in which they differ, numbers rounded to float32.

    With W the covariance of scaled features within classes and ``A = (W + 0.001 trace(W) I)^(-1/2)``, the directions
    are ``V' A``, where V spans the differences of the means ``A mu_k``: what a linear discriminant looks at.

    Attributes
    ----------
    directions : ndarray of float32, shape (R, D)
        R is the number of classes less one, less where means lie in fewer directions.
    means : ndarray of float32, shape (K, D)
        Of the named classes.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.confidence import Novelty
    >>> codes = np.repeat([0, 1], 50)
    >>> s = np.random.default_rng(0).normal(size=(100, 3)) + 4.0 * codes[:, None]
    >>> fitted = Novelty.fit(s, codes, 2)
    >>> fitted.directions.shape, fitted.means.shape
    ((1, 3), (2, 3))
    >>> near, far = fitted.parts(np.array([[4.0, 4.0, 4.0], [9.0, -9.0, 0.0]])).score((1.0, 1.0))
    >>> bool(near < far)
    True
    """

    directions: npt.NDArray[np.float32]
    means: npt.NDArray[np.float32]

    @classmethod
    def fit(cls, s: FloatArray, codes: Rows, n_named: int) -> Novelty:
        """Learn from rows of known classes.

        Parameters
        ----------
        s : ndarray, shape (n, D)
            Scaled features: columns of one scale, such as `granular_id.BlockScaler` gives.
        codes : ndarray of int, shape (n,)
            Class of each row: 0, 1, ... without a gap.
        n_named : int
            Classes 0 to ``n_named - 1`` have a mean that rows may be near to; the others are background, and show only
            how classes differ and vary.

        Returns
        -------
        Novelty
        """
        means = np.array([s[codes == k].mean(axis=0) for k in range(codes.max() + 1)])
        apart = means - means.mean(axis=0)
        solved = _solved(s - means[codes], apart)
        # V' A = (M' A A M)^(-1/2) M' A A, but for a rotation.
        variances, axes = np.linalg.eigh(apart @ solved.T)
        varies = variances > _ROUNDING * max(variances[-1], np.finfo(float).tiny)
        varies[0] = False  # differences from a mean lie in one direction fewer
        directions = (axes[:, varies] / np.sqrt(variances[varies])).T @ solved
        return cls(directions.astype(np.float32), means[:n_named].astype(np.float32))

    def parts(self, s: FloatArray) -> Parts:
        """Return squared distances of rows (n, D), scaled as those of `fit`, to the means."""
        directions, means = self.directions.astype(np.float64), self.means.astype(np.float64)
        return Parts(_squares(s @ directions.T, means @ directions.T), _squares(s, means))


def scaled(features: FloatArray, scaling: npt.NDArray[np.float32]) -> FloatArray:
    """Scale features (n, D) by centre and factor (2, D) of each."""
    centre, factor = scaling.astype(np.float64)
    rows: FloatArray = (features - centre) * factor
    return rows


def rotated(s: FloatArray) -> FloatArray:
    """Return rows with the same distances in fewer columns, where there are fewer rows than columns."""
    if s.shape[1] <= len(s):
        return s
    small: FloatArray = np.asarray(np.linalg.qr(s.T, mode="r")).T
    return small


def held_out_parts(s: FloatArray, codes: Rows, n_named: int, folds: Iterable[tuple[Rows, Rows]]) -> Parts:
    """Measure distances of rows that did not train.

    Parameters
    ----------
    s, codes, n_named
        As of `Novelty.fit`.
    folds : iterable of two ndarrays of int
        Rows that train, and rows held out; these are far from a class of which no row trains.

    Returns
    -------
    Parts
        For all rows; NaN for those that no fold holds out.
    """
    found = Parts(*np.full((2, len(s), n_named), np.nan))
    for train, test in folds:
        classes, own = np.unique(codes[train], return_inverse=True)
        named = classes[classes < n_named]
        for every, part in zip(found, Novelty.fit(s[train], own, len(named)).parts(s[test]), strict=True):
            every[test] = _FAR
            every[np.ix_(test, named)] = part
    return found


def weights_of(parts: Parts, codes: Rows) -> tuple[float, float]:
    """Weights of both distances: one over their medians of rows to their own class, all over features 0.3 of that."""
    a, b = (float(np.median(part[np.arange(len(codes)), codes])) for part in parts)
    return (1 / a if a > 0 else 0.0), (_WEIGHT / b if b > 0 else 0.0)


def limit(
    parts: Parts,
    weights: tuple[float, float],
    share_known: float,
    *,
    of_folds: tuple[Parts, Parts] | None = None,
    blocks: Rows | None = None,
) -> float:
    """Return the limit that a new row of a known class exceeds in ``1 - share_known`` of all cases, or fewer.

    Parameters
    ----------
    parts : Parts
        Of rows of named classes that were held out.
    weights : tuple of two floats
    share_known : float
        In (0, 1).
    of_folds : tuple of two Parts, optional
        Of such rows held out in 10 random folds, and in as many random folds as `parts` come from. Models of folds
        train on less, and find known rows stranger than the final model does: the limit is multiplied by the ratio.
    blocks : ndarray of int, shape (n,), optional
        Block in time of each row, where no sessions are known: the limit is one that four fifths of the blocks keep.
    """
    novelty = parts.score(weights)
    if blocks is None:
        found = quantile(novelty, share_known)
    else:
        each = [quantile(novelty[blocks == block], share_known) for block in np.unique(blocks)]
        found = quantile(np.array(each), _BLOCK_LEVEL)
    if of_folds is None:
        return found
    final, of_part = (float(np.quantile(own.score(weights), share_known)) for own in of_folds)
    return found * final / of_part if of_part > 0 else found


def blocks_in_time(rank: Rows, codes: Rows) -> IntArray:
    """Block of each row (n,) by its place in time among the rows of its class."""
    blocks = np.empty(len(codes), np.intp)
    for k in np.unique(codes):
        own = np.flatnonzero(codes == k)
        blocks[own[np.argsort(rank[own], kind="stable")]] = np.arange(own.size) * N_BLOCKS // own.size
    return blocks


def _solved(within: FloatArray, rows: FloatArray) -> FloatArray:
    """Return rows (m, D) times the inverse of the shrunken covariance of class-centred rows (n, D)."""
    n, n_columns = within.shape
    ridge = _SHRINKAGE * float((within**2).sum()) / n
    if ridge == 0:  # nothing varies within classes
        return rows
    if n_columns <= n:
        covariance = within.T @ within / n + ridge * np.eye(n_columns)
        solved: FloatArray = np.linalg.solve(covariance, rows.T).T
        return solved
    # Woodbury: fewer rows than columns.
    inner = np.linalg.solve(within @ within.T + n * ridge * np.eye(n), within @ rows.T)
    outside: FloatArray = (rows - inner.T @ within) / ridge
    return outside


def _squares(rows: FloatArray, means: FloatArray) -> FloatArray:
    """Squared distance (n, K) of each row to each mean."""
    squares = (rows**2).sum(axis=1)[:, np.newaxis] - 2 * rows @ means.T + (means**2).sum(axis=1)
    positive: FloatArray = np.maximum(squares, 0.0)
    return positive
