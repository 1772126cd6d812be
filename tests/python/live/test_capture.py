"""Captures: which rows they take, however these come in; what they refuse, and what they wait out."""

from __future__ import annotations

import pickle
import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id.live.capture import Capture, CaptureError, CaptureState, FailureReason
from granular_id.live.robot import TimedMotion
from granular_id.live.rows import Rows, start_utc_s
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger, TimeTrigger
from granular_id.recording import SampleFlag

RATE_HZ, N, PRE_S = 500.0, 400, 0.1  # 50 rows of rest
COLUMNS = ("wrench", "time_s", "host_ns", "flags", "missing_before")
NO_CLOCK = SourceInfo("x", RATE_HZ, device_clock=False)
SATURATED = SampleFlag.SATURATED


@dataclass(frozen=True)
class Block(Rows):
    """A block as a reader returns it."""

    epoch: int = 0
    missed: int = 0


@dataclass
class Line:
    """A whole stream; faults are put in, then it is cut."""

    wrench: np.ndarray
    time_s: np.ndarray
    host_ns: np.ndarray
    flags: np.ndarray
    missing_before: np.ndarray
    epoch: np.ndarray

    @classmethod
    def of(cls, n, *, seed=0):
        rng = np.random.default_rng(seed)
        time_s = 10 + np.arange(n) / RATE_HZ
        host_ns = 5e9 + 1e9 * time_s + rng.uniform(0, 5e5, n)
        zeros = np.zeros(n, dtype=np.uint8)
        wrench = rng.normal(size=(n, 6)) * 0.02
        return cls(wrench, time_s, host_ns.astype(np.uint64), zeros, zeros.astype(np.uint32), zeros.copy())

    def without(self, at, n):
        """Lose n rows from `at` on."""
        keep = np.r_[0:at, at + n : len(self.time_s)]
        lost = Line(*(getattr(self, name)[keep] for name in (*COLUMNS, "epoch")))
        lost.missing_before[at] = n
        return lost

    def blocks(self, cuts=()):
        """Cut before these rows, and wherever an epoch ends."""
        n = len(self.time_s)
        epochs = np.flatnonzero(np.diff(self.epoch)) + 1
        for a, b in pairwise(sorted({0, n, *epochs.tolist(), *(int(c) for c in cuts if c < n)})):
            yield Block(*(getattr(self, name)[a:b] for name in COLUMNS), epoch=int(self.epoch[a]))


def run(capture, line, cuts=()):
    """Feed a stream and return the rows that the capture gave back."""
    return np.concatenate([capture.feed(block) for block in line.blocks(cuts)])


def capture(trigger, **options):
    return Capture(
        RATE_HZ, trigger=trigger, **{"n_samples": N, "pre_s": PRE_S, "utc_at_zero_s": 1.7e9, **options}
    )


def moving_at(line, row):
    """A trigger whose motion begins between a row and the one before."""
    motion = TimedMotion(0, 1.0)
    motion.start_time_s = float(line.time_s[row]) - 0.4 / RATE_HZ
    return MotionTrigger(motion)


def test_a_recording_has_the_rows_around_the_trigger_and_says_what_is_known():
    line = Line.of(1000)
    taker = capture(moving_at(line, 300))
    states, rows = [taker.state], []
    for block in line.blocks(range(0, 1000, 7)):
        rows.append(taker.feed(block))
        if taker.state is not states[-1]:
            states.append(taker.state)
    assert [state.name for state in states] == ["IDLE", "ARMING", "ARMED", "TRIGGERED", "COMPLETE"]
    recording = taker.recording("rice", session="s", name="n", meta={"robot": {"a": 1}})
    assert np.array_equal(np.concatenate(rows), line.wrench[250 : 250 + N])
    assert np.array_equal(recording.wrench, line.wrench[250 : 250 + N])
    assert (recording.trigger_index, taker.n_pre, recording.rate_hz) == (50, 50, RATE_HZ)
    assert (recording.label, recording.session, recording.name) == ("rice", "s", "n")
    assert recording.start_time == pytest.approx(1.7e9 + line.time_s[250], abs=1e-6)
    assert (taker.trigger_time_s, recording.flags) == (line.time_s[300], None)
    assert (recording.meta["robot"]["a"], recording.meta["trigger"]) == (1, "motion")
    with pytest.raises(RuntimeError, match="the capture is idle: 0 of 400 rows"):
        capture(ManualTrigger()).recording()


