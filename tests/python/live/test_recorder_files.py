"""Files of recorders: whole or absent, never overwritten, wherever the process ends."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

import granular_id as gid
from granular_id.live.recorder import Recorder
from granular_id.live.stream import opened
from granular_id.live.trigger import ForceTrigger
from recorder_cases import bench, files


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
    out, err = process.communicate(timeout=120)
    assert out.split("\n")[:2] == ["robot stopped", "source stopped"]
    assert "KeyboardInterrupt" in err
    assert files(tmp_path) == []


def test_kill_in_the_middle_of_writing(tmp_path):
    process = worker("kill", tmp_path / "data")
    read_until(process, "one is there")
    read_until(process, "writing")
    process.kill()
    process.communicate(timeout=120)
    left = files(tmp_path)
    assert len(left) == 2
    assert sum(path.name.startswith(".") for path in left) == 1, "half a file, hidden"
    assert len(gid.load(tmp_path / "data")) == 1


def test_full_disk(tmp_path):
    process = worker("full", tmp_path / "data")
    _, err = process.communicate(timeout=120)
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
        assert path.parent == tmp_path / "data" / "Öl_酢"
        for wrong in ("", " rice", "a\nb", "a\x85b", "salt\u202ergus", "\u2067rice\u2069"):
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
        with pytest.raises(TypeError, match=r"trigger must make a new trigger .* got a ForceTrigger"):
            Recorder(stream, robot, tmp_path / "data", trigger=ForceTrigger(1.0))
