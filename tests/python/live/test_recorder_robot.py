"""The robot before a recorder: it stands or was told to stop, whatever happens."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from granular_id_contrib.polling import PolledMotion

from granular_id.live.capture import Capture
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.drive import drive
from granular_id.live.recorder import Recorder
from granular_id.live.robots import CallbackRobot
from granular_id.live.sim import SimSource
from granular_id.live.sim_faults import Fault
from granular_id.live.stream import opened
from granular_id.live.trigger import MotionTrigger
from recorder_cases import SHORT, Watched, bench, files


def test_robot_that_refuses_and_robot_that_fails(tmp_path):
    def refuse(*_):
        raise ConnectionError("arm is off")

    stops = []
    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        failing = CallbackRobot(refuse, lambda: stops.append(1))
        recorder = Recorder(stream, failing, tmp_path / "data", **SHORT)
        with pytest.raises(CaptureError, match="motion failed: ConnectionError: arm is off") as raised:
            recorder.record("rice")
        assert raised.value.reason is FailureReason.ROBOT
        assert stops == [1]
        failing.move_line = refuse
        with pytest.raises(CaptureError, match="refused the motion: arm is off") as raised:
            recorder.record("rice")
        assert raised.value.reason is FailureReason.ROBOT
        assert stops == [1, 1]


def test_a_robot_that_fails_on_its_way(tmp_path):
    seen = threading.Event()

    class Arm(Watched):
        def move_line(self, direction, speed_m_s, duration_s):
            motion = super().move_line(direction, speed_m_s, duration_s)

            def ask():
                if seen.is_set():
                    raise RuntimeError("reflex")
                return False

            return PolledMotion(motion.start_time_s, ask, {})

    def watch(step, capture):
        if capture.n_rows:
            seen.set()

    with opened(SimSource("rice", seed=1, speed=2)) as stream:
        robot = Arm(stream.source)
        recorder = Recorder(stream, robot, tmp_path / "data", n_samples=1600, on_step=watch)
        with pytest.raises(CaptureError, match="the robot's motion failed: RuntimeError: reflex") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.ROBOT
    assert robot.n_stops == 1


@pytest.mark.parametrize("off_s", [-600.0, 600.0])
def test_a_robot_that_has_another_clock(tmp_path, off_s):
    class Elsewhere(Watched):
        def move_line(self, direction, speed_m_s, duration_s):
            motion = super().move_line(direction, speed_m_s, duration_s)
            motion.start_time_s += off_s
            return motion

    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        robot = Elsewhere(stream.source)
        recorder = Recorder(stream, robot, tmp_path / "data", **SHORT)
        with pytest.raises(CaptureError, match=r"newest row is of .* do not share a clock") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.ROBOT
    assert robot.n_stops == 1


def test_a_recorder_returns_when_the_robot_stands(tmp_path):
    """What is recorded next does not begin with the end of the last motion, nor is a robot moved that still moves."""
    with bench(tmp_path, pre_s=0.002) as (source, robot, recorder):
        for _ in range(3):
            recorder.record("rice")
            assert source.world.push is None
        assert robot.n_stops == 0


def test_rows_while_the_robot_comes_to_its_stand_are_none_of_the_next_rest():
    source = SimSource("rice", seed=1, speed=20)
    with opened(source) as stream:
        reader = stream.buffer.reader()
        for _ in range(2):
            capture = Capture(500, trigger=MotionTrigger(), n_samples=300, pre_s=0.1)
            steps = list(drive(stream, capture, robot=source.robot(), reader=reader))
            assert capture.state is CaptureState.COMPLETE
            after = [
                step for step in steps if len(step.block) and step.block.time_s[0] > capture.rows.time_s[-1]
            ]
            assert all(len(step.rows) == 0 for step in after)
            read_s = max(step.block.time_s[-1] for step in steps if len(step.block))
            assert read_s >= capture.trigger_time_s + 250 / 500 + 0.04, "the braking was read"


def test_a_motion_that_never_ends_is_stopped(tmp_path):
    class Endless(Watched):
        def move_line(self, direction, speed_m_s, duration_s):
            motion = super().move_line(direction, speed_m_s, duration_s)
            return PolledMotion(motion.start_time_s, lambda: False, {})

    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        robot = Endless(stream.source)
        recorded = Recorder(stream, robot, tmp_path / "data", **SHORT).record("rice")
    assert robot.n_stops == 1
    assert recorded.recording.n_samples == 300, "what was recorded is nevertheless good"


@pytest.mark.parametrize(
    ("state", "speed"), [(CaptureState.ARMED, 20), (CaptureState.TRIGGERED, 2), (CaptureState.COMPLETE, 20)]
)
def test_stopped_when_a_callback_raises(tmp_path, state, speed):
    def fail(step, capture):
        if capture.state is state:
            raise ZeroDivisionError

    with bench(tmp_path, on_step=fail, speed=speed, n_samples=1200) as (_, robot, recorder):
        with pytest.raises(ZeroDivisionError):
            recorder.record("rice")
        assert robot.n_stops == 1
    assert files(tmp_path) == []


def test_a_robot_that_cannot_be_stopped_is_the_first_thing_to_know(tmp_path):
    class Deaf(Watched):
        def stop(self):
            super().stop()
            raise OSError("no connection")

    source = SimSource("rice", seed=1, speed=20)
    source.inject(Fault("gap", after_s=0.2))
    with opened(source) as stream:
        recorder = Recorder(stream, Deaf(source), tmp_path / "data", **SHORT)
        with pytest.raises(
            CaptureError, match=r"could not be stopped: OSError: no connection \(it was to stop: 1 sample "
        ) as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.ROBOT


def test_a_second_ctrl_c_while_the_robot_is_stopped(tmp_path):
    class Impatient(Watched):
        def stop(self):
            super().stop()
            if self.n_stops == 1:
                raise KeyboardInterrupt

    source = SimSource("rice", seed=1, speed=20)
    source.inject(Fault("gap", after_s=0.2))
    with opened(source) as stream:
        robot = Impatient(source)
        with pytest.raises(KeyboardInterrupt):
            Recorder(stream, robot, tmp_path / "data", **SHORT).record("rice")
    assert robot.n_stops == 2


def test_an_odd_report_does_not_cost_the_recording(tmp_path):
    class Odd(Watched):
        def move_line(self, direction, speed_m_s, duration_s):
            motion = super().move_line(direction, speed_m_s, duration_s)
            motion.report = lambda: {"pose": np.zeros(6)}
            return motion

    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        recorder = Recorder(stream, Odd(stream.source), tmp_path / "data", **SHORT)
        report = recorder.record("rice").recording.meta["robot"]
    assert "the robot's report['pose'] is a ndarray" in report["report_error"]


def test_too_long_a_push_is_the_robots_refusal(tmp_path):
    with (
        bench(tmp_path, n_samples=3000) as (_, _, recorder),
        pytest.raises(CaptureError, match="into the wall"),
    ):
        recorder.record("rice")


def test_interrupted_from_within(tmp_path):
    def interrupt(step, capture):
        if capture.n_rows > 100:
            raise KeyboardInterrupt

    with bench(tmp_path, on_step=interrupt) as (_, robot, recorder):
        with pytest.raises(KeyboardInterrupt):
            recorder.record("rice")
        assert robot.n_stops == 1
    assert files(tmp_path) == []


def test_leaving_a_drive_early_stops_the_robot():
    source = SimSource("rice", seed=1, speed=2)  # slow: a busy computer must not read the whole push at once
    with opened(source) as stream:
        robot = Watched(source)
        capture = Capture(500, trigger=MotionTrigger())
        steps = drive(stream, capture, robot=robot)
        for _ in steps:
            if capture.n_rows:
                break
        steps.close()
        assert robot.n_stops == 1
        assert (capture.state, capture.reason) == (CaptureState.FAILED, FailureReason.INTERRUPTED)
