"""Captures: which rows they take, however these come in; what they refuse, and what they wait out."""

import pickle
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id.live import CaptureError, FailureReason, ForceTrigger, ManualTrigger, MotionTrigger
from granular_id.live.capture import Capture
from granular_id.live.limits import Limits
from granular_id.live.robot import TimedMotion
from granular_id.live.rows import Rows, start_utc_s
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import TimeTrigger
from granular_id.recording import SampleFlag

RATE_HZ, N, PRE_S = 500.0, 400, 0.1  # 50 rows of rest
COLUMNS = ("wrench", "time_s", "host_ns", "flags", "missing_before")
CLOCK, NO_CLOCK = (SourceInfo("x", RATE_HZ, device_clock=clock) for clock in (True, False))
SATURATED, BAD = SampleFlag.SATURATED, SampleFlag.BAD_STATUS


@dataclass(frozen=True)
class Block(Rows):
    """A block as a reader returns it."""

    epoch: int = 0
    missed: int = 0


class Line:
    """A whole stream; faults are put in, then it is cut."""

    def __init__(self, n, *, seed=0):
        rng = np.random.default_rng(seed)
        self.time_s = 10 + np.arange(n) / RATE_HZ
        arrived_ns = 5e9 + 1e9 * self.time_s + rng.uniform(0, 5e5, n)
        self.host_ns = np.maximum.accumulate(arrived_ns).astype(np.uint64)
        self.wrench = rng.normal(size=(n, 6)) * 0.02
        self.flags, self.missing_before, self.epoch = np.zeros((3, n), dtype=np.uint8)

    def lose(self, at, n):
        """Lose n rows from `at` on."""
        keep = np.r_[0:at, at + n : len(self.time_s)]
        for name in (*COLUMNS, "epoch"):
            setattr(self, name, getattr(self, name)[keep])
        self.missing_before[at] = n

    def blocks(self, cuts=()):
        """Cut before these rows, and wherever an epoch ends."""
        n = len(self.time_s)
        epochs = np.flatnonzero(np.diff(self.epoch)) + 1
        for a, b in pairwise(sorted({0, n, *epochs.tolist(), *(int(c) for c in cuts if c < n)})):
            yield Block(*(getattr(self, name)[a:b] for name in COLUMNS), epoch=int(self.epoch[a]))


def run(capture, line, cuts=()):
    """Feed a stream and return the rows that the capture gave back."""
    return np.concatenate([capture.feed(block) for block in line.blocks(cuts)])


def capture(trigger, *, info=CLOCK, n_samples=N, pre_s=PRE_S, since_ns=0, **limits):
    options = {"n_samples": n_samples, "pre_s": pre_s, "since_ns": since_ns, "utc_at_zero_s": 1.7e9}
    return Capture(info, trigger, Limits(**limits), **options)


def moving_at(line, row, *, host_ns=0):
    """A trigger whose motion begins between a row and the one before, or at a time of the host's."""
    motion = TimedMotion(host_ns, 1.0)
    motion.start_time_s = None if host_ns else float(line.time_s[row]) - 0.4 / RATE_HZ
    trigger = MotionTrigger()
    trigger.follow(motion)
    return trigger


def test_recording_rows_around_the_trigger_and_facts():
    line = Line(1000)
    taker = capture(moving_at(line, 300))
    states = [taker.state]
    for block in line.blocks(range(0, 1000, 7)):
        taker.feed(block)
        states += [taker.state] * (taker.state is not states[-1])
    assert [state.name for state in states] == ["IDLE", "ARMING", "ARMED", "TRIGGERED", "COMPLETE"]
    recording = taker.recording("rice", session="s", name="n", meta={"robot": {"a": 1}})
    assert np.array_equal(recording.wrench, line.wrench[250 : 250 + N])
    assert (recording.trigger_index, taker.n_pre, recording.rate_hz) == (50, 50, RATE_HZ)
    assert (recording.label, recording.session, recording.name) == ("rice", "s", "n")
    assert recording.start_time == pytest.approx(1.7e9 + line.time_s[250], abs=1e-6)
    assert (taker.trigger_time_s, recording.flags) == (line.time_s[300], None)
    assert (recording.meta["robot"]["a"], recording.meta["trigger"]) == (1, "motion")


def trigger_of(line, row, kind):
    if kind == "time":
        return TimeTrigger([line.time_s[0] - 1, line.time_s[row] - 1e-4, line.time_s[row] + 0.1])
    if kind == "manual":
        trigger = ManualTrigger()
        trigger._fired_ns = int(line.host_ns[row])
        return trigger
    if kind == "force":
        return ForceTrigger(0.5)
    return moving_at(line, row, host_ns=int(line.host_ns[row]) if kind == "host" else 0)


