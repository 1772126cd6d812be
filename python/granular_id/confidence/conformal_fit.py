"""Thresholds of prediction sets, from scores of rows that did not train."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from granular_id.confidence.conformal import ConformalRule, checked_levels, rank_of
from granular_id.confidence.held_out import HeldOutScores
from granular_id.confidence.nonconformity import KINDS, nonconformity, softmax

__all__ = ["LEVELS", "conformal_quantile", "conformal_rule", "fit_temperature"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

LEVELS = (0.8, 0.9, 0.95)
"""Default coverages: the usual ones; 0.95 needs 19 calibration rows."""

_LOG_RANGE = 12.0  # temperatures from e^-12 to e^12 of the spread of the values
_LEAST = 1e-300


def conformal_rule(
    scored: HeldOutScores,
    levels: Sequence[float] = LEVELS,
    *,
    kind: str = "margin",
    per_class: bool = False,
) -> ConformalRule:
    """Set the thresholds of prediction sets.

    Parameters
    ----------
    scored : HeldOutScores
        Calibration rows. Where each was scored by the one model that decides in the end (split), the coverage is
        guaranteed; where by models of a cross-fit, it comes close: see ``docs/confidence.md`` for how close.
    levels : sequence of float, default `LEVELS`
        Wanted coverages in (0, 1).
    kind : str, default "margin"
        A key of `KINDS`. The margin gives the smallest sets with a linear model, and needs no probabilities.
    per_class : bool, default False
        A threshold for each class (Mondrian): each material alone is covered as often as wanted. Each class then
        needs as many rows as otherwise all have together.

    Returns
    -------
    ConformalRule
        Its `notes` say where there were too few rows.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import conformal_rule, held_out_scores
    >>> from granular_id.confidence.rows import rows_of
    >>> from granular_id.ecoc import ECOCClassifier
    >>> scored = held_out_scores(ECOCClassifier(), rows_of(*load_iris(return_X_y=True)))
    >>> rule = conformal_rule(scored, [0.9])
    >>> covered = rule.sets(scored.scores.values)[range(150), scored.truth]
    >>> float(covered.mean()) >= 0.9
    True
    """
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(map(repr, KINDS))}, got {kind!r}")
    wanted = checked_levels(levels)
    values, truth = scored.scores.values, scored.truth
    temperature = 1.0 if kind == "margin" else fit_temperature(values, truth)
    own = nonconformity(values, kind, temperature)[np.arange(len(truth)), truth]
    parts = [own[truth == k] for k in range(len(scored.classes))] if per_class else [own]
    return ConformalRule(
        scored.classes,
        kind,
        wanted,
        tuple(tuple(conformal_quantile(part, level) for part in parts) for level in wanted),
        tuple(len(part) for part in parts),
        temperature,
        scored.held_out,
    )


def conformal_quantile(scores: FloatArray, level: float) -> float:
    """Return the ceil((n + 1) level)-th smallest of n scores; infinite where that is more than n.

    Examples
    --------
    >>> conformal_quantile(np.arange(9.0), 0.9), conformal_quantile(np.arange(8.0), 0.9)
    (8.0, inf)
    """
    rank = rank_of(len(scores), level)
    return math.inf if rank > len(scores) else float(np.partition(scores, rank - 1)[rank - 1])


def fit_temperature(values: FloatArray, truth: IntArray) -> float:
    """Temperature that makes class values (n, K) the likeliest logarithms of probabilities.

    Source: Guo, Pleiss, Sun, Weinberger, "On calibration of modern neural networks" (ICML 2017), section 4.2.
    """
    spread = float(values.std()) or 1.0
    rows = np.arange(len(truth))

    def loss(log_temperature: float) -> float:
        shares = softmax(values / (spread * math.exp(log_temperature)))[rows, truth]
        return -float(np.log(np.maximum(shares, _LEAST)).mean())

    found = minimize_scalar(loss, bounds=(-_LOG_RANGE, _LOG_RANGE), method="bounded")
    return spread * math.exp(float(found.x))
