"""ECOCClassifier against MATLAB and libsvm; codings, losses and decoding against their definitions; refusals."""

import itertools
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.datasets import load_iris
from sklearn.exceptions import ConvergenceWarning
from sklearn.svm import SVC

from granular_id import ecoc
from granular_id.ecoc import (
    CODINGS,
    LOSSES,
    ECOCClassifier,
    centred_gram,
    decode,
    design,
    onevsone,
    train_learners,
)

MATRIX = np.array([[1, 1, 0], [-1, 0, 1], [0, -1, 1], [1, -1, -1]])  # a coding of four classes
X_IRIS, Y_IRIS = load_iris(return_X_y=True)


def blobs(n_classes=4, per_class=25, n_features=8, distance=1.0, seed=0):
    """Rows of as many classes in random order; another seed draws other rows of the same classes."""
    rng = np.random.default_rng(seed)
    y = rng.permutation(np.repeat(np.arange(n_classes), per_class))
    centres = distance * np.random.default_rng(99).standard_normal((n_classes, n_features))
    return rng.standard_normal((len(y), n_features)) + centres[y], y


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


def test_class_of_zero_weight_is_absent():
    clf = ECOCClassifier().fit(X, y, sample_weight=(y != "rice").astype(float))
    without = ECOCClassifier().fit(X[y != "rice"], y[y != "rice"])
    assert clf.classes_.tolist() == ["oat", "sand"]
    np.testing.assert_array_equal(clf.coef_, without.coef_)


@pytest.mark.parametrize("coding", ["onevsone", "onevsall"])
def test_poor_rows_give_finite_values(coding):
    rows, truth = blobs(3, n_features=60)
    shown = np.r_[np.flatnonzero(truth != 1), np.argmax(truth == 1)]  # one row of a class
    clf = ECOCClassifier(coding)
    assert clf.fit(rows[shown], truth[shown]).score(rows[shown], truth[shown]) == 1.0
    truth = np.repeat([0, 1, 2], [8, 4, 4])
    assert np.isfinite(clf.fit(np.ones((16, 3)), truth).decision_function(np.ones((2, 3)))).all()
    assert clf.fit([[0.0], [2.0]], ["a", "b"]).predict([[0.5], [1.5]]).tolist() == ["a", "b"]


# The definitions, in plain Python: one number at a time.
DEFINITIONS = {
    "hinge": lambda z: max(0.0, 1 - z) / 2,
    "root": lambda z: (1 + math.sqrt(-z)) / 2 if z < 0 else (1 - math.sqrt(min(1, z))) / 2,
}


@pytest.mark.parametrize("n_classes", [2, 3, 7])
def test_designs_are_those_of_their_names(n_classes):
    pairs = list(itertools.combinations(range(n_classes), 2))
    expected = np.zeros((n_classes, len(pairs)), np.int8)
    for learner, (low, high) in enumerate(pairs):
        expected[low, learner], expected[high, learner] = 1, -1
    for coding in ("onevsone", expected.tolist()):
        np.testing.assert_array_equal(design(coding, n_classes), expected, strict=True)
    expected = 2 * np.eye(n_classes, dtype=np.int8) - 1
    np.testing.assert_array_equal(design("onevsall", n_classes), expected.astype(np.int8), strict=True)


