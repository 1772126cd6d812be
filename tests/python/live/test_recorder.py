"""The recorder with the simulated bench: from the command to the file, whatever fails on the way."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from granular_id.live.capture import Capture, CaptureError, CaptureState, FailureReason
from granular_id.live.drive import drive
from granular_id.live.recorder import Recorder
from granular_id.live.replay import ReplaySource
from granular_id.live.robot import CallbackRobot, TimedMotion
from granular_id.live.sim import Fault, SimRobot, SimSource
from granular_id.live.stream import opened
from granular_id.live.trigger import ForceTrigger, MotionTrigger

SHORT = {"n_samples": 300, "pre_s": 0.1}


class Watched(SimRobot):
    """Counts how often it was stopped; `change` may replace what a motion does."""

    def __init__(self, source, change=None, on_stop=None):
        super().__init__(source)
        self.n_stops = 0
        self._change, self._on_stop = change, on_stop

    def move_line(self, direction, speed_m_s, duration_s):
        motion = super().move_line(direction, speed_m_s, duration_s)
        return motion if self._change is None else self._change(motion) or motion

    def stop(self):
        super().stop()
        self.n_stops += 1
        if self._on_stop is not None:
            self._on_stop(self.n_stops)


@contextmanager
def bench(folder, *, speed=20, seed=1, materials="rice", change=None, on_stop=None, seconds=30.0, **options):
    source = SimSource(materials, seed=seed, speed=speed)
    with opened(source, seconds) as stream:
        robot = Watched(source, change, on_stop)
        yield source, robot, Recorder(stream, robot, folder / "data", **{**SHORT, **options})


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def refused(recorder, match):
    """The reason of a recording that must fail."""
    with pytest.raises(CaptureError, match=match) as raised:
        recorder.record("rice")
    return raised.value.reason


def test_recordings_of_a_simulated_bench(tmp_path):
    rows, states = [], []

    def watch(step, capture):
        rows.append(step.rows)
        states.append(capture.state)

    with bench(tmp_path, session="Monday", n_samples=1600, pre_s=0.25, on_step=watch) as (_, robot, recorder):
        before_s = time.time()
        recorded = [recorder.record("rice") for _ in range(2)]
        assert robot.n_stops == 0
    data = gid.load(tmp_path / "data")
    assert data.X.shape == (2, 1600, 6)
    assert [r.wrench.tobytes() for r in data] == [r.recording.wrench.tobytes() for r in recorded]
    assert np.array_equal(np.concatenate(rows), np.concatenate(data.X)), "rows are given while they come"
    assert states[-1] is CaptureState.COMPLETE
    assert (set(data.y), set(data.sessions)) == ({"rice"}, {"Monday"})
    assert [path.parent.name for path in files(tmp_path / "data")] == ["rice"] * 2
    for k, recording in enumerate(data):
        assert (recording.trigger_index, recording.rate_hz, recording.flags) == (125, 500, None)
        meta = recording.meta
        assert (meta["synthetic"], meta["truth"], meta["trigger"]) == (True, "rice", "motion")
        assert (meta["source"]["meta"]["seed"], meta["robot"]["push"], meta["robot"]["error"]) == (1, k, None)
        rest = recording.wrench[:125]
        assert abs(rest - rest.mean(axis=0))[:, 0].max() < 0.12
        assert recording.wrench[125:, 0].max() > rest[:, 0].mean() + 3
    first, second = (r.start_time for r in data)
    assert second - first > 3.2, "the sensor's own time, twenty times as fast"
    assert before_s - 5 < first < before_s + 60
    errors = {finding.code for finding in data.check().findings if finding.severity == "error"}
    assert errors <= {"one-label"}


def test_somebody_moves_without_being_asked(tmp_path):
    source, moves = SimSource("dry peas", seed=1, speed=10), []

    def move_once(step, capture):
        if capture.state is CaptureState.ARMED and not moves:
            moves.append(source.robot().move_line((1, 0, 0), 0.03, 2.0))

    with opened(source) as stream:
        recorder = Recorder(stream, None, tmp_path / "data", on_step=move_once, **SHORT)
        recording = recorder.record("dry peas").recording
    assert recording.meta["trigger"] == "force"
    assert abs(recording.wrench[50, :3] - recording.wrench[:50, :3].mean(axis=0)).max() > 0.25
    assert "robot" not in recording.meta


def test_replayed_recordings_are_recorded_as_they_were(tmp_path):
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=2, duration_s=1.0, seed=1)
    source = ReplaySource(data, speed=20, pause_s=3.0)
    made, reason = [], None
    # a busy computer may have missed a beginning
    late = (None, FailureReason.TRIGGER_TOO_EARLY, FailureReason.GAP)
    with opened(source) as stream:
        recorder = Recorder(stream, None, tmp_path, trigger=source.trigger, n_samples=400, pre_s=0.1)
        while reason in late:
            try:
                made.append((recorder.record("x").recording, source.truth))
            except CaptureError as error:  # noqa: PERF203
                reason = error.reason
    assert reason is FailureReason.SOURCE
    expected = {r.wrench[r.trigger_index - 50 :][:400].tobytes(): r.label for r in data}
    assert made
    assert all(expected[recording.wrench.tobytes()] == truth for recording, truth in made)


@pytest.mark.parametrize(
    ("fault", "reason", "text"),
    [
        (Fault("gap", after_s=0.2, rows=3), FailureReason.GAP, "3 samples .* are missing"),
        (Fault("gap", after_s=-0.05, rows=2), FailureReason.GAP, "triggered after"),
        (Fault("saturation", after_s=0.2), FailureReason.SATURATION, "end of its range"),
        (Fault("restart", after_s=0.2), FailureReason.RESTART, "time began anew"),
        (Fault("restart", after_s=-0.2), FailureReason.RESTART, "anew after the motion was commanded"),
        (Fault("death", after_s=0.2), FailureReason.SOURCE, "told to die"),
        (Fault("stall", after_s=0.2, stall_s=60), FailureReason.NO_ROWS, "delivered nothing for 1 s"),
    ],
)
def test_faults_fail_the_recording_and_stop_the_robot(tmp_path, fault, reason, text):
    with bench(tmp_path) as (source, robot, recorder):
        source.inject(fault)
        assert refused(recorder, text) is reason
        assert (robot.n_stops, files(tmp_path)) == (1, [])
        if not reason.is_lasting:
            recorder.record("rice")
            assert len(gid.load(tmp_path / "data")) == 1


def test_a_gap_and_a_restart_at_rest_are_waited_out(tmp_path):
    """The robot is held until both were read: sent off between them, it would rightly fail at the restart."""
    epochs = set()

    class Patient(MotionTrigger):
        def arm(self, rest):
            return None if 1 in epochs else "the sensor has yet to begin anew"

    def watch(step, _):
        epochs.update([step.block.epoch] if len(step.block) else [])

    with bench(tmp_path, trigger=Patient, on_step=watch) as (source, _, recorder):
        source.inject(Fault("gap", rows=5))
        source.inject(Fault("restart"))
        assert recorder.record("rice").recording.n_samples == 300


def test_rows_that_come_late_and_complete_are_a_good_recording_that_says_so(tmp_path):
    with bench(tmp_path, speed=1) as (source, robot, recorder):
        source.inject(Fault("stall", after_s=0.1, stall_s=0.4))
        late = gid.load(recorder.record("rice").path)[0]
        assert robot.n_stops == 0
    with bench(tmp_path, speed=20) as (_, _, recorder):
        punctual = recorder.record("rice").recording
    assert late.meta["late_s"] > 0.2
    assert "late_s" not in punctual.meta
    assert np.array_equal(late.wrench, punctual.wrench), "neither rows nor trigger are moved"


def test_lag_without_a_clock_of_the_sensor(tmp_path):
    with bench(tmp_path, speed=1) as (source, robot, recorder):
        source._info = replace(source.info, device_clock=False)
        source.inject(Fault("stall", after_s=0.1, stall_s=0.4))
        assert refused(recorder, "late; wanted at most 20 ms") is FailureReason.LAG
        assert robot.n_stops == 1


def test_overflow(tmp_path):
    slow = threading.Event()

    def dawdle(step, capture):
        if capture.state is CaptureState.TRIGGERED and not slow.is_set():
            slow.set()
            time.sleep(0.3)

    with bench(tmp_path, seconds=0.05, on_step=dawdle, n_samples=1600) as (_, _, recorder):
        assert refused(recorder, "rows were overwritten") is FailureReason.OVERFLOW
    assert files(tmp_path) == []


def test_robots_that_refuse_and_robots_that_fail(tmp_path):
    def refuse(*_):
        raise ConnectionError("arm is off")

    stops = []
    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        failing = CallbackRobot(refuse, lambda: stops.append(1))
        recorder = Recorder(stream, failing, tmp_path / "data", **SHORT)
        assert refused(recorder, "motion failed: ConnectionError: arm is off") is FailureReason.ROBOT
        assert stops == [1]
        failing.move_line = refuse
        assert refused(recorder, "refused the motion: arm is off") is FailureReason.ROBOT
        assert stops == [1, 1]
    with bench(tmp_path, n_samples=3000) as (_, _, recorder):
        assert refused(recorder, "into the wall") is FailureReason.ROBOT


class Other(TimedMotion):
    """A motion in the place of another one: it never ends, and fails when `fails` is set."""

    def __init__(self, motion, fails):
        super().__init__(motion.start_host_ns, 1000.0)
        self.start_time_s, self._fails = motion.start_time_s, fails

    def finished(self):
        if self._fails.is_set():
            self.error = "reflex"
        return False


def test_a_robot_that_fails_on_its_way_and_a_motion_that_never_ends(tmp_path):
    fails, given = threading.Event(), {"change": lambda motion: Other(motion, fails)}
    with bench(tmp_path, **given) as (_, robot, recorder):
        assert recorder.record("rice").recording.n_samples == 300, "what was recorded is nevertheless good"
        assert robot.n_stops == 1

    def watch(step, capture):
        if capture.n_rows:
            fails.set()

    with bench(tmp_path, speed=2, n_samples=1600, on_step=watch, **given) as (_, robot, recorder):
        assert refused(recorder, "the robot's motion failed: reflex") is FailureReason.ROBOT
        assert robot.n_stops == 1


@pytest.mark.parametrize("off_s", [-600.0, 600.0])
def test_a_robot_that_has_another_clock(tmp_path, off_s):
    def shift(motion):
        motion.start_time_s += off_s

    with bench(tmp_path, change=shift) as (_, robot, recorder):
        assert refused(recorder, r"newest row is of .* do not share a clock") is FailureReason.ROBOT
        assert robot.n_stops == 1


def test_an_odd_report_does_not_cost_the_recording(tmp_path):
    def report(motion):
        motion.report = lambda: {"pose": np.zeros(6)}

    with bench(tmp_path, change=report) as (_, _, recorder):
        kept = recorder.record("rice").recording.meta["robot"]
    assert "the robot's report['pose'] is a ndarray" in kept["report_error"]


def test_a_drive_ends_when_the_robot_stands_and_its_braking_is_none_of_the_next_rest():
    source = SimSource("rice", seed=1, speed=20)
    with opened(source) as stream:
        reader, robot = stream.buffer.reader(), Watched(source)
        for _ in range(2):
            capture = Capture(500, trigger=MotionTrigger(), **SHORT)
            steps = list(drive(stream, capture, robot=robot, reader=reader))
            assert source.world.push is None, "else the next one would be refused"
            read = [step for step in steps if len(step.block)]
            assert capture.state is CaptureState.COMPLETE
            end_s = capture.rows.time_s[-1]
            assert all(len(step.rows) == 0 for step in read if step.block.time_s[0] > end_s)
            read_s = max(step.block.time_s[-1] for step in read)
            assert read_s >= capture.trigger_time_s + 250 / 500 + 0.04, "the braking was read"
        assert robot.n_stops == 0


@pytest.mark.parametrize(
    ("state", "speed", "error"),
    [
        (CaptureState.ARMED, 20, ZeroDivisionError),
        (CaptureState.TRIGGERED, 2, KeyboardInterrupt),
        (CaptureState.COMPLETE, 20, KeyboardInterrupt),
    ],
)
def test_stopped_whatever_is_raised_and_whenever(tmp_path, state, speed, error):
    def fail(step, capture):
        if capture.state is state:
            raise error

    with bench(tmp_path, on_step=fail, speed=speed, n_samples=1200) as (_, robot, recorder):
        with pytest.raises(error):
            recorder.record("rice")
        assert robot.n_stops == 1
    assert files(tmp_path) == []


def test_leaving_a_drive_early_stops_the_robot():
    source = SimSource("rice", seed=1, speed=2)  # slow: a busy computer must not read the whole push at once
    with opened(source) as stream:
        robot = Watched(source)
        capture = Capture(500, trigger=MotionTrigger())
        steps = drive(stream, capture, robot=robot)
        next(step for step in steps if capture.n_rows)
        steps.close()
        assert robot.n_stops == 1
        assert (capture.state, capture.reason) == (CaptureState.FAILED, FailureReason.INTERRUPTED)


def test_a_robot_that_cannot_be_stopped_is_the_first_thing_to_know(tmp_path):
    def deaf(_):
        raise OSError("no connection")

    with bench(tmp_path, on_stop=deaf) as (source, _, recorder):
        source.inject(Fault("gap", after_s=0.2))
        words = r"could not be stopped: OSError: no connection \(it was to stop: 1 sample "
        assert refused(recorder, words) is FailureReason.ROBOT


def test_a_second_ctrl_c_while_the_robot_is_stopped(tmp_path):
    def impatient(n_stops):
        if n_stops == 1:
            raise KeyboardInterrupt

    with bench(tmp_path, on_stop=impatient) as (source, robot, recorder):
        source.inject(Fault("gap", after_s=0.2))
        with pytest.raises(KeyboardInterrupt):
            recorder.record("rice")
        assert robot.n_stops == 2


KILLED = """
import os, signal, sys
import numpy as np
from granular_id.live import Recorder, opened
with opened("sim:rice?seed=1&speed=20") as stream:
    recorder = Recorder(stream, stream.source.robot(), sys.argv[1], n_samples=300)
    recorder.record("rice")
    write = np.lib.format.write_array
    def killed(file, array, **options):
        write(file, array, **options)
        os.kill(os.getpid(), signal.SIGKILL)
    np.lib.format.write_array = killed
    recorder.record("rice")
