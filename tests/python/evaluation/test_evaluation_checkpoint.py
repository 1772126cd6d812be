"""Checkpoints: killed anywhere, an evaluation goes on to the same numbers; other evaluations are refused."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from sklearn.pipeline import make_pipeline

import checkpoint_work
from checkpoint_work import run
from evaluation_cases import SMALL, changed, make_data
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import EvaluationResult, evaluate
from granular_id.evaluation.checkpoint import RUN
from granular_id.spaces import RawHFMH, RawSignal, Tare

# 2 session folds and 2 as many at random in 2 spaces, then 4 controls on the session folds
N_FILES = 2 * 2 * 2 + 4 * 2


@pytest.fixture(scope="module")
def uninterrupted():
    return run(None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of an evaluation that is finished."""
    folder = tmp_path_factory.mktemp("checkpoint") / "whole"
    run(folder)
    return folder


def same(one, other):
    assert list(one.predictions()) == list(other.predictions())
    assert one.controls == other.controls
    figures = [result.to_dict() for result in (one, other)]
    for figure in figures:
        for space in figure["spaces"]:
            del space["seconds"]
    for part in ("spaces", "partitions", "recordings", "settings", "portrait", "labels"):
        assert figures[0][part] == figures[1][part]


def finished(folder):
    return sorted(path for path in folder.glob("[!.]*") if path.name != RUN)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_killed_and_resumed_equals_uninterrupted(tmp_path, uninterrupted):
    folder, result = tmp_path / "kept", tmp_path / "result.json"
    program = [sys.executable, checkpoint_work.__file__, folder, result]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "bufsize": 1}
    found = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(program, env=found, **pipes) as working:

        def end_of_run(stop):
            working.stdin.write(f"{stop}\n")
            return int(working.stdout.readline())

        for stop in (9, 6):
            assert end_of_run(stop) == -signal.SIGKILL
            for path in finished(folder):
                json.loads(path.read_text())
        # the first write of the first run is that of run.json
        assert len(finished(folder)) == (9 - 2) + (6 - 1)
        assert not result.exists()
        assert end_of_run(0) == 0
    resumed = EvaluationResult.from_json(result)
    same(resumed, uninterrupted)
    assert "resumed: 12 partitions were finished by an earlier run" in resumed.notes
    assert len(finished(folder)) == N_FILES


def test_ctrl_c_leaves_what_is_finished(tmp_path, uninterrupted):
    def stop(done, total, what):
        if done == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "kept", progress=stop)
    assert 0 < len(finished(tmp_path / "kept")) < N_FILES
    same(run(tmp_path / "kept"), uninterrupted)


def test_a_finished_one_is_only_read(whole, uninterrupted, monkeypatch):
    monkeypatch.setattr(ECOCClassifier, "fit_gram", None)
    monkeypatch.setattr("granular_id.evaluation.runner.report_data_of", lambda *_: uninterrupted.report_data)
    again = run(whole, n_jobs=2)
    same(again, uninterrupted)
    assert again.spaces[0].seconds["training"] > 0
    assert f"resumed: {N_FILES} partitions were finished by an earlier run" in again.notes


def with_parts(text, **parts):
    return json.dumps({**json.loads(text), **parts})


DAMAGES = {
    "cut": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "a list": lambda text: "[]",
    "no text": lambda text: "\udcff\udcfe",
    "another class": lambda text: text.replace('"predicted": [', '"predicted": [99, '),
    "one more row": lambda text: text.replace('"predicted": [', '"predicted": [0, '),
    "no whole number": lambda text: text.replace('"predicted": [', '"predicted": [0.5, '),
    "true for one": lambda text: with_parts(text, predicted=[True] * len(json.loads(text)["predicted"])),
    "a missing entry": lambda text: text.replace('"n_features"', '"n"'),
    "another evaluation": lambda text: text.replace('"fingerprint": "', '"fingerprint": "x'),
    "another protocol": lambda text: text.replace('"protocol": "', '"protocol": "x'),
    "no seconds": lambda text: with_parts(text, seconds={}),
    "no shared seconds": lambda text: with_parts(text, shared_seconds={}),
}


