"""Posterior probabilities of a classifier: what it makes of sigmoids, couplings and cross-fitting."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.datasets import load_iris
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.exceptions import NotFittedError
from sklearn.metrics import log_loss
from sklearn.naive_bayes import GaussianNB

from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.codings import CODINGS
from granular_id.ecoc.posterior import sigmoid
from granular_id.gram import linear_gram
from posterior_cases import KL, WLW, blobs

MATRIX_OF_FOUR = np.array([[1, 1, 0], [-1, 0, 1], [0, -1, 1], [1, -1, -1]])


class TestClassifier:
    @pytest.mark.parametrize(
        "clf",
        [
            ECOCClassifier(posterior=KL),
            ECOCClassifier(posterior=WLW),
            ECOCClassifier(posterior=KL, coding=MATRIX_OF_FOUR),
            ECOCClassifier(posterior=KL, coding="ordinal", standardize=True),
            ECOCClassifier(LinearDiscriminantAnalysis(), posterior=KL, coding="onevsall"),
            ECOCClassifier(GaussianNB(), posterior=WLW),
            *(ECOCClassifier(posterior=KL, coding=coding) for coding in CODINGS),
        ],
    )
    def test_probabilities_are_those_of_new_rows(self, clf):
        X, y = blobs()
        new, truth = blobs(seed=1)
        clf = clone(clf).set_params(random_state=0).fit(X, y)
        p = clf.predict_proba(new)
        assert p.shape == (100, 4)
        assert p.min() >= 0
        np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-12)
        assert log_loss(truth, p) < 0.9  # 1.39 for a guess
        confident = p.max(axis=1) > 0.8
        if confident.sum() > 20:  # as often right as they say, up to what so few rows can tell
            right = (p.argmax(axis=1) == truth)[confident].mean()
            assert right > p.max(axis=1)[confident].mean() - 0.15

    def test_cross_fitting_keeps_noise_from_certainty(self):
        rng = np.random.default_rng(0)
        X, y = rng.standard_normal((60, 400)), np.arange(60) % 3  # nothing to learn, all rows on the margin
        new = rng.standard_normal((200, 400))
        clf = ECOCClassifier(posterior=KL, random_state=0).fit(X, y)
        assert clf.score(X, y) == 1.0
        np.testing.assert_allclose(clf.predict_proba(new), 1 / 3, atol=0.25)

    def test_two_classes_are_the_sigmoid_alone(self):
        X, y = blobs(n_classes=2, distance=0.4)
        for posterior in (KL, WLW):
            clf = ECOCClassifier(posterior=posterior, random_state=0).fit(X, y)
            fitted = clf._posterior
            expected = sigmoid(clf.binary_scores(X)[:, 0], fitted.slope[0], fitted.offset[0])
            np.testing.assert_allclose(
                clf.predict_proba(X), np.column_stack((expected, 1 - expected)), atol=1e-9
            )

    @pytest.mark.parametrize("posterior", [KL, WLW])
    def test_gram_gives_the_probabilities_of_features(self, posterior):
        X, y = blobs(n_features=80)
        gram = linear_gram(X, center=X.mean(axis=0))
        clf = ECOCClassifier(posterior=posterior, random_state=0)
        assert clf.supports_gram
        by_gram = clone(clf).fit_gram(gram, y)
        # Folds follow the values of the rows with features, their order with products: other draws of the same thing.
        np.testing.assert_allclose(
            by_gram.predict_proba_gram(gram), clf.fit(X, y).predict_proba(X), atol=0.15
        )
        p = by_gram.predict_proba_gram(gram)
        np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-12)
        np.testing.assert_array_equal(clone(clf).fit_gram(gram, y).predict_proba_gram(gram), p)

    @pytest.mark.parametrize("posterior", [KL, WLW])
    @pytest.mark.parametrize("params", [{}, {"standardize": True}, {"estimator": GaussianNB()}])
    def test_weights_equal_repeated_rows(self, posterior, params):
        X, y = blobs(distance=0.5)
        times = np.random.default_rng(1).integers(0, 4, len(y))
        clf = ECOCClassifier(posterior=posterior, random_state=0, **params)
        weighted = clone(clf).fit(X, y, times).predict_proba(X)
        repeated = clone(clf).fit(np.repeat(X, times, axis=0), np.repeat(y, times)).predict_proba(X)
        np.testing.assert_allclose(weighted, repeated, atol=1e-5)
        if not params:
            index = np.repeat(np.arange(len(y)), times)
            gram = linear_gram(X, center=X.mean(axis=0))
            by_gram = clone(clf).fit_gram(gram[np.ix_(index, index)], y[index])
            weighted = clone(clf).fit_gram(gram, y, times)
            np.testing.assert_allclose(
                weighted.predict_proba_gram(gram), by_gram.predict_proba_gram(gram[:, index]), atol=1e-5
            )

    def test_labels_are_those_without_a_posterior(self):
        X, y = blobs(distance=0.5)
        plain = ECOCClassifier().fit(X, y)
        np.testing.assert_array_equal(ECOCClassifier(posterior=KL).fit(X, y).predict(X), plain.predict(X))

    def test_same_seed_same_numbers_with_any_n_jobs(self):
        X, y = blobs(distance=0.5)
        clf = ECOCClassifier(posterior=KL, random_state=3)
        p = clone(clf).fit(X, y).predict_proba(X)
        np.testing.assert_array_equal(clone(clf).set_params(n_jobs=2).fit(X, y).predict_proba(X), p)
        assert (clone(clf).set_params(random_state=4).fit(X, y).predict_proba(X) != p).any()

    def test_exists_only_when_set(self):
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

    def test_unknown_posterior(self):
        X, y = blobs()
        with pytest.raises(
            ValueError, match="posterior must be one of 'kullback_leibler', 'wu_lin_weng', got True"
        ):
            ECOCClassifier(posterior=True).fit(X, y)

    def test_a_class_of_one_row_is_named(self):
        X, y = blobs(n_classes=3)
        kept = np.flatnonzero((y != 1) | (np.arange(len(y)) == np.argmax(y == 1)))
        names = np.array(["rice", "sand", "soil"])[y]
        clf = ECOCClassifier(posterior=KL, random_state=0)
        with pytest.warns(UserWarning, match="posterior needs 2 different rows .*: the one row of 'sand'"):
            clf.fit(X[kept], names[kept])
        p = clf.predict_proba(X[kept])
        np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-12)
        assert p[names[kept] == "sand", 1] < 0.75  # 2/3 is what one row can say

    def test_equal_rows_say_nothing(self):
        y = np.repeat([0, 1, 2], 10)
        with pytest.warns(UserWarning, match="the one row of '0', '1', '2'"):
            clf = ECOCClassifier(posterior=KL).fit(np.ones((30, 3)), y)
        np.testing.assert_allclose(clf.predict_proba(np.ones((2, 3))), 1 / 3, atol=1e-6)


def test_iris_probabilities_are_calibrated():
    X, y = load_iris(return_X_y=True)
    for posterior in (KL, WLW):
        p = ECOCClassifier(posterior=posterior, random_state=0).fit(X[::2], y[::2]).predict_proba(X[1::2])
        assert log_loss(y[1::2], p) < 0.25