def trigger_of(line, row, kind):
    if kind == "motion":
        return moving_at(line, row)
    if kind == "host":
        return MotionTrigger(TimedMotion(int(line.host_ns[row]), 1.0))
    if kind == "time":
        return TimeTrigger([line.time_s[0] - 1, line.time_s[row] - 1e-4, line.time_s[row] + 0.1])
    if kind == "manual":
        trigger = ManualTrigger()
        trigger.fire(int(line.host_ns[row]))
        return trigger
    return ForceTrigger(0.5)


@settings(max_examples=25)
@given(
    cuts=st.one_of(st.lists(st.integers(1, 299), max_size=20), st.just(range(300))),
    row=st.integers(50, 150),
    kind=st.sampled_from(["motion", "host", "time", "manual", "force"]),
)
def test_pieces_do_not_matter(cuts, row, kind):
    """The same stream in any pieces: the same rows, the same recording."""
    line = Line.of(300, seed=row)
    line.wrench[row:, 0] += 3.0
    line.host_ns = np.maximum.accumulate(line.host_ns)
    whole, pieces = (capture(trigger_of(line, row, kind), n_samples=120) for _ in range(2))
    rows = run(pieces, line, cuts)
    assert np.array_equal(run(whole, line), rows)
    assert whole.recording() == pieces.recording()
    assert np.array_equal(pieces.recording().wrench, rows)


@pytest.mark.parametrize("cuts", [(), (120,), (30, 99), range(300)])
def test_rows_of_before_do_not_count_for_the_timeout(cuts):
    line = Line.of(300)
    line.host_ns = np.maximum.accumulate(line.host_ns)
    for row, reason in ((159, None), (160, FailureReason.NO_TRIGGER)):
        taker = capture(moving_at(line, row), timeout_s=60 / RATE_HZ, n_samples=120)
        taker.since_ns = int(line.host_ns[100])
        run(taker, line, cuts)
        assert taker.reason is reason


def steps_of(line, max_gap, allow_saturated):
    """What comes in, one after the other: rows (time, wrench, flags), small gaps filled, and names of faults."""
    last = None
    for k, missing in enumerate(line.missing_before.tolist()):
        row = (line.time_s[k], line.wrench[k], int(line.flags[k]))
        between = []
        if last is not None and line.epoch[k] != line.epoch[k - 1]:
            yield "restart"
        elif last is not None and missing > max_gap:
            yield "gap"
        elif last is not None:
            flags = row[2] | last[2] | SampleFlag.GAP_FILLED
            for share in np.arange(1, missing + 1) / (missing + 1):
                time_s, wrench = ((1 - share) * a + share * b for a, b in zip(last[:2], row[:2], strict=True))
                between.append((time_s, wrench, flags))
        for one in (*between, row):
            yield "saturation" if one[2] & SATURATED and not allow_saturated else one
        last = row


def row_by_row(steps, start_s, n_left):
    """Why a capture must fail, and the rows it takes: the naive twin of `Capture`."""
    rest, taken, broken = [], [], None
    for step in steps:
        fault = step if isinstance(step, str) else None
        if taken and fault:
            return fault, taken
        if taken:
            taken.append(step)
        elif n_left == 0:
            return "no trigger", []
        elif fault:
            rest, broken = [], fault
        elif step[0] < start_s:
            rest.append(step)
            broken = None if len(rest) >= 50 else broken
        elif len(rest) < 50:
            return broken or "trigger too early", []
        else:
            taken = [*rest[-50:], step]
        n_left -= fault in (None, "saturation")
        if len(taken) == 120:
            return None, taken
    raise AssertionError("the line is too short")


