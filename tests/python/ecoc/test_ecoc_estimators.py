"""ECOCClassifier with scikit-learn classifiers as learners, and with every coding."""

import numpy as np
import pytest
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.datasets import load_iris
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import LinearRegression, RidgeClassifier, SGDClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from ecoc_cases import MATRIX, blobs
from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.codings import CODINGS, design
from granular_id.ecoc.decoding import decode
from granular_id.gram import linear_gram

pytestmark = pytest.mark.usefixtures("few_draws")

X, y = blobs(per_class=15, n_features=6)
SCALED = X * 10.0 ** np.arange(-3, 3)


class NoScore(ClassifierMixin, BaseEstimator):
    """Predicts, but says nothing of how sure it is."""

    def fit(self, X, y):
        self.classes_ = np.unique(y)
        return self

    def predict(self, X):
        return np.zeros(len(X), dtype=int)


class TwoColumns(RidgeClassifier):
    def decision_function(self, X):
        return np.zeros((len(X), 2))


class Bent(SGDClassifier):
    """Has coef_ and intercept_, which do not give its scores."""

    def decision_function(self, X):
        return np.square(super().decision_function(X))


def by_hand(estimator, X, y, matrix, new):
    """Scores of learners trained one by one."""
    columns = []
    for codes in matrix.T:
        seen = codes[y] != 0
        fitted = clone(estimator).fit(X[seen], (codes[y[seen]] > 0).astype(int))
        if hasattr(fitted, "decision_function"):
            columns.append(fitted.decision_function(new))
        else:
            columns.append(fitted.predict_proba(new)[:, 1])
    return np.column_stack(columns)


@pytest.mark.parametrize(
    "estimator",
    [
        RidgeClassifier(),
        LinearDiscriminantAnalysis(),
        SVC(kernel="rbf"),
        GaussianNB(),
        KNeighborsClassifier(),
        make_pipeline(StandardScaler(), RidgeClassifier()),
    ],
    ids=lambda estimator: type(estimator).__name__,
)
@pytest.mark.parametrize("coding", ["onevsone", MATRIX], ids=["onevsone", "own"])
def test_learners_are_those_trained_by_hand(estimator, coding):
    clf = ECOCClassifier(estimator, coding=coding).fit(X[::2], y[::2])
    matrix = clf.coding_matrix_
    expected = by_hand(estimator, X[::2], y[::2], matrix, X[1::2])
    np.testing.assert_allclose(clf.binary_scores(X[1::2]), expected, rtol=1e-9, atol=1e-9)
    unit = not hasattr(estimator, "decision_function")
    values = decode(expected, matrix, "quadratic" if unit else "hinge")
    np.testing.assert_allclose(clf.decision_function(X[1::2]), values, atol=1e-9)
    np.testing.assert_array_equal(clf.predict(X[1::2]), values.argmax(axis=1))
    assert not hasattr(estimator, "classes_")  # clones are fitted, not what was given


@pytest.mark.parametrize("estimator", [RidgeClassifier(), KNeighborsClassifier(3)])
def test_standardize_is_that_of_each_learner(estimator):
    clf = ECOCClassifier(estimator, standardize=True).fit(SCALED, y)
    expected = by_hand(make_pipeline(StandardScaler(), estimator), SCALED, y, clf.coding_matrix_, SCALED)
    np.testing.assert_allclose(clf.binary_scores(SCALED), expected, rtol=1e-6, atol=1e-8)


def test_learners_tell_their_classes():
    names = np.array(["a", "b", "c", "d"])
    clf = ECOCClassifier(RidgeClassifier(), coding=MATRIX).fit(X, names[y])
    positive, negative = [("a", "d"), ("a",), ("b", "c")], [("b",), ("c", "d"), ("d",)]
    assert [one.positive for one in clf.learners_] == positive
    assert [one.negative for one in clf.learners_] == negative
    assert all(one.estimator.classes_.tolist() == [0, 1] for one in clf.learners_)


