"""What captures refuse, and what they wait out."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from capture_cases import RATE_HZ, Line, N, capture, moving_at, run
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.robot import TimedMotion
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import ManualTrigger, MotionTrigger
from granular_id.recording import SampleFlag


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


def test_what_was_overwritten_before_the_first_row_is_nobodys_loss():
    """Between two pushes a reader may stand still for longer than the buffer: refilling takes its time."""
    line = Line.of(600)
    taker = capture(moving_at(line, 100))
    blocks = list(line.blocks([200]))
    blocks[0].missed = 17
    rows = np.concatenate([taker.feed(block) for block in blocks])
    assert np.array_equal(rows, line.wrench[50 : 50 + N])


@pytest.mark.parametrize("max_gap", [0, 2])
def test_gap_after_the_trigger(max_gap):
    line = Line.of(700).without(300, 3)
    taker = capture(moving_at(line, 200), max_gap=max_gap)
    rows = run(taker, line, cuts=[299, 305])
    assert taker.reason is FailureReason.GAP
    assert "3 samples (6 ms) are missing" in taker.text
    assert "150 of 400 rows in" in taker.text
    assert np.array_equal(rows, line.wrench[150:300])


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


@pytest.mark.parametrize("cuts", [[], range(700), [3, 310, 311]])
def test_late_rows_move_no_trigger_and_are_told(cuts):
    """Rows come in by 75 at once, the first of them 0.148 s late; the robot knows the host's clock only."""
    line = Line.of(750)
    due_ns = (5e9 + 1e9 * line.time_s).astype(np.int64)
    line.host_ns = np.repeat(due_ns[74::75], 75).astype(np.uint64)
    taker = capture(MotionTrigger(TimedMotion(int(due_ns[310]) - 800_000, 1.0)))
    assert np.array_equal(run(taker, line, cuts), line.wrench[260 : 260 + N])
    assert taker.recording().meta["late_s"] == pytest.approx(0.148)
    by_arrival = capture(
        MotionTrigger(TimedMotion(int(due_ns[310]) - 800_000, 1.0)),
        info=SourceInfo("x", RATE_HZ, device_clock=False),
        rate_tolerance=1,
    )
    run(by_arrival, line, cuts)
    assert by_arrival.trigger_time_s == line.time_s[300], "when each was measured, nobody knows"


def test_clocks_that_drift_move_no_trigger():
    line = Line.of(15_000)
    for drift in (-1e-3, -5e-5, 5e-5, 1e-3):
        due_ns = (5e9 + 1e9 * (1 + drift) * line.time_s).astype(np.int64)
        line.host_ns = due_ns.astype(np.uint64)
        taker = capture(MotionTrigger(TimedMotion(int(due_ns[14_000]) - 800_000, 1.0)))
        run(taker, line, range(0, 15_000, 100))
        assert taker.trigger_time_s == line.time_s[14_000]


def test_lag():
    line = Line.of(700)
    info = SourceInfo("x", RATE_HZ, device_clock=False)

    def fed(lags, **options):
        taker = capture(moving_at(line, 100), **{"info": info, **options})
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
    assert fed([0.3] * 35, info=None).state is CaptureState.COMPLETE, "each row bears its own time"


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


@pytest.mark.parametrize("cuts", [[], range(1000), [3, 250, 700]])
def test_a_sensor_that_stays_at_the_end_of_its_range_is_not_waited_for_for_ever(cuts):
    line = Line.of(1000)
    line.flags[:] = SampleFlag.SATURATED
    taker = capture(ManualTrigger(), timeout_s=0.5)
    run(taker, line, cuts=cuts)
    assert taker.reason is FailureReason.NO_TRIGGER
    assert taker.text.endswith(
        f"the sensor was at the end of its range at {line.time_s[249]:.3f} s of the sensor's time"
    )


def test_a_line_from_a_saturated_sample_is_no_rest():
    line = Line.of(900).without(260, 2)
    line.flags[259] = SampleFlag.SATURATED
    taker = capture(moving_at(Line.of(900), 311), max_gap=2)
    run(taker, line)
    assert taker.reason is FailureReason.SATURATION
    assert "triggered after 49 rows at rest" in taker.text, "those filled in do not count"
    allowed = capture(moving_at(Line.of(900), 300), max_gap=2, allow_saturated=True)
    run(allowed, line)
    flags = allowed.recording().flags[9:12].tolist()
    both = int(SampleFlag.SATURATED | SampleFlag.GAP_FILLED)
    assert flags == [SampleFlag.SATURATED, both, both]


def test_every_reason_is_explained():
    page = Path(__file__).parents[3] / "docs" / "live" / "recording.md"
    explained = {
        line.split("`")[1] for line in page.read_text("utf-8").splitlines() if line.startswith("| `")
    }
    assert {reason.name for reason in FailureReason} <= explained
    assert {state.name for state in CaptureState} <= explained


def test_failure_from_outside():
    taker = capture(ManualTrigger())
    taker.fail(FailureReason.SOURCE, "the source died: cable")
    taker.fail(FailureReason.GAP, "later")
    assert (taker.reason, taker.text) == (FailureReason.SOURCE, "the source died: cable")
    assert not len(taker.feed(next(iter(Line.of(10).blocks([])))))
    error = pickle.loads(pickle.dumps(CaptureError(FailureReason.GAP, "why")))
    assert (error.reason, str(error)) == (FailureReason.GAP, "why")
