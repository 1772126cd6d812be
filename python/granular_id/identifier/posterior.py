"""Probabilities of the space "best", from the recordings that it held out to choose."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from granular_id.best import BestClassifier
from granular_id.ecoc.posterior import Posterior, check_posterior, fit_posterior
from granular_id.ecoc.task import Task

__all__ = ["posterior_of"]


def posterior_of(classifier: BestClassifier, y: npt.NDArray[np.str_], method: str) -> Posterior:
    """Fit probabilities to scores of training rows by machines that had not seen them.

    Parameters
    ----------
    classifier : BestClassifier
        Fitted.
    y : ndarray, shape (n,)
        Labels of its training rows.
    method : str
        As `posterior` of `granular_id.ECOCClassifier`.

    Raises
    ------
    ValueError
        An unknown method, or a class of which no recording was held out.
    """
    matrix, scores = classifier.coding_matrix_, classifier.held_out_scores_
    check_posterior(method, matrix)
    rows = np.flatnonzero(~np.isnan(scores).any(axis=1))
    index = np.searchsorted(classifier.classes_, y[rows])
    missing = [str(name) for k, name in enumerate(classifier.classes_) if not (index == k).any()]
    if missing:
        raise ValueError(
            f"posterior needs recordings of every class that were held out, {missing[0]!r} has none: record more "
            "of it, or leave posterior out"
        )
    task = Task(
        matrix, index.astype(np.intp), None, np.arange(rows.size), [str(c) for c in classifier.classes_]
    )
    return fit_posterior(method, scores[rows], task)
