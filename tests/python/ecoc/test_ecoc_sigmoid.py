"""Sigmoids that turn scores into probabilities, against twins."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize
from sklearn.calibration import CalibratedClassifierCV
from sklearn.svm import SVC

from granular_id.ecoc.posterior import fit_sigmoid, sigmoid
from posterior_cases import blobs


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
