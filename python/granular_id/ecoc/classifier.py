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

from granular_id._checks import argument_error, checked_flag, checked_n_jobs, float_array, named, real_number
from granular_id._estimators import LabelledClassifier, labels_of
from granular_id.ecoc.codings import CodingMatrix, design
from granular_id.ecoc.decoding import DECODINGS, class_values, fitting_loss
from granular_id.ecoc.estimators import (
    EstimatorLearner,
    EstimatorLearners,
    check_estimator,
    fit_estimators,
    score_range,
)
from granular_id.ecoc.learners import (
    DualLearners,
    LinearLearner,
    PrimalLearners,
    fit_dual,
    fit_standardized,
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
from granular_id.ecoc.task import Task, checked_gram, checked_weights, class_indices, sides_of
from granular_id.gram import linear_gram

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Set by some ways of fitting and not by others: a new fit starts without them.
_CONDITIONAL = ("coef_", "intercept_", "dual_coef_", "alpha_at_bound_", "_estimators", "_posterior")


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

    By default the learners are linear support vector machines, one for each pair of classes. The Gram matrix of
    the rows is computed once and sliced for each learner. libsvm's answer is brought to the exact optimum, up to
    rounding: it then does not depend on the order of the rows, on a common offset, nor on whether a row is
    repeated or weighted. Where that fails, libsvm's own answer stands, within its tolerance.

    Parameters
    ----------
    estimator : classifier, optional
        Any scikit-learn classifier of two classes, cloned for each learner and trained on 0 (code -1) and 1
        (code +1). Its score is `decision_function` where it has one, else the probability of 1. Default: the
        linear support vector machine described above, the paper's, much faster here than as an `estimator`.
    coding : str or array-like, shape (K, L), default "onevsone"
        Which learner sees which classes on which side:
        "onevsone" with K (K - 1) / 2 learners (the paper), "onevsall" K, "ordinal" K - 1, "binarycomplete"
        2^(K-1) - 1, "ternarycomplete" (3^K - 2^(K+1) + 1) / 2, "denserandom" about 10 log2 K, "sparserandom"
        about 15 log2 K; or codes -1, 0, +1 of one's own, a row for each of the sorted classes.
    decoding : {"loss_weighted", "loss_based"}, default "loss_weighted"
        By what the summed loss of a class is divided: by how many learners saw it, or by L.
        For one-vs-one both name the same classes and differ by the factor (K - 1) / L. The paper uses "loss_weighted".
    loss : str, default "auto"
        Binary loss. "hinge" belongs to support vector machines and is
        what the paper uses; "hamming" counts votes, "root", which takes the root of a score first, is half way between
        the two; "linear", "exponential", "logit", "binodeviance". "quadratic" is for learners whose score is a
        probability, and the only one for them. "auto": the hinge or, for probabilities, "quadratic".
    C : float, default 1.0
        Cost of a violated margin, positive. 1 is the default of MATLAB and scikit-learn. With 10,200 raw
        features the margin is mostly hard already: `alpha_at_bound_` tells. Of the built-in machine only.
    hard_margin : bool, default False
        Allow no violated margin (C has no effect then). Solved with a bound on the dual variables of 1e10
        over the mean squared distance from the centre, which none may reach. An error that names two classes
        when no hyperplane separates them. Of the built-in machine only.
    standardize : bool, default False
        Centre and scale each feature within the rows of each learner (weighted mean and population standard
        deviation; a feature that is constant there is ignored). No two learners share a Gram matrix then:
        slower by about the number of learners. `coef_` and `intercept_` are in the units of `X` all the same.
    posterior : {"kullback_leibler", "wu_lin_weng"}, optional
        Also fit class probabilities, for `predict_proba`: Platt's sigmoid for each learner, on scores of rows
        that it has not seen (5 folds of each class; five more trainings), then coupled.
        "kullback_leibler" serves any coding, "wu_lin_weng" one-vs-one. A class needs
        two different rows; a warning names those with one, which learners know when they score it. Labels come
        from the losses all the same: where classes are close, the likeliest can be another.
    n_jobs : int, optional
        Threads over learners, as in joblib. The numbers do not depend on it.
    random_state : int or RandomState, optional
        Draws the random codings and the folds of `posterior`, and seeds every `random_state` of `estimator`
        that is None.

    Attributes
    ----------
    classes_ : ndarray, shape (K,)
        Sorted labels.
    coding_matrix_ : ndarray of int8, shape (K, L)
        Codes: +1 and -1 for the two sides of a learner, 0 for classes it is not shown.
    coef_, intercept_ : ndarray, shapes (L, D) and (L,)
        A score is ``coef_ @ x + intercept_``; positive speaks for the classes with code +1. Only if all learners
        are linear.
    dual_coef_ : ndarray, shape (L, n)
        Weight of each training row in each learner; 0 for rows that are no support vectors. Built-in machine.
    learners_ : tuple of LinearLearner or EstimatorLearner
        Classes of each learner, with its support vectors or its fitted estimator.
    alpha_at_bound_ : float
        Share of dual variables at C; 0 means that the margin is already hard. Built-in machine.
    supports_gram : bool
        Whether `fit_gram` and the other methods that end in `_gram` serve these parameters.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: a parameter outside its range, a loss that does not fit the scores of the estimator, more than
        100,000 learners, a coding matrix that does not fit the classes, fewer than two classes, NaN or infinity in
        X, negative weights or an estimator that takes none, `hard_margin` with classes that overlap.

    Notes
    -----
    Ties go to the class that comes first in `classes_`. Rare with the hinge, they are common with "hamming".

    `sample_weight` multiplies C: a whole number equals as many repetitions of the row, for the posterior too.
    MATLAB divides by n - 1 in the standard deviation; this class divides by n so that the equality holds with
    `standardize` too. The difference is that of a C larger by 1 / n.

    An evaluation over many partitions computes one Gram matrix and uses `fit_gram` and `predict_gram`.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> clf = ECOCClassifier(standardize=True).fit(X, y)
    >>> clf.coding_matrix_
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    >>> round(1 - clf.score(X, y), 4), round(float(clf.margin(X, y).mean()), 4)
    (0.0267, 0.744)
    >>> from sklearn.tree import DecisionTreeClassifier
    >>> trees = ECOCClassifier(DecisionTreeClassifier(max_depth=2), coding="onevsall", random_state=0)
    >>> trees.fit(X, y).predict(X[:2])
    array([0, 0])
    """

    classes_: npt.NDArray[Any]
    coding_matrix_: CodingMatrix
    coef_: FloatArray
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
            Non-negative factors of C, or passed to the estimator. A row of weight 0 is as good as absent, its
            label included.

        Returns
        -------
        ECOCClassifier
            This estimator.
        """
        self._check_parameters(weighted=sample_weight is not None)
        rows, labels = validate_data(self, X, labels_of(X, y, self), dtype=np.float64)
        weights = None if sample_weight is None else checked_weights(sample_weight, len(rows))
        task, fold_seed, learner_seed = self._start(labels, weights)
        learned: PrimalLearners | EstimatorLearners
        if self.supports_gram:
            with np.errstate(over="ignore", invalid="ignore"):  # `linear_gram` refuses what follows from it
                origin = rows.mean(axis=0)
            gram = checked_gram(linear_gram(rows, center=origin))
            moments = [(origin, np.ones(1))] * task.n_learners
            learned = in_features(self._fit_dual(gram, task), rows, moments)
            scorer = self._gram_scorer(gram, task)
        else:
            rows = np.ascontiguousarray(rows)  # products round by the layout of the rows
            learned = self._fit_rows(rows, task, learner_seed)

            def scorer(train: IntArray, test: IntArray) -> FloatArray:
                return self._fit_rows(rows[train], task.of_rows(train), learner_seed).scores(rows[test])

        if isinstance(learned, EstimatorLearners):
            fitting_loss(self.loss, learned.score_range)  # some estimators show only now what score they have
            self._estimators = learned
        else:
            self._keep_dual(learned.dual)
        if learned.coef is not None and learned.intercept is not None:
            self.coef_, self.intercept_ = learned.coef, learned.intercept
        if self.posterior is not None:
            self._fit_posterior(scorer, rows, task, fold_seed)
        return self

    @property
    def learners_(self) -> tuple[LinearLearner, ...] | tuple[EstimatorLearner, ...]:
        """The binary learners, in the order of the columns of `coding_matrix_`."""
        check_is_fitted(self, ["dual_coef_", "_estimators"], all_or_any=any)
        if hasattr(self, "_estimators"):
            return self._estimators.each

        def learner(codes: CodingMatrix, dual_coef: FloatArray, intercept: float) -> LinearLearner:
            support = np.flatnonzero(dual_coef)
            sides = sides_of(codes, self.classes_.tolist())
            return LinearLearner(*sides, support, dual_coef[support], intercept)

        return tuple(map(learner, self.coding_matrix_.T, self.dual_coef_, self.intercept_.tolist()))

    def binary_scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the binary learners for features (n, D); positive speaks for the code +1.

        Of learners that give probabilities: that of the code +1.
        """
        check_is_fitted(
            self,
            ["coef_", "_estimators"],
            all_or_any=any,
            msg="This %(name)s has no coef_: call fit (fit_gram serves *_gram only)",
        )
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        if hasattr(self, "_estimators"):
            return self._estimators.scores(rows, self.n_jobs)
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
    def supports_gram(self) -> bool:
        """Whether `fit_gram` and its kin serve these parameters: the built-in machine, not standardised."""
        return self.estimator is None and not self.standardize

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
        ValueError
            As `fit`; also with `standardize=True`, as each learner then has scalar products of its own, or with
            an `estimator`, which needs the features.
        """
        self._check_parameters(weighted=sample_weight is not None)
        self._check_supports_gram()
        labels = column_or_1d(y, warn=True)
        products = float_array("gram", gram)
        if products.ndim == 0 or len(products) != len(labels):
            raise ValueError(f"gram has shape {products.shape}, but y has {len(labels)} labels")
        weights = None if sample_weight is None else checked_weights(sample_weight, len(products))
        task, fold_seed, _ = self._start(labels, weights)
        for of_features in ("n_features_in_", "feature_names_in_"):
            if hasattr(self, of_features):
                delattr(self, of_features)
        self._keep_dual(self._fit_dual(checked_gram(products), task))
        if self.posterior is not None:
            kinds = first_equal(products)[:, None]
            self._fit_posterior(self._gram_scorer(products, task), kinds, task, fold_seed)
        return self

    def binary_scores_gram(self, gram: npt.ArrayLike) -> FloatArray:
        """Scores (m, L) from scalar products (m, n) with the training rows, taken about the same origin."""
        self._check_supports_gram()
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

    def _check_parameters(self, *, weighted: bool) -> None:
        named(DECODINGS, "decoding", self.decoding)
        cost = real_number("C", self.C)
        if not 0 < cost < math.inf:
            raise argument_error(
                ValueError, "C", f"must be positive and finite, got {cost!r}; for no limit hard_margin=True"
            )
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

    def _check_supports_gram(self) -> None:
        if not self.supports_gram:
            what = "standardize=True" if self.standardize else "estimator"
            raise ValueError(f"{what} needs the features: use fit(X, y) and the methods that take X")

    def _start(self, labels: npt.NDArray[Any], weights: FloatArray | None) -> tuple[Task, int, int]:
        """Forget an earlier fit, learn classes and codes; return the task, seeds of the folds and of the learners."""
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
        return Task.of(matrix, codes, weights, classes.tolist()), fold_seed, learner_seed

    def _fit_dual(self, gram: FloatArray, task: Task) -> DualLearners:
        return fit_dual(gram, task, self._cost(), self.n_jobs)

    def _fit_rows(self, rows: FloatArray, task: Task, seed: int) -> PrimalLearners | EstimatorLearners:
        """Train where learners do not share a Gram matrix."""
        if self.estimator is None:
            return fit_standardized(rows, task, self._cost(), self.n_jobs)
        standardize = bool(self.standardize)
        return fit_estimators(
            self.estimator, rows, task, standardize=standardize, seed=seed, n_jobs=self.n_jobs
        )

    def _cost(self) -> float | None:
        return None if self.hard_margin else float(self.C)

    def _keep_dual(self, learned: DualLearners) -> None:
        self.dual_coef_, self.intercept_ = learned.dual_coef, learned.intercept
        self.alpha_at_bound_ = learned.alpha_at_bound

    def _gram_scorer(self, gram: FloatArray, task: Task) -> Callable[[IntArray, IntArray], FloatArray]:
        def scorer(train: IntArray, test: IntArray) -> FloatArray:
            learned = self._fit_dual(gram[np.ix_(train, train)], task.of_rows(train))
            return learned.scores(gram[np.ix_(test, train)])

        return scorer

    def _fit_posterior(
        self,
        fit_and_score: Callable[[IntArray, IntArray], FloatArray],
        rows: npt.NDArray[Any],
        task: Task,
        seed: int,
    ) -> None:
        """Fit sigmoids on scores of rows that the learners have not seen; `rows` (n, m) tells which are equal."""
        scores = cross_fitted(fit_and_score, folds_of(rows, task, seed), task.n_learners)
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