@settings(max_examples=100)
@given(
    start=st.integers(10, 150),
    saturated=st.sets(st.integers(0, 250), max_size=3),
    restarts=st.sets(st.integers(0, 250), max_size=1),
    gaps=st.dictionaries(st.integers(0, 25), st.integers(1, 4), max_size=2),
    cuts=st.lists(st.integers(1, 299), max_size=8),
    n_left=st.integers(60, 200),
    max_gap=st.integers(0, 3),
    allow_saturated=st.booleans(),
)
def test_a_capture_is_its_naive_twin(
    start, saturated, restarts, gaps, cuts, n_left, max_gap, allow_saturated
):
    """Faults long before the trigger are waited out, others refuse the recording; small gaps are filled."""
    line = Line.of(350)
    trigger = moving_at(line, start)
    line.flags[[40, 180]] = SampleFlag.BAD_STATUS
    line.flags[list(saturated)] = SATURATED
    for row in restarts:
        line.epoch[row:] += 1
    for tens in sorted(gaps, reverse=True):
        line = line.without(10 * tens, gaps[tens])
    taker = capture(
        trigger, n_samples=120, timeout_s=n_left / RATE_HZ, max_gap=max_gap, allow_saturated=allow_saturated
    )
    rows = run(taker, line, cuts)
    steps = steps_of(line, max_gap, allow_saturated)
    reason, taken = row_by_row(steps, trigger._motion.start_time_s, n_left)
    assert taker.reason is (None if reason is None else FailureReason(reason))
    assert np.allclose(rows, np.array([step[1] for step in taken]).reshape(-1, 6), atol=1e-15)
    assert taker.rows.flags.tolist() == [step[2] for step in taken]


def test_no_rest_wanted():
    line = Line.of(600)
    taker = capture(moving_at(line, 7), pre_s=0)
    assert np.array_equal(run(taker, line, cuts=[3, 7, 9]), line.wrench[7 : 7 + N])
    assert taker.recording().trigger_index == 0
    with pytest.raises(ValueError, match="pre_s must be above 0"):
        run(capture(ForceTrigger(), pre_s=0), line)

    class Restless(ManualTrigger):
        def arm(self, _rest):
            return "never content"

    taker = capture(Restless(), pre_s=0, timeout_s=0.5)
    run(taker, line)
    assert taker.reason is FailureReason.NO_TRIGGER


def test_start_time_comes_from_the_row_that_came_soonest():
    time_s, none = np.arange(5) / 500, np.zeros(5, np.int64)
    arrived = (7e9 + 1e9 * time_s).astype(np.int64) + np.array([300, 900, 100, 500, 800]) * 1000
    rows = Rows(np.zeros((5, 6)), time_s, arrived, none.astype(np.uint8), none)
    assert start_utc_s(rows, 1e9) == pytest.approx(1e9 + 7 + 100e-6, abs=1e-6)


def test_the_force_is_told_from_its_level_at_rest_and_the_end_of_the_last_push_is_none():
    line = Line.of(900)
    line.wrench[:, 2] += 40.0
    line.wrench[:200, 0] += np.linspace(4, 0, 200)
    line.wrench[400:, 1] -= 0.8
    assert np.array_equal(run(capture(ForceTrigger(0.5)), line), line.wrench[350 : 350 + N])


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("n_samples", 1, ValueError),
        ("n_samples", 3.5, TypeError),
        ("pre_s", -1, ValueError),
        ("pre_s", 0.8, ValueError),
        ("max_gap", -1, ValueError),
        ("rate_tolerance", float("nan"), ValueError),
        ("timeout_s", "1", TypeError),
        ("trigger", ForceTrigger, TypeError),
        ("trigger", "force", TypeError),
    ],
)
def test_bad_options_are_named(name, value, error):
    with pytest.raises(error, match=f"^{name}"):
        capture(**{"trigger": ManualTrigger(), name: value})
    with pytest.raises(ValueError, match="threshold_n must be positive"):
        ForceTrigger(0)


