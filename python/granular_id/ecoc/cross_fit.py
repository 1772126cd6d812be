"""Scores of training rows from learners that have not seen them.

A support vector machine with more features than rows puts every training row on its margin or beyond: the scores of its
own rows say nothing of how sure it is. Each row is scored by learners trained on the other folds instead.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["KEPT", "N_FOLDS", "cross_fitted", "folds_of"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

N_FOLDS = 5
"""Folds of the cross-fit: four fifths of the rows train, close to the learners that are used in the end."""

KEPT = N_FOLDS
"""Number of the fold that always trains."""


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
    and dealt out in turn, going on in the next class with the next fold. The one row of a class cannot be held out:
    it goes to the fold `KEPT`, which always trains, and is scored by learners that know it. How sure they are of it is
    bounded by the softened target of the sigmoid, 2/3 for one row.

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

    Warns
    -----
    UserWarning
        Classes with a single row, by name.
    """
    rng = np.random.default_rng(seed)
    folds = np.full(len(codes), -1)
    next_fold, single = 0, []
    for k, name in enumerate(names):
        own = counted[codes[counted] == k]
        different, inverse = np.unique(rows[own], axis=0, return_inverse=True)
        if len(different) < 2:
            folds[own] = KEPT
            single.append(repr(str(name)))
            continue
        order = rng.permutation(len(different))
        folds[own] = (next_fold + order[inverse.ravel()]) % N_FOLDS
        next_fold += len(different)
    if single:
        warnings.warn(
            "posterior needs 2 different rows of a class, to score each by learners trained on the other; "
            f"scored by learners that know it: the one row of {', '.join(single)}",
            UserWarning,
            stacklevel=2,
        )
    return folds


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
        trains = (folds >= 0) & ((folds != fold) | (folds == KEPT))
        scored = np.flatnonzero(folds == fold)
        scores[scored] = fit_and_score(np.flatnonzero(trains), scored)
    return scores