class TestLinear:
    @pytest.mark.parametrize("estimator", [None, RidgeClassifier(), LinearDiscriminantAnalysis()])
    @pytest.mark.parametrize("standardize", [False, True])
    def test_coef_gives_the_scores(self, estimator, standardize):
        rows = X * 10.0 ** np.linspace(-1, 1, 6) + 5.0
        rows[:, 2] = 7.0
        clf = ECOCClassifier(estimator, standardize=standardize).fit(rows, y)
        assert clf.coef_.shape == (6, 6)
        scores = rows @ clf.coef_.T + clf.intercept_
        np.testing.assert_array_equal(clf.binary_scores(rows), scores)
        if estimator is not None:
            by_learner = np.column_stack([one.scores(rows) for one in clf.learners_])
            np.testing.assert_allclose(scores, by_learner, rtol=1e-6, atol=1e-6)

    @pytest.mark.parametrize("estimator", [SVC(kernel="rbf"), GaussianNB(), Bent(random_state=0)])
    def test_no_coef_otherwise(self, estimator):
        clf = ECOCClassifier(RidgeClassifier()).fit(X, y)
        clf.set_params(estimator=estimator).fit(X, y)
        assert not hasattr(clf, "coef_")
        assert not hasattr(clf, "intercept_")

    def test_what_belongs_to_the_built_in_machine_goes(self):
        clf = ECOCClassifier().fit(X, y)
        assert clf.supports_gram
        clf.set_params(estimator=GaussianNB()).fit(X, y)
        assert not clf.supports_gram
        for name in ("dual_coef_", "alpha_at_bound_", "coef_"):
            assert not hasattr(clf, name)
        assert hasattr(clf.set_params(estimator=None).fit(X, y), "alpha_at_bound_")
        assert not hasattr(clf, "_estimators")


@pytest.mark.parametrize("coding", CODINGS)
class TestEveryCoding:
    def test_learns_iris_with_either_kind_of_learner(self, coding):
        rows, truth = load_iris(return_X_y=True)
        # Versicolor lies between the others: no plane has it alone on one side.
        for estimator in (None, DecisionTreeClassifier(max_depth=3)):
            clf = ECOCClassifier(estimator, coding=coding, random_state=0).fit(rows, truth)
            assert clf.coding_matrix_.shape == (3, CODINGS[coding].n_learners(3))
            assert clf.score(rows, truth) > (0.65 if coding == "onevsall" and estimator is None else 0.9)

    @pytest.mark.parametrize("standardize", [False, True])
    def test_scores_are_those_of_libsvm(self, coding, standardize):
        clf = ECOCClassifier(coding=coding, standardize=standardize, random_state=0).fit(X, y)
        machine = SVC(kernel="linear", tol=1e-8)
        machine = make_pipeline(StandardScaler(), machine) if standardize else machine
        expected = by_hand(machine, X, y, clf.coding_matrix_, X)
        np.testing.assert_allclose(clf.binary_scores(X), expected, atol=1e-4)

    def test_weights_equal_repeated_rows(self, coding):
        times = np.random.default_rng(1).integers(0, 4, len(y))
        matrix = design(coding, 4, np.random.default_rng(0))  # drawn once
        for params in ({}, {"standardize": True}, {"estimator": GaussianNB()}):
            clf = ECOCClassifier(coding=matrix, **params)
            weighted = clone(clf).fit(X, y, sample_weight=times).binary_scores(X)
            repeated = clone(clf).fit(np.repeat(X, times, axis=0), np.repeat(y, times)).binary_scores(X)
            np.testing.assert_allclose(weighted, repeated, rtol=1e-7, atol=1e-7)

    def test_gram_and_features_and_threads_agree(self, coding):
        clf = ECOCClassifier(coding=coding, random_state=0).fit(X, y)
        gram = linear_gram(X, center=X.mean(axis=0))
        by_gram = clone(clf).fit_gram(gram, y)
        np.testing.assert_array_equal(by_gram.coding_matrix_, clf.coding_matrix_)
        scores = by_gram.binary_scores_gram(gram)
        np.testing.assert_allclose(scores, clf.binary_scores(X), rtol=1e-9, atol=1e-9)
        threads = clone(clf).set_params(n_jobs=2).fit(X, y)
        np.testing.assert_array_equal(threads.coef_, clf.coef_)
        assert threads.alpha_at_bound_ == clf.alpha_at_bound_


