"""Prediction sets: against the definition written anew, and the coverage that they promise."""

import json
import math
import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id.confidence import ConformalRule, HeldOutScores, conformal_rule
from granular_id.confidence.conformal import (
    KINDS,
    conformal_quantile,
    fit_temperature,
    nonconformity,
    rank_of,
    rows_needed,
)
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


def twin(values, k, kind, temperature):
    """Score of class k of one row, from the words of `KINDS`."""
    if kind == "margin":
        return max(v for j, v in enumerate(values) if j != k) - values[k]
    powers = [math.exp((v - max(values)) / temperature) for v in values]
    shares = [power / sum(powers) for power in powers]
    if kind == "probability":
        return -shares[k]
    order = sorted(range(len(values)), key=lambda j: -shares[j])
    return sum(shares[j] for j in order[: order.index(k) + 1])


@pytest.mark.parametrize("kind", KINDS)
@given(
    values=st.lists(st.floats(-50, 50), min_size=2, max_size=8),
    temperature=st.floats(0.1, 10),
)
def test_scores_are_those_of_the_definition(kind, values, temperature):
    found = nonconformity(np.array(values), kind, temperature)
    wanted = [twin(values, k, kind, temperature) for k in range(len(values))]
    assert found == pytest.approx(wanted, rel=1e-12, abs=1e-12)


@given(n=st.integers(0, 2000), percent=st.integers(1, 99))
def test_rank_is_the_exact_ceiling(n, percent):
    assert rank_of(n, percent / 100) == math.ceil(Fraction(percent, 100) * (n + 1))


@given(percent=st.integers(1, 99))
def test_rows_needed_are_the_fewest(percent):
    level = percent / 100
    n = rows_needed(level)
    assert rank_of(n, level) <= n
    assert n == 1 or rank_of(n - 1, level) > n - 1


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("per_class", [False, True])
def test_coverage_over_100_seeds_is_what_was_asked_for(kind, per_class):
    """The mean must lie between the level and the level plus 1 / (n + 1), but for the noise of the draw."""
    n = 399
    levels = (0.8, 0.9, 0.95)
    shares = []
    for seed in range(100):
        rule = conformal_rule(scored(*drawn(n, 4, seed)), levels, kind=kind, per_class=per_class)
        values, truth = drawn(1000, 4, 1000 + seed)
        shares.append([rule.sets(values, level)[np.arange(1000), truth].mean() for level in levels])
    assert np.mean(shares, axis=0) == pytest.approx(levels, abs=0.012 if per_class else 0.007)


def test_per_class_covers_the_hard_class_too():
    values, truth = drawn(4000, 3, 0)
    values[truth == 2, 2] -= 1.5  # one class is not recognised
    fitted, tested = slice(0, 2000), slice(2000, None)
    for per_class in (False, True):
        rule = conformal_rule(scored(values[fitted], truth[fitted]), [0.9], per_class=per_class)
        inside = rule.sets(values[tested])[np.arange(2000), truth[tested]]
        hard = inside[truth[tested] == 2].mean()
        assert (hard > 0.86) == per_class


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("per_class", [False, True])
def test_one_row_alone_gets_the_set_of_the_batch(kind, per_class):
    values, truth = drawn(200, 5, 3)
    rule = conformal_rule(scored(values, truth), [0.5, 0.9], kind=kind, per_class=per_class)
    for level in rule.levels:
        batch = rule.sets(values, level)
        for row, inside in zip(values, batch, strict=True):
            names = rule.names(row, level)
            assert set(names) == {rule.classes[k] for k in np.flatnonzero(inside)}
            own = [row[rule.classes.index(name)] for name in names]
            assert own == sorted(own, reverse=True)
            assert (rule.sets(row, level) == inside).all()


def test_empty_sets_are_told_from_the_best_guess_and_ties_share_a_set():
    rule = ConformalRule(("oat", "rice"), "margin", (0.8,), ((-1.0,),), (60,))
    assert rule.names([0.0, 0.5]) == ()
    assert rule.names([0.0, 0.5], at_least_one=True) == ("rice",)
    rule = ConformalRule(("oat", "rice", "salt"), "margin", (0.8,), ((0.0,),), (60,))
    assert rule.names([1.0, 1.0, 0.0]) == ("oat", "rice")


