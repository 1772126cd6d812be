"""`ECOCClassifier` on scalar products: train and predict without features."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils.metaestimators import available_if
from sklearn.utils.validation import check_is_fitted, column_or_1d

from granular_id._arrays import float_array
from granular_id.ecoc.base import ECOCBase, has_posterior
from granular_id.ecoc.coding_matrix import CodingMatrix
from granular_id.ecoc.equal_rows import first_equal
from granular_id.ecoc.learners import DualLearners, fit_dual
from granular_id.ecoc.training import checked_weights

__all__ = ["GramMethods", "gram_scorer"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class GramMethods(ECOCBase):
    """The methods of `granular_id.ecoc.ECOCClassifier` that end in `_gram`."""

    @property
    def supports_gram(self) -> bool:
        """Whether `fit_gram` and its kin serve these parameters: the built-in machine, not standardised."""
        return self.estimator is None and not self.standardize

    def fit_gram(
        self, gram: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None
    ) -> GramMethods:
        """Train all learners on scalar products instead of features.

        Parameters
        ----------
        gram : array-like, shape (n, n)
            Scalar products of the training rows (`granular_id.gram.linear_gram`), for instance a slice of
            the matrix of all rows of an evaluation. Any origin serves: results are the same.
        y, sample_weight
            As in `fit`.

        Returns
        -------
        ECOCClassifier
            This estimator, for the methods that end in `_gram`. It has no `coef_`, `predict` needs `fit`.

        Raises
        ------
        ValueError
            As `fit`; also with `standardize=True`, as each learner then has scalar products of its own, or with
            an `estimator`, which needs the features.
        """
        self._check_parameters(weighted=sample_weight is not None)
        if not self.supports_gram:
            what = "standardize=True" if self.standardize else "estimator"
            raise ValueError(f"{what} needs the features: use fit(X, y) instead of fit_gram")
        labels = column_or_1d(y, warn=True)
        products = float_array("gram", gram)
        if products.ndim == 0 or len(products) != len(labels):
            raise ValueError(f"gram has shape {products.shape}, but y has {len(labels)} labels")
        weights = None if sample_weight is None else checked_weights(sample_weight, len(products))
        codes, fold_seed, _ = self._start(labels, weights)
        for of_features in ("n_features_in_", "feature_names_in_"):
            if hasattr(self, of_features):
                delattr(self, of_features)
        options = self._machine_options(weights)
        self._keep(fit_dual(products, codes, self.coding_matrix_, **options))
        if self.posterior is not None:
            scorer = gram_scorer(products, codes, self.coding_matrix_, options)
            self._learn_posterior(scorer, first_equal(products)[:, None], codes, weights, fold_seed)
        return self

    def binary_scores_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """Scores (m, L) from scalar products (m, n) with the training rows, taken about the same origin."""
        if not self.supports_gram:
            what = "an estimator" if self.estimator is not None else "standardize=True"
            raise ValueError(f"{what} has no shared Gram matrix: use the methods that take X")
        check_is_fitted(self, "dual_coef_")
        return DualLearners(self.dual_coef_, self.intercept_, self.alpha_at_bound_).scores(gram)

    def decision_function_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """`decision_function` for scalar products (m, n) with the training rows."""
        return self._decision(self.binary_scores_gram(gram))

    def predict_gram(self, gram: npt.ArrayLike) -> npt.NDArray[Any]:
        """`predict` for scalar products (m, n) with the training rows."""
        return self._winners(self.binary_scores_gram(gram))

    @available_if(has_posterior)  # type: ignore[untyped-decorator]
    def predict_proba_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """`predict_proba` for scalar products (m, n) with the training rows."""
        return self._probabilities(self.binary_scores_gram(gram))


def gram_scorer(
    gram: FloatArray, codes: IntArray, matrix: CodingMatrix, options: dict[str, Any]
) -> Callable[[IntArray, IntArray], FloatArray]:
    """Train on some rows of a Gram matrix and score others, for `granular_id.ecoc.cross_fit.cross_fitted`."""

    def fit_and_score(train: IntArray, test: IntArray) -> FloatArray:
        weights = options["sample_weight"]
        own = {**options, "sample_weight": None if weights is None else weights[train]}
        learned = fit_dual(gram[np.ix_(train, train)], codes[train], matrix, **own)
        return learned.scores(gram[np.ix_(test, train)])

    return fit_and_score
