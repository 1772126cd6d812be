"""Posterior probabilities: sigmoids, couplings and cross-fitting against twins, and what a classifier makes of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from sklearn.base import clone
from sklearn.calibration import CalibratedClassifierCV
from sklearn.datasets import load_iris
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.metrics import log_loss
from sklearn.naive_bayes import GaussianNB
from sklearn.svm import SVC

from granular_id.ecoc import ECOCClassifier, coupling, random_codings
from granular_id.ecoc.codings import CODINGS, design, onevsone
from granular_id.ecoc.coupling import couple_kullback_leibler, couple_wu_lin_weng, pairs_of
from granular_id.ecoc.cross_fit import KEPT, N_FOLDS, cross_fitted, folds_of
from granular_id.ecoc.sigmoid import fit_sigmoid, sigmoid
from granular_id.gram import linear_gram

KL, WLW = "kullback_leibler", "wu_lin_weng"


def blobs(n_classes=4, per_class=25, n_features=8, distance=1.0, seed=0):
    rng = np.random.default_rng(seed)
    y = rng.permutation(np.repeat(np.arange(n_classes), per_class))
    centres = distance * np.random.default_rng(99).standard_normal((n_classes, n_features))
    return rng.standard_normal((len(y), n_features)) + centres[y], y


def learner_probabilities(p, matrix):
    """What learners would say if the classes had the probabilities p (n, K)."""
    positive, negative = p @ (matrix == 1), p @ (matrix == -1)
    return positive / (positive + negative)


class TestSigmoid:
    def platt_likelihood(self, scores, targets, weights):
        """Negative log-likelihood with Platt's targets, written from his paper."""
        n_pos, n_neg = weights[targets > 0].sum(), weights[targets < 0].sum()
        t = np.where(targets > 0, (n_pos + 1) / (n_pos + 2), 1 / (n_neg + 2))

        def value(ab):
            p = 1 / (1 + np.exp(ab[0] * scores + ab[1]))
            return -np.sum(weights * (t * np.log(p) + (1 - t) * np.log(1 - p)))

        return value

    @settings(max_examples=40)
    @given(
        seed=st.integers(0, 1000),
        n=st.integers(2, 40),
        gap=st.sampled_from([0.0, 1.0, 4.0]),
        weighted=st.booleans(),
    )
    def test_maximum_of_the_likelihood(self, seed, n, gap, weighted):
        rng = np.random.default_rng(seed)
        targets = np.where(np.arange(n) % 3 == 0, 1.0, -1.0)
        scores = rng.standard_normal(n) + gap * targets / 2
        weights = rng.uniform(0.1, 4.0, n) if weighted else np.ones(n)
        found = fit_sigmoid(scores, targets, weights if weighted else None)
        value = self.platt_likelihood(scores, targets, weights)
        best = minimize(value, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12})
        assert value(found) <= best.fun + 1e-9
        for step in np.eye(2) * 1e-4:
            assert value(found + step) > value(found) < value(found - step)

    def test_equals_scikit_learn(self):
        X, y = blobs(n_classes=2, distance=0.3)
        machine = SVC(kernel="linear").fit(X, y)
        theirs = CalibratedClassifierCV(machine, cv=2, ensemble=False).fit(X, y).calibrated_classifiers_[0]
        calibrator = theirs.calibrators[0]
        scores = np.linspace(-3, 3, 50)
        from sklearn.calibration import _SigmoidCalibration
        from sklearn.model_selection import cross_val_predict

        held_out = cross_val_predict(machine, X, y, cv=2, method="decision_function")
        assert isinstance(calibrator, _SigmoidCalibration)
        slope, offset = fit_sigmoid(held_out, np.where(y == 1, 1.0, -1.0), None)
        np.testing.assert_allclose(sigmoid(scores, slope, offset), calibrator.predict(scores), atol=1e-4)

    @pytest.mark.parametrize("scale", [1e-300, 1e-6, 1.0, 1e6, 1e150])
    def test_scores_of_any_size(self, scale):
        scores = np.array([-1.0, -0.4, 0.1, 0.3, 1.0, 0.6])
        targets = np.array([-1.0, -1.0, 1.0, -1.0, 1.0, 1.0])
        slope, offset = fit_sigmoid(scores, targets, None)
        scaled = fit_sigmoid(scores * scale, targets, None)
        assert scaled[0] * scale == pytest.approx(slope, rel=1e-6)
        assert scaled[1] == pytest.approx(offset, rel=1e-6)

    def test_certain_scores_do_not_give_certainty(self):
        scores = np.repeat([-1e6, 1e6], 20)
        slope, offset = fit_sigmoid(scores, np.sign(scores), None)
        np.testing.assert_allclose(sigmoid(scores, slope, offset)[[0, -1]], [1 / 22, 21 / 22], rtol=1e-6)

    def test_equal_scores_give_the_shares(self):
        targets = np.array([1.0, 1.0, 1.0, -1.0])
        for value in (0.0, 3.0):
            slope, offset = fit_sigmoid(np.full(4, value), targets, None)
            mean_target = (3 * 4 / 5 + 1 / 3) / 4
            assert sigmoid(np.array([value]), slope, offset)[0] == pytest.approx(mean_target, rel=1e-6)

    def test_weights_equal_repetitions(self):
        rng = np.random.default_rng(0)
        scores, targets = rng.standard_normal(20), np.where(np.arange(20) % 2, 1.0, -1.0)
        times = rng.integers(1, 4, 20)
        repeated = fit_sigmoid(np.repeat(scores, times), np.repeat(targets, times), None)
        np.testing.assert_allclose(fit_sigmoid(scores, targets, times.astype(float)), repeated, rtol=1e-6)


