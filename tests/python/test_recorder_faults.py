"""What recorders refuse: faults of the sensor, of the robot, of whoever waits."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

import granular_id as gid
from granular_id.live.adapters.polling import PolledMotion
from granular_id.live.capture import Capture
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.drive import drive
from granular_id.live.recorder import Recorder
from granular_id.live.robots import CallbackRobot
from granular_id.live.sim import SimSource
from granular_id.live.sim_faults import Fault
from granular_id.live.source import SourceInfo
from granular_id.live.source_thread import ThreadedSource
from granular_id.live.stream import opened
from granular_id.live.trigger import ManualTrigger, MotionTrigger
from recorder_cases import SHORT, Watched, bench, files

FAULTS = {
    "gap": (Fault("gap", after_s=0.2, rows=3), FailureReason.GAP, "3 samples .* are missing"),
    "saturation": (Fault("saturation", after_s=0.2), FailureReason.SATURATION, "end of its range"),
    "restart": (Fault("restart", after_s=0.2), FailureReason.RESTART, "time began anew"),
    "death": (Fault("death", after_s=0.2), FailureReason.SOURCE, "told to die"),
    "silence": (Fault("stall", after_s=0.2, stall_s=60), FailureReason.NO_ROWS, "delivered nothing for 1 s"),
    "restart before the motion": (
        Fault("restart", after_s=-0.2),
        FailureReason.RESTART,
        "time began anew after the motion was commanded",
    ),
    "gap before the trigger": (Fault("gap", after_s=-0.05, rows=2), FailureReason.GAP, "triggered after"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_fail_the_recording(tmp_path, name):
    fault, reason, text = FAULTS[name]
    with bench(tmp_path) as (source, robot, recorder):
        source.inject(fault)
        with pytest.raises(CaptureError, match=text) as raised:
            recorder.record("rice")
        assert raised.value.reason is reason
        assert robot.n_stops == 1
        assert files(tmp_path) == []
        if reason not in (FailureReason.SOURCE, FailureReason.NO_ROWS):
            recorder.record("rice")
            assert len(gid.load(tmp_path / "data")) == 1


def test_a_gap_at_rest_is_waited_out(tmp_path):
    with bench(tmp_path) as (source, _, recorder):
        source.inject(Fault("gap", rows=5))
        source.inject(Fault("restart"))
        assert recorder.record("rice").recording.n_samples == 300


def test_a_gap_that_may_be_filled(tmp_path):
    with bench(tmp_path, max_gap=3) as (source, _, recorder):
        source.inject(Fault("gap", after_s=0.2, rows=3))
        recorded = recorder.record("rice")
    loaded = gid.load(recorded.path)[0]
    assert np.count_nonzero(loaded.flags == gid.SampleFlag.GAP_FILLED) == 3


def test_lag(tmp_path):
    with bench(tmp_path, speed=1) as (source, robot, recorder):
        source.inject(Fault("stall", after_s=0.1, stall_s=0.4))
        with pytest.raises(CaptureError, match="late; wanted at most 20 ms") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.LAG
    assert robot.n_stops == 1


def test_overflow(tmp_path):
    source = SimSource("rice", seed=1, speed=20)
    slow = threading.Event()

    def dawdle(step, capture):
        if capture.state is CaptureState.TRIGGERED and not slow.is_set():
            slow.set()
            time.sleep(0.3)

    with opened(source, seconds=0.05) as stream:
        recorder = Recorder(stream, Watched(source), tmp_path / "data", on_step=dawdle, n_samples=1600)
        with pytest.raises(CaptureError, match="rows were overwritten") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.OVERFLOW
    assert files(tmp_path) == []


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
            CaptureError, match=r"could not be stopped: OSError: no connection \(it was to stop: 1 samples"
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


def test_trigger_before_the_rest_is_there(tmp_path):
    trigger = ManualTrigger()
    trigger.fire()
    with bench(tmp_path, trigger=lambda: trigger) as (_, robot, recorder):
        with pytest.raises(CaptureError, match="rows at rest, wanted 50") as raised:
            recorder.record("rice")
        assert raised.value.reason is FailureReason.TRIGGER_TOO_EARLY
        assert robot.n_stops == 1


def test_nobody_moves(tmp_path):
    with opened("sim:rice?seed=1&speed=20") as stream:
        recorder = Recorder(stream, None, tmp_path / "data", timeout_s=2.0, **SHORT)
        with pytest.raises(CaptureError, match="nothing triggered within 2 s") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.NO_TRIGGER


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


class Silent(ThreadedSource):
    def __init__(self, fault=None):
        super().__init__(SourceInfo("silent", 500, device_clock=True))
        self._fault = fault

    def deliver(self, buffer, stopping):
        if self._fault is not None:
            raise self._fault
        stopping.wait(20)


def test_sources_that_do_not_begin():
    with (
        pytest.raises(TimeoutError, match=r"silent delivered nothing within 0\.1 s"),
        opened(Silent(), first_row_s=0.1),
    ):
        pass
    for option in ("seconds", "first_row_s"):
        with pytest.raises(ValueError, match=f"{option} must be positive"), opened(Silent(), **{option: 0}):
            pass

    class Ended(Silent):
        def deliver(self, buffer, stopping):
            """Nothing to deliver."""

    with pytest.raises(ConnectionError, match="silent came to its end before its first row"), opened(Ended()):
        pass
    dead = Silent(OSError("no route"))
    with pytest.raises(ConnectionError, match="silent: OSError: no route"), opened(dead):
        pass
    with (
        pytest.raises(TypeError, match="source must be a URL or have info, start, stop and health, got int"),
        opened(3),
    ):
        pass


def test_a_stream_is_stopped_whatever_happens():
    source = SimSource("rice", seed=1)

    def use():
        with opened(source) as stream:
            assert stream.health().running
            assert stream.health().counters["written"] > 0
            assert 0 <= stream.lag_s() < 5
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert not source.health().running
