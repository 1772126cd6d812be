"""Limits of force and torque: every sample is held against them, and the robot is stopped before anything else."""

from __future__ import annotations

import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from cli_cases import refused
from granular_id._core import host_ns
from granular_id.live import (
    CallbackRobot,
    Capture,
    CaptureError,
    FailureReason,
    LiveIdentifier,
    ManualTrigger,
    MotionTrigger,
    Recorder,
    SimSource,
    SourceInfo,
    WrenchBuffer,
    opened,
)
from granular_id.live.capture import CaptureState
from granular_id.live.drive import drive
from granular_id.live.robot import TimedMotion
from granular_id.live.source import Health
from live_view_cases import pushes_and_model

RATE_HZ, N, REST = 500.0, 100, 20
INFO = SourceInfo("bench", RATE_HZ, device_clock=True)
BEYOND = np.array([30.0, -40.0, 0.0, 0.0, 0.0, 0.0])
TOO_MUCH = r"force of 50 N at {} s of the sensor's time, the limit is 49 N"


class Bench:
    """A stream whose rows are written by the test."""

    def __init__(self):
        self.buffer = WrenchBuffer(10.0, rate_hz=RATE_HZ)
        self.info, self.source = INFO, self
        self.utc_at_zero_s, self.pause_s = None, 0.0
        self.n_rows = 0

    def lag_s(self):
        return 0.0

    def health(self):
        return Health(True, None, False, {})

    def write(self, n, **beyond):
        """Write n rows, `at` of them beyond the limit."""
        rows = np.zeros((n, 6))
        for at in beyond.get("at", ()):
            rows[at] = BEYOND
        self.buffer.push_block(rows, (self.n_rows + np.arange(n)) / RATE_HZ)
        self.n_rows += n


class Motion(TimedMotion):
    """Begins with the next row that is written, and has ended, or does so when its arm is stopped."""

    def __init__(self, arm, ended=True):
        super().__init__(host_ns(), 0.0)
        self.start_time_s, self.ended = arm.bench.n_rows / RATE_HZ, ended
        arm.motions.append(self)

    def finished(self):
        return self.ended


class Arm:
    """Notes what it is told; a robot that can go back where `back` makes its motion."""

    def __init__(self, bench, back=None):
        self.bench, self.told, self.ended, self.motions = bench, [], True, []
        if back is not None:
            self.move_back = lambda: self.told.append("back") or back(self)

    def tcp_pose(self):
        return None

    def move_line(self, direction, speed_m_s, duration_s):
        self.told.append("move")
        return Motion(self, self.ended)

    def stop(self):
        self.told.append("stop")
        for motion in self.motions:
            motion.ended = True


def driven(bench, robot, do, **limits):
    """Drive a capture whose every step is followed by what `do` does; return it."""
    capture = Capture(
        RATE_HZ, n_samples=N, pre_s=REST / RATE_HZ, trigger=MotionTrigger(), info=INFO, **limits
    )
    reader = bench.buffer.reader(from_oldest=True)
    with closing(drive(bench, capture, robot=robot, reader=reader)) as steps:
        for step in steps:
            do(capture, step)
    return capture


def once(action):
    """Do something in the first step in which the robot moves."""
    done = []

    def do(capture, step):
        if step.motion is not None and not done:
            done.append(1)
            action()

    return do


@pytest.mark.parametrize("at", [0, 41, 79])
def test_one_sample_beyond_the_limit_in_a_block_of_many_stops_the_robot_and_fails_the_push(at):
    bench = Bench()
    bench.write(REST)
    robot = Arm(bench)
    capture = driven(bench, robot, once(lambda: bench.write(N, at=[at])), max_force_n=49)
    assert robot.told == ["move", "stop"]
    assert capture.reason is FailureReason.LIMIT
    assert capture.text == TOO_MUCH.format(f"{(REST + at) / RATE_HZ:.3f}") + "; the robot was stopped"


@pytest.mark.parametrize(
    ("limits", "row", "text"),
    [
        ({"max_force_n": 50.0}, BEYOND, ""),
        ({"max_force_n": 49.9}, BEYOND, "force of 50 N at 0.044 s of the sensor's time, the limit is 49.9 N"),
        ({"max_torque_n_m": 2.0}, [99, 99, 99, 0, 0, 2], ""),
        (
            {"max_torque_n_m": 2.0},
            [0, 0, 0, 3, 0, -4],
            "torque of 5 N m at 0.044 s of the sensor's time, the",
        ),
        ({}, [1e200, 0, 0, 0, 0, 0], ""),
        ({"max_force_n": 50.0}, [1e200, 0, 0, 0, 0, 0], "force of inf N at 0.044 s"),
    ],
)
def test_limits_are_those_of_the_length_of_force_and_torque(limits, row, text):
    capture = Capture(RATE_HZ, trigger=ManualTrigger(), info=INFO, **limits)
    buffer = WrenchBuffer(1.0, rate_hz=RATE_HZ)
    reader = buffer.reader()
    rows = np.zeros((40, 6))
    rows[22:] = row
    buffer.push_block(rows, np.arange(40) / RATE_HZ)
    said = capture.beyond_limit(reader.read())
    assert said.startswith(text)
    assert bool(said) == bool(text)


