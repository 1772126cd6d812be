"""The recorder with the simulated bench, from the command to the file: what it stores, and what it refuses."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import granular_id as gid
from granular_id.live.capture import Capture
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.drive import drive
from granular_id.live.recorder import Recorder
from granular_id.live.replay import ReplaySource
from granular_id.live.robots import CallbackRobot, ManualRobot
from granular_id.live.sim import SimRobot, SimSource
from granular_id.live.sim_faults import Fault
from granular_id.live.source import SourceInfo
from granular_id.live.source_thread import ThreadedSource
from granular_id.live.stream import opened
from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger

SHORT = {"n_samples": 300, "pre_s": 0.1}


class Watched(SimRobot):
    """Counts how often it was stopped."""

    def __init__(self, source):
        super().__init__(source)
        self.n_stops = 0

    def stop(self):
        super().stop()
        self.n_stops += 1


@contextmanager
def bench(tmp_path, *, speed=20, seed=1, materials="rice", **options):
    source = SimSource(materials, seed=seed, speed=speed)
    with opened(source) as stream:
        robot = Watched(source)
        yield source, robot, Recorder(stream, robot, tmp_path / "data", **{**SHORT, **options})


def files(folder):
    return sorted(path for path in Path(folder).rglob("*") if path.is_file())


def test_recordings_of_a_simulated_bench(tmp_path):
    with bench(tmp_path, session="Monday", n_samples=1600, pre_s=0.25) as (_, robot, recorder):
        before_s = time.time()
        recorded = [recorder.record("rice") for _ in range(3)]
        assert robot.n_stops == 0
    data = gid.load(tmp_path / "data")
    assert len(data) == 3
    assert [r.wrench.tobytes() for r in data] == [r.recording.wrench.tobytes() for r in recorded]
    assert data.X.shape == (3, 1600, 6)
    assert set(data.y) == {"rice"}
    assert set(data.sessions) == {"Monday"}
    assert [path.parent.name for path in files(tmp_path / "data")] == ["rice"] * 3
    for k, recording in enumerate(data):
        assert recording.trigger_index == 125
        assert recording.rate_hz == 500
        assert recording.meta["synthetic"] is True
        assert recording.meta["truth"] == "rice"
        assert recording.meta["trigger"] == "motion"
        assert recording.meta["source"]["meta"]["seed"] == 1
        assert recording.meta["robot"]["push"] == k
        assert recording.meta["robot"]["error"] is None
        assert recording.flags is None
        rest = recording.wrench[:125]
        assert abs(rest - rest.mean(axis=0))[:, 0].max() < 0.12
        assert recording.wrench[125:, 0].max() > rest[:, 0].mean() + 3
    starts = [r.start_time for r in data]
    assert np.diff(starts).min() > 3.2, "the sensor's own time, twenty times as fast"
    assert before_s - 5 < starts[0] < before_s + 60
    findings = data.check().findings
    assert {finding.code for finding in findings if finding.severity == "error"} <= {"one-label"}


def test_same_seed_same_recordings(tmp_path):
    made = []
    for speed in (20, 9):
        with bench(tmp_path / str(speed), speed=speed, seed=3, materials="unknown") as (source, _, recorder):
            made.append([(recorder.record("x").recording.wrench.tobytes(), source.truth) for _ in range(3)])
    assert made[0] == made[1]


def test_rows_given_while_they_come_are_the_recording(tmp_path):
    rows, states = [], []

    def watch(step, capture):
        rows.append(step.rows)
        states.append(capture.state)

    with bench(tmp_path, on_step=watch) as (_, _, recorder):
        recording = recorder.record("rice").recording
    assert np.array_equal(np.concatenate(rows), recording.wrench)
    assert states[-1] is CaptureState.COMPLETE


def test_close_to_what_synthesize_makes(tmp_path):
    """Mean force of recordings through the whole chain: within the spread of `synthesize`'s own."""
    made = gid.synthesize(["fine sugar"], n_per_class=16, seed=2)
    theirs = np.array([r.wrench[r.trigger_index :].mean(axis=0) for r in made])[:, :3]
    ours = []
    for seed in range(2):
        place = tmp_path / str(seed)
        with bench(place, seed=seed, materials="fine sugar", n_samples=1600, pre_s=0.2) as (_, _, recorder):
            for _ in range(4):
                recorder.record("fine sugar")
        ours += [r.wrench[r.trigger_index :].mean(axis=0)[:3] for r in gid.load(place / "data")]
    assert len(ours) == 8
    spread = theirs.std(axis=0)
    assert (abs(np.mean(ours, axis=0) - theirs.mean(axis=0)) < 2 * spread).all()
    assert (np.std(ours, axis=0) < 3 * spread).all()


