"""Posterior probabilities: a sigmoid for each learner, then one distribution over the classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from granular_id.ecoc.coding_matrix import CodingMatrix
from granular_id.ecoc.coupling import couple_kullback_leibler, couple_wu_lin_weng, pairs_of
from granular_id.ecoc.sigmoid import fit_sigmoid, sigmoid
from granular_id.ecoc.task import Task
from granular_id.ecoc.training import named

__all__ = ["POSTERIORS", "Posterior", "check_posterior", "fit_posterior"]

FloatArray = npt.NDArray[np.float64]

POSTERIORS: Mapping[str, str] = MappingProxyType(
    {
        "kullback_leibler": "least divergence from what the learners say, for any coding",
        "wu_lin_weng": "least squares over pairs of classes, for one-vs-one",
    }
)
"""How probabilities of learners are coupled, by name."""


@dataclass(frozen=True)
class Posterior:
    """Fitted sigmoids and how to couple them.

    Attributes
    ----------
    method : str
        A key of `POSTERIORS`.
    slope, offset : ndarray, shape (L,)
        Of the sigmoid of each learner.
    weights : ndarray, shape (L,)
        Sum of the weights of the rows behind each learner.
    """

    method: str
    slope: FloatArray
    offset: FloatArray
    weights: FloatArray

    def probabilities(self, scores: FloatArray, coding_matrix: CodingMatrix) -> FloatArray:
        """Probabilities (n, K) of the classes from scores (n, L); rows sum to 1."""
        of_learners = sigmoid(scores, self.slope, self.offset)
        pairs = pairs_of(coding_matrix) if self.method == "wu_lin_weng" else None
        if pairs is not None:
            return couple_wu_lin_weng(of_learners, pairs)
        return couple_kullback_leibler(of_learners, coding_matrix, self.weights)


def check_posterior(method: object, coding_matrix: CodingMatrix) -> None:
    """Raise a ValueError for an unknown method, or one that does not serve the coding."""
    named(POSTERIORS, "posterior", method)
    if method == "wu_lin_weng" and pairs_of(coding_matrix) is None:
        raise ValueError(
            "posterior='wu_lin_weng' needs one learner for each pair of classes (coding='onevsone'); "
            "'kullback_leibler' serves any coding"
        )


def fit_posterior(method: str, scores: FloatArray, task: Task) -> Posterior:
    """Fit the sigmoid of each learner to cross-fitted scores (n, L) of its rows."""
    slope, offset, weights = (np.empty(task.n_learners) for _ in range(3))
    for learner in range(task.n_learners):
        rows = task.rows(learner)
        own = None if task.weights is None else task.weights[rows]
        slope[learner], offset[learner] = fit_sigmoid(scores[rows, learner], task.targets(learner, rows), own)
        weights[learner] = len(rows) if own is None else own.sum()
    return Posterior(method, slope, offset, weights)
