"""ECOCClassifier: the figures of MATLAB's documentation, labels, scores, probabilities, threads, memory, refusals."""

import tracemalloc

import numpy as np
import pytest
from sklearn.datasets import load_iris
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.svm import SVC

from ecoc_cases import MATRIX, blobs
from granular_id import ecoc
from granular_id.ecoc import ECOCClassifier, centred_gram, onevsone, train_learners

X_IRIS, Y_IRIS = load_iris(return_X_y=True)


# Figures: MATLAB documentation of fitcsvm, fitcecoc, resubLoss and resubEdge, all on Fisher's iris.
def test_two_classes_of_iris_give_matlabs_machine():
    shown = Y_IRIS > 0
    X, y = X_IRIS[shown][:, 2:], Y_IRIS[shown]
    assert round(abs(ECOCClassifier().fit(X, y).intercept_[0]), 4) == 14.4149
    gram = centred_gram(X, X.mean(axis=0))
    learned = train_learners(gram, onevsone(2), y - 1, cost=1.0)
    assert np.count_nonzero(learned.dual_coef) == 24
    # 11 multipliers of each class at C, and one free pair.
    assert learned.share_at_bound == 22 / 100


def test_all_classes_of_iris_give_matlabs_error_and_edge():
    clf = ECOCClassifier().fit(X_IRIS, Y_IRIS)
    values = clf.decision_function(X_IRIS)
    is_true = np.arange(3) == Y_IRIS[:, None]
    edge = (values[is_true] - np.where(is_true, -np.inf, values).max(axis=1)).mean()
    assert (round(1 - clf.score(X_IRIS, Y_IRIS), 4), round(edge, 4)) == (0.0067, 0.6467)


def test_two_classes_decide_by_the_sign():
    X, y = blobs(2, distance=0.1)
    clf = ECOCClassifier().fit(X, y)
    decision = clf.decision_function(X)
    assert decision.shape == (50,)
    np.testing.assert_array_equal(clf.predict(X), (decision > 0).astype(int))
    # One learner, +1 for the lower class: a score below -1 costs class 1 nothing.
    scores = clf.binary_scores(X)[:, 0]
    np.testing.assert_array_equal(decision, np.maximum(0, 1 - scores) / 2 - np.maximum(0, 1 + scores) / 2)


@pytest.mark.parametrize("n_classes", [2, 4])
def test_probabilities_are_a_softmax_over_the_temperature(n_classes):
    X, y = blobs(n_classes)
    clf = ECOCClassifier(temperature=0.2).fit(X, y)
    values = clf.decision_function(X)
    if n_classes == 2:  # the value of the second less that of the first
        values = np.column_stack([np.zeros(len(X)), values])
    powers = np.exp(values / 0.2)
    found = clf.predict_proba(X)
    np.testing.assert_allclose(found, powers / powers.sum(axis=1, keepdims=True), rtol=1e-10)
    np.testing.assert_array_equal(found.argmax(axis=1), clf.predict(X))
    surer = clf.set_params(temperature=0.1).predict_proba(X)
    assert (surer.max(axis=1) > found.max(axis=1)).all()


@pytest.mark.parametrize("coding", ["onevsone", "onevsall", MATRIX])
@pytest.mark.parametrize("n_features", [6, 90])  # features, and the Gram matrix of 60 rows
def test_scores_are_those_of_libsvm(coding, n_features):
    X, y = blobs(per_class=15, n_features=n_features, distance=0.4)
    clf = ECOCClassifier(coding).fit(X, y)
    expected = clf.binary_scores(X)
    for codes, scores in zip(clf.coding_matrix_.T, expected.T, strict=True):
        targets = codes[y]
        seen = targets != 0
        machine = SVC(kernel="linear", tol=1e-5).fit(X[seen], targets[seen])
        np.testing.assert_allclose(scores, machine.decision_function(X), atol=1e-3)
    # Neither offset nor unit matters, nor threads.
    for scale, offset in ((1.0, 1e4), (1e8, 0.0), (1e-6, 1.0)):
        rows = X * scale + offset
        scores = ECOCClassifier(coding, C=scale**-2.0).fit(rows, y).binary_scores(rows)
        np.testing.assert_allclose(scores, expected, atol=2e-3)
    np.testing.assert_array_equal(ECOCClassifier(coding, n_jobs=2).fit(X, y).coef_, clf.coef_)
    # Weights are repetitions of rows.
    times = np.random.default_rng(1).integers(0, 4, len(y))
    weighted = ECOCClassifier(coding).fit(X, y, sample_weight=times)
    repeated = ECOCClassifier(coding).fit(np.repeat(X, times, axis=0), np.repeat(y, times))
    np.testing.assert_allclose(weighted.binary_scores(X), repeated.binary_scores(X), atol=2e-3)


def test_memory_beside_wide_rows_is_small():
    """No copy of all rows (20 MB), nor of those of a pair of classes (8 MB)."""
    rng = np.random.default_rng(0)
    y = np.repeat(np.arange(5), 50)
    X = rng.standard_normal((250, 10_200))
    X[:, :5] += 5.0 * np.eye(5)[y]
    tracemalloc.start()
    try:
        ECOCClassifier().fit(X, y).predict(X)
        assert tracemalloc.get_traced_memory()[1] < 6e6
    finally:
        tracemalloc.stop()


