"""Tests over overlapping partitions, against independent twins and worked examples."""

import math

import numpy as np
import pytest
from scipy import special, stats

from granular_id.statistics import cluster_interval, corrected_resampled_t, holm, mann_whitney

DIFFERENCES = [0.031, -0.008, 0.015, 0.023, 0.008, 0.0, 0.038, -0.015, 0.023, 0.015]


def test_corrected_t_of_the_papers_design_by_hand():
    p_value = corrected_resampled_t(DIFFERENCES, n_train=550, n_test=132)
    mean = sum(DIFFERENCES) / 10
    variance = sum((d - mean) ** 2 for d in DIFFERENCES) / 9
    error = math.sqrt((0.1 + 0.24) * variance)
    # P(T > |t|) from the incomplete beta function instead of scipy.stats
    tail = 0.5 * special.betainc(4.5, 0.5, 9 / (9 + (mean / error) ** 2))
    assert p_value == pytest.approx(2 * tail, rel=1e-12)
    assert corrected_resampled_t([-d for d in DIFFERENCES], 550, 132) == pytest.approx(
        p_value
    )  # methods swapped


def answers(shares, n=10, n_classes=1):
    """Answers of sessions that all classes share, of which a share is right in each."""
    right = np.concatenate([np.arange(n) < share * n for share in shares for _ in range(n_classes)])
    truth = np.tile(np.repeat(np.arange(n_classes), n), len(shares))
    return right, truth, np.repeat(np.arange(len(shares)), n * n_classes)


@pytest.mark.parametrize("n_classes", [1, 3])
def test_interval_of_equal_sessions_is_that_of_their_mean(n_classes):
    shares = [0.4, 0.6, 0.5, 0.9]
    low, high = cluster_interval(*answers(shares, n_classes=n_classes))
    assert (low, high) == pytest.approx(stats.t.interval(0.95, 3, np.mean(shares), stats.sem(shares)))


def test_interval_of_own_sessions_adds_the_spread_of_each_class():
    right, _, sessions = answers([0.4, 0.6, 0.8, 0.5, 0.7, 0.9])
    low, high = cluster_interval(right, np.repeat([0, 1], 30), sessions)
    error = math.hypot(stats.sem([0.4, 0.6, 0.8]), stats.sem([0.5, 0.7, 0.9])) / 2
    assert (low, high) == pytest.approx(stats.t.interval(0.95, 4, 0.65, error))


def test_interval_of_unequal_sessions_leaves_each_out():
    shares, sizes = np.array([0.4, 0.6, 0.5, 0.6, 0.5, 0.7]), np.array([10, 10, 10, 10, 10, 30])
    right = np.concatenate([np.arange(n) < share * n for share, n in zip(shares, sizes, strict=True)])
    low, high = cluster_interval(right, np.zeros(80, dtype=np.intp), np.repeat(np.arange(6), sizes))
    mean = np.average(shares, weights=sizes)
    without = (mean * 80 - shares * sizes) / (80 - sizes)
    error = math.sqrt(5 / 6 * ((without - mean) ** 2).sum())
    n_alike = 80**2 / (sizes**2).sum()  # as many sessions of one size weigh the same
    assert (low, high) == pytest.approx(stats.t.interval(0.95, n_alike - 1, mean, error))


def test_interval_stays_among_the_possible_accuracies():
    assert cluster_interval(*answers([1.0, 1.0, 0.5]))[1] == 1.0
    assert cluster_interval(*answers([0.0, 0.0, 0.5]))[0] == 0.0


@pytest.mark.parametrize(
    ("right", "truth", "sessions"),
    [
        ([1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 1]),
        ([1, 1, 1], [0, 0, 0], [0, 1, 2]),
        ([1, 0, 1, 0], [0, 0, 0, 1], [0, 1, 2, 2]),
    ],
    ids=["two sessions", "no spread", "a class with one session"],
)
def test_interval_of_too_little_is_none(right, truth, sessions):
    found = cluster_interval(np.array(right, dtype=bool), np.array(truth), np.array(sessions))
    assert np.isnan(found).all()


@pytest.mark.parametrize("differences", [[0.0], [0.0] * 20, [1e-17, 0.0, -1e-17]])
def test_no_difference_at_all_is_none(differences):
    assert corrected_resampled_t(differences, 550, 132) == 1.0


@pytest.mark.parametrize("differences", [[0.1], [0.1] * 20, [0.9 - 0.8, 0.7 - 0.6, 0.4 - 0.3]])
def test_differences_without_spread_have_no_p_value(differences):
    assert math.isnan(corrected_resampled_t(differences, 550, 132))


def test_holm_against_a_loop():
    rng = np.random.default_rng(3)
    for m in range(1, 9):
        p = rng.uniform(0, 0.3, m).round(2)  # ties among them
        want = np.empty(m)
        running = 0.0
        for rank, i in enumerate(np.argsort(p, kind="stable")):
            running = max(running, min(1.0, (m - rank) * p[i]))
            want[i] = running
        assert holm(p) == pytest.approx(want)


def test_holm_leaves_out_what_was_not_tested():
    np.testing.assert_array_equal(holm([0.01, math.nan, 0.04]), [0.02, math.nan, 0.04])


def test_mann_whitney_counts_the_ways_to_deal_the_ranks():
    # no overlap of 4 and 4 values: 2 of the C(8, 4) = 70 ways are as extreme
    assert mann_whitney([1, 2, 3, 4], [5, 6, 7, 8]) == pytest.approx(2 / 70)
    assert mann_whitney([0.5] * 20, [0.5] * 20) == 1.0
