"""Probabilities against what happens, and the scores of held-out rows behind them."""

import json

import numpy as np
import pytest
from sklearn.datasets import load_iris
from sklearn.metrics import log_loss
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import LinearSVC
from sklearn.tree import DecisionTreeClassifier

from granular_id.confidence import held_out_scores
from granular_id.confidence.calibration import fit_temperature, probabilities_of, reliability
from granular_id.confidence.held_out import rows_of
from granular_id.ecoc import ECOCClassifier
from granular_id.partitions import kfold_partitions
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH

X, Y = load_iris(return_X_y=True)


def outcomes(n, seed, power=1.0):
    """Labels drawn from probabilities, and probabilities that overstate them when power is above 1."""
    rng = np.random.default_rng(seed)
    true = rng.dirichlet([0.6] * 4, size=n)
    truth = (true.cumsum(axis=1) < rng.random((n, 1))).sum(axis=1).clip(0, 3)
    stated = true**power
    return stated / stated.sum(axis=1, keepdims=True), truth


def alone(probabilities, truth, seed=0):
    """Reliability of rows that are each a group of their own."""
    truth = np.asarray(truth)
    return reliability(np.asarray(probabilities), truth, np.arange(len(truth)), seed=seed)


def test_figures_by_loops():
    given, truth = outcomes(300, 0, 1.5)
    seen = alone(given, truth)
    gaps = [[] for _ in range(15)]
    for row, k in zip(given, truth, strict=True):
        best = int(row.argmax())
        gaps[int(np.ceil(15 * row[best])) - 1].append((best == k) - row[best])
    assert seen.ece == pytest.approx(sum(abs(sum(gap)) for gap in gaps) / 300)
    wanted = np.mean(
        [sum((p - (j == k)) ** 2 for j, p in enumerate(row)) for row, k in zip(given, truth, strict=True)]
    )
    assert seen.brier == pytest.approx(wanted)
    assert seen.log_loss == pytest.approx(log_loss(truth, given, labels=range(4)))
    assert sum(part.n for part in seen.bins) == 300


def test_a_calibrated_model_stays_within_what_calibrated_models_show():
    inside = 0
    for seed in range(60):
        seen = alone(*outcomes(250, seed), seed=seed)
        low, high = seen.ece_if_calibrated
        inside += low <= seen.ece <= high
    assert inside >= 50  # 95 % of 60 are 57


NO_MISTAKES = np.zeros(50, dtype=int)


@pytest.mark.parametrize(
    ("probabilities", "truth", "verdict"),
    [
        (*outcomes(1000, 0, 3.0), "too sure"),
        (*outcomes(1000, 0, 0.4), "not sure enough"),
        (*outcomes(1000, 1), "no sign of being off"),
        (*outcomes(8, 1), "too few rows to tell"),
        (np.tile([0.99, 0.01], (8, 1)), np.ones(8, dtype=int), "too sure"),  # so far off that eight rows do
        (np.tile([0.9999, 0.0001], (50, 1)), NO_MISTAKES, "no mistakes, so nothing to judge by"),
        (np.tile([0.8, 0.2], (50, 1)), NO_MISTAKES, "not sure enough"),
        (np.tile([0.9999, 0.0001], (5000, 1)), np.arange(5000) // 4999, "no sign of being off"),
    ],
)
def test_which_way_probabilities_are_off(probabilities, truth, verdict):
    seen = alone(probabilities, truth)
    low, high = seen.ece_interval
    assert seen.verdict == verdict
    assert low <= seen.ece <= high or verdict.startswith("no ")


def test_whole_sessions_are_drawn():
    """Rows of a session that are all the same are one piece of evidence, not fifty."""
    given = np.tile([0.75, 0.25], (400, 1))
    sessions = np.repeat(np.arange(8), 50)
    truth = (np.isin(sessions, [1, 5])).astype(int)
    single = alone(given, truth).ece_interval
    together = reliability(given, truth, sessions).ece_interval
    assert together[1] - together[0] > 3 * (single[1] - single[0])


def test_same_seed_same_intervals_and_plain_values():
    first, again = (alone(*outcomes(100, 0), seed=4) for _ in range(2))
    assert first == again
    assert json.loads(json.dumps(first.to_dict()))["ece"] == first.ece
    assert "expected calibration error" in str(first)


def test_certainty_and_impossibility():
    seen = alone([[1.0, 0.0], [0.0, 1.0]], [0, 0])
    assert seen.log_loss == pytest.approx(-np.log(1e-15) / 2)
    assert seen.brier == 1.0
    assert [(part.low, part.n) for part in seen.bins] == [(14 / 15, 2)]
    right = alone(np.eye(2)[[0, 1] * 10], [0, 1] * 10)
    assert "-0.000" not in str(right)


@pytest.mark.parametrize("row", [[0.5, 0.6, 0.0], [1.5, -0.5, 0.0], [np.nan, 0.5, 0.5]])
def test_probabilities_of_bad_predict_proba_raises(row):
    class Odd(LinearSVC):
        def predict_proba(self, X):
            return np.tile(row, (len(X), 1))

    with pytest.raises(ValueError, match="predict_proba of model must not be negative, and sum to 1"):
        probabilities_of(held_out_scores(X, Odd(), Y))


def test_each_row_is_scored_by_a_model_that_has_not_seen_it():
    rows = rows_of(X, Y)
    folds = kfold_partitions(rows.codes, n_folds=4, seed=1)
    model = make_pipeline(StandardScaler(), ECOCClassifier(temperature=0.1))
    scored = held_out_scores(rows, model, partitions=folds, n_jobs=2)
    assert sorted(scored.rows) == list(range(150))
    for k, fold in enumerate(folds):
        fitted = make_pipeline(StandardScaler(), ECOCClassifier(temperature=0.1))
        fitted.fit(X[fold.train], rows.labels[fold.train])
        own = scored.folds == k
        assert (scored.rows[own] == fold.test).all()
        assert (scored.scores.values[own] == fitted.decision_function(X[fold.test])).all()
        assert (
            scored.scores.binary[own] == fitted[-1].binary_scores(fitted[:-1].transform(X[fold.test]))
        ).all()
        assert (scored.scores.probabilities[own] == fitted.predict_proba(X[fold.test])).all()
    assert probabilities_of(scored)[1] == "predict_proba of the model"


def test_temperature_finds_the_one_that_made_the_labels():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(20_000, 4))
    powers = np.exp(values / 0.5)
    truth = (powers.cumsum(axis=1) / powers.sum(axis=1, keepdims=True) < rng.random((20_000, 1))).sum(axis=1)
    assert fit_temperature(values, truth) == pytest.approx(0.5, rel=0.03)