def test_search_without_end_warns(monkeypatch):
    monkeypatch.setattr(ecoc, "_MAX_STEPS", 2)
    with pytest.warns(ConvergenceWarning, match="terminated early"):
        ECOCClassifier().fit(*blobs(2, distance=0.1))


X = np.random.default_rng(0).standard_normal((30, 5))
y = np.repeat(["oat", "rice", "sand"], 10)
GAP = np.where(np.arange(150).reshape(30, 5) == 23, np.nan, X)


@pytest.mark.parametrize(
    ("params", "rows", "labels", "weights", "message"),
    [
        ({"C": 0}, X, y, None, "C must be positive and finite, got 0"),
        ({"temperature": 0}, X, y, None, "temperature must be positive and finite, got 0"),
        ({"loss": "votes"}, X, y, None, "loss must be one of 'hinge', 'root', got 'votes'"),
        ({"n_jobs": 0}, X, y, None, "n_jobs must be None, positive, or negative .* got 0"),
        ({"coding": "pairs"}, X, y, None, "coding must be one of 'onevsone', 'onevsall', got 'pairs'"),
        ({}, X, ["sand"] * 30, None, "y holds one class only"),
        ({}, X, np.array([1, "oat"] * 15, dtype=object), None, "y must hold labels of one kind, .* got 1, 'oat'"),
        ({}, X[:3], ["oat", "rice", None], None, "y must hold labels of one kind"),
        ({}, GAP, y, None, "NaN"),
        ({}, X, y, ["a"] * 30, "could not convert"),
        ({}, X, y, -np.ones(30), "sample_weight must not be negative"),
        ({}, X, y, np.zeros(30), "zero"),  # the newest scikit-learn refuses it in its own words
        ({}, X, y, np.repeat([1.0, 0.0], [10, 20]), "y holds one class only"),
    ],
)  # fmt: skip
def test_bad_input_of_fit_is_refused(params, rows, labels, weights, message):
    with pytest.raises((TypeError, ValueError), match=message):
        ECOCClassifier(**params).fit(rows, labels, weights)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (GAP, "NaN"),
        (X[:, :-1], "5 features"),
        (np.full((1, 5), 1.7e308), "X must be finite, with scores in the range of float64"),
    ],
)
def test_bad_rows_to_name_are_refused(rows, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit(X, y).predict(rows)


def test_failed_fit_leaves_nothing_fitted():
    clf = ECOCClassifier(np.ones((2, 3)))
    with pytest.raises(ValueError, match="coding column 0 must hold both"):
        clf.fit(np.ones((6, 2)), [0, 0, 0, 1, 1, 1])
    for use in (clf.predict, clf.decision_function, clf.predict_proba):
        with pytest.raises(NotFittedError):
            use(np.ones((6, 2)))


def test_class_of_zero_weight_is_absent():
    clf = ECOCClassifier().fit(X, y, sample_weight=(y != "rice").astype(float))
    without = ECOCClassifier().fit(X[y != "rice"], y[y != "rice"])
    assert clf.classes_.tolist() == ["oat", "sand"]
    np.testing.assert_array_equal(clf.coef_, without.coef_)


def test_seventy_classes_of_two_rows_are_distinguished():
    truth = np.repeat(np.arange(70), 2)
    centres = 5.0 * np.random.default_rng(0).standard_normal((70, 12))
    rows = np.random.default_rng(1).standard_normal((140, 12)) * 0.3 + centres[truth]
    clf = ECOCClassifier().fit(rows, truth)
    assert clf.coef_.shape == (2415, 12)
    assert clf.score(rows, truth) > 0.99


@pytest.mark.parametrize("coding", ["onevsone", "onevsall"])
def test_poor_rows_give_finite_values(coding):
    rows, truth = blobs(3, n_features=60)
    shown = np.flatnonzero(
        (truth != 1) | (np.arange(len(truth)) == np.argmax(truth == 1))
    )  # one row of a class
    clf = ECOCClassifier(coding)
    assert clf.fit(rows[shown], truth[shown]).score(rows[shown], truth[shown]) == 1.0
    truth = np.repeat([0, 1, 2], [8, 4, 4])
    assert np.isfinite(clf.fit(np.ones((16, 3)), truth).decision_function(np.ones((2, 3)))).all()
    assert clf.fit([[0.0], [2.0]], ["a", "b"]).predict([[0.5], [1.5]]).tolist() == ["a", "b"]


@pytest.mark.parametrize("coding", ["onevsone", "onevsall"])
def test_constant_features_change_nothing(coding):
    rows, truth = blobs(3)
    wide = np.column_stack([rows, np.full(len(truth), 0.1), np.zeros(len(truth))])
    expected = ECOCClassifier(coding).fit(rows, truth).decision_function(rows)
    np.testing.assert_allclose(
        ECOCClassifier(coding).fit(wide, truth).decision_function(wide), expected, atol=1e-6
    )
