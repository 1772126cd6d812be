"""ECOCClassifier: the figures of MATLAB's documentation, labels of every kind, parameters, bad input."""

import tracemalloc

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.datasets import load_iris
from sklearn.exceptions import NotFittedError
from sklearn.multiclass import OneVsOneClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.decoding import LOSSES, decode


@pytest.fixture(scope="module")
def iris():
    return load_iris(return_X_y=True)


def error(clf, X, y):
    return round(1 - clf.score(X, y), 4)


def edge(clf, X, y):
    return round(float(clf.margin(X, y).mean()), 4)


# Figures: MATLAB documentation of fitcsvm, fitcecoc, resubLoss and resubEdge, all on Fisher's iris.
class TestIris:
    def test_two_classes_two_features(self, iris):
        X, y = iris
        kept = y > 0
        clf = ECOCClassifier().fit(X[kept][:, 2:], y[kept])
        (learner,) = clf.learners_
        assert len(learner.support) == 24
        assert round(abs(learner.intercept), 4) == 14.4149
        assert (learner.positive, learner.negative) == ((1,), (2,))
        # 11 multipliers of each class at C, and one free pair.
        assert clf.alpha_at_bound_ == 22 / 100

    def test_standardized(self, iris):
        clf = ECOCClassifier(standardize=True).fit(*iris)
        assert error(clf, *iris) == 0.0267
        assert edge(clf, *iris) == 0.7440
        clf.set_params(decoding="loss_based")
        assert error(clf, *iris) == 0.0267
        assert edge(clf, *iris) == 0.4960

    def test_not_standardized(self, iris):
        clf = ECOCClassifier().fit(*iris)
        assert error(clf, *iris) == 0.0067
        assert edge(clf, *iris) == 0.6467

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
    def test_losses(self, iris, loss, expected):
        assert error(ECOCClassifier(standardize=True, loss=loss).fit(*iris), *iris) == expected


def blobs(n_classes=5, per_class=24, n_features=60, distance=1.2, seed=0):
    rng = np.random.default_rng(seed)
    y = np.repeat(np.arange(n_classes), per_class)
    centres = distance * rng.standard_normal((n_classes, n_features))
    return rng.standard_normal((len(y), n_features)) + centres[y], y


@pytest.mark.parametrize("distance", [0.05, 0.3, 1.2])
def test_labels_of_one_vs_one_where_votes_and_losses_agree(distance):
    X, y = blobs(distance=distance)
    X_new, _ = blobs(distance=distance, seed=1)
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
    X, y = blobs(distance=0.3)
    weighted = ECOCClassifier(loss=loss).fit(X, y)
    based = clone(weighted).set_params(decoding="loss_based").fit(X, y)
    X_new, _ = blobs(distance=0.3, seed=1)
    np.testing.assert_array_equal(weighted.predict(X_new), based.predict(X_new))
    np.testing.assert_allclose(
        based.decision_function(X_new), weighted.decision_function(X_new) * 4 / 10, rtol=1e-14
    )


def test_scores_come_from_coef_and_intercept():
    X, y = blobs()
    for standardize in (False, True):
        clf = ECOCClassifier(standardize=standardize).fit(X, y)
        assert clf.coef_.shape == (10, 60)
        assert clf.intercept_.shape == (10,)
        np.testing.assert_array_equal(clf.binary_scores(X), X @ clf.coef_.T + clf.intercept_)


def test_standardize_is_that_of_each_learner():
    X, y = blobs(n_classes=3, distance=0.3)
    X[:, 5] = 7.25  # constant everywhere
    X[y != 2, 6] = -1.1  # constant for the learner of classes 0 and 1
    clf = ECOCClassifier(standardize=True).fit(X, y)
    for learner, (low, high) in enumerate([(0, 1), (0, 2), (1, 2)]):
        rows = (y == low) | (y == high)
        pair = make_pipeline(StandardScaler(), ECOCClassifier()).fit(X[rows], y[rows])
        scaler, one = pair[0], pair[1]
        expected = one.binary_scores(scaler.transform(X))
        np.testing.assert_allclose(clf.binary_scores(X)[:, [learner]], expected, rtol=1e-8, atol=1e-8)
    assert (clf.coef_[:, 5] == 0).all()
    assert clf.coef_[0, 6] == 0


def test_standardize_does_not_depend_on_units():
    X, y = blobs(n_classes=3, distance=0.3)
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
    X, y = blobs(n_classes=3)
    clf = ECOCClassifier().fit(X, names[y])
    np.testing.assert_array_equal(clf.classes_, np.sort(names))
    assert clf.predict(X).dtype == names.dtype
    np.testing.assert_array_equal(clf.predict(X), names[y])
    assert clf.score(X, names[y]) == 1.0


