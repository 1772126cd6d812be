"""The rule of `select`, its folds, and what it refuses."""

import math

import numpy as np
import pytest

from evaluation_cases import changed, make_data
from granular_id.evaluation.candidates import Candidate, plan_candidates
from granular_id.evaluation.selection import best_cost, choose, select
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH, RawHFMH
from granular_id.splits import nested_folds, plan_partitions, strictest

SMALL = {"relative_costs": (1.0,), "n_outer": 2, "n_inner": 2, "progress": False}


def pick(shares, parts=None, n_features=None):
    """Choose among candidates given as (J, n_candidates) or (J, n_candidates, n_costs) accuracies."""
    shares = np.asarray(shares, dtype=float)
    if shares.ndim == 2:
        shares = shares[:, :, np.newaxis]
    n = shares.shape[1]
    candidates = [Candidate(f"s{k}", None, None, (parts or [1] * n)[k]) for k in range(n)]
    choice = choose(shares, candidates, n_features or [10] * n, n_train=80, n_test=20)
    assert choice.accuracy == shares[:, choice.candidate, choice.cost].mean()
    return choice.candidate, choice.cost


# -- the rule


EQUAL = np.full((3, 3), 0.9)


@pytest.mark.parametrize(
    ("shares", "parts", "n_features", "choice"),
    [
        # the best wins where the simpler is clearly worse
        ([[0.90, 0.95], [0.91, 0.96], [0.92, 0.98]], [1, 2], None, (1, 0)),
        # the simpler within a standard error and a point: 1/300 lost, standard error 0.0088
        ([[0.94, 0.95], [0.96, 0.95], [0.95, 0.96]], [1, 2], None, (0, 0)),
        ([[0.94, 0.95], [0.96, 0.95], [0.95, 0.96]], [2, 1], None, (1, 0)),
        # more than a point is too much however large the error: 2 points lost, standard error 13 points
        ([[0.80, 0.95], [0.99, 0.85], [0.90, 0.95]], [1, 2], None, (1, 0)),
        # a constant loss is a loss
        ([[0.895, 0.9], [0.795, 0.8], [0.945, 0.95]], [1, 2], None, (1, 0)),
        # of equals fewer parts, then fewer features, then the first
        (EQUAL, None, None, (0, 0)),
        (EQUAL, None, [10, 9, 9], (1, 0)),
        (EQUAL, [2, 3, 1], [1, 1, 99], (2, 0)),
        # each candidate keeps its own best cost
        ([[[0.7, 0.8, 0.6], [0.5, 0.6, 0.9]]] * 2, None, None, (1, 2)),
    ],
)
def test_the_simplest_that_is_not_clearly_worse_wins(shares, parts, n_features, choice):
    assert pick(shares, parts, n_features) == choice


@pytest.mark.parametrize(
    ("means", "place"),
    [([0.9, 0.9, 0.9], 1), ([0.9, 0.9], 0), ([0.8, 0.9, 0.9, 0.9, 0.9], 2), ([0.1, 0.2, 0.1], 1)],
)
def test_of_equal_costs_the_middle_one(means, place):
    assert best_cost(np.array([means])) == place
    rounded = np.array([[1 / 3] * len(means), [0.1] * len(means), [0.2 + 1e-16] * len(means)])
    assert best_cost(rounded) == (len(means) - 1) // 2


def test_parts_count_blocks_and_what_learns():
    candidates = plan_candidates(
        ["raw", "pca", "raw-histogram", "raw+hfmh", "norm-raw+dft"], [None, "unit"], 500.0, 0
    )
    assert {c.name: c.parts for c in candidates} == {
        "raw": 1,
        "pca": 3,
        "raw-histogram": 2,
        "raw+hfmh": 2,
        "raw+hfmh (unit)": 3,
        "norm-raw+dft": 2,
        "norm-raw+dft (unit)": 3,
    }


# -- the folds


def test_whole_sessions_are_held_out_at_both_levels():
    data = changed(make_data(12), session=lambda r: f"day {int(r.name.split('_')[1]) % 4}")
    folds = nested_folds(data, 4, 3, 0)
    assert folds.held_out == "sessions"
    assert folds.notes == (
        "outer folds (judge the choice): 4 folds of whole sessions",
        "inner folds (make the choice): 3 folds of whole sessions",
    )
    for fold in folds.nested:
        assert not set(data.sessions[fold.outer.train]) & set(data.sessions[fold.outer.test])
        assert sorted(np.concatenate([p.test for p in fold.inner]).tolist()) == fold.outer.train.tolist()
        for inner in fold.inner:
            assert not set(data.sessions[inner.train]) & set(data.sessions[inner.test])
            assert not set(inner.train.tolist() + inner.test.tolist()) & set(fold.outer.test.tolist())


def test_two_sessions_leave_one_inside_and_halves_in_time_stand_in():
    folds = nested_folds(make_data(8), 5, 2, 0)
    assert (folds.held_out, len(folds.nested)) == ("sessions", 2)
    wanted = (
        "inner folds (make the choice): the earlier and the later half of each class in time, by start time "
    )
    assert folds.notes[1].startswith(wanted)


