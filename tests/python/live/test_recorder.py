"""The recorder with the simulated bench, from the command to the file."""

from __future__ import annotations

import time

import numpy as np

import granular_id as gid
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.recorder import Recorder
from granular_id.live.replay import ReplaySource
from granular_id.live.robots import ManualRobot
from granular_id.live.sim import SimSource
from granular_id.live.stream import opened
from granular_id.live.trigger import ForceTrigger, MotionTrigger
from recorder_cases import SHORT, bench, files


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


def test_somebody_moves_without_being_asked(tmp_path):
    source, moves = SimSource("dry peas", seed=1, speed=10), []

    def move_once(step, capture):
        if capture.state is CaptureState.ARMED and not moves:
            moves.append(source.robot().move_line((1, 0, 0), 0.03, 2.0))

    with opened(source) as stream:
        recording = (
            Recorder(stream, None, tmp_path / "data", on_step=move_once, **SHORT).record("dry peas").recording
        )
    assert recording.meta["trigger"] == "force"
    assert abs(recording.wrench[50, :3] - recording.wrench[:50, :3].mean(axis=0)).max() > 0.25
    assert "robot" not in recording.meta


def test_replayed_recordings_are_recorded_as_they_were(tmp_path):
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=2, seed=1)
    source = ReplaySource(data, speed=20, pause_s=6.0)
    made = []
    with opened(source) as stream:
        recorder = Recorder(
            stream, None, tmp_path / "data", trigger=source.trigger, n_samples=1500, pre_s=0.1
        )

        def next_one():
            try:
                made.append((recorder.record("x").recording, source.truth))
            except CaptureError as error:
                return error.reason
            return None

        late = (
            None,
            FailureReason.TRIGGER_TOO_EARLY,
            FailureReason.GAP,
        )  # a busy computer missed the beginning
        while (reason := next_one()) in late:
            pass
    assert reason is FailureReason.SOURCE
    expected = {r.wrench[r.trigger_index - 50 :][:1500].tobytes(): r.label for r in data}
    assert made
    for recording, truth in made:
        assert expected[recording.wrench.tobytes()] == truth


def test_who_waits_for_the_force(tmp_path):
    with opened("sim:rice?seed=1") as stream:
        kinds = {
            robot: Recorder(stream, robot, tmp_path)._trigger
            for robot in (None, ManualRobot(), stream.source.robot())
        }
    assert list(kinds.values()) == [ForceTrigger, ForceTrigger, MotionTrigger]