def test_two_classes_decide_by_sign():
    X, y = blobs(n_classes=2, distance=0.1)
    clf = ECOCClassifier().fit(X, y)
    decision = clf.decision_function(X)
    assert decision.shape == (48,)
    np.testing.assert_array_equal(clf.predict(X), (decision > 0).astype(int))
    # One learner, +1 for the lower class: a score below -1 costs class 1 nothing.
    scores = clf.binary_scores(X)[:, 0]
    np.testing.assert_array_equal(decision, np.maximum(0, 1 - scores) / 2 - np.maximum(0, 1 + scores) / 2)


def test_margin_is_the_gap_to_the_best_other_class():
    X, y = blobs(distance=0.2)
    clf = ECOCClassifier().fit(X, y)
    X_new, y_new = blobs(distance=0.2, seed=4)
    values = clf.decision_function(X_new)
    expected = [row[k] - np.delete(row, k).max() for row, k in zip(values, y_new, strict=True)]
    np.testing.assert_array_equal(clf.margin(X_new, y_new), expected)
    np.testing.assert_array_equal(clf.margin(X_new, y_new) < 0, clf.predict(X_new) != y_new)
    with pytest.raises(ValueError, match="y holds 9, which is not among the classes"):
        clf.margin(X_new, np.full(len(y_new), 9))
    with pytest.raises(ValueError, match=r"y must have 120 labels, one per row of X, got 3"):
        clf.margin(X_new, y_new[:3])


def test_learners_tell_their_classes_and_support_vectors():
    X, y = blobs(n_classes=3, distance=0.3)
    names = np.array(["a", "b", "c"])
    clf = ECOCClassifier().fit(X, names[y])
    learners = clf.learners_
    assert [(one.positive, one.negative) for one in learners] == [
        (("a",), ("b",)),
        (("a",), ("c",)),
        (("b",), ("c",)),
    ]
    for learner, one in enumerate(learners):
        np.testing.assert_array_equal(np.sign(one.dual_coef), clf.coding_matrix_[y[one.support], learner])
        np.testing.assert_allclose(one.dual_coef @ X[one.support], clf.coef_[learner], rtol=1e-9, atol=1e-12)


def test_gram_matrix_of_all_rows_serves_every_partition():
    X, y = blobs(distance=0.2)
    names = np.array(["a", "b", "c", "d", "e"])[y]
    from granular_id.gram import linear_gram

    gram = linear_gram(X, center=X.mean(axis=0))
    order = np.random.default_rng(0).permutation(len(y))
    train, test = order[:80], order[80:]
    by_features = ECOCClassifier().fit(X[train], names[train])
    by_gram = ECOCClassifier().fit_gram(gram[np.ix_(train, train)], names[train])
    rows = gram[np.ix_(test, train)]
    expected = by_features.binary_scores(X[test])
    np.testing.assert_allclose(by_gram.binary_scores_gram(rows), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(by_gram.predict_gram(rows), by_features.predict(X[test]))
    np.testing.assert_allclose(
        by_gram.decision_function_gram(rows), by_features.decision_function(X[test]), rtol=1e-9, atol=1e-9
    )
    # After fit, products about the origin of X serve as well.
    np.testing.assert_allclose(
        by_features.binary_scores_gram(linear_gram(X[test], X[train])), expected, rtol=1e-9, atol=1e-9
    )
    with pytest.raises(NotFittedError, match="call fit"):
        by_gram.predict(X[test])
    # What an earlier fit on features left behind must not answer for the Gram matrix.
    again = by_features.fit_gram(gram[np.ix_(train, train)], names[train])
    assert not hasattr(again, "coef_")
    assert not hasattr(again, "n_features_in_")


def test_input_is_not_changed_and_may_be_read_only():
    X, y = blobs(n_classes=3)
    weights = np.ones(len(y))
    kept = X.copy()
    for array in (X, y, weights):
        array.setflags(write=False)
    for standardize in (False, True):
        ECOCClassifier(standardize=standardize).fit(X, y, weights).predict(X)
    ECOCClassifier().fit_gram(np.asfortranarray(X @ X.T), y)
    np.testing.assert_array_equal(X, kept)


def test_float32_and_lists_are_converted():
    X, y = blobs(n_classes=3)
    single = X.astype(np.float32)
    expected = ECOCClassifier().fit(single.astype(np.float64), y).decision_function(single)
    for rows in (single, single.tolist(), np.asfortranarray(single)):
        clf = ECOCClassifier().fit(rows, y.tolist())
        assert clf.coef_.dtype == np.float64
        np.testing.assert_allclose(clf.decision_function(rows), expected, rtol=1e-12, atol=1e-12)


def test_memory_beside_the_rows_stays_below_ten_megabytes():
    rng = np.random.default_rng(0)
    y = np.repeat(np.arange(11), 50)
    X = rng.standard_normal((550, 10_200))
    X[:, :11] += 5.0 * np.eye(11)[y]
    tracemalloc.start()
    try:
        ECOCClassifier().fit(X, y).predict(X)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()
