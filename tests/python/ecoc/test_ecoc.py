"""ECOCClassifier: the figures of MATLAB's documentation, labels, margins, products instead of features, memory."""

import tracemalloc

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.datasets import load_iris
from sklearn.exceptions import NotFittedError
from sklearn.multiclass import OneVsOneClassifier
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from ecoc_cases import blobs
from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.decoding import LOSSES, decode
from granular_id.gram import linear_gram

X_IRIS, Y_IRIS = load_iris(return_X_y=True)


def rounded_error(clf):
    return round(1 - clf.score(X_IRIS, Y_IRIS), 4)


def rounded_edge(clf):
    return round(float(clf.margin(X_IRIS, Y_IRIS).mean()), 4)


# Figures: MATLAB documentation of fitcsvm, fitcecoc, resubLoss and resubEdge, all on Fisher's iris.
class TestIris:
    def test_two_classes_two_features(self):
        kept = Y_IRIS > 0
        clf = ECOCClassifier().fit(X_IRIS[kept][:, 2:], Y_IRIS[kept])
        (learner,) = clf.learners_
        assert len(learner.support) == 24
        assert round(abs(learner.intercept), 4) == 14.4149
        assert (learner.positive, learner.negative) == ((1,), (2,))
        # 11 multipliers of each class at C, and one free pair.
        assert clf.alpha_at_bound_ == 22 / 100

    def test_all_classes(self):
        plain = ECOCClassifier().fit(X_IRIS, Y_IRIS)
        assert (rounded_error(plain), rounded_edge(plain)) == (0.0067, 0.6467)
        clf = ECOCClassifier(standardize=True).fit(X_IRIS, Y_IRIS)
        assert (rounded_error(clf), rounded_edge(clf)) == (0.0267, 0.7440)
        clf.set_params(decoding="loss_based")
        assert (rounded_error(clf), rounded_edge(clf)) == (0.0267, 0.4960)

    @pytest.mark.parametrize(
        ("loss", "expected"),
        [
            ("hinge", 0.0267),
            ("logit", 0.0200),
            ("exponential", 0.0267),
            ("binodeviance", 0.0267),
            ("hamming", 0.0267),
            ("linear", 0.3667),
        ],
    )
    def test_losses(self, loss, expected):
        assert rounded_error(ECOCClassifier(standardize=True, loss=loss).fit(X_IRIS, Y_IRIS)) == expected


@pytest.mark.parametrize("distance", [0.05, 0.3])
def test_labels_of_one_vs_one_where_votes_and_losses_agree(distance):
    X, y = blobs(5, 24, 60, distance)
    X_new, _ = blobs(5, 24, 60, distance, seed=1)
    ours = ECOCClassifier().fit(X, y)
    theirs = OneVsOneClassifier(SVC(kernel="linear", tol=1e-9)).fit(X, y)
    by_loss = ours.predict(X_new)
    votes = decode(ours.binary_scores(X_new), ours.coding_matrix_, "hamming")
    # scikit-learn breaks ties of votes in its own way: there is no common winner to agree on.
    unique = (votes == votes.max(axis=1, keepdims=True)).sum(axis=1) == 1
    agree = unique & (ours.classes_[votes.argmax(axis=1)] == by_loss)
    assert agree.sum() > 30
    np.testing.assert_array_equal(theirs.predict(X_new)[agree], by_loss[agree])


@pytest.mark.parametrize("loss", [name for name, loss in LOSSES.items() if loss.scores == "real"])
def test_both_decodings_name_the_same_classes(loss):
    X, y = blobs(5, 12, 20, 0.3)
    X_new, _ = blobs(5, 12, 20, 0.3, seed=1)
    weighted = ECOCClassifier(loss=loss).fit(X, y)
    based = clone(weighted).set_params(decoding="loss_based").fit(X, y)
    np.testing.assert_array_equal(weighted.predict(X_new), based.predict(X_new))
    expected = weighted.decision_function(X_new) * 4 / 10
    np.testing.assert_allclose(based.decision_function(X_new), expected, rtol=1e-14)


def test_a_feature_may_be_constant_for_one_learner():
    X, y = blobs(3, n_features=60, distance=0.3)
    X[y != 2, 6] = -1.1  # constant for the learner of classes 0 and 1
    clf = ECOCClassifier(standardize=True).fit(X, y)
    rows = y != 2
    scaler = StandardScaler().fit(X[rows])
    pair = ECOCClassifier().fit(scaler.transform(X[rows]), y[rows])
    expected = pair.binary_scores(scaler.transform(X))
    np.testing.assert_allclose(clf.binary_scores(X)[:, [0]], expected, rtol=1e-8, atol=1e-8)
    assert clf.coef_[0, 6] == 0


def test_standardize_does_not_depend_on_units():
    X, y = blobs(3, n_features=20, distance=0.3)
    units = 10.0 ** np.random.default_rng(3).integers(-160, 100, X.shape[1])
    clf = ECOCClassifier(standardize=True).fit(X, y)
    scaled = clone(clf).fit(X * units, y)
    np.testing.assert_allclose(scaled.binary_scores(X * units), clf.binary_scores(X), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    "names",
    [
        np.array(["sand", "gravel", "rice"]),
        np.array(["sand", "gravel", "rice"], dtype=object),
        np.array([30, -1, 7]),
        np.array([2.0, 1.0, 0.0]),
    ],
)
def test_labels_of_every_kind(names):
    X, y = blobs(3, distance=3.0)
    clf = ECOCClassifier().fit(X, names[y])
    np.testing.assert_array_equal(clf.classes_, np.sort(names))
    assert clf.predict(X).dtype == names.dtype
    np.testing.assert_array_equal(clf.predict(X), names[y])


