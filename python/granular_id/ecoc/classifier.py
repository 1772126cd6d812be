"""ECOCClassifier: many two-class linear support vector machines, one decision.

Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
Measurements" (arXiv 2403.17606): trinary one-vs-one ECOC, linear SVM, loss-weighted decoding with the hinge
loss. Defaults reproduce `fitcecoc` of MATLAB.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_is_fitted, column_or_1d, validate_data

from granular_id.ecoc.coding import DECODINGS, LOSSES, decode, named, onevsone
from granular_id.ecoc.learners import DualLearners, LinearLearner, fit_dual
from granular_id.ecoc.primal import fit_features
from granular_id.ecoc.training import checked_cost, checked_weights, class_indices

__all__ = ["ECOCClassifier"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class ECOCClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Error-correcting output codes over linear support vector machines, one-vs-one.

    K classes give L = K (K - 1) / 2 learners. The Gram matrix of the rows is computed once and
    sliced for each learner. libsvm's answer is brought to the exact optimum, up to rounding: it then does not
    depend on the order of the rows, on a common offset, nor on whether a row is repeated or weighted. Where
    that fails, libsvm's own answer stands, within its tolerance.

    Parameters
    ----------
    decoding : {"loss_weighted", "loss_based"}, default "loss_weighted"
        By what the summed loss of a class is divided; see `granular_id.ecoc.coding.decode`. For one-vs-one both
        name the same classes and differ by the factor (K - 1) / L. The paper uses "loss_weighted".
    loss : str, default "hinge"
        Binary loss, a key of `granular_id.ecoc.coding.LOSSES`: "hinge" belongs to support vector machines and is
        what the paper uses; "hamming" counts votes; "linear", "exponential", "logit", "binodeviance".
    C : float, default 1.0
        Cost of a violated margin, positive. 1 is the default of MATLAB and scikit-learn. With 10,200 raw
        features the margin is mostly hard already: `alpha_at_bound_` tells.
    hard_margin : bool, default False
        Allow no violated margin (C has no effect then). Solved with a bound on the dual variables of 1e10
        over the mean squared distance from the centre, which none may reach. An error that names two classes
        when no hyperplane separates them.
    standardize : bool, default False
        Centre and scale each feature within the rows of each learner (weighted mean and population standard
        deviation; a feature that is constant there is ignored). No two learners share a Gram matrix then:
        slower by about the number of learners. `coef_` and `intercept_` are in the units of `X` all the same.

    Attributes
    ----------
    classes_ : ndarray, shape (K,)
        Sorted labels.
    coding_matrix_ : ndarray of int8, shape (K, L)
        +1 for the lower class index of each pair, -1 for the higher.
    coef_, intercept_ : ndarray, shapes (L, D) and (L,)
        A score is ``coef_ @ x + intercept_``; positive speaks for the class with code +1.
    dual_coef_ : ndarray, shape (L, n)
        Weight of each training row in each learner; 0 for rows that are no support vectors.
    learners_ : tuple of LinearLearner
        Classes and support vectors of each learner.
    alpha_at_bound_ : float
        Share of dual variables at C; 0 means that the margin is already hard.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    ValueError
        From `fit`: a parameter outside its range, fewer than two classes, NaN or infinity in X, negative
        weights, `hard_margin` with classes that overlap.

    Notes
    -----
    Ties go to the class that comes first in `classes_`. Rare with the hinge, they are common with "hamming".

    `sample_weight` multiplies C: a whole number equals as many repetitions of the row. MATLAB divides by
    n - 1 in the standard deviation; this class divides by n so that the equality holds with `standardize`
    too. The difference is that of a C larger by 1 / n.

    An evaluation over many partitions computes one Gram matrix and uses `fit_gram` and `predict_gram`.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.ecoc import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> clf = ECOCClassifier(standardize=True).fit(X, y)
    >>> clf.coding_matrix_
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    >>> round(1 - clf.score(X, y), 4), round(float(clf.margin(X, y).mean()), 4)
    (0.0267, 0.744)
    """

    classes_: npt.NDArray[Any]
    coding_matrix_: npt.NDArray[np.int8]
    coef_: FloatArray
    intercept_: FloatArray
    dual_coef_: FloatArray
    alpha_at_bound_: float

    def __init__(
        self,
        *,
        decoding: str = "loss_weighted",
        loss: str = "hinge",
        C: float = 1.0,
        hard_margin: bool = False,
        standardize: bool = False,
    ) -> None:
        self.decoding = decoding
        self.loss = loss
        self.C = C
        self.hard_margin = hard_margin
        self.standardize = standardize

    def fit(
        self, X: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None
    ) -> ECOCClassifier:
        """Train all learners.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Features, finite.
        y : array-like, shape (n,)
            Labels: strings, integers or other values that can be sorted.
        sample_weight : array-like, shape (n,), optional
            Non-negative factors of C. A row of weight 0 is as good as absent, its label included.

        Returns
        -------
        ECOCClassifier
            This estimator.
        """
        self._check_parameters()
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        weights = None if sample_weight is None else checked_weights(sample_weight, len(rows))
        codes = self._learn_classes(labels, weights)
        learned = fit_features(
            rows,
            codes,
            self.coding_matrix_,
            standardize=bool(self.standardize),
            **self._dual_options(weights),
        )
        self._keep(learned.dual)
        self.coef_ = learned.coef
        self.intercept_ = learned.intercept
        return self

    def fit_gram(
        self, gram: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None
    ) -> ECOCClassifier:
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
            As `fit`; also `standardize=True`, as each learner then has scalar products of its own.
        """
        self._check_parameters()
        if self.standardize:
            raise ValueError("standardize=True needs the features: use fit(X, y) instead of fit_gram")
        labels = column_or_1d(y, warn=True)
        products = np.asarray(gram, dtype=np.float64)
        if products.ndim == 0 or len(products) != len(labels):
            raise ValueError(f"gram has shape {products.shape}, but y has {len(labels)} labels")
        weights = None if sample_weight is None else checked_weights(sample_weight, len(products))
        codes = self._learn_classes(labels, weights)
        learned = fit_dual(products, codes, self.coding_matrix_, **self._dual_options(weights))
        self._keep(learned)
        for of_features in ("coef_", "n_features_in_", "feature_names_in_"):
            if hasattr(self, of_features):
                delattr(self, of_features)
        return self

    def binary_scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the binary learners for features (n, D); positive speaks for the code +1."""
        check_is_fitted(
            self, "coef_", msg="This %(name)s has no coef_: call fit (fit_gram serves *_gram only)"
        )
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        scores: FloatArray = rows @ self.coef_.T + self.intercept_
        return scores

    def binary_scores_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """Scores (m, L) from scalar products (m, n) with the training rows, taken about the same origin."""
        check_is_fitted(self, "dual_coef_")
        if self.standardize:
            raise ValueError("standardize=True has no shared Gram matrix: use the methods that take X")
        return DualLearners(self.dual_coef_, self.intercept_, self.alpha_at_bound_).scores(gram)

    def decision_function(self, X: npt.ArrayLike) -> FloatArray:
        """Decision value of each class for features (n, D).

        Returns
        -------
        ndarray, shape (n, K), or (n,) for two classes
            Minus the mean binary loss of each class: the largest wins. For two classes the value of the
            second minus that of the first: positive means ``classes_[1]``.
        """
        return _as_decision(self._class_values(self.binary_scores(X)))

    def decision_function_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """`decision_function` for scalar products (m, n) with the training rows."""
        return _as_decision(self._class_values(self.binary_scores_gram(gram)))

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Label of each row of features (n, D); of tied classes the first in `classes_`."""
        return self._winners(self.binary_scores(X))

    def predict_gram(self, gram: npt.ArrayLike) -> npt.NDArray[Any]:
        """`predict` for scalar products (m, n) with the training rows."""
        return self._winners(self.binary_scores_gram(gram))

    def margin(self, X: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Decision value (n,) of the true class minus the largest of the others.

        Negative rows are misclassified. The mean over rows is the edge of MATLAB.

        Raises
        ------
        ValueError
            A label in `y` that is not in `classes_`, or another number of labels than rows.
        """
        values = self._class_values(self.binary_scores(X))
        labels = column_or_1d(y, warn=True)
        if len(labels) != len(values):
            raise ValueError(f"y must have {len(values)} labels, one per row of X, got {len(labels)}")
        is_true = labels[:, None] == self.classes_
        unknown = ~is_true.any(axis=1)
        if unknown.any():
            raise ValueError(
                f"y holds {labels[unknown].tolist()[0]!r}, which is not among the classes of fit"
            )
        others = np.where(is_true, -np.inf, values).max(axis=1)
        margins: FloatArray = values[is_true] - others
        return margins

    @property
    def learners_(self) -> tuple[LinearLearner, ...]:
        """The binary learners, in the order of the columns of `coding_matrix_`."""
        check_is_fitted(self, "dual_coef_")
        columns = zip(self.coding_matrix_.T, self.dual_coef_, self.intercept_.tolist(), strict=True)
        return tuple(LinearLearner.of_column(self.classes_, *column) for column in columns)

    def _class_values(self, scores: FloatArray) -> FloatArray:
        return decode(scores, self.coding_matrix_, self.loss, self.decoding)

    def _winners(self, scores: FloatArray) -> npt.NDArray[Any]:
        labels: npt.NDArray[Any] = self.classes_[self._class_values(scores).argmax(axis=1)]
        return labels

    def _check_parameters(self) -> None:
        named(LOSSES, "loss", self.loss)
        named(DECODINGS, "decoding", self.decoding)
        checked_cost(self.C)
        for name in ("hard_margin", "standardize"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise TypeError(f"{name} must be True or False, got {getattr(self, name)!r}")

    def _learn_classes(self, labels: npt.NDArray[Any], weights: FloatArray | None) -> IntArray:
        """Set `classes_` and `coding_matrix_`; return the class index of each row."""
        self.classes_, codes = class_indices(labels, weights)
        self.coding_matrix_ = onevsone(len(self.classes_))
        return codes

    def _dual_options(self, weights: FloatArray | None) -> dict[str, Any]:
        return {
            "C": float(self.C),
            "hard_margin": bool(self.hard_margin),
            "sample_weight": weights,
            "class_names": self.classes_.tolist(),
        }

    def _keep(self, learned: DualLearners) -> None:
        self.dual_coef_ = learned.dual_coef
        self.intercept_ = learned.intercept
        self.alpha_at_bound_ = learned.alpha_at_bound


def _as_decision(values: FloatArray) -> FloatArray:
    return values[:, 1] - values[:, 0] if values.shape[1] == 2 else values
