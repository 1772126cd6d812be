"""`BestClassifier.adapt` and `recalibrate`: against the same done plainly, and what they refuse."""

import numpy as np
import pytest
from sklearn.base import clone

from granular_id import synthesize
from granular_id.spaces import BestClassifier, Learners, SourceStatistics, adapted, recalibrated
from granular_id.spaces.adaptation import balanced_shift, recentred, self_trained

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


def test_the_shift_is_that_of_its_definition(rows, new):
    own = learners()
    source = SourceStatistics.of(rows[0], np.searchsorted(list("abcd"), rows[1]), own)
    scores, offset = new[0] @ own.coef.T + own.intercept, np.zeros(6)
    for _ in range(4):
        losses = plain_losses(scores - offset)
        order = np.sort(losses, axis=1)
        named, margins = losses.argmin(axis=1), order[:, 1] - order[:, 0]
        weights, found, known = [], [], []
        for k in range(K):
            members = [i for i in range(len(named)) if named[i] == k]
            members.sort(key=lambda i: -margins[i])  # stable: ties by row
            if members:
                kept = members[: max(1, int(0.7 * len(members)))]
                weights.append(min(len(kept), 5))
                found.append(scores[kept].mean(axis=0))
                known.append(source.scores[k])
        total = sum(weights)
        w, found, known = np.array(weights) / total, np.array(found), np.array(known)
        a, b = found - w @ found, known - w @ known
        slope = min(max((w @ (a * b).sum(axis=1)) / (w @ (b * b).sum(axis=1)), 0.8), 1)
        offset = (w @ found - slope * (w @ known)) * total / (total + K)  # a row a class asks for none
    np.testing.assert_allclose(balanced_shift(own, source, new[0]).intercept, own.intercept - offset)


def test_caution_draws_the_shift_to_none(rows, new):
    own = learners()
    source = SourceStatistics.of(rows[0], np.searchsorted(list("abcd"), rows[1]), own)
    sizes = [
        np.abs(balanced_shift(own, source, new[0], caution=caution).intercept - own.intercept).max()
        for caution in (0.0, 3.0, 1e9)
    ]
    assert sizes[0] > sizes[1] > sizes[2]
    assert sizes[2] < 1e-6


def test_the_mean_of_few_rows_moves_little(rows, new):
    own = learners()
    source = SourceStatistics.of(rows[0], np.searchsorted(list("abcd"), rows[1]), own)
    whole = (new[0] @ own.coef.T + own.intercept).mean(axis=0) - source.scores.mean(axis=0)
    made = recentred(own, source, new[0])
    np.testing.assert_allclose(own.intercept - made.intercept, whole * 120 / 140)


def test_rows_of_all_classes_about_equally_are_named_so(rows, new):
    own = learners()
    source = SourceStatistics.of(rows[0], np.searchsorted(list("abcd"), rows[1]), own)
    tilted = own.shifted(np.array([3.0, 3.0, 3.0, 0.0, 0.0, 0.0]))  # speaks against the first class
    least = [
        np.bincount(
            self_trained(tilted, source, new[0], 1, None, even=even).answers(new[0]), minlength=K
        ).min()
        for even in (False, True)
    ]
    assert least[1] > least[0]


def test_few_rows_are_enough(rows, new):
    own = learners()
    source = SourceStatistics.of(rows[0], np.searchsorted(list("abcd"), rows[1]), own)
    three, one = new[0][:3], new[0][:1]
    shifted, _ = adapted(own, source, three, all_materials=False, rounds=2)
    again = recalibrated(own, source, one, np.array([2]), BLOCKS)
    assert np.isfinite(shifted.intercept).all()
    assert np.isfinite(again.coef).all()


def test_it_gains_without_labels_and_more_with_them(fitted, rows, new):
    X, y = draw(200, 2, gains=GAINS, offset=OFFSET)
    before = right(fitted, X, y)
    shifted, standardised = (
        right(fitted.adapt(*rows, new[0], all_materials=declared), X, y) for declared in (False, True)
    )
    few = [np.flatnonzero(new[1] == label)[:5] for label in "abcd"]
    labelled = fitted.recalibrate(*rows, *(part[np.concatenate(few)] for part in new))
    assert before + 0.05 < min(shifted, standardised)
    assert right(labelled, X, y) > before + 0.05


def test_declared_rows_take_gains_and_offsets_away_exactly(fitted, rows):
    X, y = rows
    balanced = np.concatenate(
        [np.flatnonzero(y == label)[: np.unique(y, return_counts=True)[1].min()] for label in "abcd"]
    )
    own = BestClassifier(blocks=BLOCKS, shrinkages=[None], relative_costs=[1.0]).fit(X[balanced], y[balanced])
    seen = X[balanced] * GAINS + OFFSET
    made = own.adapt(X[balanced], y[balanced], seen, all_materials=True, rounds=0)
    np.testing.assert_allclose(made.binary_scores(seen), own.binary_scores(X[balanced]), atol=1e-9)


