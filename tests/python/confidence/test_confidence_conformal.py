"""Prediction sets: against the definition written anew, and the coverage that they promise."""

import json
import math
import pickle
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id.confidence import ConformalRule, HeldOutScores, conformal_rule
from granular_id.confidence.conformal import conformal_quantile, nonconformity, rank_of, rows_needed
from granular_id.confidence.held_out import Scores


def scored(values, truth):
    values, truth = np.asarray(values, dtype=float), np.asarray(truth)
    classes = tuple("abcdefgh"[: values.shape[1]])
    rows = np.arange(len(truth))
    return HeldOutScores(classes, truth, Scores(values), rows, rows % 5, rows, "here")


def drawn(n, n_classes, seed):
    rng = np.random.default_rng(seed)
    truth = rng.integers(n_classes, size=n)
    values = rng.normal(size=(n, n_classes))
    values[np.arange(n), truth] += 1.5
    return values, truth


@given(values=st.lists(st.floats(-50, 50), min_size=2, max_size=8))
def test_nonconformity_follows_its_definition(values):
    found = nonconformity(np.array(values))
    assert found.tolist() == [max(values[:k] + values[k + 1 :]) - own for k, own in enumerate(values)]


@given(n=st.integers(0, 2000), percent=st.integers(1, 99))
def test_rank_is_the_exact_ceiling(n, percent):
    assert rank_of(n, percent / 100) == math.ceil(Fraction(percent, 100) * (n + 1))


@given(percent=st.integers(1, 99))
def test_rows_needed_are_the_fewest(percent):
    level = percent / 100
    n = rows_needed(level)
    assert rank_of(n, level) <= n
    assert n == 1 or rank_of(n - 1, level) > n - 1


def test_coverage_over_100_seeds_is_what_was_asked_for():
    """The mean must lie between the level and the level plus 1 / (n + 1), but for the noise of the draw."""
    n = 399
    levels = (0.8, 0.9, 0.95)
    shares = []
    for seed in range(100):
        rule = conformal_rule(scored(*drawn(n, 4, seed)), levels)
        values, truth = drawn(1000, 4, 1000 + seed)
        shares.append([rule.sets(values, level)[np.arange(1000), truth].mean() for level in levels])
    assert np.mean(shares, axis=0) == pytest.approx(levels, abs=0.007)


def test_one_row_alone_gets_the_set_of_the_batch():
    values, truth = drawn(200, 5, 3)
    rule = conformal_rule(scored(values, truth), [0.5, 0.9])
    for level in rule.levels:
        batch = rule.sets(values, level)
        for row, inside in zip(values, batch, strict=True):
            names = rule.names(row, level)
            assert set(names) == {rule.classes[k] for k in np.flatnonzero(inside)}
            own = [row[rule.classes.index(name)] for name in names]
            assert own == sorted(own, reverse=True)
            assert (rule.sets(row, level) == inside).all()


def test_empty_sets_are_told_from_the_best_guess_and_ties_share_a_set():
    rule = ConformalRule(("oat", "rice"), (0.8,), (-1.0,), 60)
    assert rule.names([0.0, 0.5]) == ()
    assert rule.names([0.0, 0.5], at_least_one=True) == ("rice",)
    rule = ConformalRule(("oat", "rice", "salt"), (0.8,), (0.0,), 60)
    assert rule.names([1.0, 1.0, 0.0]) == ("oat", "rice")


def test_too_few_rows_give_full_sets_and_say_so():
    values, truth = drawn(12, 3, 0)
    rule = conformal_rule(scored(values, truth), [0.9, 0.95])
    assert rule.thresholds[1] == math.inf
    assert rule.sets(values, 0.95).all()
    assert rule.notes == ("95 % needs 19 calibration rows, there are 12: every set is full",)


@given(
    scores=st.lists(st.floats(-5, 5), min_size=1, max_size=50),
    percent=st.integers(1, 99),
)
def test_quantile_is_the_sorted_one(scores, percent):
    rank = math.ceil(Fraction(percent, 100) * (len(scores) + 1))
    wanted = math.inf if rank > len(scores) else sorted(scores)[rank - 1]
    assert conformal_quantile(np.array(scores), percent / 100) == wanted


@given(
    values=st.lists(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3), min_size=6, max_size=30),
)
def test_a_rule_survives_json_and_pickle(values):
    rule = conformal_rule(scored(values, np.arange(len(values)) % 3), [0.5, 0.95])
    again = ConformalRule.from_dict(json.loads(json.dumps(rule.to_dict(), allow_nan=False)))
    assert again == rule
    assert pickle.loads(pickle.dumps(rule)) == rule
    for level in rule.levels:
        assert (again.sets(values, level) == rule.sets(values, level)).all()


GOOD = ConformalRule(("a", "b", "c"), (0.8, 0.9), (0.1, 0.2), 50)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": ("a", "a", "b")}, "at least 2 different names"),
        ({"levels": (0.9, 0.8)}, "levels must ascend"),
        ({"levels": (0.8, math.nan)}, "between 0 and 1"),
        ({"thresholds": (0.1,)}, "thresholds must hold a number for each of 2 levels, got 1"),
        ({"thresholds": (math.nan, 0.2)}, "NaN"),
        ({"n_calibration": -5}, "n_calibration must not be negative, got -5"),
    ],
)
def test_a_rule_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(GOOD, **change)


@pytest.mark.parametrize(
    "change",
    [
        {"format": "granular-id conformal rule 2"},
        {"levels": [0.8, True]},
        {"thresholds": [[0.1], [0.2]]},
        {"thresholds": [1e400, 0.2]},
        {"n_calibration": 1.5},
        {"classes": [1, 2, 3]},
        {"more": 1},
    ],
)
def test_a_damaged_rule_is_refused(change):
    (name,) = change
    with pytest.raises((ValueError, TypeError), match=name):
        ConformalRule.from_dict({**GOOD.to_dict(), **change})
    if name != "more":
        with pytest.raises(ValueError, match=name):
            ConformalRule.from_dict({k: v for k, v in GOOD.to_dict().items() if k != name})


def test_bad_questions():
    drawn_rows = scored(*drawn(10, 3, 0))
    for ask, message in (
        (lambda: GOOD.sets([0, 0, 0], 0.7), r"level must be one of 0\.8, 0\.9, got 0\.7"),
        (lambda: GOOD.sets([0, 0]), r"shape \(3,\)"),
        (lambda: GOOD.names([[0, 0, 0]]), r"shape \(K,\)"),
        (lambda: GOOD.names([0, 0, math.nan]), "finite"),
        (lambda: conformal_rule(drawn_rows, []), "levels must be different"),
    ):
        with pytest.raises(ValueError, match=message):
            ask()