@settings(max_examples=25)
@given(
    cuts=st.one_of(st.lists(st.integers(1, 299), max_size=20), st.just(range(300))),
    row=st.integers(50, 150),
    kind=st.sampled_from(["motion", "host", "time", "manual", "force"]),
)
def test_recording_in_any_pieces_is_the_same(cuts, row, kind):
    line = Line(300, seed=row)
    line.wrench[row:, 0] += 3.0
    whole, pieces = (capture(trigger_of(line, row, kind), n_samples=120) for _ in range(2))
    rows = run(pieces, line, cuts)
    assert np.array_equal(run(whole, line), rows)
    assert whole.recording() == pieces.recording()
    assert np.array_equal(pieces.recording().wrench, rows)


@pytest.mark.parametrize("cuts", [(), (120,), (30, 99), range(300)])
@pytest.mark.parametrize(("row", "reason"), [(159, None), (160, FailureReason.NO_TRIGGER)])
def test_timeout_counts_no_rows_of_before(cuts, row, reason):
    line = Line(300)
    since_ns = int(line.host_ns[100])
    taker = capture(moving_at(line, row), since_ns=since_ns, timeout_s=60 / RATE_HZ, n_samples=120)
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
            saturated = one[2] & SATURATED and not allow_saturated
            yield "saturation" if saturated else "status" if one[2] & BAD else one
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
        n_left -= fault in (None, "saturation", "status")
        if len(taken) == 120:
            return None, taken
    raise AssertionError("the line is too short")


@settings(max_examples=100)
@given(
    start=st.integers(10, 150),
    saturated=st.sets(st.integers(0, 250), max_size=3),
    bad=st.sets(st.integers(0, 250), max_size=1),
    restarts=st.sets(st.integers(0, 250), max_size=1),
    gaps=st.dictionaries(st.integers(0, 25), st.integers(1, 4), max_size=2),
    cuts=st.lists(st.integers(1, 299), max_size=8),
    n_left=st.integers(60, 200),
    max_gap=st.integers(0, 3),
    allow_saturated=st.booleans(),
)
def test_capture_is_its_naive_twin(
    start, saturated, bad, restarts, gaps, cuts, n_left, max_gap, allow_saturated
):
    line = Line(350)
    trigger = moving_at(line, start)
    line.flags[list(bad)] = BAD
    line.flags[list(saturated)] = SATURATED
    for row in restarts:
        line.epoch[row:] += 1
    for tens in sorted(gaps, reverse=True):
        line.lose(10 * tens, gaps[tens])
    limits = {"timeout_s": n_left / RATE_HZ, "max_gap": max_gap, "allow_saturated": allow_saturated}
    taker = capture(trigger, n_samples=120, **limits)
    rows = run(taker, line, cuts)
    steps = steps_of(line, max_gap, allow_saturated)
    reason, taken = row_by_row(steps, trigger._motion.start_time_s, n_left)
    assert taker.reason is (None if reason is None else FailureReason(reason))
    if reason:
        with pytest.raises(CaptureError) as raised:
            taker.recording()
        assert pickle.loads(pickle.dumps(raised.value)).reason is taker.reason
    assert np.allclose(rows, np.array([step[1] for step in taken]).reshape(-1, 6), atol=1e-15)
    assert taker.rows.flags.tolist() == [step[2] for step in taken]


def test_capture_without_rest_begins_at_the_trigger():
    line = Line(600)
    taker = capture(moving_at(line, 7), pre_s=0)
    assert np.array_equal(run(taker, line, cuts=[3, 7, 9]), line.wrench[7 : 7 + N])
    assert taker.recording().trigger_index == 0


def test_start_time_comes_from_the_row_that_came_soonest():
    time_s, none = np.arange(5) / 500, np.zeros(5, np.int64)
    arrived = (7e9 + 1e9 * time_s).astype(np.int64) + np.array([300, 900, 100, 500, 800]) * 1000
    rows = Rows(np.zeros((5, 6)), time_s, arrived, none.astype(np.uint8), none)
    assert start_utc_s(rows, 1e9) == pytest.approx(1e9 + 7 + 100e-6, abs=1e-6)


def test_force_trigger_level_is_the_rest_not_the_last_push():
    line = Line(900)
    line.wrench[:, 2] += 40.0
    line.wrench[:200, 0] += np.linspace(4, 0, 200)
    line.wrench[400:, 1] -= 0.8
    assert np.array_equal(run(capture(ForceTrigger(0.5)), line), line.wrench[350 : 350 + N])


REFUSED = {"n_samples": 1, "pre_s": 0.8, "max_gap": -1, "timeout_s": "1", "absolute": 1}


@pytest.mark.parametrize(("name", "value"), [*REFUSED.items(), ("trigger", ForceTrigger)])
def test_capture_refused_argument_is_named(name, value):
    with pytest.raises((TypeError, ValueError), match=f"^{name}"):
        capture(**{"trigger": ManualTrigger(), name: value})


