"""Any scikit-learn classifier as binary learner: a clone for each column of a coding matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import is_classifier
from sklearn.utils.validation import has_fit_parameter

from granular_id._estimators import seeded_clone
from granular_id.ecoc.learners import line_scores, mean_and_deviation
from granular_id.ecoc.task import Task, over_learners, sides_of

FloatArray = npt.NDArray[np.float64]

# Rows on which a learner with coef_ must give the scores of coef_ before it is taken for linear.
_PROBES = 8


@dataclass(frozen=True)
class EstimatorLearner:
    """One binary learner of a fitted `ECOCClassifier` with an `estimator`.

    Attributes
    ----------
    positive, negative : tuple
        Labels of the classes with code +1 and with code -1.
    estimator : classifier
        Fitted clone; its classes are 0 for the code -1 and 1 for the code +1.
    mean, deviation : ndarray, shape (D,), or None
        It was trained on ``(x - mean) / deviation``; None when not standardised.
    """

    positive: tuple[Any, ...]
    negative: tuple[Any, ...]
    estimator: Any
    mean: FloatArray | None = None
    deviation: FloatArray | None = None

    def scores(self, rows: FloatArray) -> FloatArray:
        """Scores (m,) of features (m, D) in their own units: real, or in [0, 1] for probabilities of the code +1."""
        own = _moved(rows, self.mean, self.deviation)
        if score_range(self.estimator) == "unit":
            probabilities = np.asarray(self.estimator.predict_proba(own), dtype=np.float64)
            positive: FloatArray = probabilities[:, int(np.flatnonzero(self.estimator.classes_ == 1)[0])]
            return np.clip(positive, 0.0, 1.0)  # a sum of shares may pass 1 by rounding
        values = np.asarray(self.estimator.decision_function(own), dtype=np.float64)
        if values.size != len(rows):
            raise ValueError(
                f"decision_function of {type(self.estimator).__name__} must give one score per row for two classes, "
                f"got shape {values.shape} for {len(rows)} rows"
            )
        return values.reshape(len(rows))

    def line(self, n_features: int) -> tuple[FloatArray, float] | None:
        """Weights (D,) and intercept in the units of the features; None without `coef_` and `intercept_`."""
        coef, intercept = (getattr(self.estimator, name, None) for name in ("coef_", "intercept_"))
        if not isinstance(coef, np.ndarray) or coef.size != n_features or intercept is None:
            return None
        offsets = np.asarray(intercept, dtype=np.float64).ravel()
        if len(offsets) != 1:
            return None
        weights = np.array(coef, dtype=np.float64).reshape(n_features)
        if self.mean is None or self.deviation is None:
            return weights, float(offsets[0])
        weights /= self.deviation
        return weights, float(offsets[0]) - float(weights @ self.mean)


@dataclass(frozen=True)
class EstimatorLearners:
    """All learners in the order of the columns, and as lines (L, D) and (L,) where all of them are linear."""

    each: tuple[EstimatorLearner, ...]
    coef: FloatArray | None
    intercept: FloatArray | None

    @property
    def score_range(self) -> str | None:
        """Range of the scores; the learners are clones and all have the same."""
        return score_range(self.each[0].estimator)

    def scores(self, rows: FloatArray, n_jobs: int | None = None) -> FloatArray:
        """Scores (m, L) of features (m, D)."""
        if self.coef is not None and self.intercept is not None:
            return line_scores("X", rows, self.coef, self.intercept)
        columns = over_learners(lambda learner: self.each[learner].scores(rows), len(self.each), n_jobs)
        return np.column_stack(columns)


def check_estimator(estimator: object, *, weighted: bool) -> None:
    """Raise a TypeError unless `estimator` is a classifier that can be cloned, and weighted where that is wanted."""
    is_instance = not isinstance(estimator, type) and hasattr(estimator, "get_params")
    if not is_instance or not is_classifier(estimator):
        raise TypeError(
            f"estimator must be None or a scikit-learn classifier such as LogisticRegression(), got {estimator!r}"
        )
    if weighted and not has_fit_parameter(estimator, "sample_weight"):
        raise TypeError(
            f"sample_weight was given, but the estimator's fit does not take it: {type(estimator).__name__}"
        )


def score_range(estimator: object) -> str | None:
    """Return "real" for a classifier with decision_function, "unit" for one with predict_proba only, else None."""
    if hasattr(estimator, "decision_function"):
        return "real"
    return "unit" if hasattr(estimator, "predict_proba") else None


def fit_estimators(
    estimator: Any, rows: FloatArray, task: Task, *, standardize: bool, seed: int, n_jobs: int | None
) -> EstimatorLearners:
    """Train a clone of an estimator for each learner; `seed` spreads over each ``random_state`` that is None."""

    def train(learner: int) -> EstimatorLearner:
        members = task.rows(learner)
        own, weights = rows[members], task.weights_of(members)
        mean, deviation = mean_and_deviation(own, weights) if standardize else (None, None)
        fresh = seeded_clone(estimator, np.random.SeedSequence(seed, spawn_key=(learner,)))
        targets = (task.targets(learner, members) > 0).astype(np.intp)
        weighted = {} if weights is None else {"sample_weight": weights}
        try:
            fresh.fit(_moved(own, mean, deviation), targets, **weighted)
        except ValueError as reason:
            raise ValueError(f"the learner of {task.described(learner)}: {reason}") from reason
        if score_range(fresh) is None:
            raise TypeError(
                f"estimator must have decision_function or predict_proba, {type(estimator).__name__} has neither"
            )
        return EstimatorLearner(*sides_of(task.matrix[:, learner], task.names), fresh, mean, deviation)

    each = tuple(over_learners(train, task.n_learners, n_jobs))
    return EstimatorLearners(each, *_lines(each, rows, task))


def _moved(rows: FloatArray, mean: FloatArray | None, deviation: FloatArray | None) -> FloatArray:
    return rows if mean is None or deviation is None else (rows - mean) / deviation


def _lines(
    each: Sequence[EstimatorLearner], rows: FloatArray, task: Task
) -> tuple[FloatArray, FloatArray] | tuple[None, None]:
    """Weights (L, D) and intercepts (L,) if all learners are linear: they have `coef_`, and it gives their scores."""
    coef, intercept = np.empty((len(each), rows.shape[1])), np.empty(len(each))
    for number, learner in enumerate(each):
        line = learner.line(rows.shape[1]) if score_range(learner.estimator) == "real" else None
        if line is None:
            return None, None
        coef[number], intercept[number] = line
        probes = rows[task.rows(number)[:_PROBES]]
        scores = learner.scores(probes)
        tolerance = 1e-6 * (np.abs(probes) @ np.abs(coef[number]) + abs(intercept[number])) + 1e-9
        if not (np.abs(probes @ coef[number] + intercept[number] - scores) <= tolerance).all():
            return None, None
    return coef, intercept
