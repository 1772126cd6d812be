"""Probabilities: sigmoids of scores, and classes from learners, against twins and other methods."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize
from sklearn.calibration import CalibratedClassifierCV
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import cross_val_predict
from sklearn.svm import SVC

from ecoc_cases import WLW, blobs
from granular_id.ecoc import ECOCClassifier, posterior
from granular_id.ecoc.codings import CODINGS, design, onevsone
from granular_id.ecoc.posterior import (
    couple_kullback_leibler,
    couple_wu_lin_weng,
    fit_sigmoid,
    pairs_of,
    sigmoid,
)

# Each class is seen by three or four of seven learners.
OWN = np.array(
    [
        [1, 0, 0, -1, 1, 0, 0],
        [-1, 1, 0, 0, 0, 1, 0],
        [0, -1, 1, 0, 1, -1, 0],
        [0, 0, -1, 1, -1, 0, 1],
        [1, 0, 0, 0, 0, 1, -1],
    ]
)


class TestSigmoid:
    def platt_likelihood(self, scores, targets, weights):
        """Negative log-likelihood with Platt's targets, written from his paper."""
        n_pos, n_neg = weights[targets > 0].sum(), weights[targets < 0].sum()
        t = np.where(targets > 0, (n_pos + 1) / (n_pos + 2), 1 / (n_neg + 2))

        def value(ab):
            p = 1 / (1 + np.exp(ab[0] * scores + ab[1]))
            return -np.sum(weights * (t * np.log(p) + (1 - t) * np.log(1 - p)))

        return value

    @settings(max_examples=20)
    @given(st.integers(0, 1000), st.integers(2, 40), st.sampled_from([0.0, 1.0, 4.0]), st.booleans())
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
        X, y = blobs(2, distance=0.3)
        machine = SVC(kernel="linear")
        theirs = CalibratedClassifierCV(machine, cv=2, ensemble=False).fit(X, y).calibrated_classifiers_[0]
        held_out = cross_val_predict(machine, X, y, cv=2, method="decision_function")
        slope, offset = fit_sigmoid(held_out, np.where(y == 1, 1.0, -1.0), None)
        scores = np.linspace(-3, 3, 50)
        expected = theirs.calibrators[0].predict(scores)
        np.testing.assert_allclose(sigmoid(scores, slope, offset), expected, atol=1e-4)

    @pytest.mark.parametrize("scale", [1e-300, 1e-6, 1e6, 1e150])
    def test_scores_of_any_size(self, scale):
        scores = np.array([-1.0, -0.4, 0.1, 0.3, 1.0, 0.6])
        targets = np.array([-1.0, -1.0, 1.0, -1.0, 1.0, 1.0])
        slope, offset = fit_sigmoid(scores, targets, None)
        scaled = fit_sigmoid(scores * scale, targets, None)
        assert scaled[0] * scale == pytest.approx(slope, rel=1e-6)
        assert scaled[1] == pytest.approx(offset, rel=1e-6)

    def test_certain_scores_do_not_give_certainty_and_equal_scores_the_shares(self):
        scores = np.repeat([-1e6, 1e6], 20)
        slope, offset = fit_sigmoid(scores, np.sign(scores), None)
        np.testing.assert_allclose(sigmoid(scores, slope, offset)[[0, -1]], [1 / 22, 21 / 22], rtol=1e-6)
        for value in (0.0, 3.0):
            slope, offset = fit_sigmoid(np.full(4, value), np.array([1.0, 1.0, 1.0, -1.0]), None)
            mean_target = (3 * 4 / 5 + 1 / 3) / 4
            assert sigmoid(np.array([value]), slope, offset)[0] == pytest.approx(mean_target, rel=1e-6)


def learner_probabilities(p, matrix):
    """What learners would say if the classes had the probabilities p (n, K)."""
    positive, negative = p @ (matrix == 1), p @ (matrix == -1)
    return positive / (positive + negative)


def divergence(p, r, matrix, weights):
    """Weighted Kullback-Leibler divergence of one row, written from its definition."""
    s = learner_probabilities(p[None], matrix)[0]
    return np.sum(weights * (r * np.log(r / s) + (1 - r) * np.log((1 - r) / (1 - s)))) / weights.sum()