def test_temperature_of_rows_that_are_all_right_or_all_the_same_is_a_number():
    assert 0 < fit_temperature(np.eye(3), np.arange(3)) < np.inf
    assert 0 < fit_temperature(np.zeros((3, 3)), np.arange(3)) < np.inf


def test_temperature_of_a_fold_does_not_know_it():
    scored = held_out_scores(X, LinearSVC(), Y)
    before, source = probabilities_of(scored)
    assert "other folds" in source
    own = scored.folds == 0
    scored.truth[own] = (scored.truth[own] + 1) % 3
    after, _ = probabilities_of(scored)
    assert (before[own] == after[own]).all()
    assert (before[~own] != after[~own]).any()


def test_steps_that_learn_nothing_run_once(monkeypatch):
    calls = []
    plain = HFMH.transform
    monkeypatch.setattr(HFMH, "transform", lambda self, rows: calls.append(len(rows)) or plain(self, rows))
    wrench = np.random.default_rng(0).normal(size=(20, 200, 6))
    held_out_scores(wrench, make_pipeline(HFMH(), ECOCClassifier()), list("ab") * 10)
    assert calls == [20]


def test_two_classes_have_two_values():
    scored = held_out_scores(X[:100], LinearSVC(), Y[:100])
    assert scored.scores.values.shape == (100, 2)
    assert scored.accuracy == 1.0


def test_models_that_do_not_serve():
    with pytest.raises(TypeError, match="must have decision_function"):
        held_out_scores(X, DecisionTreeClassifier(), Y)
    folds = kfold_partitions(Y, n_folds=4)
    with pytest.raises(ValueError, match="at most once"):
        held_out_scores(X, LinearSVC(), Y, partitions=[*folds, folds[0]])


def recordings(sessions=None, times=True):
    """Six recordings of each of two materials, in the sessions in turn."""
    rng = np.random.default_rng(0)
    made = []
    for label in "ab":
        for k in range(6):
            session = sessions[k % len(sessions)] if sessions else None
            start = 1e9 + 100 * k + ord(label) if times else None
            known = {"label": label, "name": f"{label}{k}", "session": session, "start_time": start}
            made.append(Recording(rng.normal(size=(20, 6)), rate_hz=100, **known))
    return Dataset(made)


def test_the_strictest_folds_that_there_are():
    assert rows_of(recordings(["mon", "tue"])).folds()[1] == "2 folds of whole sessions"
    assert rows_of(recordings(["mon", "tue"])).folds(strict=False)[1] == "6 random folds"
    assert rows_of(recordings()).folds()[1] == "5 blocks of each class in time order"
    assert rows_of(recordings()).partitions()[1] == "halves in time order"
    assert rows_of(recordings(["mon"])).folds()[1] == "5 blocks of each class in time order"
    by_file = rows_of(recordings(times=False))
    assert by_file.groups.order is not None  # the order of the files
    random = rows_of(X, Y).folds()[1]
    assert random == "10 random folds (sessions are not known; no order in time is known)"
    assert len(rows_of(X[::25], Y[::25]).folds()[0]) == 2


def test_some_rows_keep_their_order_and_classes():
    rows = rows_of(X, Y, in_time_order=True, sessions=["s"] * 150)
    taken = rows.take(np.array([149, 3, 120]))
    assert taken.classes == ("0", "2")
    assert taken.groups.order.tolist() == [1, 2, 0]
    assert (X[[149, 3, 120]] == taken.X).all()
    assert taken.labels.tolist() == ["2", "0", "2"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"data": X}, "y must hold a label"),
        ({"data": X, "y": Y[:-1]}, "a row and a label each"),
        ({"data": Y, "y": Y}, "a row and a label each"),
        ({"data": X, "y": Y, "sessions": ["a"]}, "sessions must name one session per row of X, 150, got 1"),
        ({"data": X[:50], "y": Y[:50]}, "at least 2 classes"),
        ({"data": recordings(), "y": Y}, "come from the data set"),
    ],
)
def test_rows_that_do_not_fit(arguments, message):
    with pytest.raises(ValueError, match=message):
        rows_of(**arguments)