def divergence(p, r, matrix, weights):
    """Weighted Kullback-Leibler divergence of one row, written from its definition."""
    s = learner_probabilities(p[None], matrix)[0]
    return np.sum(weights * (r * np.log(r / s) + (1 - r) * np.log((1 - r) / (1 - s)))) / weights.sum()


class TestKullbackLeibler:
    @pytest.mark.parametrize("coding", CODINGS)
    @settings(max_examples=20)
    @given(n_classes=st.integers(2, 6), seed=st.integers(0, 1000))
    def test_consistent_probabilities_come_back(self, coding, n_classes, seed):
        rng = np.random.default_rng(seed)
        p = rng.dirichlet(np.ones(n_classes), 3) + 1e-3
        p /= p.sum(axis=1, keepdims=True)
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(random_codings, "_DRAWS", 20)
            matrix = design(coding, n_classes, rng)
        weights = rng.uniform(1, 50, matrix.shape[1])
        found = couple_kullback_leibler(learner_probabilities(p, matrix), matrix, weights)
        np.testing.assert_allclose(found, p, atol=1e-6)

    @pytest.mark.parametrize("coding", CODINGS)
    def test_no_better_point_is_found_by_another_method(self, coding):
        rng = np.random.default_rng(1)
        matrix = design(coding, 5, rng)
        weights = rng.uniform(1, 50, matrix.shape[1])
        given_probabilities = rng.uniform(0.02, 0.98, (6, matrix.shape[1]))
        found = couple_kullback_leibler(given_probabilities, matrix, weights)
        np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-14)
        for p, r in zip(found, given_probabilities, strict=True):

            def of_logs(logs, r=r):
                shares = np.exp(logs - logs.max())
                return divergence(np.maximum(shares / shares.sum(), 1e-12), r, matrix, weights)

            starts = [np.zeros(5), np.log(p + 1e-9), *rng.standard_normal((3, 5))]
            best = min(minimize(of_logs, start, tol=1e-12).fun for start in starts[:2])
            assert divergence(np.maximum(p, 1e-12), r, matrix, weights) <= best + 1e-7

    def test_hastie_tibshirani_condition(self):
        # Their fixed point for pairs: for each class the weighted sums of r_ij and of mu_ij are equal.
        rng = np.random.default_rng(2)
        matrix = onevsone(5)
        weights = rng.integers(10, 60, 10).astype(float)
        r = rng.uniform(0.05, 0.95, (20, 10))
        mu = learner_probabilities(couple_kullback_leibler(r, matrix, weights), matrix)
        for k in range(5):
            wins = np.where(matrix[k] > 0, r, 1 - r)[:, matrix[k] != 0]
            implied = np.where(matrix[k] > 0, mu, 1 - mu)[:, matrix[k] != 0]
            shown = weights[matrix[k] != 0]
            np.testing.assert_allclose(wins @ shown, implied @ shown, rtol=1e-8)

    @pytest.mark.parametrize("coding", CODINGS)
    def test_a_row_alone_gives_the_bits_it_gives_in_a_batch(self, coding):
        rng = np.random.default_rng(3)
        matrix = design(coding, 6, rng)
        r = rng.uniform(size=(9, matrix.shape[1]))
        whole = couple_kullback_leibler(r, matrix, np.ones(matrix.shape[1]))
        alone = [couple_kullback_leibler(row[None], matrix, np.ones(matrix.shape[1]))[0] for row in r]
        np.testing.assert_array_equal(whole, alone)

    @pytest.mark.parametrize("coding", ["onevsone", "onevsall", "sparserandom"])
    def test_learners_that_are_certain(self, coding):
        matrix = design(coding, 5, np.random.default_rng(0))
        r = (matrix[[2, 4]] > 0).astype(float)
        r[:, matrix[2] == 0] = 0.5
        p = couple_kullback_leibler(r, matrix, np.ones(matrix.shape[1]))
        assert p[0, 2] > 0.999
        assert np.isfinite(p).all()
        np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-14)

    def test_giving_up_is_a_warning(self, monkeypatch):
        monkeypatch.setattr(coupling, "_MAX_STEPS", 1)
        with pytest.warns(ConvergenceWarning, match="coupling did not converge for 2 of 2 rows"):
            couple_kullback_leibler(np.array([[0.9, 0.2, 0.7]] * 2), onevsone(3), np.ones(3))