class TestKullbackLeibler:
    @pytest.mark.parametrize("coding", CODINGS)
    @settings(max_examples=10)
    @given(n_classes=st.integers(2, 6), seed=st.integers(0, 1000))
    def test_consistent_probabilities_come_back(self, coding, n_classes, seed):
        rng = np.random.default_rng(seed)
        p = rng.dirichlet(np.ones(n_classes), 3) + 1e-3
        p /= p.sum(axis=1, keepdims=True)
        matrix = design(coding, n_classes)
        weights = rng.uniform(1, 50, matrix.shape[1])
        found = couple_kullback_leibler(learner_probabilities(p, matrix), matrix, weights)
        np.testing.assert_allclose(found, p, atol=1e-6)

    @pytest.mark.parametrize("coding", [*CODINGS, OWN])
    def test_no_better_point_is_found_by_another_method(self, coding):
        rng = np.random.default_rng(1)
        matrix = design(coding, 5)
        weights = rng.uniform(1, 50, matrix.shape[1])
        given_probabilities = rng.uniform(0.02, 0.98, (3, matrix.shape[1]))
        found = couple_kullback_leibler(given_probabilities, matrix, weights)
        np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-14)
        for p, r in zip(found, given_probabilities, strict=True):

            def of_logs(logs, r=r):
                shares = np.exp(logs - logs.max())
                return divergence(np.maximum(shares / shares.sum(), 1e-12), r, matrix, weights)

            best = min(minimize(of_logs, start, tol=1e-12).fun for start in (np.zeros(5), np.log(p + 1e-9)))
            assert divergence(np.maximum(p, 1e-12), r, matrix, weights) <= best + 1e-7

    def test_hastie_tibshirani_condition(self):
        # Their fixed point for pairs: for each class the weighted sums of r_ij and of mu_ij are equal.
        rng = np.random.default_rng(2)
        matrix = onevsone(5)
        weights = rng.integers(10, 60, 10).astype(float)
        r = rng.uniform(0.05, 0.95, (20, 10))
        mu = learner_probabilities(couple_kullback_leibler(r, matrix, weights), matrix)
        for codes in matrix:
            seen = codes != 0
            wins = np.where(codes > 0, r, 1 - r)[:, seen]
            implied = np.where(codes > 0, mu, 1 - mu)[:, seen]
            np.testing.assert_allclose(wins @ weights[seen], implied @ weights[seen], rtol=1e-8)

    @pytest.mark.parametrize("coding", [*CODINGS, OWN])
    def test_a_row_alone_gives_the_bits_it_gives_in_a_batch(self, coding):
        rng = np.random.default_rng(3)
        matrix = design(coding, 5)
        r, weights = rng.uniform(size=(9, matrix.shape[1])), np.ones(matrix.shape[1])
        whole = couple_kullback_leibler(r, matrix, weights)
        alone = [couple_kullback_leibler(row[None], matrix, weights)[0] for row in r]
        np.testing.assert_array_equal(whole, alone)

    @pytest.mark.parametrize("coding", [*CODINGS, OWN])
    def test_learners_that_are_certain(self, coding):
        matrix = design(coding, 5)
        r = (matrix[[2, 4]] > 0).astype(float)
        r[:, matrix[2] == 0] = 0.5
        p = couple_kullback_leibler(r, matrix, np.ones(matrix.shape[1]))
        assert p[0, 2] > 0.999
        np.testing.assert_allclose(p.sum(axis=1), 1.0, rtol=1e-14)

    def test_giving_up_is_a_warning(self, monkeypatch):
        monkeypatch.setattr(posterior, "_MAX_STEPS", 1)
        with pytest.warns(ConvergenceWarning, match="coupling did not converge for 2 of 2 rows"):
            couple_kullback_leibler(np.array([[0.9, 0.2, 0.7]] * 2), onevsone(3), np.ones(3))


class TestWuLinWeng:
    @settings(max_examples=40)
    @given(n_classes=st.integers(2, 8), seed=st.integers(0, 1000))
    def test_consistent_probabilities_come_back_whatever_the_order_of_pairs(self, n_classes, seed):
        rng = np.random.default_rng(seed)
        p = rng.dirichlet(np.ones(n_classes), 4) + 1e-4
        p /= p.sum(axis=1, keepdims=True)
        matrix = rng.permutation(onevsone(n_classes), axis=1)
        matrix = matrix * rng.choice(np.array([-1, 1], np.int8), matrix.shape[1])
        found = couple_wu_lin_weng(learner_probabilities(p, matrix), pairs_of(matrix))
        np.testing.assert_allclose(found, p, atol=1e-9)

    def test_minimum_of_the_sum_of_squares(self):
        matrix = onevsone(5)
        pairs = list(zip(*np.triu_indices(5, 1), strict=True))
        r = np.random.default_rng(4).uniform(0.02, 0.98, (5, 10))
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
            assert squares(p) <= best.fun + 1e-10
            np.testing.assert_allclose(p, best.x, atol=1e-4)

    @pytest.mark.parametrize("r", [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [0.5, 0.5, 0.5]])
    def test_extremes(self, r):
        p = couple_wu_lin_weng(np.array([r]), pairs_of(onevsone(3)))
        assert (p >= 0).all()
        assert p.sum() == pytest.approx(1.0, abs=1e-14)

    @pytest.mark.parametrize("coding", ["onevsall", [[1, -1, 0], [-1, 1, 1], [0, 0, -1]]])
    def test_other_codings_have_no_pairs(self, coding):
        matrix = np.array(coding) if isinstance(coding, list) else design(coding, 3)
        assert pairs_of(matrix) is None
        with pytest.raises(ValueError, match=r"'wu_lin_weng' needs one learner for each|columns 0 and 1"):
            ECOCClassifier(coding, posterior=WLW).fit(*blobs(3))