def test_too_few_rows_give_full_sets_and_say_so():
    values, truth = drawn(12, 3, 0)
    rule = conformal_rule(scored(values, truth), [0.9, 0.95])
    assert rule.thresholds[1] == (math.inf,)
    assert rule.sets(values, 0.95).all()
    assert rule.notes == ("95 % needs 19 calibration rows, there are 12: every set is full",)
    by_class = conformal_rule(scored(values, np.repeat([0, 1, 2], 4)), [0.8, 0.9], per_class=True)
    assert by_class.notes == ("90 % needs 9 calibration rows, there are 4 for a, b, c: always in the set",)


def test_a_class_without_calibration_rows_is_always_in_the_set():
    values, _ = drawn(40, 3, 0)
    rule = conformal_rule(scored(values, np.arange(40) % 2), [0.9], per_class=True)
    assert rule.n_calibration == (20, 20, 0)
    assert rule.sets(values)[:, 2].all()


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
    kind=st.sampled_from(sorted(KINDS)),
    per_class=st.booleans(),
)
def test_a_rule_survives_json_and_pickle(values, kind, per_class):
    rule = conformal_rule(
        scored(values, np.arange(len(values)) % 3), [0.5, 0.95], kind=kind, per_class=per_class
    )
    again = ConformalRule.from_dict(json.loads(json.dumps(rule.to_dict(), allow_nan=False)))
    assert again == rule
    assert pickle.loads(pickle.dumps(rule)) == rule
    for level in rule.levels:
        assert (again.sets(values, level) == rule.sets(values, level)).all()


def test_temperature_finds_the_one_that_made_the_labels():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(20_000, 4))
    powers = np.exp(values / 0.5)
    truth = (powers.cumsum(axis=1) / powers.sum(axis=1, keepdims=True) < rng.random((20_000, 1))).sum(axis=1)
    assert fit_temperature(values, truth) == pytest.approx(0.5, rel=0.03)


def test_temperature_of_rows_that_are_all_right_or_all_the_same_is_a_number():
    assert 0 < fit_temperature(np.eye(3), np.arange(3)) < math.inf
    assert 0 < fit_temperature(np.zeros((3, 3)), np.arange(3)) < math.inf


GOOD = ConformalRule(("a", "b", "c"), "margin", (0.8, 0.9), ((0.1,), (0.2,)), (50,))


FIELDS = {name: getattr(GOOD, name) for name in GOOD.__dataclass_fields__ if name != "_limits"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": ("a", "a", "b")}, "at least 2 different names"),
        ({"kind": "votes"}, "kind must be one of 'margin'"),
        ({"levels": (0.9, 0.8)}, "levels must ascend"),
        ({"levels": (0.8, math.nan)}, "between 0 and 1"),
        ({"thresholds": ((0.1, 0.2), (0.1, 0.2))}, "thresholds must hold 1 or 3"),
        ({"thresholds": ((math.nan,), (0.2,))}, "NaN"),
        ({"n_calibration": (5, 5, 5)}, "n_calibration must hold 1"),
        ({"n_calibration": (-5,)}, "n_calibration"),
        ({"temperature": math.inf}, "temperature must be positive"),
    ],
)
def test_a_rule_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        ConformalRule(**{**FIELDS, **change})


@pytest.mark.parametrize(
    "change",
    [
        {"format": "granular-id conformal rule 2"},
        {"kind": 3},
        {"levels": [0.8, True]},
        {"thresholds": [0.1, 0.2]},
        {"thresholds": [[1e400], [0.2]]},
        {"temperature": None},
        {"n_calibration": [1.5]},
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
        (lambda: conformal_rule(drawn_rows, kind="votes"), "kind must be one of"),
        (lambda: conformal_rule(drawn_rows, []), "levels must be different"),
    ):
        with pytest.raises(ValueError, match=message):
            ask()