class TestSeeds:
    def forest(self, **params):
        forest = RandomForestClassifier(n_estimators=3, max_depth=2)
        return ECOCClassifier(forest, **{"n_jobs": 2, **params}).fit(X, y)

    def test_same_seed_same_numbers_with_any_n_jobs(self):
        scores = self.forest(random_state=5).binary_scores(X)
        np.testing.assert_array_equal(self.forest(random_state=5, n_jobs=1).binary_scores(X), scores)
        assert (self.forest(random_state=6).binary_scores(X) != scores).any()

    def test_every_learner_has_its_own_unless_it_is_set(self):
        assert len({one.estimator.random_state for one in self.forest(random_state=0).learners_}) == 6
        estimator = make_pipeline(StandardScaler(), DecisionTreeClassifier(random_state=7))
        clf = ECOCClassifier(estimator, random_state=0).fit(X, y)
        assert {one.estimator[-1].random_state for one in clf.learners_} == {7}

    def test_random_designs_follow_the_seed(self):
        rows, truth = blobs(7, 3)
        clf = ECOCClassifier(coding="sparserandom")
        one, same, other = (
            clf.set_params(random_state=seed).fit(rows, truth).coding_matrix_ for seed in (1, 1, 2)
        )
        np.testing.assert_array_equal(one, same)
        assert (one != other).any()


@pytest.mark.parametrize(
    ("params", "kind", "message"),
    [
        ({"estimator": LinearRegression()}, TypeError, "estimator must be None or a scikit-learn classifier"),
        ({"estimator": RidgeClassifier}, TypeError, "estimator must be None or .* got <class"),
        ({"estimator": "svm"}, TypeError, "such as LogisticRegression.., got 'svm'"),
        ({"estimator": NoScore()}, TypeError, "decision_function or predict_proba, NoScore has neither"),
        ({"estimator": TwoColumns()}, ValueError, r"decision_function of TwoColumns must give one score per"),
        ({"estimator": GaussianNB(), "C": 2.0}, ValueError, "C and hard_margin belong to the built-in"),
        ({"estimator": GaussianNB(), "hard_margin": True}, ValueError, "set what the estimator has"),
        (
            {"estimator": GaussianNB(), "loss": "hinge"},
            ValueError,
            r"loss='hinge' .* a probability in \[0, 1\]",
        ),
        (
            {"estimator": RidgeClassifier(), "loss": "quadratic"},
            ValueError,
            "'quadratic' .* any real number",
        ),
        (
            {"estimator": DecisionTreeClassifier(max_depth=-1)},
            ValueError,
            "the learner of '0' against '1': The 'max_depth' parameter",
        ),
    ],
)
def test_bad_estimators(params, kind, message):
    clf = ECOCClassifier(**params)
    with pytest.raises(kind, match=message):
        clf.fit(X, y).predict(X)


@pytest.mark.parametrize("estimator", [LinearDiscriminantAnalysis(), make_pipeline(RidgeClassifier())])
def test_weights_that_an_estimator_does_not_take(estimator):
    with pytest.raises(TypeError, match="sample_weight was given, but the estimator's fit does not take it"):
        ECOCClassifier(estimator).fit(X, y, np.ones(len(y)))


def test_estimators_need_features():
    clf = ECOCClassifier(RidgeClassifier())
    with pytest.raises(ValueError, match="estimator needs the features"):
        clf.fit_gram(X @ X.T, y)
    with pytest.raises(ValueError, match="estimator needs the features"):
        clf.fit(X, y).predict_gram(X @ X.T)


def test_a_loss_set_after_the_fit_is_used_and_checked():
    clf = ECOCClassifier(GaussianNB()).fit(X, y)
    with pytest.raises(ValueError, match="loss='logit' does not fit the learners"):
        clf.set_params(loss="logit").predict(X)
