"""The rule that picks one candidate and one C from accuracies on the same folds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id.evaluation.statistics import ROPE, corrected_resampled_t
from granular_id.selection.candidates import Candidate

__all__ = ["Pick", "best_cost", "choose"]

Floats = NDArray[np.float64]


class Pick(NamedTuple):
    """Index of a candidate, and index of its C in the grid."""

    candidate: int
    cost: int


def choose(
    accuracies: Floats,
    candidates: Sequence[Candidate],
    n_features: Sequence[int],
    n_train: float,
    n_test: float,
) -> Pick:
    """Pick the simplest candidate that is as good as the best.

    The best has the highest mean accuracy over folds. As good as the best is what loses no more than one
    standard error (of its paired differences to the best, corrected for the folds' common training rows) and no
    more than one point. Of those the one with the fewest `Candidate.parts` is taken, then the one with fewest
    features, then the first; it keeps the C with its highest mean accuracy, see `best_cost`.

    Parameters
    ----------
    accuracies : (J, n_candidates, n_costs) float array
        On J folds, C ascending.
    candidates : sequence of Candidate
    n_features : sequence of int
        Of each candidate.
    n_train, n_test : float
        Recordings in a fold.

    Returns
    -------
    Pick

    Notes
    -----
    The one-standard-error rule of Breiman et al., "Classification and Regression Trees" (1984), section 3.4.3,
    with a paired error and a limit: folds in time differ much, and the plain rule would then accept candidates
    that lose many points.
    """
    costs = [best_cost(accuracies[:, k]) for k in range(len(candidates))]
    at_best = np.stack([accuracies[:, k, cost] for k, cost in enumerate(costs)], axis=1)
    best = int(at_best.mean(axis=0).argmax())
    as_good = [
        k
        for k in range(len(candidates))
        if k == best or _as_good(at_best[:, best] - at_best[:, k], n_train, n_test)
    ]
    simplest = min(as_good, key=lambda k: (candidates[k].parts, n_features[k], k))
    return Pick(simplest, costs[simplest])


def best_cost(accuracies: Floats) -> int:
    """Index of the C with the highest mean accuracy of (J, n_costs); of equals the middle one.

    On a plateau its edges are where the next recordings fall off first.
    """
    means = accuracies.mean(axis=0)
    equals = np.flatnonzero(means >= means.max() - 1e-12)  # but for rounding of the mean
    return int(equals[(len(equals) - 1) // 2])


def _as_good(losses: Floats, n_train: float, n_test: float) -> bool:
    test = corrected_resampled_t(losses, n_train, n_test)
    # Equal on every fold, or so close that the folds could not tell; an error that is NaN accepts nothing else.
    return test.mean <= 0 or (test.mean <= ROPE and test.mean <= test.standard_error)
