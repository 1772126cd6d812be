"""Refusal of unknown materials: against twins, and the share of known ones that is asked for."""

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import LinearSVC

from granular_id._core import NearestMean
from granular_id.confidence import UnknownRule, held_out_scores, unknown_rule
from granular_id.confidence.held_out import rows_of
from granular_id.confidence.open_set import area_under_roc, false_positives, leave_one_material_out
from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc import decode, onevsone


def clouds(n_classes=4, n_each=40, n_features=6, seed=0, distance=4.0):
    rng = np.random.default_rng(seed)
    centres = distance * np.eye(n_features)[:n_classes]
    y = np.repeat(np.array(list("abcdef")[:n_classes]), n_each)
    return rng.normal(size=(len(y), n_features)) + np.repeat(centres, n_each, axis=0), y


@pytest.fixture(scope="module")
def crossed():
    return held_out_scores(rows_of(*clouds()), ECOCClassifier())


def test_novelty_follows_its_definition(crossed):
    rule = unknown_rule(crossed)
    assert rule.of_pairs
    strange = rule.novelty(crossed.scores.values, crossed.scores.binary)
    whitener, means = np.array(rule.whitener), np.array(rule.means)
    squares = [  # the hinge decides, so class values are those under the hinge
        [d @ whitener @ whitener.T @ d for d in score - means] for score in crossed.scores.values
    ]
    assert strange == pytest.approx(np.sqrt(np.min(squares, axis=1)), rel=1e-9)


def test_one_row_alone_is_judged_as_in_the_batch(crossed):
    rule = unknown_rule(crossed)
    values, binary = crossed.scores.values, crossed.scores.binary
    each = [float(rule.novelty(v, b)) for v, b in zip(values, binary, strict=True)]
    assert rule.novelty(values, binary) == pytest.approx(each, rel=1e-12)
    assert isinstance(rule.knows(values[0], binary[0]), bool)
    assert json.loads(json.dumps(rule.to_dict(), allow_nan=False)) == rule.to_dict()
    assert UnknownRule.from_dict(json.loads(json.dumps(rule.to_dict()))) == rule
    assert pickle.loads(pickle.dumps(rule)) == rule


@pytest.fixture(scope="module")
def many():
    """Of 20 data sets: scores of held-out rows, and the scores of new rows by the model of all of them."""
    made = []
    for seed in range(20):
        X, y = clouds(seed=seed)
        model = ECOCClassifier().fit(X, y)
        new, _ = clouds(seed=1000 + seed, n_each=200)
        held = held_out_scores(X, ECOCClassifier(), y)
        made.append((held, model.decision_function(new), model.binary_scores(new)))
    return made


@pytest.mark.parametrize("share", [0.8, 0.95])
def test_the_share_of_known_rows_is_kept_on_new_ones(many, share):
    accepted = [
        unknown_rule(held, share_known=share).knows(values, binary).mean() for held, values, binary in many
    ]
    # a little more than asked for: the models of the cross-fit have trained on fewer rows than the final one
    assert share - 0.02 < np.mean(accepted) < share + 0.06


def left_out(X, y, model=None, n_jobs=None, **known):
    """Leave each material out, with 95 % of the known to be accepted."""
    model = ECOCClassifier() if model is None else model
    return leave_one_material_out(rows_of(X, y, **known), model, share_known=0.95, n_jobs=n_jobs)


def test_a_cloud_apart_is_refused_when_it_is_left_out():
    X, y = clouds(n_classes=4, distance=10.0)
    X[y == "d", :4] += np.array([5.0, 5.0, 0.0, -10.0])  # between the first two
    result = left_out(X, y, make_pipeline(StandardScaler(), ECOCClassifier()))
    rows = {row.material: row for row in result.rows}
    assert rows["d"].auroc > 0.95
    assert (rows["d"].n_unknown, rows["d"].n_known) == (40, 120)
    assert 0.85 < result.mean("accepted") <= 1.0
    assert "random folds" in str(result)


def test_left_out_rows_train_nowhere():
    """What is left out could be anything: figures of the others' models do not change, but for the left-out rows."""
    seen = []

    class Spy(ECOCClassifier):
        def fit(self, X, y, sample_weight=None):
            seen.append(set(y))
            return super().fit(X, y, sample_weight)

    X, y = clouds(n_classes=3, n_each=12)
    left_out(X, y, Spy())
    assert {frozenset(labels) for labels in seen} == {frozenset("ab"), frozenset("ac"), frozenset("bc")}


def test_sessions_are_held_out_whole():
    X, y = clouds(n_classes=3, n_each=12)
    sessions = [f"day {k % 3}" for k in range(len(y))]
    tested = left_out(X, y, sessions=sessions)
    assert tested.held_out == "held-out sessions"
    in_time = left_out(X, y, in_time_order=True)
    assert in_time.held_out == "halves in time order"


def test_seeds_and_threads_make_no_difference():
    X, y = clouds(n_classes=3, n_each=15)
    assert left_out(X, y, n_jobs=2) == left_out(X, y)


def test_two_classes_are_one_number():
    """Their two class values are one number twice: no direction of no variance may make rows strange."""
    X, y = clouds(n_classes=2)
    for model in (ECOCClassifier(), LinearSVC()):
        crossed = held_out_scores(X, model, y)
        assert unknown_rule(crossed).knows(crossed.scores.values, crossed.scores.binary).mean() > 0.9


def test_scores_that_are_all_the_same_are_all_known():
    crossed = held_out_scores(np.tile(np.eye(3), (8, 1)), ECOCClassifier(C=1e-9), list("abc") * 8)
    rule = unknown_rule(crossed)
    assert np.isfinite(rule.threshold)
    assert rule.knows(crossed.scores.values, crossed.scores.binary).all()


