"""Probabilities of classes from those of learners, against twins and other methods."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize
from sklearn.exceptions import ConvergenceWarning

from granular_id.ecoc import ECOCClassifier, codings as random_codings, posterior as coupling
from granular_id.ecoc.codings import CODINGS, design, onevsone
from granular_id.ecoc.posterior import couple_kullback_leibler, couple_wu_lin_weng, pairs_of
from posterior_cases import WLW, blobs


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