def test_first_reason_of_a_failure_counts():
    taker = capture(ManualTrigger())
    taker.fail(FailureReason.GAP, "first")
    taker.fail(FailureReason.SOURCE, "second", complete=True)
    assert (taker.reason, taker.text) == (FailureReason.GAP, "first")


@pytest.mark.parametrize(("late", "reason"), [(0, None), (1, FailureReason.OVERFLOW)])
def test_overflow_fails_unless_before_the_first_row(late, reason):
    line = Line(600)
    taker, blocks = capture(moving_at(line, 100)), list(line.blocks([200]))
    blocks[late] = replace(blocks[late], missed=17)
    rows = np.concatenate([taker.feed(block) for block in blocks])
    assert np.array_equal(rows, line.wrench[50:200] if late else line.wrench[50 : 50 + N])
    assert taker.reason is reason


@pytest.mark.parametrize("off", [0.0009, 0.0011, -0.0009, -0.0011])
@pytest.mark.parametrize("by", ["time_s", "host_ns"])
def test_rate_by_the_sensors_clock_or_else_by_arrival(by, off):
    line = Line(900)
    time_s = np.arange(900) / (RATE_HZ * (1 + off))
    setattr(line, by, time_s if by == "time_s" else (1e9 * time_s).astype(np.uint64))
    taker = capture(moving_at(line, 200), info=CLOCK if by == "time_s" else NO_CLOCK)
    run(taker, line)
    assert taker.reason is (None if abs(off) < 0.001 else FailureReason.RATE)


@pytest.mark.parametrize("cuts", [[], [3, 310, 311]])
def test_late_rows_move_no_trigger_and_are_noted(cuts):
    """Rows come in by 75 at once, the first of them 0.148 s late; the robot knows the host's clock only."""
    line = Line(750)
    due_ns = (5e9 + 1e9 * line.time_s).astype(np.int64)
    line.host_ns = np.repeat(due_ns[74::75], 75).astype(np.uint64)
    trigger = moving_at(line, 310, host_ns=int(due_ns[310]) - 800_000)
    taker = capture(trigger)
    assert np.array_equal(run(taker, line, cuts), line.wrench[260 : 260 + N])
    assert taker.recording().meta["late_s"] == pytest.approx(0.148)
    by_arrival = capture(trigger, info=NO_CLOCK, rate_tolerance=1)
    run(by_arrival, line, cuts)
    assert by_arrival.trigger_time_s == line.time_s[300], "when each was measured, nobody knows"


@pytest.mark.parametrize("drift", [-1e-3, 0.0, 5e-5, 1e-3])
def test_clocks_that_drift_or_restart_move_no_trigger(drift):
    line = Line(15_000)
    due_ns = (5e9 + 1e9 * (1 + drift) * line.time_s).astype(np.int64)
    line.host_ns = due_ns.astype(np.uint64)
    if not drift:
        line.epoch[100:] += 1
        line.time_s[100:] -= 5.0
    taker = capture(moving_at(line, 14_000, host_ns=int(due_ns[14_000]) - 800_000))
    run(taker, line, range(0, 15_000, 100))
    assert taker.trigger_time_s == line.time_s[14_000]


@pytest.mark.parametrize(
    ("lags", "info", "fails"),
    [
        ([0.0] * 35, NO_CLOCK, False),
        ([0.0, 0.05] * 17 + [0.0], NO_CLOCK, False),  # it stumbles, and recovers
        ([0.0] * 10 + [0.05] * 25, NO_CLOCK, True),
        ([0.0] * 10 + [0.13] + [0.0] * 24, NO_CLOCK, True),
        ([0.3] * 3 + [0.0] * 32, NO_CLOCK, False),  # nothing was recorded yet
        ([0.3] * 35, CLOCK, False),  # each row bears its own time
    ],
)
def test_lag_that_lasts_fails_rows_without_a_time(lags, info, fails):
    line = Line(700)
    taker = capture(moving_at(line, 100), info=info)
    cuts = np.linspace(0, 700, len(lags) + 1)[1:-1].round()
    for block, lag_s in zip(line.blocks(cuts), lags, strict=True):
        taker.feed(block, lag_s)
    assert taker.reason is (FailureReason.LAG if fails else None)


def test_jitter_and_lateness_are_those_of_the_delays():
    line, trigger = Line(100), ManualTrigger()
    trigger._fired_ns = 0
    delays_s = np.random.default_rng(0).uniform(0, 0.004, 100)
    line.host_ns = (1e9 * (5 + 1.00005 * line.time_s + delays_s)).astype(np.uint64)  # a clock that drifts
    taker = capture(trigger, n_samples=100, pre_s=0)
    assert taker.timing is None
    run(taker, line)
    wanted = {"rate_hz": RATE_HZ, "jitter_s": delays_s.std(), "late_s": np.ptp(delays_s)}
    assert taker.timing == pytest.approx(wanted, rel=0.05)