class TestWuLinWeng:
    @given(n_classes=st.integers(2, 8), seed=st.integers(0, 1000))
    def test_consistent_probabilities_come_back(self, n_classes, seed):
        p = np.random.default_rng(seed).dirichlet(np.ones(n_classes), 4) + 1e-4
        p /= p.sum(axis=1, keepdims=True)
        matrix = onevsone(n_classes)
        found = couple_wu_lin_weng(learner_probabilities(p, matrix), pairs_of(matrix))
        np.testing.assert_allclose(found, p, atol=1e-9)

    def test_minimum_of_the_sum_of_squares(self):
        rng = np.random.default_rng(4)
        matrix = onevsone(5)
        pairs = list(zip(*np.triu_indices(5, 1), strict=True))
        r = rng.uniform(0.02, 0.98, (5, 10))
        for p, row in zip(couple_wu_lin_weng(r, pairs_of(matrix)), r, strict=True):

            def squares(q, row=row):
                return sum(((1 - row[n]) * q[i] - row[n] * q[j]) ** 2 for n, (i, j) in enumerate(pairs))

            best = minimize(
                squares,
                np.full(5, 0.2),
                method="SLSQP",
                bounds=[(0, 1)] * 5,
                constraints={"type": "eq", "fun": lambda q: q.sum() - 1},
                options={"ftol": 1e-14},
            )
            assert p.min() >= 0
            assert p.sum() == pytest.approx(1.0, abs=1e-14)
            assert squares(p) <= best.fun + 1e-10
            np.testing.assert_allclose(p, best.x, atol=1e-4)

    def test_order_and_signs_of_the_pairs_do_not_matter(self):
        matrix = onevsone(4)[:, ::-1] * np.array([1, -1, 1, -1, -1, 1], dtype=np.int8)
        p = np.array([[0.1, 0.2, 0.3, 0.4]])
        found = couple_wu_lin_weng(learner_probabilities(p, matrix), pairs_of(matrix))
        np.testing.assert_allclose(found, p, atol=1e-12)

    @pytest.mark.parametrize("r", [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [0.5, 0.5, 0.5]])
    def test_extremes(self, r):
        p = couple_wu_lin_weng(np.array([r]), pairs_of(onevsone(3)))
        assert (p >= 0).all()
        assert p.sum() == pytest.approx(1.0, abs=1e-14)

    @pytest.mark.parametrize("coding", ["onevsall", "ordinal", "sparserandom", "binarycomplete"])
    def test_other_codings_have_no_pairs(self, coding):
        assert pairs_of(design(coding, 3, np.random.default_rng(0))) is None
        with pytest.raises(
            ValueError, match=r"'wu_lin_weng' needs one learner for each pair .*'kullback_leibler'"
        ):
            ECOCClassifier(coding=coding, posterior=WLW).fit(*blobs(n_classes=3))

    def test_a_pair_twice_is_no_set_of_pairs(self):
        assert pairs_of(np.array([[1, -1, 0], [-1, 1, 1], [0, 0, -1]])) is None


class TestFolds:
    NAMES = ("a", "b", "c")

    def folds(self, X, y, seed=0, counted=None):
        return folds_of(X, y, np.arange(len(y)) if counted is None else counted, seed, self.NAMES)

    def test_classes_are_dealt_out_evenly(self):
        X, y = blobs(n_classes=3, per_class=13)
        folds = self.folds(X, y)
        for k in range(3):
            assert set(np.bincount(folds[y == k], minlength=N_FOLDS)) == {2, 3}
        assert set(np.bincount(folds)) == {7, 8}
        assert (folds != self.folds(X, y, seed=1)).any()

    def test_order_of_the_rows_does_not_matter(self):
        X, y = blobs(n_classes=3)
        order = np.random.default_rng(0).permutation(len(y))
        np.testing.assert_array_equal(self.folds(X[order], y[order]), self.folds(X, y)[order])

    def test_equal_rows_of_a_class_stay_together(self):
        X, y = blobs(n_classes=3, per_class=6)
        times = np.random.default_rng(0).integers(1, 4, len(y))
        repeated = self.folds(np.repeat(X, times, axis=0), np.repeat(y, times))
        np.testing.assert_array_equal(repeated, np.repeat(self.folds(X, y), times))

    def test_rows_that_do_not_count_are_as_good_as_absent(self):
        X, y = blobs(n_classes=3, per_class=6)
        counted = np.flatnonzero(np.arange(len(y)) % 4)
        folds = self.folds(X, y, counted=counted)
        np.testing.assert_array_equal(folds[counted], self.folds(X[counted], y[counted]))
        assert (np.delete(folds, counted) == -1).all()

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