def test_the_old_classifier_stays_and_the_new_one_has_no_held_out_scores(rows, new):
    own = BestClassifier(blocks=BLOCKS, shrinkages=[None, 1e-3], relative_costs=[1.0]).fit(*rows)
    before = own.coef_.tobytes(), own.intercept_.tobytes()
    made = own.adapt(*rows, new[0], all_materials=True)
    assert (own.coef_.tobytes(), own.intercept_.tobytes()) == before
    assert hasattr(own, "held_out_scores_")
    assert not hasattr(made, "held_out_scores_")
    assert made.choice_.chosen == own.choice_.chosen
    assert not hasattr(clone(made), "coef_")


def test_a_second_time_goes_by_what_is_known_of_the_training(fitted, rows, new):
    X, y = draw(200, 2, gains=GAINS, offset=OFFSET)
    once = fitted.adapt(*rows, new[0])
    twice = once.adapt(*rows, new[0])
    declared = fitted.adapt(*rows, new[0], all_materials=True)
    labelled = declared.recalibrate(*rows, *(part[:40] for part in new))
    assert right(twice, X, y) > right(once, X, y) - 0.02
    assert right(labelled, X, y) > right(fitted, X, y) + 0.05
    for adapted_one in (once, declared, labelled):
        with pytest.raises(ValueError, match="has been adapted since: adapt the model that it was made from"):
            adapted_one.adapt(*rows, new[0], all_materials=True)


def test_fitted_anew_it_knows_nothing_of_an_earlier_training(fitted, rows, new):
    again = fitted.adapt(*rows, new[0]).fit(*rows)
    assert again.coef_.tobytes() == fitted.coef_.tobytes()
    assert again.adapt(*rows, new[0], all_materials=True)


@pytest.mark.parametrize("n", [8, 120])
def test_a_block_that_was_left_out_stays_out(rows, new, n):
    clf = BestClassifier(blocks=BLOCKS, shrinkages=[None], relative_costs=[1.0]).fit(*rows)
    clf.coef_[:, :4] = 0.0
    made = clf.recalibrate(*rows, *(part[:n] for part in new), allow_missing=True)
    assert not made.coef_[:, :4].any()
    assert (made.coef_[:, 4:] != clf.coef_[:, 4:]).any()


def test_a_constant_column_changes_nothing(rows, new):
    with_constant = [(np.hstack([X, np.full((len(X), 1), 3.0)]), y) for X, y in (rows, new)]
    own = BestClassifier(blocks={**BLOCKS, "still": 1}, shrinkages=[None], relative_costs=[1.0])
    made = own.fit(*with_constant[0]).recalibrate(*with_constant[0], *with_constant[1])
    assert np.isfinite(made.coef_).all()
    assert not made.coef_[:, -1].any()


def test_missing_classes_are_named(fitted, rows, new):
    some = np.flatnonzero(np.isin(new[1], ["a", "c"]))
    with pytest.raises(ValueError, match="b, d are missing: what the others show does not carry over"):
        fitted.recalibrate(*rows, new[0][some], new[1][some])
    assert fitted.recalibrate(*rows, new[0][some], new[1][some], allow_missing=True)


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
        fitted.adapt(**given)


def test_too_few_rows_to_tell_an_offset(fitted, rows, new):
    with pytest.raises(ValueError, match="adapting needs at least 3 recordings, got 2"):
        fitted.adapt(*rows, new[0][:2])


def test_too_few_labelled_rows_to_tell_an_offset(fitted, rows, new):
    with pytest.raises(ValueError, match="recalibration needs at least 3 recordings, got 2"):
        fitted.recalibrate(*rows, new[0][:2], new[1][:2], allow_missing=True)


@pytest.mark.parametrize("name", ["X", "X_new"])
def test_recordings_are_not_features(fitted, rows, new, name):
    given = {"X": rows[0], "y": rows[1], "X_new": new[0]} | {name: synthesize(["rice"], 3, duration_s=0.5)}
    with pytest.raises(
        TypeError, match=f"{name} must be features, got a Dataset: pass those of a feature space"
    ):
        fitted.adapt(**given)


def test_too_few_rows_to_be_all_classes(fitted, rows, new):
    with pytest.raises(
        ValueError, match="needs 3 recordings a material in the mean, 12 for 4 materials, got 11"
    ):
        fitted.adapt(*rows, new[0][:11], all_materials=True)