def test_two_classes_decide_by_sign():
    X, y = blobs(2, distance=0.1)
    clf = ECOCClassifier().fit(X, y)
    decision = clf.decision_function(X)
    assert decision.shape == (50,)
    np.testing.assert_array_equal(clf.predict(X), (decision > 0).astype(int))
    # One learner, +1 for the lower class: a score below -1 costs class 1 nothing.
    scores = clf.binary_scores(X)[:, 0]
    np.testing.assert_array_equal(decision, np.maximum(0, 1 - scores) / 2 - np.maximum(0, 1 + scores) / 2)


def test_margin_is_the_gap_to_the_best_other_class():
    clf = ECOCClassifier().fit(*blobs(5, distance=0.2))
    X, y = blobs(5, distance=0.2, seed=4)
    values = clf.decision_function(X)
    expected = [row[k] - np.delete(row, k).max() for row, k in zip(values, y, strict=True)]
    np.testing.assert_array_equal(clf.margin(X, y), expected)
    np.testing.assert_array_equal(clf.margin(X, y) < 0, clf.predict(X) != y)
    with pytest.raises(ValueError, match="y holds 9, which is not among the classes"):
        clf.margin(X, np.full(len(y), 9))
    with pytest.raises(ValueError, match=r"y must have 125 labels, one per row of X, got 3"):
        clf.margin(X, y[:3])


def test_learners_tell_their_classes_and_support_vectors():
    X, y = blobs(3, distance=0.3)
    clf = ECOCClassifier().fit(X, np.array(["a", "b", "c"])[y])
    assert [one.positive + one.negative for one in clf.learners_] == [("a", "b"), ("a", "c"), ("b", "c")]
    for k, one in enumerate(clf.learners_):
        np.testing.assert_array_equal(np.sign(one.dual_coef), clf.coding_matrix_[y[one.support], k])
        np.testing.assert_allclose(one.dual_coef @ X[one.support], clf.coef_[k], rtol=1e-9, atol=1e-12)


def test_gram_matrix_of_all_rows_serves_every_partition():
    X, y = blobs(5, distance=0.2)
    names = np.array(["a", "b", "c", "d", "e"])[y]
    gram = linear_gram(X, center=X.mean(axis=0))
    train, test = np.arange(80), np.arange(80, 125)
    by_features = ECOCClassifier().fit(X[train], names[train])
    by_gram = ECOCClassifier().fit_gram(gram[np.ix_(train, train)], names[train])
    rows = gram[np.ix_(test, train)]
    expected = by_features.binary_scores(X[test])
    close = {"rtol": 1e-9, "atol": 1e-9}
    np.testing.assert_allclose(by_gram.binary_scores_gram(rows), expected, **close)
    np.testing.assert_array_equal(by_gram.predict_gram(rows), by_features.predict(X[test]))
    values = by_features.decision_function(X[test])
    np.testing.assert_allclose(by_gram.decision_function_gram(rows), values, **close)
    # After fit, products about the origin of X serve as well.
    np.testing.assert_allclose(
        by_features.binary_scores_gram(linear_gram(X[test], X[train])), expected, **close
    )
    with pytest.raises(NotFittedError, match="call fit"):
        by_gram.predict(X[test])
    # What an earlier fit on features left behind must not answer for the Gram matrix.
    again = by_features.fit_gram(gram[np.ix_(train, train)], names[train])
    assert not hasattr(again, "coef_")
    assert not hasattr(again, "n_features_in_")


def test_input_is_not_changed_and_may_be_read_only_and_of_any_kind():
    X, y = blobs(3)
    X, weights = X.astype(np.float32), np.ones(len(y))
    kept = X.copy()
    for array in (X, y, weights):
        array.setflags(write=False)
    expected = ECOCClassifier(standardize=True).fit(X.astype(np.float64), y).decision_function(X)
    for rows in (X, X.tolist(), np.asfortranarray(X)):
        clf = ECOCClassifier(standardize=True).fit(rows, y.tolist(), weights)
        assert clf.coef_.dtype == np.float64
        np.testing.assert_allclose(clf.decision_function(rows), expected, rtol=1e-9, atol=1e-9)
    ECOCClassifier().fit_gram(np.asfortranarray(X @ X.T, dtype=float), y)
    np.testing.assert_array_equal(X, kept)


def test_memory_beside_the_rows_is_small():
    """No copy of all rows (20 MB), nor of those of a pair of classes (8 MB)."""
    rng = np.random.default_rng(0)
    y = np.repeat(np.arange(5), 50)
    X = rng.standard_normal((250, 10_200))
    X[:, :5] += 5.0 * np.eye(5)[y]
    tracemalloc.start()
    try:
        ECOCClassifier().fit(X, y).predict(X)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
