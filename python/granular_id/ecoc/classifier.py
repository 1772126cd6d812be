"""ECOCClassifier: many two-class learners, one decision.

Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
Measurements" (arXiv 2403.17606): trinary one-vs-one ECOC, linear SVM, loss-weighted decoding with the hinge
loss. Defaults reproduce `fitcecoc` of MATLAB.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MethodType
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, column_or_1d, validate_data

from granular_id._checks import argument_error, checked_n_jobs, float_array, named, real_number
from granular_id._estimators import LabelledClassifier, labels_of
from granular_id.ecoc.codings import LOSSES, CodingMatrix, decode, design
from granular_id.ecoc.learners import (
    DualLearners,
    Task,
    checked_gram,
    checked_weights,
    class_indices,
    fit_dual,
    in_features,
    line_scores,
)
from granular_id.ecoc.posterior import (
    POSTERIORS,
    Posterior,
    check_posterior,
    cross_fitted,
    fit_posterior,
    folds_of,
)
from granular_id.ecoc.svm import first_equal
from granular_id.gram import linear_gram

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Set by some ways of fitting and not by others: a new fit starts without them.
_CONDITIONAL = ("coef_", "intercept_", "dual_coef_", "alpha_at_bound_", "_posterior")


class _WithPosterior:
    """A method that exists where `posterior` is set; where not, the error says what to choose."""

    def __init__(self, method: Callable[..., FloatArray]) -> None:
        self._method = method
        self.__doc__ = method.__doc__

    def __get__(self, classifier: Any, owner: Any = None) -> Callable[..., FloatArray]:
        if classifier is None:
            return self._method
        if classifier.posterior is None:
            name = self._method.__name__
            raise AttributeError(
                f"{name} needs probabilities, which are fitted with posterior={' or '.join(map(repr, POSTERIORS))}: "
                f"fit an ECOCClassifier(posterior={next(iter(POSTERIORS))!r})"
            )
        return MethodType(self._method, classifier)


class ECOCClassifier(LabelledClassifier, BaseEstimator):  # type: ignore[misc]
    """Error-correcting output codes: K classes are told apart by L learners of two sides each.

    The learners are linear support vector machines, by default one for each pair of classes. The Gram matrix of
    the rows is computed once and sliced for each learner. libsvm's answer is brought to the exact optimum, up to
    rounding: it then does not depend on the order of the rows, on a common offset, nor on whether a row is
    repeated or weighted. Where that fails, libsvm's own answer stands, within its tolerance.

    Scores are decoded by loss-weighted decoding, as in the paper: the summed loss of a class is divided by how many
    learners saw it.

    Parameters
    ----------
    coding : str or array-like, shape (K, L), default "onevsone"
        Which learner sees which classes on which side: "onevsone" with K (K - 1) / 2 learners (the paper), "onevsall"
        with K; or codes -1, 0, +1 of one's own, a row for each of the sorted classes.
    loss : {"hinge", "root"}, default "hinge"
        Binary loss. "hinge" belongs to support vector machines and is what the paper uses; "root", which takes the
        root of a score first, is half way between votes and the hinge.
    C : float, default 1.0
        Cost of a violated margin, positive. 1 is the default of MATLAB and scikit-learn. With 10,200 raw
        features the margin is mostly hard already: `alpha_at_bound_` tells.
    posterior : {"kullback_leibler", "wu_lin_weng"}, optional
        Also fit class probabilities, for `predict_proba`: Platt's sigmoid for each learner, on scores of rows
        that it has not seen (5 folds of each class; five more trainings), then coupled.
        "kullback_leibler" serves any coding, "wu_lin_weng" one-vs-one. A class needs
        two different rows; a warning names those with one, which learners know when they score it. Labels come
        from the losses all the same: where classes are close, the likeliest can be another.
    n_jobs : int, optional
        Threads over learners, as in joblib. The numbers do not depend on it.
    random_state : int or RandomState, optional
        Draws the folds of `posterior`.

    Attributes
    ----------
    classes_ : ndarray, shape (K,)
        Sorted labels.
    coding_matrix_ : ndarray of int8, shape (K, L)
        Codes: +1 and -1 for the two sides of a learner, 0 for classes it is not shown.
    coef_, intercept_ : ndarray, shapes (L, D) and (L,)
        A score is ``coef_ @ x + intercept_``; positive speaks for the classes with code +1.
    dual_coef_ : ndarray, shape (L, n)
        Weight of each training row in each learner; 0 for rows that are no support vectors.
    alpha_at_bound_ : float
        Share of dual variables at C; 0 means that the margin is already hard.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: a parameter outside its range, more than 100,000 pairs of classes, a coding matrix that does not
        fit the classes, fewer than two classes, NaN or infinity in X, negative weights.

    Notes
    -----
    Ties go to the class that comes first in `classes_`.

    `sample_weight` multiplies C: a whole number equals as many repetitions of the row, for the posterior too.

    An evaluation over many partitions computes one Gram matrix and uses `fit_gram` and `predict_gram`.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> clf = ECOCClassifier().fit(X, y)
    >>> clf.coding_matrix_
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    >>> round(1 - clf.score(X, y), 4)
    0.0067
    """

    classes_: npt.NDArray[Any]
    coding_matrix_: CodingMatrix
    coef_: FloatArray
    intercept_: FloatArray
    dual_coef_: FloatArray
    alpha_at_bound_: float
    _posterior: Posterior

    def __init__(
        self,
        coding: str | npt.ArrayLike = "onevsone",
        *,
        loss: str = "hinge",
        C: float = 1.0,
        posterior: str | None = None,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.coding = coding
        self.loss = loss
        self.C = C
        self.posterior = posterior
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(
        self, X: npt.ArrayLike, y: npt.ArrayLike | None = None, sample_weight: npt.ArrayLike | None = None
    ) -> ECOCClassifier:
        """Train all learners.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Features, finite.
        y : array-like, shape (n,), optional
            Labels: strings, integers or other values that can be sorted. Without them those of the `Dataset` that a
            feature space in front was given.
        sample_weight : array-like, shape (n,), optional
            Non-negative factors of C. A row of weight 0 is as good as absent, its label included.

        Returns
        -------
        ECOCClassifier
            This estimator.
        """
        self._check_parameters()
        rows, labels = validate_data(self, X, labels_of(X, y, self), dtype=np.float64)
        weights = None if sample_weight is None else checked_weights(sample_weight, len(rows))
        task, fold_seed = self._start(labels, weights)
        with np.errstate(over="ignore", invalid="ignore"):  # `linear_gram` refuses what follows from it
            origin = rows.mean(axis=0)
        gram = checked_gram(linear_gram(rows, center=origin))
        learned = self._fit_dual(gram, task)
        self.coef_, self.intercept_ = in_features(learned, rows, origin)
        if self.posterior is not None:
            self._fit_posterior(gram, rows, task, fold_seed)
        return self

    def binary_scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the binary learners for features (n, D); positive speaks for the code +1."""
        check_is_fitted(
            self, "coef_", msg="This %(name)s has no coef_: call fit (fit_gram serves *_gram only)"
        )
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        return line_scores("X", rows, self.coef_, self.intercept_)

    def decision_function(self, X: npt.ArrayLike) -> FloatArray:
        """Decision value of each class for features (n, D).

        Returns
        -------
        ndarray, shape (n, K), or (n,) for two classes
            Minus the mean binary loss of each class: the largest wins. For two classes the value of the
            second minus that of the first: positive means ``classes_[1]``.
        """
        return self._decision(self.binary_scores(X))

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Label of each row of features (n, D); of tied classes the first in `classes_`."""
        return self._winners(self.binary_scores(X))

    @_WithPosterior
    def predict_proba(self, X: npt.ArrayLike) -> FloatArray:
        """Probability (n, K) of each class for features (n, D); rows sum to 1. Exists when `posterior` is set."""
        return self._probabilities(self.binary_scores(X))

    def fit_gram(
        self, gram: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None
    ) -> ECOCClassifier:
        """Train all learners on scalar products instead of features.

        Parameters
        ----------
        gram : array-like, shape (n, n)
            Scalar products of the training rows, for instance a slice of
            the matrix of all rows of an evaluation. Any origin serves: results are the same.
        y, sample_weight
            As in `fit`.

        Returns
        -------
        ECOCClassifier
            This estimator, for the methods that end in `_gram`. It has no `coef_`, `predict` needs `fit`.

        Raises
        ------
        TypeError, ValueError
            As `fit`.
        """
        self._check_parameters()
        labels = column_or_1d(y, warn=True)
        products = float_array("gram", gram)
        if products.ndim == 0 or len(products) != len(labels):
            raise ValueError(f"gram has shape {products.shape}, but y has {len(labels)} labels")
        weights = None if sample_weight is None else checked_weights(sample_weight, len(products))
        task, fold_seed = self._start(labels, weights)
        for of_features in ("n_features_in_", "feature_names_in_"):
            if hasattr(self, of_features):
                delattr(self, of_features)
        learned = self._fit_dual(checked_gram(products), task)
        self.intercept_ = learned.intercept
        if self.posterior is not None:
            kinds = first_equal(products)[:, None]
            self._fit_posterior(products, kinds, task, fold_seed)
        return self

    def binary_scores_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """Scores (m, L) from scalar products (m, n) with the training rows, taken about the same origin."""
        check_is_fitted(self, "dual_coef_")
        products = float_array("gram", gram)
        if products.ndim != 2 or products.shape[1] != self.dual_coef_.shape[1]:
            raise ValueError(
                f"gram must have shape (m, {self.dual_coef_.shape[1]}), one column per training row, "
                f"got shape {products.shape}"
            )
        return line_scores("gram", products, self.dual_coef_, self.intercept_)

    def decision_function_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """`decision_function` for scalar products (m, n) with the training rows."""
        return self._decision(self.binary_scores_gram(gram))

    def predict_gram(self, gram: npt.ArrayLike) -> npt.NDArray[Any]:
        """`predict` for scalar products (m, n) with the training rows."""
        return self._winners(self.binary_scores_gram(gram))

    @_WithPosterior
    def predict_proba_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """`predict_proba` for scalar products (m, n) with the training rows."""
        return self._probabilities(self.binary_scores_gram(gram))

    def _check_parameters(self) -> None:
        cost = real_number("C", self.C)
        if not 0 < cost < math.inf:
            raise argument_error(ValueError, "C", f"must be positive and finite, got {cost!r}")
        checked_n_jobs(self.n_jobs)
        if self.posterior is not None:
            named(POSTERIORS, "posterior", self.posterior)
        named(LOSSES, "loss", self.loss)

    def _start(self, labels: npt.NDArray[Any], weights: FloatArray | None) -> tuple[Task, int]:
        """Forget an earlier fit, learn classes and codes; return the task and the seed of the folds."""
        base = int(check_random_state(self.random_state).randint(np.iinfo(np.int32).max))
        _, fold_seed = np.random.SeedSequence(base).generate_state(2).tolist()
        classes, codes = class_indices(labels, weights)
        matrix = design(self.coding, len(classes))
        if self.posterior is not None:
            check_posterior(self.posterior, matrix)
        for name in _CONDITIONAL:
            if hasattr(self, name):
                delattr(self, name)
        self.classes_, self.coding_matrix_ = classes, matrix
        return Task.of(matrix, codes, weights, classes.tolist()), fold_seed

    def _fit_dual(self, gram: FloatArray, task: Task) -> DualLearners:
        learned = fit_dual(gram, task, float(self.C), self.n_jobs)
        self.dual_coef_, self.alpha_at_bound_ = learned.dual_coef, learned.alpha_at_bound
        return learned

    def _fit_posterior(self, gram: FloatArray, rows: npt.NDArray[Any], task: Task, seed: int) -> None:
        """Fit sigmoids on scores of rows that the learners have not seen; `rows` (n, m) tells which are equal."""

        def fit_and_score(train: IntArray, test: IntArray) -> FloatArray:
            part = fit_dual(gram[np.ix_(train, train)], task.of_rows(train), float(self.C), self.n_jobs)
            return part.scores(gram[np.ix_(test, train)])

        scores = cross_fitted(fit_and_score, folds_of(rows, task, seed), task.n_learners)
        self._posterior = fit_posterior(str(self.posterior), scores, task)

    def _class_values(self, scores: FloatArray) -> FloatArray:
        """Decision values (n, K) for scores (n, L); the loss may have been set anew after the fit."""
        return decode(scores, self.coding_matrix_, self.loss)

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
