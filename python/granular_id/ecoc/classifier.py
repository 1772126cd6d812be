"""ECOCClassifier: many two-class learners, one decision.

Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
Measurements" (arXiv 2403.17606): trinary one-vs-one ECOC, linear SVM, loss-weighted decoding with the hinge
loss. Defaults reproduce `fitcecoc` of MATLAB.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils.metaestimators import available_if
from sklearn.utils.validation import check_is_fitted, column_or_1d, validate_data

from granular_id.ecoc.base import has_posterior
from granular_id.ecoc.estimators import EstimatorLearners, fit_estimators
from granular_id.ecoc.gram_methods import GramMethods, gram_scorer
from granular_id.ecoc.learners import line_scores
from granular_id.ecoc.losses import fitting_loss
from granular_id.ecoc.primal import PrimalLearners, fit_shared, fit_standardized
from granular_id.ecoc.training import checked_weights
from granular_id.gram import linear_gram

__all__ = ["ECOCClassifier"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class ECOCClassifier(GramMethods):
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
        Which learner sees which classes on which side, a key of `granular_id.ecoc.codings.CODINGS`:
        "onevsone" with K (K - 1) / 2 learners (the paper), "onevsall" K, "ordinal" K - 1, "binarycomplete"
        2^(K-1) - 1, "ternarycomplete" (3^K - 2^(K+1) + 1) / 2, "denserandom" about 10 log2 K, "sparserandom"
        about 15 log2 K; or codes -1, 0, +1 of one's own, a row for each of the sorted classes.
    decoding : {"loss_weighted", "loss_based"}, default "loss_weighted"
        By what the summed loss of a class is divided; see `granular_id.ecoc.decoding.decode`. For one-vs-one both
        name the same classes and differ by the factor (K - 1) / L. The paper uses "loss_weighted".
    loss : str, default "auto"
        Binary loss, a key of `granular_id.ecoc.losses.LOSSES`. "hinge" belongs to support vector machines and is
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
        that it has not seen (5 folds of each class; five more trainings), then coupled; see
        `granular_id.ecoc.coupling`. "kullback_leibler" serves any coding, "wu_lin_weng" one-vs-one. A class needs
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
    >>> from granular_id.ecoc import ECOCClassifier
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

    coef_: FloatArray

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
            Non-negative factors of C, or passed to the estimator. A row of weight 0 is as good as absent, its
            label included.

        Returns
        -------
        ECOCClassifier
            This estimator.
        """
        self._check_parameters(weighted=sample_weight is not None)
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        weights = None if sample_weight is None else checked_weights(sample_weight, len(rows))
        codes, fold_seed, learner_seed = self._start(labels, weights)
        if self.supports_gram:
            with np.errstate(over="ignore", invalid="ignore"):  # `linear_gram` refuses what follows from it
                origin = rows.mean(axis=0)
            gram = linear_gram(rows, center=origin)
            options = self._machine_options(weights)
            self._keep_lines(fit_shared(rows, origin, gram, codes, self.coding_matrix_, **options))
            scorer = gram_scorer(gram, codes, self.coding_matrix_, options)
        else:
            every = np.arange(len(rows))
            learned = self._fit_rows(rows, codes, weights, learner_seed, every)
            if isinstance(learned, EstimatorLearners):
                self._keep_estimators(learned)
            else:
                self._keep_lines(learned)

            def scorer(train: IntArray, test: IntArray) -> FloatArray:
                return self._fit_rows(rows, codes, weights, learner_seed, train).scores(rows[test])

        if self.posterior is not None:
            self._learn_posterior(scorer, rows, codes, weights, fold_seed)
        return self

    def _fit_rows(
        self, rows: FloatArray, codes: IntArray, weights: FloatArray | None, seed: int, members: IntArray
    ) -> PrimalLearners | EstimatorLearners:
        """Train on some of the rows, where learners do not share a Gram matrix."""
        own, own_codes = rows[members], codes[members]
        own_weights = None if weights is None else weights[members]
        if self.estimator is None:
            return fit_standardized(own, own_codes, self.coding_matrix_, **self._machine_options(own_weights))
        return fit_estimators(
            self.estimator,
            own,
            own_codes,
            self.coding_matrix_,
            classes=self.classes_.tolist(),
            standardize=bool(self.standardize),
            sample_weight=own_weights,
            seed=seed,
            n_jobs=self.n_jobs,
        )

    def _keep_lines(self, learned: PrimalLearners) -> None:
        self._keep(learned.dual)
        self.coef_, self.intercept_ = learned.coef, learned.intercept

    def _keep_estimators(self, learned: EstimatorLearners) -> None:
        fitting_loss(self.loss, learned.score_range)  # some estimators show only now what score they have
        self._estimators = learned
        if learned.coef is not None and learned.intercept is not None:
            self.coef_, self.intercept_ = learned.coef, learned.intercept

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

    @available_if(has_posterior)  # type: ignore[untyped-decorator]
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
