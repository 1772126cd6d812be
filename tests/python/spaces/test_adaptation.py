"""Linear learners brought to another set-up, by labels and by rows declared to hold all classes."""

from dataclasses import replace

import numpy as np
import pytest

from granular_id.spaces import (
    BestClassifier,
    Learners,
    SourceStatistics,
    adapted_by_labels,
    adapted_classifier,
    adapted_to_all,
)
from granular_id.spaces.adaptation import self_trained, standardised

BLOCKS = {"left": 8, "right": 24}
K, PAIRS = 4, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def draw(n, seed, gains=1.0, offset=0.0):
    """Rows of classes at fixed places, seen by an instrument with other gains and zero."""
    rng = np.random.default_rng(seed)
    places = np.random.default_rng(77).normal(size=(K, 32)) * 0.6
    codes = rng.integers(K, size=n)
    return (places[codes] + rng.normal(size=(n, 32))) * gains + offset, codes


GAINS = np.exp(np.random.default_rng(5).normal(size=32) * 0.3)
OFFSET = np.random.default_rng(6).normal(size=32) * 1.5


def classifier_of(rows):
    return BestClassifier(blocks=BLOCKS, shrinkages=[None], relative_costs=[1.0]).fit(*rows)


@pytest.fixture(scope="module")
def rows():
    return draw(80, 0)


@pytest.fixture(scope="module")
def new():
    return draw(120, 1, gains=GAINS, offset=OFFSET)


@pytest.fixture(scope="module")
def fitted(rows):
    made = classifier_of(rows)
    return Learners(made.coef_, made.intercept_, made.coding_matrix_, plain_losses)


@pytest.fixture(scope="module")
def source(fitted, rows):
    return SourceStatistics.of(*rows, fitted)


def plain_losses(scores):
    loss = 1 / (1 + np.exp(2 * np.clip(scores, -300, 300)))  # any falling loss will do
    sums = np.zeros((len(scores), K))
    for learner, (a, b) in enumerate(PAIRS):
        sums[:, a] += loss[:, learner]
        sums[:, b] += 1 - loss[:, learner]
    return sums / (K - 1)


def right(learners, X, codes):
    return np.mean(learners.answers(X) == codes)


def test_self_trained_names_classes_more_equally(fitted, source, new):
    tilted = fitted.shifted(np.array([3.0, 3.0, 3.0, 0.0, 0.0, 0.0]))  # speaks against the first class
    made = self_trained(tilted, source, new[0], None)
    least = [np.bincount(one.answers(new[0]), minlength=K).min() for one in (tilted, made)]
    assert least[1] > least[0]


def test_adapted_learners_gain_in_both_ways(fitted, source, new):
    seen = draw(200, 2, gains=GAINS, offset=OFFSET)
    few = np.concatenate([np.flatnonzero(new[1] == code)[:5] for code in range(K)])
    before = right(fitted, *seen)
    declared, known = adapted_to_all(fitted, source, new[0], BLOCKS)
    assert right(declared, *seen) > before + 0.05
    assert right(adapted_by_labels(fitted, source, new[0][few], new[1][few], BLOCKS), *seen) > before + 0.05
    assert right(adapted_by_labels(declared, known, new[0][few], new[1][few], BLOCKS), *seen) > before + 0.05


def test_standardised_takes_gains_and_offsets_away(fitted, rows):
    X, codes = rows
    n = np.bincount(codes).min()
    balanced = np.concatenate([np.flatnonzero(codes == code)[:n] for code in range(K)])
    source, seen = SourceStatistics.of(X[balanced], codes[balanced], fitted), X[balanced] * GAINS + OFFSET
    made, _ = standardised(fitted, source, seen)
    np.testing.assert_allclose(made.scores(seen), fitted.scores(X[balanced]), atol=1e-9)


@pytest.mark.parametrize("n", [1, 8, 120])
def test_block_that_was_left_out_stays_out(fitted, source, new, n):
    coef = fitted.coef.copy()
    coef[:, :4] = 0.0
    made = adapted_by_labels(replace(fitted, coef=coef), source, new[0][:n], new[1][:n], BLOCKS)
    assert not made.coef[:, :4].any()
    assert (made.coef[:, 4:] != coef[:, 4:]).any() == (n > 1)  # one row moves the intercepts alone
    assert (made.intercept != fitted.intercept).all()


def test_constant_column_changes_nothing(rows, new):
    with_constant = [(np.hstack([X, np.full((len(X), 1), 3.0)]), codes) for X, codes in (rows, new)]
    blocks = {**BLOCKS, "still": 1}
    own = BestClassifier(blocks=blocks, shrinkages=[None], relative_costs=[1.0]).fit(*with_constant[0])
    learners = Learners(own.coef_, own.intercept_, own.coding_matrix_, plain_losses)
    source = SourceStatistics.of(*with_constant[0], learners)
    made = adapted_by_labels(learners, source, *with_constant[1], blocks)
    assert np.isfinite(made.coef).all()
    assert not made.coef[:, -1].any()


def test_adapted_classifier_gains_and_leaves_the_old_one(rows, new):
    X, codes = draw(200, 2, gains=GAINS, offset=OFFSET)
    own = classifier_of(rows)
    before = own.coef_.tobytes(), own.intercept_.tobytes()
    made = adapted_classifier(own, *rows, new[0])
    assert np.mean(made.predict(X) == codes) > np.mean(own.predict(X) == codes) + 0.05
    assert (own.coef_.tobytes(), own.intercept_.tobytes()) == before