FAULTS = {
    "gap": (Fault("gap", after_s=0.2, rows=3), FailureReason.GAP, "3 samples .* are missing"),
    "saturation": (Fault("saturation", after_s=0.2), FailureReason.SATURATION, "end of its range"),
    "restart": (Fault("restart", after_s=0.2), FailureReason.RESTART, "time began anew"),
    "death": (Fault("death", after_s=0.2), FailureReason.SOURCE, "told to die"),
    "silence": (Fault("stall", after_s=0.2, stall_s=60), FailureReason.NO_ROWS, "delivered nothing for 1 s"),
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
    from granular_id.live.adapters.polling import PolledMotion

    class Arm(Watched):
        def move_line(self, direction, speed_m_s, duration_s):
            motion = super().move_line(direction, speed_m_s, duration_s)

            def ask():
                if stream.source.world.tick > stream.source.world.push.start_tick + 50:
                    raise RuntimeError("reflex")
                return False

            return PolledMotion(motion.start_time_s, ask, {})

    with opened(SimSource("rice", seed=1, speed=5)) as stream:
        robot = Arm(stream.source)
        recorder = Recorder(stream, robot, tmp_path / "data", n_samples=1000)
        with pytest.raises(CaptureError, match="the robot's motion failed: RuntimeError: reflex") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.ROBOT
    assert robot.n_stops == 1


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


def test_somebody_moves_without_being_asked(tmp_path):
    source = SimSource("dry peas", seed=1, speed=10)
    with opened(source) as stream:
        recorder = Recorder(stream, None, tmp_path / "data", **SHORT)
        source.robot().move_line((1, 0, 0), 0.03, 2.0)
        recording = recorder.record("dry peas").recording
    assert recording.meta["trigger"] == "force"
    assert abs(recording.wrench[50, :3] - recording.wrench[:50, :3].mean(axis=0)).max() > 0.25
    assert "robot" not in recording.meta


def test_replayed_recordings_are_recorded_as_they_were(tmp_path):
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=2, seed=1)
    source = ReplaySource(data, speed=20, pause_s=2.0)
    made = []
    with opened(source) as stream:
        recorder = Recorder(
            stream, None, tmp_path / "data", trigger=source.trigger, n_samples=1500, pre_s=0.1
        )

        def play_on():
            while True:
                made.append((recorder.record("x").recording, source.truth))

        with pytest.raises(CaptureError, match="the source came to its end") as raised:
            play_on()
    assert raised.value.reason is FailureReason.SOURCE
    expected = {r.wrench[r.trigger_index - 50 :][:1500].tobytes(): r.label for r in data}
    assert len(made) >= 3
    for recording, truth in made:
        assert expected[recording.wrench.tobytes()] == truth


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
    source = SimSource("rice", seed=1, speed=20)
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


