"""Until the robot stands: a motion that goes on is no success, and none begins on top of it."""

from __future__ import annotations

import threading
import time
from contextlib import closing

import pytest

from granular_id.live import (
    CallbackRobot,
    Capture,
    CaptureError,
    FailureReason,
    LiveIdentifier,
    MotionTrigger,
    Recorder,
    SimSource,
    opened,
    setup_of,
    stopping,
)
from granular_id.live.drive import drive
from live_view_cases import pushes_and_model
from test_limits import INFO, RATE_HZ, REST, Arm, Bench, Motion, N, gone_back

SHORT = {"n_samples": 60, "pre_s": 0.04, "rate_tolerance": 1.0}
GOES_ON = (
    r"^the robot could not be stopped: its motion goes on \d+\.\d s after stop\(\) \(it was to stop: {}\)$"
)


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    """Two seconds are a tenth."""
    monkeypatch.setattr("granular_id.live.drive._STAND_S", 0.1)


@pytest.fixture
def endless():
    """A robot of functions whose motion ends when the test does, and what it was told."""
    told, release = [], threading.Event()

    def move(*_):
        told.append("move")
        release.wait(20)

    yield CallbackRobot(move, lambda: told.append("stop")), told
    release.set()


class Stubborn(Arm):
    """Does not heed `stop` before its motion is ended by the test."""

    def stop(self):
        self.told.append("stop")


def pushed(bench, robot, **settings):
    """Drive a push of which all rows come in, and return its capture; nothing is read where it fails before."""
    capture = Capture(RATE_HZ, n_samples=N, pre_s=REST / RATE_HZ, trigger=MotionTrigger(), info=INFO)
    bench.write(REST)
    reader = bench.buffer.reader(from_oldest=True)
    done = []
    with closing(drive(bench, capture, robot=robot, reader=reader, **settings)) as steps:
        for step in steps:
            if step.motion is not None and not done:
                done.append(bench.write(N))
    return capture


def failed(bench, robot, **settings):
    with pytest.raises(CaptureError) as raised:
        pushed(bench, robot, **settings)
    assert raised.value.reason is FailureReason.ROBOT
    return str(raised.value)


def test_a_recording_of_a_motion_that_never_ends_fails_and_no_other_begins_on_top_of_it(endless, tmp_path):
    robot, told = endless
    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        recorder = Recorder(stream, robot, tmp_path, **SHORT)
        for why in ("its motion did not end by itself", "the robot's last motion still went on"):
            with pytest.raises(CaptureError, match=GOES_ON.format(why)) as raised:
                recorder.record("rice")
            assert raised.value.reason is FailureReason.ROBOT
    assert told.count("move") == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_pushes_end_where_a_motion_never_does(endless, monkeypatch):
    robot, told = endless
    monkeypatch.setattr("granular_id.live.drive.motion_duration_s", lambda _: 0.2)
    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        live = LiveIdentifier(stream, pushes_and_model()[1], setup_of(stream.source, robot))
        for _ in range(2):
            with pytest.raises(CaptureError, match="could not be stopped"):
                next(live.pushes())
        assert (live.n_answered, told.count("move")) == (0, 1)


@pytest.mark.parametrize("back", [None, lambda arm: Motion(arm, ended=False)])
def test_a_motion_whose_finished_stays_false_is_no_success(back, monkeypatch):
    monkeypatch.setattr("granular_id.live.drive._BACK_S", 0.05)
    bench = Bench()
    robot = Stubborn(bench, back)
    robot.ended = back is not None
    monkeypatch.setattr("granular_id.live.drive.motion_duration_s", lambda _: 0.05)
    assert "could not be stopped" in failed(bench, robot)
    assert robot.told == ["move", *(["back"] if back else []), "stop"]


def left(bench, robot, reader=None):
    """Leave a push as soon as the robot moves; return its capture."""
    capture = Capture(RATE_HZ, n_samples=N, pre_s=0, trigger=MotionTrigger(), info=INFO)
    reader = bench.buffer.reader() if reader is None else reader
    bench.write(1)
    with closing(drive(bench, capture, robot=robot, reader=reader)) as steps:
        next(step for step in steps if step.motion)
    return capture


def test_another_push_begins_when_the_last_motion_has_ended_after_all():
    bench = Bench()
    robot = Stubborn(bench)
    robot.ended = False
    with pytest.raises(CaptureError, match="was to stop: ended from outside"):
        left(bench, robot)
    assert "still went on" in failed(bench, robot, back_first=True)
    robot.motions[0].ended = robot.ended = True
    assert pushed(bench, robot).reason is None
    assert robot.told == ["move", "stop", "stop", "move"]
    assert not any(one._robot is robot for one in stopping._IN_MOTION)


def test_where_stop_raises_no_other_push_begins_before_the_motion_has_ended():
    class Deaf(Stubborn):
        def stop(self):
            super().stop()
            raise OSError("no connection")

    bench = Bench()
    robot = Deaf(bench)
    robot.ended = False
    with pytest.raises(CaptureError, match=r"OSError: no connection \(it was to stop: ended from outside"):
        left(bench, robot)
    assert failed(bench, robot).endswith("(it was to stop: the robot's last motion still went on)")
    assert robot.told == ["move", "stop", "stop"]
    robot.motions[0].ended = robot.ended = True
    assert pushed(bench, robot).reason is None


def test_what_comes_in_while_the_robot_brakes_is_none_of_the_next_rest():
    class Braking(Stubborn):
        def stop(self):
            super().stop()
            self.motions[-1].finished = self.brake

        def brake(self):
            self.bench.write(5)
            return self.bench.n_rows > 40

    bench = Bench()
    robot, reader = Braking(bench), bench.buffer.reader()
    robot.ended = False
    assert left(bench, robot, reader).text == "ended from outside; the robot was stopped"
    assert len(reader.read()) < 20 < bench.n_rows


def test_a_motion_that_does_not_heed_stop_is_waited_for_until_it_should_have_ended(monkeypatch):
    monkeypatch.setattr("granular_id.live.drive._STAND_S", 0.0)
    monkeypatch.setattr("granular_id.live.drive.motion_duration_s", lambda _: 20.0)

    class Sleeping(Stubborn):
        def stop(self):
            super().stop()
            end_s = time.monotonic() + 0.1
            self.motions[-1].finished = lambda: time.monotonic() > end_s

    bench = Bench()
    robot = Sleeping(bench)
    robot.ended = False
    assert left(bench, robot).text == "ended from outside; the robot was stopped"
    assert robot.told == ["move", "stop"]


@pytest.mark.parametrize("method", ["move_line", "move_back"])
def test_a_robot_that_returns_no_motion_is_stopped_and_told_what_it_lacks(method):
    bench = Bench()
    robot = Arm(bench, gone_back)
    setattr(robot, method, lambda *_: 0)
    with pytest.raises(TypeError, match=f"^the robot's {method} must return a motion with .*; got int$"):
        pushed(bench, robot)
    assert robot.told[-1] == "stop"