def test_too_many_pairs_are_refused():
    with pytest.raises(ValueError, match=r"='onevsone' needs 100,128 learners .* 'onevsall' needs 448"):
        design("onevsone", 448)
    assert design("onevsall", 448).shape == (448, 448)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([["a", "b"]], "must be an array of numbers"),
        ([[1, [2]], [1]], "must be an array of numbers"),
        (None, r"must have 3 rows, .* got shape \(\)"),
        ("votes", "must be one of 'onevsone', 'onevsall', got 'votes'"),
        (np.zeros((3, 0)), r"must have 3 rows, one per class, and a column per learner, got shape \(3, 0\)"),
        ([[1], [-1]], r"must have 3 rows, one per class, .* got shape \(2, 1\)"),
        ([[1, 2], [-1, -1], [0, 1]], r"must hold -1, 0 and \+1 only"),
        ([[1, np.nan], [-1, -1], [0, 1]], r"must hold -1, 0 and \+1 only"),
        ([[1, 1], [-1, 0], [-1, 0]], "column 1 must hold both"),
        ([[1], [-1], [0]], "row 2 is all 0"),
        ([[1, 1], [1, 1], [-1, -1]], "row 1 is like one before: these classes are never separated"),
        ([[1, 1, -1], [-1, 0, 1], [0, -1, 0]], "column 2 is like one before: .* but for the sign"),
    ],
)
def test_coding_that_does_not_fit_is_refused(matrix, message):
    with pytest.raises(ValueError, match=f"coding {message}"):
        design(matrix, 3)


@pytest.mark.parametrize("name", LOSSES)
def test_losses_are_their_definitions_and_never_rise(name):
    agreements = np.concatenate([-np.logspace(6, -3, 400), [0.0], np.logspace(-3, 6, 400)])
    loss = LOSSES[name](agreements)
    expected = [DEFINITIONS[name](z) for z in agreements]
    np.testing.assert_allclose(loss, expected, rtol=1e-13, atol=1e-14)
    assert loss[400] == 0.5  # where the score says nothing
    assert (np.diff(loss) <= 0).all()
    assert (np.diff(loss[:400]) < 0).all()  # no ties among wrong answers, however wrong


@pytest.mark.parametrize("matrix", [onevsone(9), MATRIX])
@pytest.mark.parametrize("name", LOSSES)
def test_decode_adds_losses_in_the_order_of_the_learners(matrix, name):
    rng = np.random.default_rng(5)
    shape = (20, matrix.shape[1])
    scores = 10.0 ** rng.uniform(-8, 8, shape) * rng.choice([-1, 1], shape)
    expected = np.zeros((20, len(matrix)))
    for i, k in np.ndindex(expected.shape):
        total = 0.0
        for m, s in zip(matrix[k].tolist(), scores[i].tolist(), strict=True):
            if m != 0:
                total += DEFINITIONS[name](m * s)
        expected[i, k] = -(total / np.count_nonzero(matrix[k]))
    np.testing.assert_array_equal(decode(scores, matrix, name), expected)


@settings(max_examples=30)
@given(
    n_classes=st.integers(2, 7),
    seed=st.integers(0, 1000),
    coding=st.sampled_from(sorted(CODINGS)),
    name=st.sampled_from(sorted(LOSSES)),
)
def test_row_alone_gives_the_bits_it_gives_in_a_batch(n_classes, seed, coding, name):
    matrix = design(coding, n_classes)
    scores = np.random.default_rng(seed).normal(scale=3.0, size=(17, matrix.shape[1]))
    rows = np.concatenate([decode(row[None], matrix, name) for row in scores])
    np.testing.assert_array_equal(rows, decode(scores, matrix, name))


def test_two_hundred_classes_decode_by_their_pairs():
    """More pairs than are decoded at once."""
    matrix = onevsone(200)
    truth = np.random.default_rng(0).integers(0, 200, 30)
    scores = 2.0 * matrix[truth] + np.random.default_rng(1).normal(scale=0.5, size=(30, 19_900))
    values = decode(scores, matrix)
    np.testing.assert_array_equal(values.argmax(axis=1), truth)
    seen = matrix[7] != 0
    expected = -np.maximum(0, 1 - matrix[7, seen] * scores[:, seen]).mean(axis=1) / 2
    np.testing.assert_allclose(values[:, 7], expected, rtol=1e-12)


def test_ties_are_exact_so_that_the_first_class_wins():
    # A circle: 0 beats 1, 1 beats 2, 2 beats 0, all by as much.
    (value,) = decode(np.array([[0.3, -0.3, 0.3]]), onevsone(3))
    assert len(set(value)) == 1
