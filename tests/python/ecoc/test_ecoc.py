"""ECOCClassifier: the figures of MATLAB's documentation, labels, products instead of features, threads, memory."""

import tracemalloc

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.datasets import load_iris
from sklearn.exceptions import NotFittedError
from sklearn.multiclass import OneVsOneClassifier
from sklearn.svm import SVC

from ecoc_cases import MATRIX, blobs
from granular_id.ecoc import ECOCClassifier
from granular_id.gram import linear_gram

X_IRIS, Y_IRIS = load_iris(return_X_y=True)


# Figures: MATLAB documentation of fitcsvm, fitcecoc, resubLoss and resubEdge, all on Fisher's iris.
class TestIris:
    def test_two_classes_two_features(self):
        kept = Y_IRIS > 0
        clf = ECOCClassifier().fit(X_IRIS[kept][:, 2:], Y_IRIS[kept])
        assert np.count_nonzero(clf.dual_coef_) == 24
        assert round(abs(clf.intercept_[0]), 4) == 14.4149
        # 11 multipliers of each class at C, and one free pair.
        assert clf.alpha_at_bound_ == 22 / 100

    def test_all_classes(self):
        clf = ECOCClassifier().fit(X_IRIS, Y_IRIS)
        values = clf.decision_function(X_IRIS)
        is_true = np.arange(3) == Y_IRIS[:, None]
        edge = (values[is_true] - np.where(is_true, -np.inf, values).max(axis=1)).mean()
        assert (round(1 - clf.score(X_IRIS, Y_IRIS), 4), round(edge, 4)) == (0.0067, 0.6467)


@pytest.mark.parametrize("distance", [0.05, 0.3])
def test_labels_of_one_vs_one_where_votes_and_losses_agree(distance):
    X, y = blobs(5, 24, 60, distance)
    X_new, _ = blobs(5, 24, 60, distance, seed=1)
    ours = ECOCClassifier().fit(X, y)
    theirs = OneVsOneClassifier(SVC(kernel="linear", tol=1e-9)).fit(X, y)
    by_loss = ours.predict(X_new)
    votes = (ours.binary_scores(X_new)[:, None, :] * ours.coding_matrix_ > 0).sum(axis=2)
    # scikit-learn breaks ties of votes in its own way: there is no common winner to agree on.
    unique = (votes == votes.max(axis=1, keepdims=True)).sum(axis=1) == 1
    agree = unique & (ours.classes_[votes.argmax(axis=1)] == by_loss)
    assert agree.sum() > 30
    np.testing.assert_array_equal(theirs.predict(X_new)[agree], by_loss[agree])


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
    expected = ECOCClassifier().fit(X.astype(np.float64), y).decision_function(X)
    for rows in (X, X.tolist(), np.asfortranarray(X)):
        clf = ECOCClassifier().fit(rows, y.tolist(), weights)
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


@pytest.mark.parametrize("coding", ["onevsone", "onevsall", MATRIX])
class TestCodings:
    X, y = blobs(per_class=15, n_features=6)

    def test_scores_are_those_of_libsvm(self, coding):
        clf = ECOCClassifier(coding).fit(self.X, self.y)
        for codes, scores in zip(clf.coding_matrix_.T, clf.binary_scores(self.X).T, strict=True):
            targets = codes[self.y]
            seen = targets != 0
            machine = SVC(kernel="linear", tol=1e-8).fit(self.X[seen], targets[seen])
            np.testing.assert_allclose(scores, machine.decision_function(self.X), atol=1e-4)

    def test_coef_gives_the_scores(self, coding):
        rows = self.X * 10.0 ** np.linspace(-1, 1, 6) + 5.0
        rows[:, 2] = 7.0
        clf = ECOCClassifier(coding).fit(rows, self.y)
        np.testing.assert_array_equal(clf.binary_scores(rows), rows @ clf.coef_.T + clf.intercept_)
        np.testing.assert_allclose(clf.dual_coef_ @ rows, clf.coef_, rtol=1e-9, atol=1e-12)

    def test_weights_equal_repeated_rows(self, coding):
        times = np.random.default_rng(1).integers(0, 4, len(self.y))
        clf = ECOCClassifier(coding)
        weighted = clone(clf).fit(self.X, self.y, sample_weight=times).binary_scores(self.X)
        repeated = clone(clf).fit(np.repeat(self.X, times, axis=0), np.repeat(self.y, times))
        np.testing.assert_allclose(weighted, repeated.binary_scores(self.X), rtol=1e-7, atol=1e-7)

    def test_gram_and_features_and_threads_agree(self, coding):
        clf = ECOCClassifier(coding).fit(self.X, self.y)
        gram = linear_gram(self.X, center=self.X.mean(axis=0))
        scores = clone(clf).fit_gram(gram, self.y).binary_scores_gram(gram)
        np.testing.assert_allclose(scores, clf.binary_scores(self.X), rtol=1e-9, atol=1e-9)
        threads = clone(clf).set_params(n_jobs=2).fit(self.X, self.y)
        np.testing.assert_array_equal(threads.coef_, clf.coef_)
        assert threads.alpha_at_bound_ == clf.alpha_at_bound_