def test_damaged_files_are_computed_anew_and_said(whole, tmp_path, uninterrupted):
    kept = Path(shutil.copytree(whole, tmp_path / "kept"))
    victims = finished(kept)[: len(DAMAGES)]
    before = [path.read_text() for path in victims]
    for path, text, damage in zip(victims, before, DAMAGES.values(), strict=True):
        assert damage(text) != text
        path.write_text(damage(text), errors="surrogateescape")
    resumed = run(kept)
    same(resumed, uninterrupted)
    said = next(note for note in resumed.notes if "damaged checkpoint files" in note)
    assert said.startswith(f"{len(DAMAGES)} damaged checkpoint files were computed anew, the first is ")
    assert any(repr(path.name) in said for path in victims)
    for path, text, damage in zip(victims, before, DAMAGES, strict=True):
        assert json.loads(path.read_text())["predicted"] == json.loads(text)["predicted"], damage


FORMAT = '{"format": "granular_id.checkpoint/9", "fingerprint": ""}'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        *[(text, "run.json is damaged.*give a new folder") for text in ("", "{", "[]", "{}", "\xff")],
        (FORMAT, "has format 'granular_id.checkpoint/9', wanted"),
    ],
)
def test_a_folder_whose_owner_cannot_be_read_is_refused(tmp_path, content, message):
    (tmp_path / RUN).write_text(content, encoding="latin-1")
    with pytest.raises(ValueError, match=f"checkpoint='.*{message}"):
        run(tmp_path)


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(ValueError, match=r"holds 'thesis.tex' and no run.json: it is no checkpoint"):
        run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(NotADirectoryError, match="is or lies in a file, wanted a folder"):
        run(tmp_path / "thesis.tex")


SWAPPED = {"oat": "peas", "peas": "oat"}
OTHERS = {
    "samples": (make_data(seed=1), {}),
    "labels": (changed(make_data(), label=lambda r: SWAPPED.get(r.label, r.label)), {}),
    "times": (changed(make_data(), start_time=lambda r: r.start_time + 1), {}),
    "seed": (make_data(), {"random_state": 1}),
    "counts": (make_data(), {"n_partitions": 4}),
    "classifier": (make_data(), {"classifier": ECOCClassifier(C=2.0)}),
    "space": (make_data(), {"spaces": {"raw": RawHFMH()}}),
    "controls": (make_data(), {"controls": True}),
    "protocol": (make_data(), {"protocol": "session"}),
}
PLAIN = {**SMALL, "spaces": {"raw": make_pipeline(Tare(0.02), RawSignal())}, "protocol": "paper"}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return the folder of the evaluation `PLAIN`, which nothing may touch again, and its result."""
    folder = tmp_path_factory.mktemp("checkpoint") / "plain"
    return folder, evaluate(make_data(), checkpoint=folder, **PLAIN)


@pytest.mark.parametrize("change", OTHERS)
def test_another_evaluation_is_refused(plain, change):
    folder, _ = plain
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    data, arguments = OTHERS[change]
    with pytest.raises(ValueError, match="belongs to another evaluation"):
        evaluate(data, checkpoint=folder, **{**PLAIN, **arguments})
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_threads_and_progress_make_no_other_evaluation(plain):
    folder, first = plain
    spaces = {"raw": make_pipeline(Tare(0.02), RawSignal(threads=1))}
    threads = {**PLAIN, "spaces": spaces, "n_jobs": 2, "progress": True}
    again = evaluate(make_data(), checkpoint=folder, **threads)
    assert list(again.predictions()) == list(first.predictions())


def test_a_control_and_a_space_of_one_name_do_not_meet(tmp_path):
    spaces = {"means": RawSignal(), "control means": RawHFMH(), "a/b": RawSignal(), "a?b": RawHFMH()}
    arguments = {**PLAIN, "spaces": spaces, "controls": True}
    first, again = (evaluate(make_data(), checkpoint=tmp_path, **arguments) for _ in range(2))
    without = evaluate(make_data(), **arguments)
    same(first, without)
    same(again, without)
