"""The recorder: from the command to the file, whatever fails on the way."""

import time

import numpy as np
import pytest

import granular_id as gid
from granular_id.live import CaptureError, ForceTrigger, Recorder, SimSource, opened
from granular_id.live.capture import CaptureState
from world import World


def bench(folder, **options):
    """A world with an arm that goes back, and a recorder of it."""
    world, options = World(), {"n_samples": 300, "pre_s": 0.1} | options
    return world, Recorder(world.stream, world.arm.goes_back(), folder / "data", **options)


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_recordings_of_a_simulation_have_all_that_is_known(tmp_path):
    rows, states, before_s = [], [], time.time()

    def watch(step, capture):
        rows.append(step.rows)
        states.append(capture.state)

    with opened(SimSource("rice", seed=1, speed=20)) as stream:
        recorder = Recorder(stream, stream.source.robot(), tmp_path, session="Monday", on_step=watch)
        recorded = [recorder.record("rice") for _ in range(2)]
    data = gid.load(tmp_path)
    assert [r.wrench.tobytes() for r in data] == [r.recording.wrench.tobytes() for r in recorded]
    assert np.array_equal(np.concatenate(rows), np.concatenate(data.X)), "rows are given while they come"
    assert states[-1] is CaptureState.COMPLETE
    for k, one in enumerate(data):
        assert (one.label, one.session, one.n_samples) == ("rice", "Monday", 1600)
        assert (one.trigger_index, one.rate_hz, one.flags) == (125, 500, None)
        meta = one.meta
        assert (meta["synthetic"], meta["truth"], meta["trigger"]) == (True, "rice", "motion")
        assert (meta["source"]["meta"]["seed"], meta["robot"]["push"], meta["robot"]["error"]) == (1, k, None)
    first, second = (one.start_time for one in data)
    assert second - first > 3.2, "the sensor's own time, twenty times as fast"
    assert before_s - 5 < first < before_s + 60


@pytest.mark.parametrize("fault", ["gap", "error", "command", "step"])
def test_push_that_fails_leaves_no_file_and_the_next_one_does(tmp_path, fault):
    def fail(*_):
        raise ConnectionError("arm is off")

    def watch(*_):
        return fault == "step" and world.arm.times("push") and fail()

    world, recorder = bench(tmp_path, on_step=watch)
    moves, sensor = world.arm.move_line, world.sensor
    happens = {"gap": lambda: setattr(sensor, "lose", 3), "error": lambda: setattr(sensor, "error", "cable")}
    world.arm.on["push"] = lambda: world.after(0.2, happens.get(fault, lambda: None))
    if fault == "command":
        world.arm.move_line = fail
    with pytest.raises(ConnectionError if fault == "step" else CaptureError):
        recorder.record("rice")
    assert (world.arm.times("stop") > 0, files(tmp_path)) == (True, [])
    fault, sensor.error, world.arm.move_line = None, None, moves
    recorder.resume()
    recorder.record("rice")
    assert len(files(tmp_path)) == 1


def test_odd_report_does_not_cost_the_recording(tmp_path):
    world, recorder = bench(tmp_path)
    world.arm.on["push"] = lambda: setattr(world.arm.motion, "report", lambda: {"pose": np.zeros(6)})
    stored = recorder.record("rice").recording.meta["robot"]
    assert "the robot's report['pose'] is a ndarray" in stored["report_error"]


@pytest.mark.parametrize("archive", [False, True])
def test_full_disk_loses_no_recording(tmp_path, monkeypatch, archive):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    if archive:
        pytest.importorskip("pyarrow")
    world, recorder = bench(tmp_path, archive=archive)
    with monkeypatch.context() as patch:
        where = "granular_id.io.parquet.writing._write" if archive else "numpy.lib.format.write_array"
        patch.setattr(where, full)
        with pytest.raises(OSError, match="No space left on device"):
            recorder.record("rice")
    assert (files(tmp_path), recorder.last.label, world.arm.times("stop")) == ([], "rice", 0)
    gid.save(gid.Dataset([recorder.last]), tmp_path / "saved.npz")
    recorder.record("rice")
    assert len(gid.load(tmp_path / "data")) == 1


def test_pushes_are_appended_to_an_archive_of_their_axes(tmp_path):
    pytest.importorskip("pyarrow")
    for _ in range(2):
        recorded = bench(tmp_path, archive=True)[1].record("rice")
    data = gid.load(tmp_path / "data")
    assert (recorded.path, len(data), data[1]) == (tmp_path / "data", 2, recorded.recording)
    with pytest.raises(FileExistsError, match=r"data: is an archive; pass archive=True"):
        bench(tmp_path)
    one = gid.Recording(np.zeros((9, 2)), rate_hz=500, label="rice", axes=("wx", "ax"))
    (tmp_path / "imu").mkdir()
    gid.save(gid.Dataset([one]), tmp_path / "imu" / "data", "parquet")
    with pytest.raises(ValueError, match=r"^the sensor has the axes fx fy .*, and the archive .* wx ax"):
        bench(tmp_path / "imu", archive=True)


def test_nothing_is_overwritten(tmp_path, monkeypatch):
    stamp = "20260101T000000Z"
    monkeypatch.setattr("granular_id.live.recorder.utc_stamp", lambda: stamp)
    recorders = [bench(tmp_path)[1] for _ in range(2)]
    names = [recorders[k].record("rice").path.name for k in (0, 0, 1)]
    assert names == [f"rice_{stamp}_{end}.npz" for end in ("1", "2", "1-2")]
    assert set(gid.load(tmp_path / "data").sessions) == {stamp}


def test_odd_label_is_a_safe_name_and_stays_itself(tmp_path):
    _, recorder = bench(tmp_path)
    assert recorder.record("../Öl & 酢").path.parent == tmp_path / "data" / "Öl_酢"
    for wrong in ("", " rice", "a\nb", "a\x85b", "salt\u202ergus", "\u2067rice\u2069", "x" * 2000):
        with pytest.raises(ValueError, match="label"):
            recorder.record(wrong)
    assert gid.load(tmp_path / "data").y.tolist() == ["../Öl & 酢"]


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"folder": "file"}, NotADirectoryError, "wanted a folder"),
        ({"direction": (0, 0, 0)}, ValueError, "direction"),
        ({"session": " "}, ValueError, "session"),
        ({"n_sample": 3}, TypeError, "n_sample"),
        ({"robot": "arm"}, TypeError, "robot must have move_line and stop, got str"),
        ({"stream": "sim:rice"}, TypeError, r"^stream must be an opened source .* got 'sim:rice'$"),
        ({"trigger": ForceTrigger(1.0)}, TypeError, r"trigger must make a new trigger .* got a ForceTrigger"),
    ],
)
def test_recorder_refused_argument_is_named(tmp_path, options, error, match):
    (tmp_path / "file").write_text("")
    given = {"stream": World().stream, "robot": None, "folder": "data", **options}
    with pytest.raises(error, match=match):
        Recorder(given.pop("stream"), given.pop("robot"), tmp_path / given.pop("folder"), **given)
