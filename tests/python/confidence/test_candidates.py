"""Candidates: against their definition written anew, and how often they hold the right material."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id.confidence import CandidateRule, candidate_rule
from granular_id.confidence.candidates import behind_best, quantile

CLASSES = ("oat", "rice", "salt")


def drawn(n, seed=0, session_effect=0.0, n_sessions=5):
    """Class values (n, 3) of which the right one is larger by 1.5, less an effect of the session."""
    rng = np.random.default_rng(seed)
    sessions, truth = np.arange(n) % n_sessions, rng.integers(3, size=n)
    values = rng.normal(size=(n, 3))
    values[np.arange(n), truth] += 1.5 + session_effect * rng.normal(size=n_sessions)[sessions]
    return values, truth, sessions


@given(values=st.lists(st.floats(-50, 50), min_size=2, max_size=8))
def test_behind_best_follows_its_definition(values):
    found = behind_best(np.array(values))
    assert found.tolist() == [max(values[:k] + values[k + 1 :]) - own for k, own in enumerate(values)]


@given(scores=st.lists(st.floats(-5, 5), min_size=1, max_size=50), percent=st.integers(1, 100))
def test_quantile_is_the_exact_order_statistic(scores, percent):
    rank = min(len(scores), math.ceil(Fraction(percent, 100) * (len(scores) + 1)))
    assert quantile(np.array(scores), percent / 100) == sorted(scores)[rank - 1]


@pytest.mark.parametrize("level", [0.5, 0.9, 0.97])
@pytest.mark.parametrize("effect", [0.0, 2.0])
def test_threshold_is_that_of_the_definition(level, effect):
    values, truth, sessions = drawn(60, 1, effect)
    rule = candidate_rule(CLASSES, values, truth, sessions, level)
    own = [max(np.delete(row, k)) - row[k] for row, k in zip(values, truth, strict=True)]
    for share in [level + 0.01 * k for k in range(50) if level + 0.01 * k < 0.9901] + [0.995, 1.0]:
        covered = []
        for session in range(5):
            others = sorted(o for o, s in zip(own, sessions, strict=True) if s != session)
            limit = others[min(len(others), math.ceil((len(others) + 1) * share - 1e-9)) - 1]
            covered.append(np.mean([o <= limit for o, s in zip(own, sessions, strict=True) if s == session]))
        if np.mean(covered) >= level - 1e-9:
            break
    place = min(60, math.ceil(61 * share - 1e-9)) - 1
    assert rule.threshold == pytest.approx(sorted(own)[place])
    assert (rule.n_rows, rule.n_sessions, rule.level) == (60, 5, level)


@pytest.mark.parametrize("sure", [0.0, 6.0])  # where answers are sure, the threshold is below zero
@pytest.mark.parametrize("effect", [0.0, 2.0])
def test_shares_are_those_of_the_sets_that_are_given(effect, sure):
    values, truth, sessions = drawn(60, 1, effect)
    values[np.arange(60), truth] += sure
    rule = candidate_rule(CLASSES, values, truth, sessions, 0.9)
    shares = np.r_[np.arange(0.9, 0.9901, 0.01), 0.995, 1.0]
    own = behind_best(values)[np.arange(60), truth]
    place = int(np.argmin([abs(quantile(own, share) - rule.threshold) for share in shares]))
    held = []
    for session in range(5):
        other = replace(rule, threshold=quantile(own[sessions != session], shares[place]))
        rows = np.flatnonzero(sessions == session)
        held.append(np.mean([CLASSES[truth[k]] in other.names(values[k]) for k in rows]))
    assert (rule.mean, rule.worst) == pytest.approx((np.mean(held), min(held)))


def test_sessions_that_differ_make_larger_sets():
    values, truth, sessions = drawn(90, 3, 2.0)
    apart = candidate_rule(CLASSES, values, truth, sessions, 0.9)
    assert apart.threshold > candidate_rule(CLASSES, values, truth, None, 0.9).threshold
    assert apart.worst < apart.mean


def test_rule_without_sessions_promises_less():
    values, truth, sessions = drawn(200)
    rule = candidate_rule(CLASSES, values, truth, None, 0.9)
    assert (rule.n_sessions, rule.worst) == (0, rule.mean)
    assert rule.promise.endswith("90 % of recordings, within the sessions of the training only")
    assert candidate_rule(CLASSES, values, truth, np.zeros(200, dtype=np.intp), 0.9) == rule
    several = candidate_rule(CLASSES, values, truth, sessions, 0.9)
    assert f"in the mean over new sessions ({100 * several.mean:.0f} % in 5 held-out ones" in several.promise


def test_level_that_no_share_reaches_takes_the_largest_score():
    values = np.array([[1.0, 0.0]] * 4 + [[0.0, 1.0]])
    rule = candidate_rule(("a", "b"), values, np.zeros(5, dtype=np.intp), np.array([0, 0, 1, 1, 2]), 0.9)
    assert (rule.threshold, rule.worst) == (1.0, 0.0)
    assert rule.mean == pytest.approx(2 / 3)


RULE = CandidateRule(CLASSES, 0.9, 0.2, 62, 4, 0.91, 0.85)


def test_names_are_the_set_with_the_likeliest_first():
    values, _, _ = drawn(200, 3)
    for row, inside in zip(values, RULE.sets(values), strict=True):
        names = RULE.names(row)
        assert set(names) == {CLASSES[k] for k in np.flatnonzero(inside)} or not inside.any()
        own = [row[CLASSES.index(name)] for name in names]
        assert own == sorted(own, reverse=True)
        assert names[0] == CLASSES[row.argmax()]
        assert (RULE.sets(row) == inside).all()


def test_empty_sets_name_the_best_and_ties_share_a_set():
    sure = CandidateRule(("oat", "rice"), 0.8, -1.0, 60, 0, 0.8, 0.8)
    assert not sure.sets([0.0, 0.5]).any()
    assert sure.names([0.0, 0.5]) == ("rice",)
    assert RULE.names([1.0, 1.0, 0.0]) == ("oat", "rice")


@pytest.mark.parametrize("change", [{"format": ""}, {"threshold": math.inf}, {"classes": [1]}, {"more": 1}])
def test_damaged_rule_is_refused(change):
    (name,) = change
    with pytest.raises((ValueError, TypeError), match=name):
        CandidateRule.from_dict({**RULE.to_dict(), **change})
    if name != "more":
        with pytest.raises(ValueError, match=name):
            CandidateRule.from_dict({k: v for k, v in RULE.to_dict().items() if k != name})


@pytest.mark.parametrize("call", [RULE.sets, RULE.names])
def test_values_that_do_not_fit_are_refused(call):
    for values, message in (([0, 0], r"got \(2,\)"), ([0, 0, math.nan], "must be numbers, got NaN")):
        with pytest.raises(ValueError, match=message):
            call(values)
