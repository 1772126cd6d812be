"""Captures: which rows they take, however these come in."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from capture_cases import RATE_HZ, Block, Line, N, capture, moving_at, run
from granular_id.live.capture_state import CaptureState, FailureReason
from granular_id.live.clock import start_utc_s
from granular_id.live.robot import TimedMotion
from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger, TimeTrigger
from granular_id.recording import SampleFlag


def test_rows_are_those_around_the_trigger():
    line = Line.of(1000)
    taker = capture(moving_at(line, 300))
    rows = run(taker, line, cuts=range(0, 1000, 7))
    assert taker.state is CaptureState.COMPLETE
    assert np.array_equal(rows, line.wrench[250 : 250 + N])
    recording = taker.recording("rice", session="s", name="n", meta={"robot": {"a": 1}})
    assert np.array_equal(recording.wrench, rows)
    assert recording.trigger_index == taker.n_pre == 50
    assert recording.rate_hz == RATE_HZ
    assert (recording.label, recording.session, recording.name) == ("rice", "s", "n")
    assert recording.start_time == pytest.approx(1.7e9 + line.time_s[250], abs=1e-6)
    assert taker.trigger_time_s == line.time_s[300]
    assert recording.flags is None
    assert recording.meta["robot"]["a"] == 1
    assert recording.meta["trigger"] == "motion"


def triggers(line, row, kind):
    if kind == "motion":
        return moving_at(line, row)
    if kind == "host":
        motion = TimedMotion(int(line.host_ns[row]), 1.0)
        return MotionTrigger(motion)
    if kind == "time":
        return TimeTrigger([line.time_s[0] - 1, line.time_s[row] - 1e-4, line.time_s[row] + 0.1])
    if kind == "manual":
        trigger = ManualTrigger()
        trigger.fire(int(line.host_ns[row]))
        return trigger
    return ForceTrigger(0.5)


@settings(max_examples=60)
@given(
    cuts=st.lists(st.integers(1, 999), max_size=60),
    row=st.integers(50, 600),
    kind=st.sampled_from(["motion", "host", "time", "manual", "force"]),
    gap=st.one_of(st.none(), st.integers(60, 640)),
    max_gap=st.integers(0, 3),
)
def test_pieces_do_not_matter(cuts, row, kind, gap, max_gap):
    """The same stream in any pieces: the same rows, the same recording, the same failure."""
    line = Line.of(1000, seed=row)
    line.wrench[row:, 0] += 3.0
    line.host_ns = np.maximum.accumulate(line.host_ns)
    if gap is not None:
        line = line.without(gap, 2)
    whole = capture(triggers(line, row, kind), max_gap=max_gap)
    pieces = capture(triggers(line, row, kind), max_gap=max_gap)
    all_rows, rows = run(whole, line), run(pieces, line, cuts)
    assert (whole.state, whole.reason, whole.text) == (pieces.state, pieces.reason, pieces.text)
    assert whole.state.is_over
    if whole.state is CaptureState.COMPLETE:
        assert whole.recording() == pieces.recording()
        assert np.array_equal(all_rows, rows)
        assert np.array_equal(pieces.recording().wrench, rows)


def test_one_row_at_a_time():
    line = Line.of(700)
    taker = capture(moving_at(line, 200))
    rows = run(taker, line, cuts=range(700))
    assert np.array_equal(rows, line.wrench[150 : 150 + N])


def test_no_rest_wanted():
    line = Line.of(600)
    taker = capture(moving_at(line, 7), pre_s=0)
    rows = run(taker, line, cuts=[3, 7, 9])
    assert np.array_equal(rows, line.wrench[7 : 7 + N])
    assert taker.recording().trigger_index == 0


@pytest.mark.parametrize("cut", [299, 300, 301])
def test_gap_that_may_be_filled(cut):
    full = Line.of(700)
    line = full.without(300, 3)
    taker = capture(moving_at(full, 200), max_gap=3)
    rows = run(taker, line, cuts=[cut])
    assert taker.state is CaptureState.COMPLETE
    recording = taker.recording()
    share = np.arange(1, 4)[:, np.newaxis] / 4
    line_between = full.wrench[299] + share * (full.wrench[303] - full.wrench[299])
    assert np.allclose(rows[150:153], line_between, atol=1e-15)
    assert np.flatnonzero(recording.flags).tolist() == [150, 151, 152]
    assert set(recording.flags[150:153]) == {SampleFlag.GAP_FILLED}
    assert np.array_equal(rows[153:], full.wrench[303 : 150 + N])
    assert recording.n_samples == N


def test_states_in_order():
    line = Line.of(700)
    taker = capture(moving_at(line, 100))
    seen = [taker.state]
    for block in line.blocks(range(0, 700, 10)):
        taker.feed(block)
        if taker.state is not seen[-1]:
            seen.append(taker.state)
    assert [state.name for state in seen] == ["IDLE", "ARMING", "ARMED", "TRIGGERED", "COMPLETE"]
    with pytest.raises(RuntimeError, match="the capture is idle: 0 of 400 rows"):
        capture(ManualTrigger()).recording()


def test_an_empty_block_changes_nothing():
    taker = capture(ManualTrigger())
    empty = Block(np.zeros((0, 6)), *(np.zeros(0, dtype=t) for t in (float, "u8", "u1", "u4")))
    assert taker.feed(empty).shape == (0, 6)
    assert taker.state is CaptureState.ARMING


def test_start_time_comes_from_the_row_that_came_soonest():
    time_s = np.arange(5) / 500
    late_ns = np.array([300, 900, 100, 500, 800]) * 1000
    arrived = (7e9 + 1e9 * time_s).astype(np.int64) + late_ns
    assert start_utc_s(time_s, arrived, 1e9) == pytest.approx(1e9 + 7 + 100e-6, abs=1e-6)


def test_force_trigger_is_relative_to_the_rest():
    line = Line.of(900)
    line.wrench[:, 2] += 40.0
    line.wrench[400:, 1] -= 0.8
    taker = capture(ForceTrigger(0.5))
    rows = run(taker, line, cuts=[123])
    assert np.array_equal(rows, line.wrench[350 : 350 + N])
    with pytest.raises(ValueError, match="pre_s must be above 0"):
        run(capture(ForceTrigger(), pre_s=0), line)


@pytest.mark.parametrize("cuts", [[], range(900), [7, 333, 334]])
def test_the_end_of_the_last_push_is_no_rest(cuts):
    """The force of a push that still goes on is not taken for the level at rest, however rows come in."""
    line = Line.of(900)
    line.wrench[:200, 0] += np.linspace(4, 0, 200)
    line.wrench[400:, 1] -= 0.8
    rows = run(capture(ForceTrigger(0.5)), line, cuts=cuts)
    assert np.array_equal(rows, line.wrench[350 : 350 + N])


def test_a_tool_that_never_rests_is_waited_for_and_told_of():
    line = Line.of(2000)
    line.wrench[:, 0] += 2 * np.sin(np.arange(2000) / 5)
    taker = capture(ForceTrigger(0.5), timeout_s=1)
    assert len(run(taker, line, cuts=[3])) == 0
    assert taker.reason is FailureReason.NO_TRIGGER
    assert re.search(r"within 1 s; .* the force moved by 2\.?\d* N before the motion", taker.text)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"n_samples": 1}, ValueError, "n_samples must be at least 2, got 1"),
        ({"n_samples": 3.5}, TypeError, "n_samples must be a whole number"),
        ({"pre_s": -1}, ValueError, "pre_s must not be negative"),
        ({"pre_s": 0.8}, ValueError, "pre_s=0.8 is 400 rows at 500 Hz, of n_samples=400 in all"),
        ({"max_gap": -1}, ValueError, "max_gap must be at least 0"),
        ({"rate_tolerance": float("nan")}, ValueError, "rate_tolerance must be finite"),
        ({"timeout_s": "1"}, TypeError, "timeout_s must be a number"),
    ],
)
def test_bad_options(options, error, match):
    with pytest.raises(error, match=match):
        capture(ManualTrigger(), **options)


def test_a_kind_of_trigger_is_none():
    for wrong in (ForceTrigger, "force", None):
        with pytest.raises(TypeError, match=r"trigger must be a trigger like ForceTrigger\(\), got"):
            capture(wrong)


def test_bad_threshold():
    with pytest.raises(ValueError, match="threshold_n must be positive"):
        ForceTrigger(0)
