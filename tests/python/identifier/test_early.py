"""Provisional and early answers: the rule is found among all, and judged by sessions that did not choose it."""

import re

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id import Identifier, extract_features
from granular_id.identifier import early
from granular_id.identifier.early import N_CHECKPOINTS, HeldOut, OverTime, calibrate
from granular_id.score import Held
from granular_id.splits import Fold, Folds

RATE = 500.0


def held_of(truth, winners, margins, sessions, by="session"):
    """Held-out answers (n, M), each session a fold of its own."""
    n, m = winners.shape
    names, folds = np.unique(sessions, return_inverse=True)
    own = [folds == k for k in range(len(names))]
    parts = Folds(
        by, tuple(Fold(np.flatnonzero(~one), np.flatnonzero(one), str(k)) for k, one in enumerate(own))
    )
    days = np.array([f"day {one}" for one in sessions], dtype=object)
    held = Held(tuple("abc"), np.arange(n), folds, truth, winners[:, -1], np.zeros((n, 3)), days, days, parts)
    return HeldOut(held, np.arange(1, m + 1), RATE, winners, margins)


def answers(rng, n, m, start, wrong_margins):
    """Answers that are right more often the later, from a share of `start` on; margins of wrong ones are smaller."""
    truth = rng.integers(0, 3, n)
    right = rng.random((n, m)) < np.linspace(start, 1.0, m)
    winners = np.where(right, truth[:, None], (truth[:, None] + 1) % 3)
    return truth, winners, np.where(right, 1.0, wrong_margins) * rng.random((n, m))


