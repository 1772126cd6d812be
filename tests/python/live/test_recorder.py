"""The recorder with the simulated bench: from the command to the file, whatever fails on the way."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from faulty_sim import Fault, FaultySource
from granular_id._core import host_ns
from granular_id.live.capture import Capture, CaptureError, CaptureState, FailureReason
from granular_id.live.drive import drive
from granular_id.live.recorder import Recorder
from granular_id.live.replay import ReplaySource
from granular_id.live.robot import CallbackRobot, TimedMotion
from granular_id.live.sim import SimRobot, SimSource
from granular_id.live.stream import opened
from granular_id.live.trigger import ForceTrigger, MotionTrigger

SHORT = {"n_samples": 300, "pre_s": 0.1}


class Watched(SimRobot):
    """Counts how often it was stopped; `change` may replace what a motion does."""

    def __init__(self, source, change=None, on_stop=None):
        super().__init__(source)
        self.n_stops, self.motion = 0, None
        self._change, self._on_stop = change, on_stop

    def move_line(self, direction, speed_m_s, duration_s):
        motion = super().move_line(direction, speed_m_s, duration_s)
        self.motion = motion if self._change is None else self._change(motion) or motion
        return self.motion

    def stop(self):
        super().stop()
        if self.motion is not None:
            self.motion.cancel()
        self.n_stops += 1
        if self._on_stop is not None:
            self._on_stop(self.n_stops)


@contextmanager
def bench(folder, *, speed=20, clock=True, change=None, on_stop=None, seconds=30.0, **options):
    source = FaultySource("rice", seed=1, speed=speed)
    source._info = replace(source.info, device_clock=clock)
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
                made.append((one := recorder.record("x").recording, one.meta["truth"]))
            except CaptureError as error:  # noqa: PERF203
                reason = error.reason
    assert reason is FailureReason.SOURCE
    expected = {r.wrench[r.trigger_index - 50 :][:400].tobytes(): r.label for r in data}
    assert made
    assert all(expected[recording.wrench.tobytes()] == truth for recording, truth in made)


def test_time_counts_from_the_call(tmp_path):
    with bench(tmp_path, speed=5, timeout_s=5.0, seconds=1.0) as (_, _, recorder):
        for _ in range(2):
            time.sleep(1.5)  # 7.5 s of the sensor's time
            assert recorder.record("rice").recording.n_samples == 300


def test_a_replay_that_has_run_ahead_is_read_from_its_first_row(tmp_path):
    data = gid.synthesize(["rice"], n_per_class=2, duration_s=1.0, seed=1)
    source = ReplaySource(data, speed=20, pause_s=3.0)
    with opened(source) as stream:
        recorder = Recorder(
            stream, None, tmp_path, trigger=source.trigger, n_samples=400, pre_s=0.1, timeout_s=0.5
        )
        time.sleep(0.5)  # it is over
        recording = recorder.record("rice").recording
    assert np.array_equal(recording.wrench, data[0].wrench[data[0].trigger_index - 50 :][:400])


def test_the_truth_is_that_of_the_push_also_where_the_replay_has_moved_on(tmp_path):
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=1, duration_s=1.0, seed=1)
    source = ReplaySource(data, speed=20, pause_s=3.0)

    def wait_for_the_next(step, capture):
        while capture.state is CaptureState.COMPLETE and source.truth == data[0].label:
            time.sleep(0.01)

    with opened(source) as stream:
        limits = {"n_samples": 400, "pre_s": 0.1, "on_step": wait_for_the_next}
        recorder = Recorder(stream, None, tmp_path, trigger=source.trigger, **limits)
        recording = recorder.record("x").recording
        assert source.truth == data[1].label
    assert recording.meta["truth"] == data[0].label


class Lasting(TimedMotion):
    """A motion in the place of another one: it does not end by itself, but fails after a while."""

    def __init__(self, motion):
        super().__init__(motion.start_host_ns, 1000.0)
        self.start_time_s = motion.start_time_s

    def finished(self):
        if host_ns() > self.start_host_ns + 5e7:
            self.error = "reflex"
        return super().finished()


def shifted(by_s):
    def shift(motion):
        motion.start_time_s += by_s

    return shift


def dawdle(step, capture):
    if capture.state is CaptureState.TRIGGERED:
        time.sleep(0.3)


def deaf(_):
    raise OSError("no connection")


GAP = Fault("gap", after_s=0.2, rows=3)


@pytest.mark.parametrize(
    ("fault", "options", "reason", "text"),
    [
        (GAP, {}, "gap", "3 samples .* are missing"),
        (Fault("gap", after_s=-0.05, rows=2), {}, "gap", "triggered after"),
        (Fault("saturation", after_s=0.2), {}, "saturation", "end of its range"),
        (Fault("restart", after_s=0.2), {}, "restart", "time began anew"),
        (Fault("restart", after_s=-0.2), {}, "restart", "anew after the motion was commanded"),
        (Fault("death", after_s=0.2), {}, "source", "told to die"),
        (Fault("stall", after_s=0.2, stall_s=60), {}, "no rows", "delivered nothing for 1 s"),
        (
            Fault("stall", after_s=0.1, stall_s=0.4),
            {"speed": 1, "clock": False},
            "lag",
            "wanted at most 20 ms",
        ),
        (None, {"seconds": 0.05, "on_step": dawdle, "n_samples": 1600}, "overflow", "rows were overwritten"),
        (None, {"n_samples": 3000}, "robot", "refused the motion: .* into the wall"),
        (None, {"change": shifted(-600.0)}, "robot", "newest row is of .* do not share a clock"),
        (None, {"change": shifted(600.0)}, "robot", "newest row is of .* do not share a clock"),
        (
            None,
            {"change": Lasting, "speed": 2, "n_samples": 1600},
            "robot",
            "the robot's motion failed: reflex",
        ),
        (
            GAP,
            {"on_stop": deaf},
            "robot",
            r"not be stopped: OSError: no connection \(it was to stop: 3 samples ",
        ),
    ],
)
def test_what_fails_stops_the_robot_and_leaves_no_file(tmp_path, fault, options, reason, text):
    with bench(tmp_path, **options) as (source, robot, recorder):
        if fault is not None:
            source.inject(fault)
        assert refused(recorder, text) is FailureReason(reason)
        assert (robot.n_stops, files(tmp_path)) == (1, [])
        if fault is not None and not FailureReason(reason).is_lasting and "clock" not in options:
            recorder.record("rice")
            assert len(gid.load(tmp_path / "data")) == 1, "the next one is good"


def test_what_the_users_robot_raises_fails_the_recording(tmp_path):
    def refuse(*_):
        raise ConnectionError("arm is off")

    stops = []
    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        robot = CallbackRobot(refuse, lambda: stops.append(1))
        recorder = Recorder(stream, robot, tmp_path / "data", **SHORT)
        assert refused(recorder, "motion failed: ConnectionError: arm is off") is FailureReason.ROBOT
        assert stops == [1]
        robot.move_line = refuse  # at once, not on its way
        assert refused(recorder, "refused the motion: arm is off") is FailureReason.ROBOT
        assert stops == [1, 1]


def test_a_motion_that_does_not_end_by_itself_is_stopped_and_what_was_recorded_is_good(tmp_path):
    with bench(tmp_path, change=Lasting) as (_, robot, recorder):
        assert recorder.record("rice").recording.n_samples == 300
        assert robot.n_stops == 1


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


def test_a_second_ctrl_c_while_the_robot_is_stopped(tmp_path):
    def impatient(n_stops):
        if n_stops == 1:
            raise KeyboardInterrupt

    with bench(tmp_path, on_stop=impatient) as (source, robot, recorder):
        source.inject(Fault("gap", after_s=0.2))
        with pytest.raises(KeyboardInterrupt):
            recorder.record("rice")
        assert robot.n_stops == 2


def test_what_a_killed_process_leaves_is_a_hidden_file_that_nothing_reads(tmp_path, monkeypatch):
    """Looked at while each array is written, as if the process ended there."""
    write, seen = np.lib.format.write_array, []

    def look(file, array, **options):
        write(file, array, **options)
        hidden = [path for path in files(tmp_path) if path.name.startswith(".")]
        seen.append((len(hidden), len(files(tmp_path)), len(gid.load(tmp_path / "data"))))

    with bench(tmp_path) as (_, _, recorder):
        recorder.record("rice")
        monkeypatch.setattr("numpy.lib.format.write_array", look)
        recorder.record("rice")
    assert set(seen) == {(1, 2, 1)}
    assert len(files(tmp_path)) == len(gid.load(tmp_path / "data")) == 2


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


def test_pushes_are_appended_to_an_archive(tmp_path):
    pytest.importorskip("pyarrow")
    for _ in range(2):
        with bench(tmp_path, archive=True) as (_, _, recorder):
            recorded = recorder.record("rice")
            assert recorded.path == tmp_path / "data"
    data = gid.load(tmp_path / "data")
    assert len(data) == 2
    assert data[1] == recorded.recording


def test_a_push_that_cannot_be_appended_is_kept_by_the_recorder(tmp_path, monkeypatch):
    pytest.importorskip("pyarrow")

    def full(*_):
        raise OSError(28, "No space left on device")

    with bench(tmp_path, archive=True) as (_, robot, recorder):
        with monkeypatch.context() as patch:
            patch.setattr("granular_id.live.recorder.append", full)
            with pytest.raises(OSError, match="No space left"):
                recorder.record("rice")
        assert (robot.n_stops, recorder.last.label) == (0, "rice")
        assert recorder.record("rice").recording.n_samples == 300, "the next one is good"
    assert len(gid.load(tmp_path / "data")) == 1


def test_what_is_no_archive_of_these_axes_is_refused_before_anything_moves(tmp_path):
    pytest.importorskip("pyarrow")
    one = gid.Recording(np.zeros((9, 2)), rate_hz=500, label="rice", axes=("wx", "ax"))
    gid.save(gid.Dataset([one]), tmp_path / "data", "parquet")
    with (
        pytest.raises(ValueError, match=r"^the sensor has the axes fx fy .*, and the archive .* wx ax"),
        bench(tmp_path, archive=True),
    ):
        pass
    (tmp_path / "other" / "data").mkdir(parents=True)
    (tmp_path / "other" / "data" / "a.txt").touch()
    with (
        pytest.raises(FileExistsError, match=r"holds 'a\.txt'; wanted an archive"),
        bench(tmp_path / "other", archive=True),
    ):
        pass


def test_no_files_are_written_into_an_archive(tmp_path):
    pytest.importorskip("pyarrow")
    with bench(tmp_path, archive=True) as (_, _, recorder):
        recorder.record("rice")
    before = files(tmp_path)
    with (
        pytest.raises(FileExistsError, match=r"data: is an archive; pass archive=True .*, or name another"),
        bench(tmp_path),
    ):
        pass
    assert files(tmp_path) == before


def test_nothing_is_overwritten(tmp_path, monkeypatch):
    stamp = "20260101T000000Z"
    monkeypatch.setattr("granular_id.live.recorder.utc_stamp", lambda: stamp)
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
        ({"n_sample": 3}, TypeError, "^n_sample is not known here; known limits: n_samples, pre_s, max_gap"),
        ({"robot": "arm"}, TypeError, "robot must have tcp_pose, move_line and stop, got str"),
        ({"trigger": ForceTrigger(1.0)}, TypeError, r"trigger must make a new trigger .* got a ForceTrigger"),
    ],
)
def test_refused_before_anything_moves(tmp_path, options, error, match):
    (tmp_path / "file").write_text("")
    given = {"robot": None, "folder": "data", **options}
    with opened("sim:rice?seed=1") as stream, pytest.raises(error, match=match):
        Recorder(stream, given.pop("robot"), tmp_path / given.pop("folder"), **given)