@pytest.mark.parametrize("model", [LinearSVC(), ECOCClassifier(coding="onevsall")])
def test_unknown_rule_without_pairs_takes_class_values(model):
    X, y = clouds()
    crossed = held_out_scores(X, model, y)
    rule = unknown_rule(crossed)
    assert not rule.of_pairs
    assert rule.knows(crossed.scores.values).mean() > 0.9
    assert len(left_out(X, y, model).rows) == 4


@pytest.mark.parametrize("n_classes", [2, 3, 11])
def test_distances_of_pairs_are_those_of_what_the_hinge_decodes(n_classes):
    coding = onevsone(n_classes)
    rng = np.random.default_rng(n_classes)
    scores = rng.normal(scale=2.0, size=(50, coding.shape[1]))
    means, whitener = rng.normal(size=(n_classes, n_classes)), rng.normal(size=(n_classes, n_classes))
    differences = (decode(scores, coding, "hinge")[:, None] - means) @ whitener
    wanted = np.sqrt((differences**2).sum(axis=2).min(axis=1))
    nearest = NearestMean(means, whitener, of_pairs=True)
    np.testing.assert_allclose(nearest.distances(scores), wanted, rtol=1e-12)
    assert [float(nearest.distances(row)[0]) for row in scores] == nearest.distances(scores).tolist()


def test_nearest_mean_refuses():
    eye = np.eye(2)
    for call, message in (
        (lambda: NearestMean(np.ones((2, 3)), eye), r"must fit.*shapes \(2, 3\) and \(2, 2\)"),
        (lambda: NearestMean(np.ones((0, 2)), eye), "K and S at least 1"),
        (lambda: NearestMean(np.full((2, 2), np.nan), eye), "means must be finite"),
        (lambda: NearestMean(eye, np.full((2, 2), np.inf)), "whitener must be finite"),
        (lambda: NearestMean(eye, eye).distances(np.ones(3)), r"scores must have shape \(2,\)"),
        (lambda: NearestMean(eye, eye).distances([1, np.nan], "binary"), "binary must be finite"),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_models_without_a_limit_are_counted_and_not_drawn():
    X, y = clouds(n_classes=3, n_each=10)
    few = left_out(X, y, in_time_order=True)
    assert few.n_unlimited == 6
    assert [len(values) for values in few.novelty] == [0, 0]
    assert "6 models had too few rows" in str(few.table())
    X, y = clouds(n_classes=3)
    many = left_out(X, y, in_time_order=True)
    assert many.n_unlimited == 0
    assert all(np.isfinite(values).all() and len(values) for values in many.novelty)


def test_too_few_rows_refuse_nothing_and_say_so():
    crossed = held_out_scores(rows_of(*clouds(n_classes=3, n_each=4)), ECOCClassifier())
    rule = unknown_rule(crossed)
    assert rule.threshold == math.inf
    assert rule.notes == ("too few calibration rows (12) to accept 95 % of the known: nothing is refused",)
    assert rule.knows([1e9, -1e9, 0.0], [1e9, -1e9, 0.0])
    assert UnknownRule.from_dict(rule.to_dict()) == rule


def test_figures_are_those_of_others():
    rng = np.random.default_rng(0)
    known, unknown = rng.normal(size=50).round(1), rng.normal(0.5, size=30).round(1)
    truth = np.repeat([0, 1], [50, 30])
    assert area_under_roc(known, unknown) == pytest.approx(roc_auc_score(truth, np.r_[known, unknown]))
    limit = sorted(known)[math.ceil(0.95 * 50) - 1]
    assert false_positives(known, unknown) == (unknown <= limit).mean()


GOOD = UnknownRule(
    ("a", "b"),
    3.0,
    0.95,
    50,
    means=((0.0, 1.0), (1.0, 0.0)),
    whitener=((1.0, 0.0), (0.0, 1.0)),
    of_pairs=False,
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": ("a", "a")}, "different names"),
        ({"threshold": math.nan}, "threshold"),
        ({"share_known": 1.0}, "share_known"),
        ({"n_calibration": -1}, "n_calibration"),
        ({"means": ((0.0, 1.0),)}, "means must be 2 rows of 2 numbers"),
        ({"whitener": ((1.0,), (1.0,))}, "whitener must be 2 rows of 2 numbers"),
        ({"means": ((0.0, math.inf), (1.0, 0.0))}, "finite"),
    ],
)
def test_a_rule_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(GOOD, **change)


@pytest.mark.parametrize(
    "change",
    [
        {"format": "other"},
        {"threshold": "3"},
        {"n_calibration": True},
        {"of_pairs": 1},
        {"means": [[0.0, 1.0], [1.0]]},
        {"means": [[0.0, None], [1.0, 0.0]]},
        {"more": 1},
    ],
)
def test_a_damaged_rule_is_refused(change):
    with pytest.raises((ValueError, TypeError), match=next(iter(change))):
        UnknownRule.from_dict({**GOOD.to_dict(), **change})


def test_bad_questions(crossed):
    by_pairs, values = unknown_rule(crossed), [1.0, 2.0, 3.0, 4.0]
    for ask, message in (
        (lambda: GOOD.knows([1.0, 2.0, 3.0]), r"values must have shape \(2,\)"),
        (lambda: GOOD.knows([1.0, math.nan]), "finite"),
        (lambda: by_pairs.knows(values), "binary must hold the scores"),
        (lambda: by_pairs.knows(values, np.zeros((2, 6))), "same rows"),
        (lambda: by_pairs.knows(values, np.zeros(4)), r"binary must have shape \(6,\)"),
        (lambda: unknown_rule(crossed, share_known=0.0), "share_known"),
    ):
        with pytest.raises(ValueError, match=message):
            ask()
