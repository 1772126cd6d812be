"""ECOCClassifier with scikit-learn classifiers as learners, and with every coding."""

import numpy as np
import pytest
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.datasets import load_iris
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import LinearRegression, LogisticRegression, SGDClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.codings import CODINGS, design
from granular_id.ecoc.decoding import decode
from granular_id.gram import linear_gram

MATRIX = np.array([[1, 1, 0], [-1, 0, 1], [0, -1, 1], [1, -1, -1]])


@pytest.fixture(scope="module")
def blobs():
    rng = np.random.default_rng(0)
    y = rng.permutation(np.arange(120) % 4)
    return rng.standard_normal((120, 6)) + 1.5 * rng.standard_normal((4, 6))[y], y


class NoScore(ClassifierMixin, BaseEstimator):
    """Predicts, but says nothing of how sure it is."""

    def fit(self, X, y):
        self.classes_ = np.unique(y)
        return self

    def predict(self, X):
        return np.zeros(len(X), dtype=int)


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
        LogisticRegression(),
        LinearDiscriminantAnalysis(),
        SVC(kernel="rbf"),
        GaussianNB(),
        KNeighborsClassifier(),
        make_pipeline(StandardScaler(), LogisticRegression()),
    ],
    ids=lambda estimator: type(estimator).__name__,
)
@pytest.mark.parametrize("coding", ["onevsone", MATRIX], ids=["onevsone", "own"])
def test_learners_are_those_trained_by_hand(blobs, estimator, coding):
    X, y = blobs
    clf = ECOCClassifier(estimator, coding=coding).fit(X[::2], y[::2])
    matrix = clf.coding_matrix_
    expected = by_hand(estimator, X[::2], y[::2], matrix, X[1::2])
    np.testing.assert_allclose(clf.binary_scores(X[1::2]), expected, rtol=1e-9, atol=1e-9)
    unit = not hasattr(estimator, "decision_function")
    values = decode(expected, matrix, "quadratic" if unit else "hinge")
    np.testing.assert_allclose(clf.decision_function(X[1::2]), values, atol=1e-9)
    np.testing.assert_array_equal(clf.predict(X[1::2]), values.argmax(axis=1))
    assert not hasattr(estimator, "classes_")  # clones are fitted, not what was given


def test_learners_tell_their_classes(blobs):
    X, y = blobs
    names = np.array(["a", "b", "c", "d"])
    clf = ECOCClassifier(LogisticRegression(), coding=MATRIX).fit(X, names[y])
    assert [(one.positive, one.negative) for one in clf.learners_] == [
        (("a", "d"), ("b",)),
        (("a",), ("c", "d")),
        (("b", "c"), ("d",)),
    ]
    assert all(one.estimator.classes_.tolist() == [0, 1] for one in clf.learners_)


