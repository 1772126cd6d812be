"""The temperature of probabilities: it finds what made the labels, and sessions weigh alike."""

import numpy as np
import pytest

from granular_id.confidence import fit_temperature, softmax


def labels_drawn(rng, values, temperature):
    """Draw labels from the probabilities of class values (n, K)."""
    shares = softmax(values, temperature)
    return (shares.cumsum(axis=1) < rng.random((len(values), 1))).sum(axis=1)


def test_softmax_follows_its_definition():
    values = np.array([[0.1, 0.4, -0.3], [2.0, -np.inf, 1.0]])
    powers = np.exp(values / 0.5)
    np.testing.assert_allclose(softmax(values, 0.5), powers / powers.sum(axis=1, keepdims=True))
    assert softmax([1e6, 0.0], 1e-3).tolist() == [1.0, 0.0]


def test_temperature_is_the_one_that_made_the_labels():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(20_000, 4))
    assert fit_temperature(values, labels_drawn(rng, values, 0.5)) == pytest.approx(0.5, rel=0.03)


def test_sessions_weigh_alike_whatever_their_size():
    rng = np.random.default_rng(1)
    few, many = rng.normal(size=(2000, 3)), rng.normal(size=(20_000, 3))
    truth = np.r_[labels_drawn(rng, few, 2.0), labels_drawn(rng, many, 0.2)]
    values, sessions = np.r_[few, many], np.repeat([0, 2], [2000, 20_000])
    alike = fit_temperature(np.r_[few, many[:2000]], np.r_[truth[:2000], truth[2000:4000]])
    by_session = fit_temperature(values, truth, sessions)
    assert by_session == pytest.approx(alike, rel=0.1)
    assert by_session > 1.3 * fit_temperature(values, truth)


@pytest.mark.parametrize("values", [np.eye(3), np.zeros((3, 3)), np.where(np.eye(3) == 1, 1.0, -np.inf)])
def test_temperature_of_rows_without_a_mistake_is_a_number(values):
    assert 0 < fit_temperature(values, np.arange(3)) < np.inf


@pytest.mark.parametrize("n", [10, 100])
def test_no_mistake_among_few_makes_no_answer_certain(n):
    """As in Platt's scaling, (n + 1) / (n + 2) where all rows are alike."""
    values, truth = np.tile([1.0, 0.0], (n, 1)), np.zeros(n, dtype=np.intp)
    assert softmax(values[0], fit_temperature(values, truth))[0] == pytest.approx((n + 1) / (n + 2), abs=1e-4)
