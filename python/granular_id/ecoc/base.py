"""What `ECOCClassifier` does whatever it learns from: parameters, classes and codes, decoding, labels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from granular_id.ecoc.coding_matrix import CodingMatrix
from granular_id.ecoc.codings import design
from granular_id.ecoc.cross_fit import cross_fitted, folds_of
from granular_id.ecoc.decoding import DECODINGS, class_values
from granular_id.ecoc.estimators import EstimatorLearner, EstimatorLearners, check_estimator, score_range
from granular_id.ecoc.learners import DualLearners, LinearLearner
from granular_id.ecoc.losses import fitting_loss
from granular_id.ecoc.posterior import POSTERIORS, Posterior, check_posterior, fit_posterior
from granular_id.ecoc.task import checked_task
from granular_id.ecoc.training import checked_cost, checked_flag, checked_n_jobs, class_indices, named

__all__ = ["ECOCBase", "has_posterior"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Set by some ways of fitting and not by others: a new fit starts without them.
_CONDITIONAL = ("coef_", "intercept_", "dual_coef_", "alpha_at_bound_", "_estimators", "_posterior")


def has_posterior(classifier: ECOCBase) -> bool:
    """Return True where `predict_proba` exists, for `sklearn.utils.metaestimators.available_if`."""
    if classifier.posterior is None:
        raise AttributeError(f"predict_proba needs posterior={' or '.join(map(repr, POSTERIORS))}")
    return True


class ECOCBase(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Base of `granular_id.ecoc.ECOCClassifier`, which documents the parameters."""

    classes_: npt.NDArray[Any]
    coding_matrix_: CodingMatrix
    intercept_: FloatArray
    dual_coef_: FloatArray
    alpha_at_bound_: float
    _estimators: EstimatorLearners
    _posterior: Posterior

    def __init__(
        self,
        estimator: Any = None,
        *,
        coding: str | npt.ArrayLike = "onevsone",
        decoding: str = "loss_weighted",
        loss: str = "auto",
        C: float = 1.0,
        hard_margin: bool = False,
        standardize: bool = False,
        posterior: str | None = None,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.estimator = estimator
        self.coding = coding
        self.decoding = decoding
        self.loss = loss
        self.C = C
        self.hard_margin = hard_margin
        self.standardize = standardize
        self.posterior = posterior
        self.n_jobs = n_jobs
        self.random_state = random_state

    @property
    def learners_(self) -> tuple[LinearLearner, ...] | tuple[EstimatorLearner, ...]:
        """The binary learners, in the order of the columns of `coding_matrix_`."""
        check_is_fitted(self, ["dual_coef_", "_estimators"], all_or_any=any)
        if hasattr(self, "_estimators"):
            return self._estimators.each
        columns = zip(self.coding_matrix_.T, self.dual_coef_, self.intercept_.tolist(), strict=True)
        return tuple(LinearLearner.of_column(self.classes_, *column) for column in columns)

    def _check_parameters(self, *, weighted: bool) -> None:
        named(DECODINGS, "decoding", self.decoding)
        checked_cost(self.C)
        checked_flag("hard_margin", self.hard_margin)
        checked_flag("standardize", self.standardize)
        checked_n_jobs(self.n_jobs)
        if self.posterior is not None:
            named(POSTERIORS, "posterior", self.posterior)
        if self.estimator is not None:
            check_estimator(self.estimator, weighted=weighted)
            if self.hard_margin or self.C != 1.0:
                raise ValueError(
                    "C and hard_margin belong to the built-in support vector machine: set what the estimator has "
                    f"of them on the estimator, got C={self.C!r}, hard_margin={self.hard_margin!r}"
                )
        fitting_loss(self.loss, "real" if self.estimator is None else score_range(self.estimator))

    def _start(self, labels: npt.NDArray[Any], weights: FloatArray | None) -> tuple[IntArray, int, int]:
        """Forget an earlier fit; learn classes and codes; return class indices, seeds of the folds and of learners."""
        base = int(check_random_state(self.random_state).randint(np.iinfo(np.int32).max))
        coding_seed, fold_seed, learner_seed = np.random.SeedSequence(base).generate_state(3).tolist()
        classes, codes = class_indices(labels, weights)
        matrix = design(self.coding, len(classes), np.random.default_rng(coding_seed))
        if self.posterior is not None:
            check_posterior(self.posterior, matrix)
        for name in _CONDITIONAL:
            if hasattr(self, name):
                delattr(self, name)
        self.classes_, self.coding_matrix_ = classes, matrix
        return codes, fold_seed, learner_seed

    def _machine_options(self, weights: FloatArray | None) -> dict[str, Any]:
        """Options of `granular_id.ecoc.learners.fit_dual`."""
        return {
            "C": float(self.C),
            "hard_margin": bool(self.hard_margin),
            "sample_weight": weights,
            "class_names": self.classes_.tolist(),
            "n_jobs": self.n_jobs,
        }

    def _keep(self, learned: DualLearners) -> None:
        self.dual_coef_ = learned.dual_coef
        self.intercept_ = learned.intercept
        self.alpha_at_bound_ = learned.alpha_at_bound

    def _learn_posterior(
        self,
        fit_and_score: Callable[[IntArray, IntArray], FloatArray],
        rows: npt.NDArray[Any],
        codes: IntArray,
        weights: FloatArray | None,
        seed: int,
    ) -> None:
        """Fit sigmoids on scores of rows that the learners have not seen; `rows` (n, m) tells which are equal."""
        names = self.classes_.tolist()
        task = checked_task(len(codes), codes, self.coding_matrix_, weights, names)
        folds = folds_of(rows, codes, task.counted, seed, names)
        scores = cross_fitted(fit_and_score, folds, task.n_learners)
        self._posterior = fit_posterior(str(self.posterior), scores, task)

    def _class_values(self, scores: FloatArray) -> FloatArray:
        """Decision values (n, K) for scores (n, L); loss and decoding may have been set anew after the fit."""
        named(DECODINGS, "decoding", self.decoding)
        scores_are = self._estimators.score_range if hasattr(self, "_estimators") else "real"
        loss = fitting_loss(self.loss, scores_are)
        return class_values(scores, self.coding_matrix_, loss, self.decoding)

    def _decision(self, scores: FloatArray) -> FloatArray:
        values = self._class_values(scores)
        return values[:, 1] - values[:, 0] if values.shape[1] == 2 else values

    def _winners(self, scores: FloatArray) -> npt.NDArray[Any]:
        labels: npt.NDArray[Any] = self.classes_[self._class_values(scores).argmax(axis=1)]
        return labels

    def _probabilities(self, scores: FloatArray) -> FloatArray:
        check_is_fitted(
            self, "_posterior", msg="This %(name)s was fitted with posterior=None: call fit again"
        )
        return self._posterior.probabilities(scores, self.coding_matrix_)