def test_a_sample_beyond_the_limit_after_the_last_row_that_is_taken_stops_the_robot_and_costs_the_push():
    bench = Bench()
    bench.write(REST)
    robot, done = Arm(bench), []
    robot.ended = False

    def do(capture, step):
        if step.motion is not None and not done:
            done.append(bench.write(N))
        elif capture.state is CaptureState.COMPLETE and len(done) == 1:
            done.append(bench.write(3, at=[1]))

    capture = driven(bench, robot, do, max_force_n=49)
    assert (capture.reason, robot.told) == (FailureReason.LIMIT, ["move", "stop"])
    with pytest.raises(CaptureError, match=r"force of 50 N at 0\.242 s"):
        capture.recording()


def test_a_robot_does_not_move_before_a_rest_within_the_limits():
    bench = Bench()
    bench.write(REST + 5, at=range(REST))  # somebody's hands in the container
    states = []

    def do(capture, step):
        states.append((capture.state, list(robot.told)))
        if len(states) == 1:
            bench.write(REST)
        if robot.told == ["move"]:
            capture.fail(FailureReason.INTERRUPTED, "seen enough")

    robot = Arm(bench)
    driven(bench, robot, do, max_force_n=49)
    assert states[0] == (CaptureState.ARMING, [])
    assert robot.told == ["move", "stop"]


def test_a_force_that_lasts_is_named_where_the_wait_for_a_rest_ends():
    bench = Bench()
    bench.write(50, at=range(50))
    robot = Arm(bench)
    capture = driven(bench, robot, lambda *_: bench.write(50, at=range(50)), max_force_n=49, timeout_s=0.2)
    assert capture.reason is FailureReason.NO_TRIGGER
    assert "the rest was broken last by this: force of 50 N at" in capture.text
    assert "move" not in robot.told


def test_without_a_robot_a_push_beyond_the_limit_fails_in_whatever_pieces_it_comes():
    told = set()
    for n in (1, 7, 400):
        trigger = ManualTrigger()
        trigger.fire(int(1e9 * 100 / RATE_HZ))
        capture = Capture(
            RATE_HZ,
            n_samples=N,
            pre_s=0.04,
            trigger=trigger,
            info=replace(INFO, device_clock=False),
            max_force_n=49,
        )
        buffer = WrenchBuffer(1.0, rate_hz=RATE_HZ)
        reader = buffer.reader()
        rows = np.zeros((400, 6))
        rows[130] = BEYOND
        buffer.push_block(rows, np.arange(400) / RATE_HZ, host_ns=np.arange(400) * 2_000_000)
        while len(block := reader.read(n)):
            capture.feed(block)
        told.add((capture.reason, capture.text))
    assert told == {(FailureReason.LIMIT, TOO_MUCH.format("0.260"))}