class TestLinear:
    @pytest.mark.parametrize(
        "estimator", [LogisticRegression(), SVC(kernel="linear"), LinearDiscriminantAnalysis()]
    )
    @pytest.mark.parametrize("standardize", [False, True])
    def test_coef_gives_the_scores(self, blobs, estimator, standardize):
        X, y = blobs
        X = X * 10.0 ** np.arange(-3, 3) + 5.0
        X[:, 2] = 7.0
        clf = ECOCClassifier(estimator, standardize=standardize).fit(X, y)
        assert clf.coef_.shape == (6, 6)
        assert clf.intercept_.shape == (6,)
        by_learner = np.column_stack([one.scores(X) for one in clf.learners_])
        np.testing.assert_allclose(X @ clf.coef_.T + clf.intercept_, by_learner, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(clf.binary_scores(X), X @ clf.coef_.T + clf.intercept_)

    @pytest.mark.parametrize(
        "estimator",
        [
            SVC(kernel="rbf"),
            GaussianNB(),
            make_pipeline(StandardScaler(), LogisticRegression()),
            Bent(random_state=0),
        ],
    )
    def test_no_coef_otherwise(self, blobs, estimator):
        clf = ECOCClassifier(LogisticRegression()).fit(*blobs)
        clf.set_params(estimator=estimator).fit(*blobs)
        assert not hasattr(clf, "coef_")
        assert not hasattr(clf, "intercept_")

    def test_what_belongs_to_the_built_in_machine_goes(self, blobs):
        clf = ECOCClassifier().fit(*blobs)
        assert clf.supports_gram
        clf.set_params(estimator=GaussianNB()).fit(*blobs)
        assert not clf.supports_gram
        for name in ("dual_coef_", "alpha_at_bound_", "coef_"):
            assert not hasattr(clf, name)
        assert hasattr(clf.set_params(estimator=None).fit(*blobs), "alpha_at_bound_")
        assert not hasattr(clf, "_estimators")


@pytest.mark.parametrize("estimator", [LogisticRegression(), KNeighborsClassifier(3)])
def test_standardize_is_that_of_each_learner(blobs, estimator):
    X, y = blobs
    X = X * 10.0 ** np.arange(-3, 3)
    clf = ECOCClassifier(estimator, standardize=True).fit(X, y)
    expected = by_hand(make_pipeline(StandardScaler(), estimator), X, y, clf.coding_matrix_, X)
    np.testing.assert_allclose(clf.binary_scores(X), expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("coding", CODINGS)
class TestEveryCoding:
    def test_learns_iris_with_either_kind_of_learner(self, coding):
        X, y = load_iris(return_X_y=True)
        # Versicolor lies between the others: no plane has it alone on one side.
        for estimator in (None, DecisionTreeClassifier(max_depth=3)):
            clf = ECOCClassifier(estimator, coding=coding, random_state=0).fit(X, y)
            assert clf.coding_matrix_.shape == (3, CODINGS[coding].n_learners(3))
            assert clf.score(X, y) > (0.65 if coding == "onevsall" and estimator is None else 0.9)

    @pytest.mark.parametrize("standardize", [False, True])
    def test_scores_are_those_of_libsvm(self, blobs, coding, standardize):
        X, y = blobs
        clf = ECOCClassifier(coding=coding, standardize=standardize, random_state=0).fit(X, y)
        machine = SVC(kernel="linear", tol=1e-8)
        expected = by_hand(
            make_pipeline(StandardScaler(), machine) if standardize else machine, X, y, clf.coding_matrix_, X
        )
        np.testing.assert_allclose(clf.binary_scores(X), expected, atol=1e-4)

    def test_weights_equal_repeated_rows(self, blobs, coding):
        X, y = blobs
        times = np.random.default_rng(1).integers(0, 4, len(y))
        matrix = design(coding, 4, np.random.default_rng(0))  # drawn once
        for params in ({}, {"standardize": True}, {"estimator": GaussianNB()}):
            clf = ECOCClassifier(coding=matrix, **params)
            weighted = clone(clf).fit(X, y, sample_weight=times)
            repeated = clone(clf).fit(np.repeat(X, times, axis=0), np.repeat(y, times))
            np.testing.assert_allclose(
                weighted.binary_scores(X), repeated.binary_scores(X), rtol=1e-7, atol=1e-7
            )

    def test_gram_and_features_and_threads_agree(self, blobs, coding):
        X, y = blobs
        clf = ECOCClassifier(coding=coding, random_state=0).fit(X, y)
        gram = linear_gram(X, center=X.mean(axis=0))
        by_gram = clone(clf).fit_gram(gram, y)
        np.testing.assert_array_equal(by_gram.coding_matrix_, clf.coding_matrix_)
        np.testing.assert_allclose(
            by_gram.binary_scores_gram(gram), clf.binary_scores(X), rtol=1e-9, atol=1e-9
        )
        threads = clone(clf).set_params(n_jobs=2).fit(X, y)
        np.testing.assert_array_equal(threads.coef_, clf.coef_)
        assert threads.alpha_at_bound_ == clf.alpha_at_bound_


class TestSeeds:
    def forest(self, **params):
        return ECOCClassifier(RandomForestClassifier(n_estimators=3, max_depth=2), n_jobs=2, **params)

    def test_same_seed_same_numbers_with_any_n_jobs(self, blobs):
        X, y = blobs
        one, two = (
            self.forest(random_state=5).fit(X, y),
            self.forest(random_state=5).set_params(n_jobs=1).fit(X, y),
        )
        np.testing.assert_array_equal(one.binary_scores(X), two.binary_scores(X))
        assert (one.binary_scores(X) != self.forest(random_state=6).fit(X, y).binary_scores(X)).any()

    def test_every_learner_has_its_own(self, blobs):
        seeds = [one.estimator.random_state for one in self.forest(random_state=0).fit(*blobs).learners_]
        assert len(set(seeds)) == 6

    def test_a_seed_that_is_set_stays(self, blobs):
        estimator = make_pipeline(StandardScaler(), DecisionTreeClassifier(random_state=7))
        clf = ECOCClassifier(estimator, random_state=0).fit(*blobs)
        assert {one.estimator[-1].random_state for one in clf.learners_} == {7}

    def test_random_designs_follow_the_seed(self, blobs):
        found = [
            ECOCClassifier(coding="sparserandom", random_state=seed).fit(*seven()).coding_matrix_
            for seed in (1, 1, 2)
        ]
        np.testing.assert_array_equal(found[0], found[1])
        assert (found[0] != found[2]).any()


def seven():
    y = np.repeat(np.arange(7), 3)
    return np.random.default_rng(0).standard_normal((21, 4)) + 9.0 * np.eye(7)[y][:, :4], y


@pytest.mark.parametrize(
    ("params", "kind", "message"),
    [
        ({"estimator": LinearRegression()}, TypeError, "estimator must be None or a scikit-learn classifier"),
        ({"estimator": LogisticRegression}, TypeError, "estimator must be None or .* got <class"),
        ({"estimator": "svm"}, TypeError, "such as LogisticRegression.., got 'svm'"),
        ({"estimator": NoScore()}, TypeError, "decision_function or predict_proba, NoScore has neither"),
        ({"estimator": GaussianNB(), "C": 2.0}, ValueError, "C and hard_margin belong to the built-in"),
        ({"estimator": GaussianNB(), "hard_margin": True}, ValueError, "set what the estimator has"),
        (
            {"estimator": GaussianNB(), "loss": "hinge"},
            ValueError,
            r"loss='hinge' does not fit the learners: their score is a probability in \[0, 1\].*'quadratic'",
        ),
        (
            {"estimator": LogisticRegression(), "loss": "quadratic"},
            ValueError,
            "loss='quadratic' does not fit .* any real number.*'hinge', 'hamming', 'root', 'linear', 'exponential'",
        ),
        (
            {"estimator": DecisionTreeClassifier(max_depth=-1)},
            ValueError,
            "the learner of '0' against '1': The 'max_depth' parameter",
        ),
    ],
)
def test_bad_estimators(blobs, params, kind, message):
    X, y = blobs
    clf = ECOCClassifier(**params)
    with pytest.raises(kind, match=message):
        clf.fit(X[:40], y[:40]).predict(X)


def test_weights_that_an_estimator_does_not_take(blobs):
    X, y = blobs
    for estimator in (LinearDiscriminantAnalysis(), make_pipeline(StandardScaler(), LogisticRegression())):
        with pytest.raises(
            TypeError, match="sample_weight was given, but the estimator's fit does not take it: "
        ):
            ECOCClassifier(estimator).fit(X, y, np.ones(len(y)))


def test_estimators_need_features(blobs):
    X, y = blobs
    clf = ECOCClassifier(LogisticRegression())
    with pytest.raises(ValueError, match="estimator needs the features"):
        clf.fit_gram(X @ X.T, y)
    with pytest.raises(ValueError, match="estimator needs the features"):
        clf.fit(X, y).predict_gram(X @ X.T)


def test_a_score_of_the_wrong_shape(blobs):
    class TwoColumns(LogisticRegression):
        def decision_function(self, X):
            return np.zeros((len(X), 2))

    with pytest.raises(
        ValueError, match=r"decision_function of TwoColumns must give one score per row.*\(8, 2\)"
    ):
        ECOCClassifier(TwoColumns()).fit(*blobs)


def test_a_loss_set_after_the_fit_is_used_and_checked(blobs):
    X, y = blobs
    clf = ECOCClassifier(GaussianNB()).fit(X, y)
    with pytest.raises(ValueError, match="loss='logit' does not fit the learners"):
        clf.set_params(loss="logit").predict(X)
