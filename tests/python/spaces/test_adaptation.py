"""`BestClassifier.adapt` with labels and of all classes: against the same done plainly, and what they refuse."""

import numpy as np
import pytest
from sklearn.base import clone

from granular_id import synthesize
from granular_id.spaces import BestClassifier, Learners, SourceStatistics, adapted_by_labels
from granular_id.spaces.adaptation import self_trained, standardised

BLOCKS = {"left": 8, "right": 24}
K, PAIRS = 4, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def draw(n, seed, gains=1.0, offset=0.0):
    """Rows of classes at fixed places, seen by an instrument with other gains and zero."""
    rng = np.random.default_rng(seed)
    places = np.random.default_rng(77).normal(size=(K, 32)) * 0.6
    codes = rng.integers(K, size=n)
    return (places[codes] + rng.normal(size=(n, 32))) * gains + offset, np.array(list("abcd"))[codes]


GAINS = np.exp(np.random.default_rng(5).normal(size=32) * 0.3)
OFFSET = np.random.default_rng(6).normal(size=32) * 1.5


@pytest.fixture(scope="module")
def rows():
    return draw(80, 0)


@pytest.fixture(scope="module")
def fitted(rows):
    return BestClassifier(blocks=BLOCKS, shrinkages=[None], relative_costs=[1.0]).fit(*rows)


@pytest.fixture(scope="module")
def new():
    return draw(120, 1, gains=GAINS, offset=OFFSET)


def right(classifier, X, y):
    return np.mean(classifier.predict(X) == y)


def plain_losses(scores):
    loss = 1 / (1 + np.exp(2 * np.clip(scores, -300, 300)))  # any falling loss will do
    sums = np.zeros((len(scores), K))
    for learner, (a, b) in enumerate(PAIRS):
        sums[:, a] += loss[:, learner]
        sums[:, b] += 1 - loss[:, learner]
    return sums / (K - 1)


def learners(seed=3):
    rng = np.random.default_rng(seed)
    coding = np.zeros((K, len(PAIRS)), np.int8)
    for learner, (a, b) in enumerate(PAIRS):
        coding[a, learner], coding[b, learner] = 1, -1
    return Learners(rng.normal(size=(6, 32)), rng.normal(size=6), coding, plain_losses)


def source_of(own, rows):
    return SourceStatistics.of(rows[0], np.searchsorted(list("abcd"), rows[1]), own)


def test_self_trained_names_classes_more_equally(rows, new):
    own = learners()
    tilted = own.shifted(np.array([3.0, 3.0, 3.0, 0.0, 0.0, 0.0]))  # speaks against the first class
    made = self_trained(tilted, source_of(own, rows), new[0], None)
    least = [np.bincount(one.answers(new[0]), minlength=K).min() for one in (tilted, made)]
    assert least[1] > least[0]


def test_adapted_by_labels_takes_a_single_row(rows, new):
    own = learners()
    made = adapted_by_labels(own, source_of(own, rows), new[0][:1], np.array([2]), BLOCKS)
    assert np.isfinite(made.coef).all()


def test_adapt_gains_in_both_ways(fitted, rows, new):
    X, y = draw(200, 2, gains=GAINS, offset=OFFSET)
    few = np.concatenate([np.flatnonzero(new[1] == label)[:5] for label in "abcd"])
    before = right(fitted, X, y)
    assert right(fitted.adapt(*rows, new[0], all_materials=True), X, y) > before + 0.05
    assert right(fitted.adapt(*rows, new[0][few], new[1][few]), X, y) > before + 0.05


def test_standardised_takes_gains_and_offsets_away(rows):
    X, y = rows
    n = np.unique(y, return_counts=True)[1].min()
    balanced = np.concatenate([np.flatnonzero(y == label)[:n] for label in "abcd"])
    own, seen = learners(), X[balanced] * GAINS + OFFSET
    made, _ = standardised(own, source_of(own, (X[balanced], y[balanced])), seen)
    np.testing.assert_allclose(made.scores(seen), own.scores(X[balanced]), atol=1e-9)


def test_the_old_classifier_stays_and_the_new_one_has_no_held_out_scores(rows, new):
    own = BestClassifier(blocks=BLOCKS, shrinkages=[None, 1e-3], relative_costs=[1.0]).fit(*rows)
    before = own.coef_.tobytes(), own.intercept_.tobytes()
    made = own.adapt(*rows, new[0], all_materials=True)
    assert (own.coef_.tobytes(), own.intercept_.tobytes()) == before
    assert hasattr(own, "held_out_scores_")
    assert not hasattr(made, "held_out_scores_")
    assert made.choice_.chosen == own.choice_.chosen
    assert not hasattr(clone(made), "coef_")