@pytest.mark.parametrize(("late", "reason"), [(0, None), (1, FailureReason.OVERFLOW)])
def test_overflow_fails_unless_it_was_before_the_first_row(late, reason):
    """Between two pushes a reader may stand still for longer than the buffer: refilling takes its time."""
    line = Line.of(600)
    taker = capture(moving_at(line, 100))
    blocks = list(line.blocks([200]))
    blocks[late] = replace(blocks[late], missed=17)
    rows = np.concatenate([taker.feed(block) for block in blocks])
    assert np.array_equal(rows, line.wrench[50:200] if late else line.wrench[50 : 50 + N])
    assert taker.reason is reason
    assert reason is None or taker.text.startswith("17 rows were overwritten")


def flagged(flag, *rows):
    def put(line):
        line.flags[list(rows)] = flag
        return line

    return put


@pytest.mark.parametrize(
    ("row", "fault", "text"),
    [
        (49, lambda line: line, "^triggered after 49 rows at rest, wanted 50$"),
        (
            300,
            lambda line: line.without(270, 5),
            "^triggered after 25 rows .*: 5 samples .10 ms. are missing",
        ),
        (
            300,
            lambda line: line.without(400, 3),
            "^3 samples .6 ms. are missing at 10.806 s .*150 of 400 rows in",
        ),
        (300, flagged(SATURATED, 450), "end of its range at 10.900 s"),
    ],
)
def test_a_failure_says_what_was_wrong_and_when(row, fault, text):
    full = Line.of(900)
    taker = capture(moving_at(full, row))
    run(taker, fault(full))
    with pytest.raises(CaptureError, match=text) as raised:
        taker.recording()
    assert raised.value.reason is taker.reason


@pytest.mark.parametrize("off", [0.0009, 0.0011, -0.0009, -0.0011])
@pytest.mark.parametrize("by", ["time_s", "host_ns"])
def test_the_rate_by_the_sensors_clock_or_by_arrival_where_it_has_none(by, off):
    line = Line.of(900)
    time_s = np.arange(900) / (RATE_HZ * (1 + off))
    setattr(line, by, time_s if by == "time_s" else (1e9 * time_s).astype(np.uint64))
    taker = capture(moving_at(line, 200), info=None if by == "time_s" else NO_CLOCK)
    run(taker, line)
    assert taker.reason is (None if abs(off) < 0.001 else FailureReason.RATE)
    wanted = f"measured {RATE_HZ * (1 + off):g} Hz, wanted 500 Hz within 0.1 %"
    assert taker.reason is None or taker.text == wanted


@pytest.mark.parametrize("cuts", [[], [3, 310, 311]])
def test_late_rows_move_no_trigger_and_are_told(cuts):
    """Rows come in by 75 at once, the first of them 0.148 s late; the robot knows the host's clock only."""
    line = Line.of(750)
    due_ns = (5e9 + 1e9 * line.time_s).astype(np.int64)
    line.host_ns = np.repeat(due_ns[74::75], 75).astype(np.uint64)
    trigger = MotionTrigger(TimedMotion(int(due_ns[310]) - 800_000, 1.0))
    taker = capture(trigger)
    assert np.array_equal(run(taker, line, cuts), line.wrench[260 : 260 + N])
    assert taker.recording().meta["late_s"] == pytest.approx(0.148)
    by_arrival = capture(trigger, info=NO_CLOCK, rate_tolerance=1)
    run(by_arrival, line, cuts)
    assert by_arrival.trigger_time_s == line.time_s[300], "when each was measured, nobody knows"


@pytest.mark.parametrize("drift", [-1e-3, -5e-5, 5e-5, 1e-3])
def test_clocks_that_drift_move_no_trigger(drift):
    line = Line.of(15_000)
    due_ns = (5e9 + 1e9 * (1 + drift) * line.time_s).astype(np.int64)
    line.host_ns = due_ns.astype(np.uint64)
    taker = capture(MotionTrigger(TimedMotion(int(due_ns[14_000]) - 800_000, 1.0)))
    run(taker, line, range(0, 15_000, 100))
    assert taker.trigger_time_s == line.time_s[14_000]


