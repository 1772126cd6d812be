"""Scores of training rows from learners that have not seen them.

A support vector machine with more features than rows puts every training row on its margin or beyond: the scores of its
own rows say nothing of how sure it is. Each row is scored by learners trained on the other folds instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["N_FOLDS", "cross_fitted", "folds_of", "kinds_from_gram"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

N_FOLDS = 5
"""Folds of the cross-fit: four fifths of the rows train, close to the learners that are used in the end."""

# Rows this near on the scale of the largest are repetitions of one another.
_SAME = 1e-10


def folds_of(
    rows: npt.NDArray[np.generic],
    codes: IntArray,
    counted: IntArray,
    seed: int,
    names: Sequence[object],
) -> IntArray:
    """Deal the rows of each class out to `N_FOLDS` folds.

    Equal rows of a class stay together. A fold would otherwise be scored by learners that know some of its rows, and a
    weight of 2 would not mean the same as a row given twice. Within a class different rows are put in order, shuffled
    and dealt out in turn, going on in the next class with the next fold.

    Parameters
    ----------
    rows : ndarray, shape (n, m)
        What tells rows apart.
    codes : ndarray of int, shape (n,)
        Class index of each row.
    counted : ndarray of int
        Rows with a weight above 0.
    seed : int
        Same seed, same folds, in whatever order the rows come.
    names : sequence
        Class names for the message.

    Returns
    -------
    ndarray of int, shape (n,)
        Fold of each row; -1 for rows that do not count.

    Raises
    ------
    ValueError
        A class with fewer than two different rows: one must train while the other is scored.
    """
    rng = np.random.default_rng(seed)
    folds = np.full(len(codes), -1)
    next_fold = 0
    for k, name in enumerate(names):
        own = counted[codes[counted] == k]
        different, inverse = np.unique(rows[own], axis=0, return_inverse=True)
        if len(different) < 2:
            raise ValueError(
                f"posterior needs at least 2 different rows of each class, to score some by learners trained on the "
                f"others: class {str(name)!r} has {len(different)}"
            )
        order = rng.permutation(len(different))
        folds[own] = (next_fold + order[inverse.ravel()]) % N_FOLDS
        next_fold += len(different)
    return folds


def kinds_from_gram(gram: FloatArray) -> IntArray:
    """Tell rows apart by their scalar products: for each row the index of the first that equals it, shape (n, 1)."""
    squares = np.diag(gram)
    distance = squares[:, None] + squares - 2.0 * gram
    spread = max(float(np.trace(gram)) / len(gram) - float(gram.mean()), 0.0)
    first: IntArray = (distance <= _SAME * spread).argmax(axis=1)
    return first[:, None]


def cross_fitted(
    fit_and_score: Callable[[IntArray, IntArray], FloatArray], folds: IntArray, n_learners: int
) -> FloatArray:
    """Scores (n, L) of all rows that count, each from learners trained on the other folds; 0 for other rows.

    Parameters
    ----------
    fit_and_score : callable
        From the indices of the rows to train on and of the rows to score (r,) to scores (r, L).
    folds : ndarray of int, shape (n,)
        From `folds_of`.
    n_learners : int
        L.
    """
    scores = np.zeros((len(folds), n_learners))
    for fold in np.unique(folds[folds >= 0]):
        held_out = np.flatnonzero(folds == fold)
        scores[held_out] = fit_and_score(np.flatnonzero((folds >= 0) & (folds != fold)), held_out)
    return scores