@pytest.mark.parametrize(
    "change", [{}, {"session": lambda r: None, "start_time": lambda r: 2e9 - r.start_time}]
)
def test_outer_folds_are_the_partitions_that_evaluate_judges_by(change):
    data = changed(make_data(9), **change)
    strict, _ = plan_partitions(data, strictest(data)[0])
    outer = [fold.outer for fold in nested_folds(data, 10, 4, 0).nested]
    assert [part.test.tolist() for part in outer] == [part.test.tolist() for part in strict]
    assert [part.train.tolist() for part in outer] == [part.train.tolist() for part in strict]


def test_halves_in_time_are_halved_again():
    data = changed(make_data(9), session=lambda r: None, start_time=lambda r: 2e9 - r.start_time)
    folds = nested_folds(data, 5, 4, 0)
    assert folds.held_out == "halves in time"
    for fold in folds.nested:
        for part in fold.inner:
            assert sorted([*part.train, *part.test]) == fold.outer.train.tolist()
            for label in data.labels:
                trained, tested = (
                    data.start_times[rows[data.y[rows] == label]] for rows in (part.train, part.test)
                )
                assert (trained.max() < tested.min()) != (tested.max() < trained.min())


def test_without_an_order_folds_are_random_seeded_and_said_to_be():
    data = changed(make_data(6), session=lambda r: None, start_time=lambda r: 1e9)
    data = Dataset([*data, *(changed(make_data(1, seed=9), session=lambda r: None))])
    folds, same, other = (nested_folds(data, 3, 2, seed) for seed in (0, 0, 1))
    assert folds.held_out == "random recordings"
    assert folds.notes[0].startswith(
        "outer folds (judge the choice): 3 random folds (session protocol left out: no recording says "
    )
    rows = [fold.outer.test.tolist() for fold in folds.nested]
    assert rows == [fold.outer.test.tolist() for fold in same.nested]
    assert rows != [fold.outer.test.tolist() for fold in other.nested]
    assert "of recordings made among those that trained; a new session may do worse" in str(
        select(data, spaces="raw", **SMALL)
    )


# -- what is refused


def flat_recordings():
    labels = ("oat", "rice") * 6
    return Dataset([Recording(np.ones((40, 6)), rate_hz=500, label=label) for label in labels])


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"n_outer": 1}, ValueError, "n_outer must be at least 2, got 1"),
        ({"n_outer": 7}, ValueError, "n_outer must not exceed the 6 recordings of the largest class, 'oat'"),
        ({"n_inner": 4}, ValueError, "n_inner must not exceed the 3 .* 'oat', that an outer fold leaves"),
        ({"relative_costs": []}, ValueError, "relative_costs must be a sequence of numbers, got none"),
        ({"relative_costs": [1, math.nan]}, ValueError, "relative_costs must be positive and finite"),
        ({"relative_costs": [1, 1.0]}, ValueError, "relative_costs must hold each once"),
        ({"relative_costs": "soft"}, TypeError, "relative_costs must be a sequence of numbers, got 'soft'"),
        ({"block_weights": "unit"}, TypeError, "block_weights must be a sequence of choices.*into a list"),
        ({"block_weights": (1.0, 2.0)}, TypeError, "block_weights .* got 1.0 among them"),
        ({"block_weights": [None, None]}, ValueError, "block_weights must hold each once"),
        ({"block_weights": [(1, 2, 3)]}, ValueError, "block_weights must be None, 'unit' or 2 numbers"),
        ({"spaces": "rraw"}, ValueError, "spaces must be among .*, got 'rraw'"),
        ({"spaces": {"h": HFMH(rate_hz=100)}}, ValueError, "HFMH has rate_hz=100, the recordings have 500"),
        (
            {"spaces": {"a": RawHFMH(), "a (unit)": HFMH()}, "block_weights": [None, "unit"]},
            ValueError,
            "must give each candidate a name of its own",
        ),
        ({"progress": 1}, TypeError, "progress must be a bool or callable, got int"),
    ],
)
def test_bad_arguments_are_one_clear_error(change, error, message):
    data = changed(make_data(6), session=lambda r: None, start_time=lambda r: 1e9 + r.name.endswith("0"))
    with pytest.raises(error, match=message):
        select(data, **{"spaces": "raw+hfmh", **SMALL, **change})


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        (np.zeros((4, 10, 6)), TypeError, "data must be a granular_id.Dataset, got ndarray"),
        (make_data(6, label=None), ValueError, "recordings have no label, the first is 'oat_0'"),
        (make_data(6, label="oat"), ValueError, "needs recordings of at least 2 classes, got only 'oat'"),
        (make_data(2), ValueError, "class 'oat' has 2 recordings; choosing holds out twice"),
        (make_data(3), ValueError, "class 'oat' keeps 1 recording to train on in the outer fold '4 sessions"),
        (flat_recordings(), ValueError, "feature space 'raw': all recordings have the same features"),
    ],
    ids=["array", "no label", "one class", "two", "one beside a session", "all equal"],
)
def test_bad_data_are_one_clear_error(data, error, message):
    with pytest.raises(error, match=message):
        select(data, spaces="raw", **SMALL)