@st.composite
def held_outs(draw):
    n, m = draw(st.integers(2, 60)), draw(st.integers(1, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    truth, winners, margins = answers(rng, n, m, draw(st.floats(0.2, 1.0)), draw(st.floats(0.1, 1.5)))
    if draw(st.booleans()):
        margins = margins.round(1)  # with many equal ones
    return held_of(truth, winners, margins, rng.integers(0, draw(st.integers(1, 4)), n))


@given(held_outs(), st.sampled_from([0.02, 0.05, 0.1, 0.3]))
def test_early_answers_keep_the_target_with_one_more_error(held, target):
    rule = calibrate(held, target)
    if not rule:
        assert rule.why_not
        assert rule.table() is None
        return
    answered = np.flatnonzero(rule.stops >= 0)
    wrong = (~held.right[answered, rule.stops[answered]]).sum()
    assert (wrong + 1) / (len(answered) + 1) <= target
    assert rule.stops.max() < len(held.n_seen) - 1, "an answer at the end is not early"
    assert rule.table().tolist() == [[rule.n_seen, rule.margin]]
    assert 1 <= rule.n_seen < held.n_seen[-1]
    stored = rule.to_dict()
    assert stored["error"] == (wrong + 1) / (len(answered) + 1)
    assert stored["mean_seconds"] == pytest.approx((rule.stops[answered] + 1).mean() / RATE)


def test_session_is_answered_by_what_the_others_choose():
    winners = np.zeros((40, 5), int)
    winners[20:30, :3] = 1  # one session is right from the start, half of the other from the fourth moment on
    held = held_of(np.zeros(40, int), winners, np.full((40, 5), 0.5), np.repeat([0, 1], 20), "random")
    rule = calibrate(held, 0.6)
    assert rule.stops.tolist() == [3] * 20 + [0] * 20
    assert rule.error == 11 / 41


def test_session_that_errs_far_more_often_forbids_a_rule():
    truth, margins, sessions = np.zeros(400, int), np.ones((400, 3)), np.repeat(np.arange(20), 20)
    spread_out, in_one = np.zeros((400, 3), int), np.zeros((400, 3), int)
    spread_out[:200:20] = 1
    in_one[:10] = 1
    assert calibrate(held_of(truth, spread_out, margins, sessions), 0.15).worst == 1 / 20
    assert calibrate(held_of(truth, in_one, margins, sessions), 0.15).why_not.startswith("no rule keeps")


def test_without_sessions_none_is_the_worst():
    winners, halves = np.zeros((400, 3), int), np.repeat([0, 1], 200)
    winners[:1] = 1
    rule = calibrate(held_of(np.zeros(400, int), winners, np.ones((400, 3)), halves, "time"), 0.05)
    assert rule.worst == 1 / 400


def test_sessions_weigh_alike_in_the_error():
    """Two small sessions with 15 % of wrong answers beside two large ones that are right: (15 + 15) / 4 %."""
    sessions = np.repeat([0, 1, 2, 3], [300, 300, 20, 20])
    winners = np.zeros((640, 3), int)
    winners[[600, 601, 602, 620, 621, 622]] = 1
    held = held_of(np.zeros(640, int), winners, np.ones((640, 3)), sessions)
    assert calibrate(held, 0.09).stops.max() == 0
    assert calibrate(held, 0.07).why_not.startswith("no rule keeps the error of early answers within 7 %")


def test_rule_is_the_pair_that_answers_soonest():
    """Written anew, slowly: all pairs of a moment and a margin, on a set small enough to try each."""
    n, m = 60, 8
    truth, winners, margins = answers(np.random.default_rng(4), n, m, 0.4, 0.5)
    held = held_of(truth, winners, margins.round(1), np.zeros(n, int), "random")
    margins, right = held.margins, held.right
    target = 0.1
    options = []
    for first in range(m - 1):
        for level in np.unique(margins[:, :-1]):
            stops = [next((k for k in range(first, m - 1) if margins[i, k] >= level), -1) for i in range(n)]
            answered = [i for i in range(n) if stops[i] >= 0]
            wrong = sum(not right[i, stops[i]] for i in answered)
            waited = sum(stops[i] + 1 if stops[i] >= 0 else m for i in range(n))
            options.append((wrong, len(answered), waited, first + 1, level))
    for share in np.array([0.2, 0.1, 0.05, 0.0]) * target:
        fits = [o for o in options if o[1] and o[0] <= share * o[1]]
        best = min(o[2] for o in fits)
        tied = [o for o in fits if o[2] == best]
        if (tied[-1][0] + 1) / (tied[-1][1] + 1) <= target:
            break
    rule = calibrate(held, target)
    assert (rule.n_seen, rule.margin) == tied[-1][3:]


def constant(n, m, n_wrong=0):
    """All answers with full margin, the first `n_wrong` recordings answered wrongly all the time."""
    winners = np.repeat(np.arange(n) < n_wrong, m).reshape(n, m).astype(int)
    return held_of(np.zeros(n, int), winners, np.ones((n, m)), np.arange(n) % 3)


@pytest.mark.parametrize(
    ("held", "target", "why"),
    [
        (constant(32, 3), 0.01, "by 99 held-out recordings or more, there are 32: 3.04 % is the least"),
        (constant(40, 3, n_wrong=40), 0.1, "no rule keeps the error of early answers within 10 %"),
        (constant(40, 1), 0.1, "recordings of one sample leave nothing to wait for"),
        (constant(200, 3, n_wrong=5), 0.01, "within 1 %; one of 20 % could be reached"),
    ],
)
def test_no_rule_says_why_and_what_is_in_reach(held, target, why):
    assert calibrate(held, target).why_not.endswith(why)


@pytest.mark.parametrize("n", [30, 45, 96, 99])
def test_least_error_that_is_named_is_in_reach(n):
    held = constant(n, 3)
    least = re.search(r"([0-9.]+) % is the least", str(calibrate(held, 0.001).why_not))
    assert calibrate(held, float(least[1]) / 100)


def test_two_sessions_give_no_rule():
    held = held_of(np.zeros(40, int), np.zeros((40, 3), int), np.ones((40, 3)), np.repeat([0, 1], 20))
    assert calibrate(held, 0.1).why_not.startswith("two sessions do not show")


def provisional_scores(core, wrench, n_seen):
    """Scores (L,) after some samples: unseen raw samples at their mean, counts scaled up to the whole length."""
    spec, n, blocks = core.spec, core.n_samples, []
    if spec.raw:
        raw = core.raw_mean.reshape(core.n_axes, n).copy()
        raw[:, :n_seen] = wrench[:n_seen].T
        blocks.append(raw.ravel())
    if spec.hfmh:
        keywords = {**spec.__getnewargs_ex__()[1], "raw": False}
        blocks.append(extract_features(wrench[:n_seen], **keywords) * n / n_seen)
    return core.intercept + core.coef @ np.concatenate(blocks)


def hinge_losses(core, scores):
    """Mean hinge loss (K,) of the classes, loss-weighted."""
    codes = core.coding_matrix.astype(float)
    losses = np.maximum(0.0, 1.0 - codes * scores) / 2.0 * np.abs(codes)
    return losses.sum(axis=1) / np.abs(codes).sum(axis=1)


@pytest.mark.parametrize("space", ["raw", "hfmh", "raw+hfmh"])
def test_provisional_answers_are_those_of_the_definition(models, data, space):
    core, moments = models[space].core, [1, 7, 8, 41, 79, 80]
    winners, margins = early.provisional_answers(core, data.X[3], moments)
    for n, winner, margin in zip(moments, winners, margins, strict=True):
        losses = hinge_losses(core, provisional_scores(core, data.X[3], n))
        best, second = np.sort(losses)[:2]
        assert margin == pytest.approx(second - best, abs=1e-9)
        assert losses[winner] == pytest.approx(best, abs=1e-9)


@given(st.integers(1, 5000))
def test_checkpoints_rise_to_the_end_evenly(n_samples):
    moments = early.checkpoints(n_samples)
    assert moments[-1] == n_samples
    assert len(moments) == min(n_samples, N_CHECKPOINTS)
    steps = np.diff(np.concatenate(([0], moments)))
    assert steps.min() >= 1
    assert steps.max() - steps.min() <= 1


def test_early_rule_is_in_the_model_and_can_be_left_out(leveled, levels):
    rule = calibrate(leveled.held_, 0.3)
    assert np.array_equal(leveled.core.early, rule.table())
    assert leveled.trained["early"] == rule.to_dict()
    assert leveled.trained["early"]["target_error"] == 0.3
    without = Identifier.fit(levels, "raw+hfmh", target_error=None)
    assert without.core.early is None
    assert without.trained["early"] is None
    assert without.trained["estimate"] == leveled.trained["estimate"]


def test_over_time_counts_answers(leveled):
    course, held = leveled.over_time_, leveled.held_
    rule = calibrate(held, 0.3)
    assert course.seconds[-1] == pytest.approx(0.12)
    assert course.accuracy[-1] == pytest.approx(held.right[:, -1].mean())
    assert course.answered[-1] == pytest.approx((rule.stops >= 0).mean())
    assert (np.diff(course.answered) >= 0).all()
    n_answered = course.answered[-1] * course.n_answers
    with_one_more = (course.error[-1] * n_answered + 1) / (n_answered + 1)
    assert leveled.trained["early"]["error"] == pytest.approx(with_one_more)
    assert course.mean_seconds == leveled.trained["early"]["mean_seconds"]
    assert (course.chance, course.n_answers, course.synthetic) == (0.25, 32, False)
    first = int(np.argmax(course.answered > 0))
    assert np.isnan(course.error[:first]).all()
    assert course.to_dict()["error"][:first] == [None] * first
    assert str(course).startswith("32 answers, held-out sessions: ")
    assert "aim: at most 30 %" in str(course)


def test_figure_over_time_shows_what_was_counted(leveled):
    pytest.importorskip("matplotlib")
    from granular_id.plotting import plot_over_time

    course = leveled.over_time_
    panel = plot_over_time(course).axes[0]
    line = next(line for line in panel.lines if line.get_label() == "provisional answers right")
    assert np.array_equal(line.get_ydata(), course.accuracy)
    assert np.array_equal(line.get_xdata(), course.seconds)
    assert "held-out sessions: 32 answers" in panel.get_title()
    assert {"answered early", "of these wrong"} <= {*panel.get_legend_handles_labels()[1]}
    without = plot_over_time(OverTime.of(leveled.held_, None, synthetic=True)).axes[0]
    assert "answered early" not in without.get_legend_handles_labels()[1]
    assert "SYNTHETIC" in without.get_title()