@pytest.mark.parametrize(
    ("limits", "info", "message"),
    [
        ({"max_force_n": 0}, INFO, "max_force_n must be positive"),
        ({"max_torque_n_m": float("nan")}, None, "max_torque_n_m must be"),
        (
            {"max_force_n": 300},
            replace(INFO, full_scale=(290.0, 290.0, 580.0, 10.0, 10.0, 10.0)),
            "max_force_n is 300 N, but the sensor's fx ends at 290: give at most that",
        ),
        (
            {"max_force_n": 3},
            SourceInfo("imu", 100, device_clock=True, axes=("ax", "ay", "az")),
            "max_force_n needs fx fy fz; imu has ax ay az: leave it out",
        ),
    ],
)
def test_limits_that_mean_nothing_are_refused(limits, info, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        Capture(RATE_HZ, trigger=ManualTrigger(), info=info, **limits)


def test_a_recorder_leaves_no_file_and_a_live_session_ends_where_a_limit_is_passed(tmp_path):
    source = SimSource("rice", seed=1, speed=20)
    with opened(source) as stream:
        recorder = Recorder(stream, source.robot(), tmp_path, n_samples=500, max_force_n=1.0)
        with pytest.raises(CaptureError, match=r"^force of 1\.0\d* N at .* the limit is 1 N") as raised:
            recorder.record("rice")
        assert raised.value.reason is FailureReason.LIMIT
        assert source.world.push is None, "the robot stands"
        assert not [path for path in tmp_path.rglob("*") if path.is_file()]
        live = LiveIdentifier(stream, pushes_and_model()[1], max_force_n=1.0)
        with pytest.raises(CaptureError, match="the limit is 1 N") as raised:
            next(live.pushes())
    with pytest.raises(CaptureError, match="the limit is 1 N; the robot was stopped"):
        next(gid.identify(SimSource("rice", speed=20), live.model, max_force_n=1.0, on_failure="skip"))
    assert raised.value.reason.is_lasting, "nothing pushes again by itself"


# -- the way back


def gone_back(robot):
    """A way back that is over when it is looked at for the second time."""
    motion = Motion(robot)
    looks = iter((False, True, True, True))
    motion.finished = lambda: next(looks)
    return motion


def test_a_robot_that_can_goes_back_after_a_whole_push_and_its_rows_are_none_of_the_push():
    bench = Bench()
    bench.write(REST)
    robot, shown = Arm(bench, gone_back), []
    write = once(lambda: bench.write(N))

    def do(capture, step):
        write(capture, step)
        if "back" in robot.told and not shown:
            shown.append(bench.write(5))

    capture = driven(bench, robot, do, max_force_n=49)
    assert (robot.told, capture.state) == (["move", "back"], CaptureState.COMPLETE)
    assert capture.n_rows == N
    assert shown


def test_the_way_back_stops_at_the_limits_too():
    bench = Bench()
    bench.write(REST)
    write, hit = once(lambda: bench.write(N)), []
    robot = Arm(bench, lambda robot: Motion(robot, ended=False))

    def do(capture, step):
        write(capture, step)
        if "back" in robot.told and not hit:
            hit.append(bench.write(4, at=[2]))

    capture = driven(bench, robot, do, max_force_n=49)
    assert robot.told == ["move", "back", "stop"]
    assert (capture.reason, capture.state) == (FailureReason.LIMIT, CaptureState.FAILED)


def test_a_way_back_that_is_refused_or_fails_costs_the_push():
    def refuse(_):
        raise ConnectionError("arm is off")

    def fail(robot):
        motion = Motion(robot)
        motion.error = "reflex"
        return motion

    for back, text in ((refuse, "refused the way back: arm is off"), (fail, "way back failed: reflex")):
        bench = Bench()
        bench.write(REST)
        robot = Arm(bench, back)
        capture = driven(bench, robot, once(lambda bench=bench: bench.write(N)))
        assert capture.reason is FailureReason.ROBOT
        assert text in capture.text
        assert robot.told == ["move", "back", "stop"]


def test_a_robot_that_stays_and_one_whose_push_failed_are_not_sent_back():
    for back, rows, told in (
        (lambda _: None, {}, ["move", "back"]),
        (gone_back, {"at": [3]}, ["move", "stop"]),
    ):
        bench = Bench()
        bench.write(REST)
        robot = Arm(bench, back)
        driven(bench, robot, once(lambda bench=bench, rows=rows: bench.write(N, **rows)), max_force_n=49)
        assert robot.told == told


def test_two_functions_and_a_third_make_a_robot_that_goes_back(tmp_path):
    told = []
    source = SimSource("rice", seed=1, speed=20)
    with opened(source) as stream:
        robot = CallbackRobot(
            lambda *_: told.append("move"), lambda: told.append("stop"), back=lambda: told.append("back")
        )
        Recorder(stream, robot, tmp_path, n_samples=100, pre_s=0.1).record("rice")
    assert told == ["move", "back"]
    assert CallbackRobot(print, print).move_back() is None


# -- how rows came in


def test_a_push_tells_rate_jitter_and_lateness_of_its_rows():
    model = pushes_and_model()[1]
    with opened(SimSource("rice", seed=3)) as stream:
        push = LiveIdentifier(stream, model).push()
    timing = push.to_dict()["timing"]
    assert timing["rate_hz"] == pytest.approx(RATE_HZ)
    assert 0 < timing["jitter_s"] < timing["late_s"]
    assert str(push).partition("; rate 500.00 Hz, jitter ")[2].endswith(" ms")
    with opened(SimSource("rice", seed=3, speed=20)) as stream:
        fast = LiveIdentifier(stream, model).push()
    assert list(fast.timing) == ["rate_hz"], "its time is not the host's"


def test_jitter_and_lateness_are_those_of_the_delays():
    rng = np.random.default_rng(0)
    delays_s = rng.uniform(0, 0.004, N)
    trigger = ManualTrigger()
    trigger.fire(0)
    buffer = WrenchBuffer(1.0, rate_hz=RATE_HZ)
    reader = buffer.reader()
    time_s = np.arange(N) / RATE_HZ
    host = np.rint(1e9 * (5 + 1.00005 * time_s + delays_s)).astype(np.int64)  # a clock that drifts
    buffer.push_block(np.zeros((N, 6)), time_s, host_ns=host)
    capture = Capture(RATE_HZ, n_samples=N, pre_s=0, trigger=trigger, info=INFO)
    capture.feed(reader.read())
    timing = capture.timing
    assert timing["rate_hz"] == pytest.approx(RATE_HZ)
    assert timing["jitter_s"] == pytest.approx(delays_s.std(), rel=0.05)
    assert timing["late_s"] == pytest.approx(np.ptp(delays_s), rel=0.05)


def test_views_show_how_the_last_push_came_in():
    from granular_id.live import Push, Snapshot
    from granular_id.live.snapshot import Outcome

    push = Push(timing={"rate_hz": 499.98, "jitter_s": 2.1e-4, "late_s": 6e-4})
    figures = Snapshot("armed", history=(Outcome(1, 0.0, push),)).words.figures
    assert figures[2:] == (
        ("rate", "499.98 Hz", False),
        ("jitter", "0.2 ms", False),
        ("late", "0.6 ms", False),
    )


def test_without_limits_nothing_is_changed_by_them():
    assert Capture(RATE_HZ, trigger=ManualTrigger()).beyond_limit(Bench().buffer.reader().read()) == ""
    assert gid.live.Capture(RATE_HZ, trigger=ManualTrigger()).timing is None


# -- the command line


def test_the_commands_end_where_a_limit_is_passed(tmp_path):
    words = ("record", "--source", "sim:?seed=1", "--speed", 20, "--label", "rice", "-o", tmp_path / "x")
    line = refused(*words, "--max-force-n", 1)
    assert re.match(
        r"error: rice 1/10: force of 1\.0\d* N at .*, the limit is 1 N; the robot was stopped$", line
    )
    assert not (tmp_path / "x").exists()
    assert (
        refused(*words, "--max-torque-n-m", -1)
        == "error: --max-torque-n-m must be positive and finite, got -1"
    )
    pushes_and_model()[1].save(tmp_path / "m.safetensors")
    live = ("live", "--source", "sim:rice?seed=1", "--speed", 20, "--model", tmp_path / "m.safetensors", "-q")
    assert "the limit is 0.1 N m" in refused(*live, "--max-torque-n-m", 0.1)
    assert "--max-force-n is about pushes" in refused(*live, "--max-force-n", 9, "--hop-s", 0.5)


@pytest.mark.parametrize(
    ("missing", "told"), [(3, ["move", "stop", "back", "move"]), (0, ["move", "stop", "move"])]
)
def test_a_push_after_one_that_a_gap_has_cut_short_begins_where_that_one_did(tmp_path, missing, told):
    bench = Bench()
    bench.write(REST)
    robot = Arm(bench, gone_back)

    def go_wrong(step, capture):
        if robot.told[-1:] == ["move"] and step.motion is not None:
            bench.n_rows += missing
            bench.write(N, at=[] if missing else [1])
        else:
            bench.write(5)

    recorder = Recorder(
        bench,
        robot,
        tmp_path,
        on_step=go_wrong,
        n_samples=N,
        pre_s=REST / RATE_HZ,
        max_force_n=49,
        timeout_s=0.2,
    )
    for _ in range(2):
        with pytest.raises(CaptureError):
            recorder.record("rice")
        bench.write(REST)
    assert [one for one in robot.told if one != "stop"] == [one for one in told if one != "stop"]


def test_a_way_back_before_a_push_stops_at_the_limits_and_no_push_follows():
    bench = Bench()
    bench.write(REST)
    robot = Arm(bench, lambda robot: Motion(robot, ended=False))
    capture = Capture(RATE_HZ, n_samples=N, pre_s=0.04, trigger=MotionTrigger(), info=INFO, max_force_n=49)
    reader = bench.buffer.reader()
    with closing(drive(bench, capture, robot=robot, reader=reader, back_first=True)) as steps:
        for _ in steps:
            bench.write(4, at=[2])
    assert robot.told == ["back", "stop"]
    assert capture.reason is FailureReason.LIMIT