def worker(what, folder):
    script = Path(__file__).with_name("recorder_work.py")
    return subprocess.Popen(
        [sys.executable, script, what, folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def read_until(process, line):
    for came in process.stdout:
        if came.strip() == line:
            return
    raise AssertionError(f"{line!r} did not come: {process.stderr.read()}")


def test_ctrl_c(tmp_path, heeding_interrupts):
    process = worker("interrupt", tmp_path / "data")
    read_until(process, "moving")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert out.split("\n")[:2] == ["robot stopped", "source stopped"]
    assert "KeyboardInterrupt" in err
    assert files(tmp_path) == []


def test_kill_in_the_middle_of_writing(tmp_path):
    process = worker("kill", tmp_path / "data")
    read_until(process, "one is there")
    read_until(process, "writing")
    process.kill()
    process.communicate(timeout=20)
    left = files(tmp_path)
    assert len(left) == 2
    assert sum(path.name.startswith(".") for path in left) == 1, "half a file, hidden"
    assert len(gid.load(tmp_path / "data")) == 1


def test_full_disk(tmp_path):
    process = worker("full", tmp_path / "data")
    _, err = process.communicate(timeout=20)
    assert process.returncode == 1
    last = err.strip().splitlines()[-1]
    assert last.startswith(f"OSError: cannot write {tmp_path / 'data' / 'rice' / 'rice_'}")
    assert last.endswith("_2.npz: File too large")
    assert [path.name.startswith(".") for path in files(tmp_path)] == [False]
    assert len(gid.load(tmp_path / "data")) == 1


def test_full_disk_loses_no_recording(tmp_path, monkeypatch):
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
    monkeypatch.setattr("granular_id.live.recorder._stamp", lambda _: "20260101T000000Z")
    names = []
    for seed in (1, 2):
        with bench(tmp_path, seed=seed) as (_, _, recorder):
            names += [recorder.record("rice").path.name for _ in range(2)]
    assert names == [
        "rice_20260101T000000Z_1.npz",
        "rice_20260101T000000Z_2.npz",
        "rice_20260101T000000Z_1-2.npz",
        "rice_20260101T000000Z_2-2.npz",
    ]
    assert len(gid.load(tmp_path / "data")) == 4


def test_odd_labels_are_safe_names_and_stay_themselves(tmp_path):
    with bench(tmp_path) as (_, _, recorder):
        path = recorder.record("../Öl & 酢").path
        assert path.is_relative_to(tmp_path / "data")
        for wrong in ("", " rice", "a\nb"):
            with pytest.raises(ValueError, match="label"):
                recorder.record(wrong)
    assert gid.load(tmp_path / "data").y.tolist() == ["../Öl & 酢"]


def test_refused_before_anything_moves(tmp_path):
    (tmp_path / "file").write_text("")
    with opened("sim:rice?seed=1") as stream:
        robot = stream.source.robot()
        with pytest.raises(NotADirectoryError, match="wanted a folder"):
            Recorder(stream, robot, tmp_path / "file")
        for options, error, match in [
            ({"pre_s": -1}, ValueError, "pre_s must not be negative"),
            ({"n_samples": 0}, ValueError, "n_samples must be at least 2"),
            ({"direction": (0, 0, 0)}, ValueError, "direction"),
            ({"speed_m_s": 0}, ValueError, "speed_m_s must be positive"),
            ({"session": " "}, ValueError, "session"),
            ({"pre": 1}, TypeError, "'pre'"),
        ]:
            with pytest.raises(error, match=match):
                Recorder(stream, robot, tmp_path / "data", **options)
        with pytest.raises(TypeError, match="robot must have tcp_pose, move_line and stop, got str"):
            Recorder(stream, "arm", tmp_path / "data")


def test_who_waits_for_the_force(tmp_path):
    with opened("sim:rice?seed=1") as stream:
        kinds = {
            robot: Recorder(stream, robot, tmp_path)._trigger
            for robot in (None, ManualRobot(), stream.source.robot())
        }
    assert list(kinds.values()) == [ForceTrigger, ForceTrigger, MotionTrigger]


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