def test_adapt_by_labels_follows_all_materials(fitted, rows, new):
    X, y = draw(200, 2, gains=GAINS, offset=OFFSET)
    declared = fitted.adapt(*rows, new[0], all_materials=True)
    labelled = declared.adapt(*rows, *(part[:40] for part in new))
    assert right(labelled, X, y) > right(fitted, X, y) + 0.05
    for adapted_one in (declared, labelled):
        with pytest.raises(ValueError, match="has been adapted since: adapt the model that it was made from"):
            adapted_one.adapt(*rows, new[0], all_materials=True)


def test_fitted_anew_it_knows_nothing_of_an_earlier_training(fitted, rows, new):
    again = fitted.adapt(*rows, new[0], all_materials=True).fit(*rows)
    assert again.coef_.tobytes() == fitted.coef_.tobytes()
    assert again.adapt(*rows, new[0], all_materials=True)


@pytest.mark.parametrize("n", [8, 120])
def test_a_block_that_was_left_out_stays_out(rows, new, n):
    clf = BestClassifier(blocks=BLOCKS, shrinkages=[None], relative_costs=[1.0]).fit(*rows)
    clf.coef_[:, :4] = 0.0
    made = clf.adapt(*rows, *(part[:n] for part in new), allow_missing=True)
    assert not made.coef_[:, :4].any()
    assert (made.coef_[:, 4:] != clf.coef_[:, 4:]).any()


def test_a_constant_column_changes_nothing(rows, new):
    with_constant = [(np.hstack([X, np.full((len(X), 1), 3.0)]), y) for X, y in (rows, new)]
    own = BestClassifier(blocks={**BLOCKS, "still": 1}, shrinkages=[None], relative_costs=[1.0])
    made = own.fit(*with_constant[0]).adapt(*with_constant[0], *with_constant[1])
    assert np.isfinite(made.coef_).all()
    assert not made.coef_[:, -1].any()


def test_missing_classes_are_named(fitted, rows, new):
    some = np.flatnonzero(np.isin(new[1], ["a", "c"]))
    with pytest.raises(ValueError, match="b, d are missing: what the others show does not carry over"):
        fitted.adapt(*rows, new[0][some], new[1][some])
    assert fitted.adapt(*rows, new[0][some], new[1][some], allow_missing=True)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"X_new": np.zeros((3, 7))}, "features"),
        ({"X_new": np.full((3, 32), np.nan)}, "NaN"),
        ({"y": np.full(80, "a")}, "y must hold every class of the training, 'b' is missing"),
        ({"y": np.full(80, "z")}, "y must hold labels of the training, got 'z'"),
        ({"y": np.full(79, "a")}, "y must hold a label for each of 80 rows"),
    ],
)
def test_rows_that_do_not_fit_are_refused(fitted, rows, new, change, problem):
    given = {"X": rows[0], "y": rows[1], "X_new": new[0]} | change
    with pytest.raises(ValueError, match=problem):
        fitted.adapt(**given, all_materials=True)


@pytest.mark.parametrize(
    ("way", "problem"),
    [
        ({}, "one of two ways, got neither: give the labels .* or pass all_materials=True"),
        ({"y_new": np.full(120, "a"), "all_materials": True}, "one of two ways, got both"),
        ({"all_materials": True, "allow_missing": True}, "leave out allow_missing=True"),
    ],
)
def test_adapt_in_neither_or_both_ways_is_refused(fitted, rows, new, way, problem):
    with pytest.raises(ValueError, match=problem):
        fitted.adapt(*rows, new[0], **way)


def test_too_few_labelled_rows_to_tell_an_offset(fitted, rows, new):
    with pytest.raises(ValueError, match="adapting by labels needs at least 3 recordings, got 2"):
        fitted.adapt(*rows, new[0][:2], new[1][:2], allow_missing=True)


@pytest.mark.parametrize("name", ["X", "X_new"])
def test_recordings_are_not_features(fitted, rows, new, name):
    given = {"X": rows[0], "y": rows[1], "X_new": new[0]} | {name: synthesize(["rice"], 3, duration_s=0.5)}
    with pytest.raises(
        TypeError, match=f"{name} must be features, got a Dataset: pass those of a feature space"
    ):
        fitted.adapt(**given, all_materials=True)


def test_too_few_rows_to_be_all_classes(fitted, rows, new):
    with pytest.raises(
        ValueError, match="needs 3 recordings a material in the mean, 12 for 4 materials, got 11"
    ):
        fitted.adapt(*rows, new[0][:11], all_materials=True)
