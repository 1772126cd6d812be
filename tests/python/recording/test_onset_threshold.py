import numpy as np
import pytest
from scipy.stats import binomtest, norm, t

from granular_id.recording.change_detection import critical_factors


@pytest.mark.parametrize("rate", [0.2, 0.01, 1e-6])
def test_one_test_is_students(rate):
    dof = np.array([1.0, 2.5, 10, 100])
    np.testing.assert_allclose(critical_factors(dof, 1, rate), t.isf(rate / 2, dof), rtol=0.01)


@pytest.mark.parametrize("n_tests", [7, 2000])
def test_known_noise_is_sidaks(n_tests):
    exact = norm.isf((1 - (1 - 0.01) ** (1 / n_tests)) / 2)
    assert exact - 1e-3 <= critical_factors(np.array([1e4]), n_tests, 0.01)[0] <= 1.01 * exact


@pytest.mark.parametrize(("dof", "n_tests"), [(3, 10), (8, 19), (20, 5)])
def test_by_simulation(dof, n_tests):
    rng = np.random.default_rng(dof)
    n = 40_000
    largest = np.abs(rng.standard_normal((n, n_tests))).max(axis=1)
    ratio = largest / np.sqrt(rng.chisquare(dof, n) / dof)
    above = int((ratio > critical_factors(np.array([float(dof)]), n_tests, 0.05)[0]).sum())
    low, high = binomtest(above, n).proportion_ci(0.999)
    assert low <= 0.05 <= high


def test_more_knowledge_fewer_tests_and_a_higher_rate_lower_it():
    dof = np.geomspace(0.6, 5000, 50)
    assert (np.diff(critical_factors(dof, 300, 1e-4)) < 0).all()
    assert (critical_factors(dof, 300, 1e-4) < critical_factors(dof, 3000, 1e-4)).all()
    assert (critical_factors(dof, 300, 1e-3) < critical_factors(dof, 300, 1e-4)).all()


def test_nothing_known_is_never_enough():
    assert critical_factors(np.array([0.49]), 10, 0.5)[0] == np.inf