"""


def test_kill_in_the_middle_of_writing(tmp_path):
    program = [sys.executable, "-c", KILLED, tmp_path / "data"]
    assert subprocess.run(program, check=False).returncode == -signal.SIGKILL
    assert sum(path.name.startswith(".") for path in files(tmp_path)) == 1, "half a file, hidden"
    assert len(files(tmp_path)) == 2
    assert len(gid.load(tmp_path / "data")) == 1


def test_a_full_disk_loses_no_recording(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    with bench(tmp_path) as (_, _, recorder):
        with monkeypatch.context() as patch:
            patch.setattr("numpy.lib.format.write_array", full)
            with pytest.raises(OSError, match=r"cannot write .*_1\.npz: No space left on device"):
                recorder.record("rice")
        assert files(tmp_path) == []
        assert recorder.last.label == "rice"
        gid.save(gid.Dataset([recorder.last]), tmp_path / "saved.npz")


def test_nothing_is_overwritten(tmp_path, monkeypatch):
    stamp = "20260101T000000Z"
    monkeypatch.setattr("granular_id.live.recorder._stamp", lambda _: stamp)
    names = []
    for n in (2, 1):
        with bench(tmp_path) as (_, _, recorder):
            names += [recorder.record("rice").path.name for _ in range(n)]
    assert names == [f"rice_{stamp}_{end}.npz" for end in ("1", "2", "1-2")]
    assert len(gid.load(tmp_path / "data")) == 3


def test_odd_labels_are_safe_names_and_stay_themselves(tmp_path):
    with bench(tmp_path) as (_, _, recorder):
        assert recorder.record("../Öl & 酢").path.parent == tmp_path / "data" / "Öl_酢"
        for wrong in ("", " rice", "a\nb", "a\x85b", "salt\u202ergus", "\u2067rice\u2069", "x" * 2000):
            with pytest.raises(ValueError, match="label"):
                recorder.record(wrong)
    assert gid.load(tmp_path / "data").y.tolist() == ["../Öl & 酢"]


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"folder": "file"}, NotADirectoryError, "wanted a folder"),
        ({"pre_s": -1}, ValueError, "pre_s"),
        ({"direction": (0, 0, 0)}, ValueError, "direction"),
        ({"speed_m_s": 0}, ValueError, "speed_m_s"),
        ({"session": " "}, ValueError, "session"),
        ({"pre": 1}, TypeError, "'pre'"),
        ({"robot": "arm"}, TypeError, "robot must have tcp_pose, move_line and stop, got str"),
        ({"trigger": ForceTrigger(1.0)}, TypeError, r"trigger must make a new trigger .* got a ForceTrigger"),
    ],
)
def test_refused_before_anything_moves(tmp_path, options, error, match):
    (tmp_path / "file").write_text("")
    given = {"robot": None, "folder": "data", **options}
    with opened("sim:rice?seed=1") as stream, pytest.raises(error, match=match):
        Recorder(stream, given.pop("robot"), tmp_path / given.pop("folder"), **given)