@pytest.mark.parametrize(
    ("lags", "options", "fails"),
    [
        ([0.0] * 35, {}, False),
        ([0.0, 0.05] * 17 + [0.0], {}, False),  # it stumbles, and recovers
        ([0.0] * 10 + [0.05] * 25, {}, True),
        ([0.0] * 10 + [0.13] + [0.0] * 24, {}, True),
        ([0.0] * 10 + [0.021] + [0.0] * 24, {"lag_patience_s": 0}, True),
        ([0.3] * 3 + [0.0] * 32, {}, False),  # nothing was recorded yet
        ([0.3] * 35, {"info": None}, False),  # each row bears its own time
    ],
)
def test_lag(lags, options, fails):
    line = Line.of(700)
    taker = capture(moving_at(line, 100), **{"info": NO_CLOCK, **options})
    cuts = np.linspace(0, 700, len(lags) + 1)[1:-1].round()
    for block, lag_s in zip(line.blocks(cuts), lags, strict=True):
        taker.feed(block, lag_s)
    assert taker.reason is (FailureReason.LAG if fails else None)
    assert not fails or "ms late; wanted at most 20 ms" in taker.text


def test_reasons_are_short_however_large_the_numbers():
    line = flagged(SATURATED, 310)(Line.of(400))
    line.time_s[300:] = 1e280 * np.arange(1, 101)
    broken = capture(moving_at(line, 100))
    run(broken, line)
    late = capture(moving_at(line, 100), info=NO_CLOCK, allow_saturated=True)
    late.feed(next(line.blocks()), lag_s=1e300)
    assert (broken.reason, late.reason) == (FailureReason.SATURATION, FailureReason.LAG)
    for text in (broken.text, late.text):
        assert re.search(r"e\+\d{3} ", text)
        assert not re.search(r"\d{18}", text)


def never_rests(line):
    line.wrench[:, 0] += 2 * np.sin(np.arange(len(line.wrench)) / 5)
    return line


@pytest.mark.parametrize("cuts", [[], [3, 249, 250, 700]])
@pytest.mark.parametrize(
    ("trigger", "fault", "text"),
    [
        (ManualTrigger, lambda line: line, "^nothing triggered within 0.5 s$"),
        (ManualTrigger, flagged(SATURATED, *range(0, 1000, 20)), "end of its range at 10.4"),
        (ManualTrigger, flagged(SATURATED, *range(1000)), "range at 10.498 s of the sensor's time$"),
        (ForceTrigger, never_rests, r"within 0.5 s; .* the force moved by 2\.?\d* N before the motion"),
    ],
)
def test_what_never_triggers_is_not_waited_for_for_ever_and_says_why(trigger, fault, text, cuts):
    taker = capture(trigger(), timeout_s=0.5)
    assert not len(run(taker, fault(Line.of(1000)), cuts))
    assert taker.reason is FailureReason.NO_TRIGGER
    assert re.search(text, taker.text)


def test_an_empty_block_changes_nothing_and_the_first_failure_from_outside_stays():
    taker = capture(ManualTrigger())
    assert taker.feed(Block(*(getattr(Rows.none(), name) for name in COLUMNS))).shape == (0, 6)
    assert taker.state is CaptureState.ARMING
    taker.fail(FailureReason.SOURCE, "the source died: cable")
    taker.fail(FailureReason.GAP, "later")
    assert (taker.reason, taker.text) == (FailureReason.SOURCE, "the source died: cable")
    assert not len(taker.feed(next(Line.of(10).blocks())))
    error = pickle.loads(pickle.dumps(CaptureError(FailureReason.GAP, "why")))
    assert (error.reason, str(error)) == (FailureReason.GAP, "why")
