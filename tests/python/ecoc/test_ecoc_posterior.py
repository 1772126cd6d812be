"""Posterior probabilities of a classifier: what it makes of cross-fitting, sigmoids and couplings."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.datasets import load_iris
from sklearn.exceptions import NotFittedError
from sklearn.metrics import log_loss

from ecoc_cases import KL, MATRIX, WLW, blobs
from granular_id.ecoc import ECOCClassifier, Task, onevsone
from granular_id.ecoc.codings import CODINGS
from granular_id.ecoc.posterior import KEPT, N_FOLDS, cross_fitted, folds_of, sigmoid
from granular_id.gram import linear_gram


class TestFolds:
    def folds(self, X, y, seed=0, counted=None):
        counted = np.arange(len(y)) if counted is None else counted
        return folds_of(X, Task(onevsone(3), y, None, counted, ("a", "b", "c")), seed)

    def test_classes_are_dealt_out_evenly(self):
        X, y = blobs(3, per_class=13)
        folds = self.folds(X, y)
        for k in range(3):
            assert set(np.bincount(folds[y == k], minlength=N_FOLDS)) == {2, 3}
        assert set(np.bincount(folds)) == {7, 8}
        assert (folds != self.folds(X, y, seed=1)).any()

    def test_order_of_the_rows_does_not_matter(self):
        X, y = blobs(3)
        order = np.random.default_rng(0).permutation(len(y))
        np.testing.assert_array_equal(self.folds(X[order], y[order]), self.folds(X, y)[order])

    def test_every_row_is_scored_by_learners_that_do_not_know_it(self):
        folds = np.array([0, 1, 2, 0, -1, KEPT, 1])
        known = {}

        def fit_and_score(train, test):
            for row in test.tolist():
                known[row] = set(train.tolist())
            return np.full((len(test), 2), 7.0)

        scores = cross_fitted(fit_and_score, folds, 2)
        assert known == {0: {1, 2, 5, 6}, 3: {1, 2, 5, 6}, 1: {0, 2, 3, 5}, 6: {0, 2, 3, 5}} | {
            2: {0, 1, 3, 5, 6},
            5: {0, 1, 2, 3, 5, 6},  # the one row of its class
        }
        np.testing.assert_array_equal(scores, np.where(folds >= 0, 7.0, 0.0)[:, None] * np.ones(2))


@pytest.mark.parametrize(
    "clf",
    [
        ECOCClassifier(posterior=WLW),
        ECOCClassifier(posterior=KL, coding=MATRIX),
        *(ECOCClassifier(posterior=KL, coding=coding) for coding in CODINGS),
    ],
)
def test_probabilities_are_those_of_new_rows(clf):
    new, truth = blobs(seed=1)
    p = clone(clf).set_params(random_state=0).fit(*blobs()).predict_proba(new)
    assert p.shape == (100, 4)
    assert p.min() >= 0
    np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-12)
    assert log_loss(truth, p) < 0.9  # 1.39 for a guess
    confident = p.max(axis=1) > 0.8
    if confident.sum() > 20:  # as often right as they say, up to what so few rows can tell
        right = (p.argmax(axis=1) == truth)[confident].mean()
        assert right > p.max(axis=1)[confident].mean() - 0.15


@pytest.mark.parametrize("posterior", [KL, WLW])
def test_iris_probabilities_are_calibrated(posterior):
    X, y = load_iris(return_X_y=True)
    p = ECOCClassifier(posterior=posterior, random_state=0).fit(X[::2], y[::2]).predict_proba(X[1::2])
    assert log_loss(y[1::2], p) < 0.25


def test_cross_fitting_keeps_noise_from_certainty():
    rng = np.random.default_rng(0)
    X, y = rng.standard_normal((60, 400)), np.arange(60) % 3  # nothing to learn, all rows on the margin
    clf = ECOCClassifier(posterior=KL, random_state=0).fit(X, y)
    assert clf.score(X, y) == 1.0
    np.testing.assert_allclose(clf.predict_proba(rng.standard_normal((200, 400))), 1 / 3, atol=0.25)


@pytest.mark.parametrize("posterior", [KL, WLW])
def test_two_classes_are_the_sigmoid_alone(posterior):
    X, y = blobs(2, distance=0.4)
    clf = ECOCClassifier(posterior=posterior, random_state=0).fit(X, y)
    fitted = clf._posterior
    expected = sigmoid(clf.binary_scores(X)[:, 0], fitted.slope[0], fitted.offset[0])
    np.testing.assert_allclose(clf.predict_proba(X), np.column_stack((expected, 1 - expected)), atol=1e-9)


@pytest.mark.parametrize("posterior", [KL, WLW])
def test_gram_gives_the_probabilities_of_features(posterior):
    X, y = blobs(n_features=80)
    gram = linear_gram(X, center=X.mean(axis=0))
    clf = ECOCClassifier(posterior=posterior, random_state=0)
    p = clone(clf).fit_gram(gram, y).predict_proba_gram(gram)
    # Folds follow the values of the rows with features, their order with products: other draws of the same thing.
    np.testing.assert_allclose(p, clf.fit(X, y).predict_proba(X), atol=0.15)
    np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(clone(clf).fit_gram(gram, y).predict_proba_gram(gram), p)


def test_weights_equal_repeated_rows():
    X, y = blobs(distance=0.5)
    times = np.random.default_rng(1).integers(0, 4, len(y))
    clf = ECOCClassifier(posterior=KL, random_state=0)
    weighted = clone(clf).fit(X, y, times).predict_proba(X)
    repeated = clone(clf).fit(np.repeat(X, times, axis=0), np.repeat(y, times)).predict_proba(X)
    np.testing.assert_allclose(weighted, repeated, atol=1e-5)
    index = np.repeat(np.arange(len(y)), times)
    gram = linear_gram(X, center=X.mean(axis=0))
    by_gram = clone(clf).fit_gram(gram[np.ix_(index, index)], y[index]).predict_proba_gram(gram[:, index])
    weighted = clone(clf).fit_gram(gram, y, times).predict_proba_gram(gram)
    np.testing.assert_allclose(weighted, by_gram, atol=1e-5)


def test_same_labels_as_without_and_the_same_numbers_for_a_seed():
    X, y = blobs(distance=0.5)
    clf = ECOCClassifier(posterior=KL, random_state=3).fit(X, y)
    np.testing.assert_array_equal(clf.predict(X), ECOCClassifier().fit(X, y).predict(X))
    p = clf.predict_proba(X)
    np.testing.assert_array_equal(clone(clf).set_params(n_jobs=2).fit(X, y).predict_proba(X), p)
    assert (clone(clf).set_params(random_state=4).fit(X, y).predict_proba(X) != p).any()


def test_exists_only_when_set():
    clf = ECOCClassifier()
    for name in ("predict_proba", "predict_proba_gram"):
        assert not hasattr(clf, name)
        assert hasattr(ECOCClassifier(posterior=KL), name)
    with pytest.raises(AttributeError) as caught:
        clf.predict_proba([[1.0]])
    assert "posterior='kullback_leibler' or 'wu_lin_weng'" in f"{caught.value} {caught.value.__cause__}"
    X, y = blobs()
    with pytest.raises(NotFittedError, match="fitted with posterior=None: call fit again"):
        clf.fit(X, y).set_params(posterior=KL).predict_proba(X)


def test_a_class_of_one_row_is_named():
    X, y = blobs(3)
    kept = np.flatnonzero((y != 1) | (np.arange(len(y)) == np.argmax(y == 1)))
    names = np.array(["rice", "sand", "soil"])[y]
    clf = ECOCClassifier(posterior=KL, random_state=0)
    with pytest.warns(UserWarning, match="posterior needs 2 different rows .*: the one row of 'sand'"):
        clf.fit(X[kept], names[kept])
    p = clf.predict_proba(X[kept])
    np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-12)
    assert p[names[kept] == "sand", 1] < 0.75  # 2/3 is what one row can say


def test_equal_rows_say_nothing():
    y = np.repeat([0, 1, 2], 10)
    with pytest.warns(UserWarning, match="the one row of '0', '1', '2'"):
        clf = ECOCClassifier(posterior=KL).fit(np.ones((30, 3)), y)
    np.testing.assert_allclose(clf.predict_proba(np.ones((2, 3))), 1 / 3, atol=1e-6)
