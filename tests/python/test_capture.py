"""Captures: which rows they take, and what they refuse."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture_cases import RATE_HZ, Block, Line, run
from granular_id.live.capture import Capture
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.clock import start_utc_s
from granular_id.live.robot import TimedMotion
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger, TimeTrigger
from granular_id.recording import SampleFlag

N = 400
PRE_S = 0.1  # 50 rows


class Motion(TimedMotion):
    def __init__(self, start_time_s):
        super().__init__(0, 1.0)
        self.start_time_s = start_time_s


def capture(trigger, **options):
    return Capture(
        RATE_HZ, **{"n_samples": N, "pre_s": PRE_S, "trigger": trigger, "utc_at_zero_s": 1.7e9, **options}
    )


def moving_at(line, row):
    """A trigger whose motion begins between a row and the one before."""
    return MotionTrigger(Motion(float(line.time_s[row]) - 0.4 / RATE_HZ))


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
    assert recording.label, recording.session == ("rice", "s")
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


@pytest.mark.parametrize(("row", "reason"), [(0, "trigger too early"), (49, "trigger too early"), (50, None)])
def test_trigger_before_the_rest_is_there(row, reason):
    line = Line.of(600)
    taker = capture(moving_at(line, row))
    rows = run(taker, line, cuts=[20, 33])
    if reason is None:
        assert taker.state is CaptureState.COMPLETE
        assert np.array_equal(rows, line.wrench[:N])
    else:
        assert taker.reason is FailureReason(reason)
        assert taker.text == f"triggered after {row} rows at rest, wanted 50"
        assert not len(rows)
        with pytest.raises(CaptureError, match="wanted 50") as raised:
            taker.recording()
        assert raised.value.reason is FailureReason(reason)


def test_no_rest_wanted():
    line = Line.of(600)
    taker = capture(moving_at(line, 7), pre_s=0)
    rows = run(taker, line, cuts=[3, 7, 9])
    assert np.array_equal(rows, line.wrench[7 : 7 + N])
    assert taker.recording().trigger_index == 0


def test_overflow():
    line = Line.of(600)
    taker = capture(moving_at(line, 100))
    blocks = list(line.blocks([200]))
    taker.feed(blocks[0])
    assert taker.state is CaptureState.TRIGGERED
    blocks[1].missed = 17
    assert not len(taker.feed(blocks[1]))
    assert (taker.state, taker.reason) == (CaptureState.FAILED, FailureReason.OVERFLOW)
    assert taker.text.startswith("17 rows were overwritten")


@pytest.mark.parametrize("max_gap", [0, 2])
def test_gap_after_the_trigger(max_gap):
    line = Line.of(700).without(300, 3)
    taker = capture(moving_at(line, 200), max_gap=max_gap)
    rows = run(taker, line, cuts=[299, 305])
    assert taker.reason is FailureReason.GAP
    assert "3 samples (6 ms) are missing" in taker.text
    assert "150 of 400 rows in" in taker.text
    assert np.array_equal(rows, line.wrench[150:300])


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


def test_gap_at_rest_begins_the_rest_anew():
    line = Line.of(900).without(100, 5)
    taker = capture(moving_at(line, 300))
    rows = run(taker, line, cuts=[100])
    assert taker.state is CaptureState.COMPLETE
    assert np.array_equal(rows, line.wrench[250 : 250 + N])


def test_gap_shortly_before_the_trigger():
    line = Line.of(900).without(270, 5)
    taker = capture(moving_at(line, 300))
    run(taker, line)
    assert taker.reason is FailureReason.GAP
    assert taker.text.startswith("triggered after 30 rows at rest, wanted 50: 5 samples (10 ms) are missing")


def test_what_is_missing_before_the_first_row_is_nobodys_loss():
    line = Line.of(700)
    line.missing_before[0] = 9
    taker = capture(moving_at(line, 50))
    run(taker, line)
    assert taker.state is CaptureState.COMPLETE


@pytest.mark.parametrize("row", [180, 200, 350])
def test_saturation(row):
    line = Line.of(700)
    line.flags[row] = SampleFlag.SATURATED
    taker = capture(moving_at(line, 200))
    run(taker, line, cuts=[row, row + 1])
    assert taker.reason is FailureReason.SATURATION
    assert f"at {line.time_s[row]:.3f} s" in taker.text
    allowed = capture(moving_at(line, 200), allow_saturated=True)
    run(allowed, line)
    assert allowed.recording().flags[row - 150] == SampleFlag.SATURATED


def test_saturation_long_before_the_trigger():
    line = Line.of(700)
    line.flags[100:103] = SampleFlag.SATURATED
    taker = capture(moving_at(line, 200))
    run(taker, line)
    assert taker.state is CaptureState.COMPLETE


@pytest.mark.parametrize(("row", "reason"), [(100, None), (180, "restart"), (350, "restart")])
def test_restart(row, reason):
    line = Line.of(800)
    line.epoch[row:] = 1
    taker = capture(moving_at(line, 200))
    run(taker, line)
    assert taker.reason is (None if reason is None else FailureReason(reason))
    if reason is not None:
        assert "time began anew" in taker.text


def test_bad_status_is_kept_and_flagged():
    line = Line.of(700)
    line.flags[300] = SampleFlag.BAD_STATUS
    taker = capture(moving_at(line, 200))
    run(taker, line)
    assert taker.recording().flags[150] == SampleFlag.BAD_STATUS


@pytest.mark.parametrize(
    ("off", "good"), [(0.0009, True), (0.0011, False), (-0.0009, True), (-0.0011, False)]
)
def test_rate(off, good):
    line = Line.of(900)
    line.time_s = line.time_s[0] + np.arange(900) / (RATE_HZ * (1 + off))
    taker = capture(moving_at(line, 200))
    run(taker, line)
    assert taker.reason is (None if good else FailureReason.RATE)
    if not good:
        assert "wanted 500 Hz within 0.1 %" in taker.text


def test_rate_without_a_device_clock_is_measured_by_arrival():
    line = Line.of(900)
    line.host_ns = (1e9 * np.arange(900) / 480).astype(np.uint64)
    taker = capture(moving_at(line, 200), info=SourceInfo("x", RATE_HZ, device_clock=False))
    run(taker, line)
    assert taker.reason is FailureReason.RATE
    assert "measured 480 Hz" in taker.text


def test_lag():
    line = Line.of(700)

    def fed(lags, **options):
        taker = capture(moving_at(line, 100), **options)
        cuts = np.linspace(0, 700, len(lags) + 1)[1:-1].round()
        for block, lag_s in zip(line.blocks(cuts), lags, strict=True):
            taker.feed(block, lag_s)
        return taker

    assert fed([0.0] * 35).state is CaptureState.COMPLETE
    assert fed([0.0, 0.05] * 17 + [0.0]).state is CaptureState.COMPLETE, "it stumbles, and recovers"
    late = fed([0.0] * 10 + [0.05] * 25)
    assert late.reason is FailureReason.LAG
    assert "50 ms late; wanted at most 20 ms" in late.text
    assert fed([0.0] * 10 + [0.13] + [0.0] * 24).reason is FailureReason.LAG
    assert fed([0.0] * 10 + [0.021] + [0.0] * 24, lag_patience_s=0).reason is FailureReason.LAG
    assert fed([0.3] * 3 + [0.0] * 32).state is CaptureState.COMPLETE, "nothing was recorded yet"


def test_nothing_triggers():
    line = Line.of(700)
    taker = capture(ManualTrigger(), timeout_s=0.5)
    run(taker, line, cuts=[100, 249])
    assert taker.reason is FailureReason.NO_TRIGGER
    assert taker.text == "nothing triggered within 0.5 s"
    late = capture(moving_at(line, 251), timeout_s=0.5)
    run(late, line)
    assert late.reason is FailureReason.NO_TRIGGER
    just = capture(moving_at(line, 249), timeout_s=0.5)
    run(just, line)
    assert just.state is CaptureState.COMPLETE


def test_a_sensor_that_is_never_at_rest_says_why():
    line = Line.of(700)
    line.flags[::20] = SampleFlag.SATURATED
    taker = capture(ManualTrigger(), timeout_s=0.5)
    run(taker, line)
    assert taker.reason is FailureReason.NO_TRIGGER
    assert "the sensor was at the end of its range at" in taker.text


def test_failure_from_outside():
    taker = capture(ManualTrigger())
    taker.fail(FailureReason.SOURCE, "the source died: cable")
    taker.fail(FailureReason.GAP, "later")
    assert (taker.reason, taker.text) == (FailureReason.SOURCE, "the source died: cable")
    assert not len(taker.feed(next(iter(Line.of(10).blocks([])))))
    error = pickle.loads(pickle.dumps(CaptureError(FailureReason.GAP, "why")))
    assert (error.reason, str(error)) == (FailureReason.GAP, "why")


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


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"n_samples": 1}, ValueError, "n_samples must be at least 2, got 1"),
        ({"n_samples": 3.5}, TypeError, "n_samples must be a whole number"),
        ({"pre_s": -1}, ValueError, "pre_s must not be negative"),
        ({"pre_s": 0.8}, ValueError, "pre_s=0.8 is 400 rows at 500 Hz, of n_samples=400 in all"),
        ({"max_gap": -1}, ValueError, "max_gap must be at least 0"),
        ({"rate_tolerance": float("nan")}, ValueError, "rate_tolerance must be finite"),
        ({"timeout_s": "1"}, TypeError, "timeout_s must be a real number"),
    ],
)
def test_bad_options(options, error, match):
    with pytest.raises(error, match=match):
        capture(ManualTrigger(), **options)


def test_bad_threshold():
    with pytest.raises(ValueError, match="threshold_n must be positive"):
        ForceTrigger(0)
