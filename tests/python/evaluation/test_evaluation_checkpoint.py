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
from sklearn.preprocessing import FunctionTransformer

import checkpoint_work
from checkpoint_work import run
from evaluation_cases import SMALL, changed, flat, make_data
from granular_id._estimators import describe_estimator
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import EvaluationResult, evaluate
from granular_id.evaluation.checkpoint import RUN
from granular_id.spaces import RawHFMH, RawSignal, Tare

# 3 random partitions and 2 session folds, in 2 spaces and 5 controls of which the rest is left out
N_FILES = 5 * (2 + 4)


@pytest.fixture(scope="module")
def uninterrupted():
    return run(None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of an evaluation that is finished."""
    folder = tmp_path_factory.mktemp("checkpoint") / "whole"
    run(folder)
    return folder


@pytest.fixture
def kept(whole, tmp_path):
    """Return a copy of it, to be spoiled."""
    return Path(shutil.copytree(whole, tmp_path / "kept"))


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
        assert len(finished(folder)) == (9 - 2) + (
            6 - 1
        )  # the first write of the first run is that of run.json
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


def test_a_finished_one_is_only_read(tmp_path, uninterrupted, monkeypatch):
    same(run(tmp_path), uninterrupted)
    monkeypatch.setattr(ECOCClassifier, "fit_gram", None)
    monkeypatch.setattr("granular_id.evaluation.runner.portrait_of_result", lambda *_: uninterrupted.portrait)
    again = run(tmp_path, n_jobs=2)
    same(again, uninterrupted)
    assert again.spaces[0].seconds["training"] > 0
    assert f"resumed: {N_FILES} partitions were finished by an earlier run" in again.notes


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: "",
        lambda text: "[]",
        lambda text: text.replace('"predicted": [', '"predicted": [99, '),
        lambda text: text.replace('"predicted": [', '"predicted": [0, '),
        lambda text: text.replace('"predicted": [', '"predicted": [0.5, '),
        lambda text: text.replace('"n_features"', '"n"'),
        lambda text: text.replace('"fingerprint": "', '"fingerprint": "x'),
        lambda text: text.replace('"protocol": "paper"', '"protocol": "kfold"'),
        lambda text: json.dumps(
            {**json.loads(text), "predicted": [True] * len(json.loads(text)["predicted"])}
        ),
        lambda text: json.dumps({**json.loads(text), "seconds": {}}),
        lambda text: json.dumps({**json.loads(text), "shared_seconds": {}}),
    ],
)
def test_a_damaged_file_is_computed_anew_and_said(kept, uninterrupted, damage):
    victim = next(path for path in finished(kept) if "paper-0001" in path.name)
    text = victim.read_text()
    victim.write_text(damage(text))
    resumed = run(kept)
    same(resumed, uninterrupted)
    assert f"1 damaged checkpoint files were computed anew, the first is {victim.name!r}" in resumed.notes
    assert json.loads(victim.read_text())["predicted"] == json.loads(text)["predicted"]


def test_a_file_that_is_no_text_is_computed_anew(kept, uninterrupted):
    finished(kept)[0].write_bytes(b"\xff\xfe\x00")
    same(run(kept), uninterrupted)


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", "\xff"])
def test_a_damaged_owner_is_an_error(tmp_path, content):
    (tmp_path / RUN).write_text(content, encoding="latin-1")
    with pytest.raises(ValueError, match=r"checkpoint='.*': run.json is damaged.*give a new folder"):
        run(tmp_path)


def test_another_format_is_refused(tmp_path):
    (tmp_path / RUN).write_text('{"format": "granular_id.checkpoint/9", "fingerprint": ""}')
    with pytest.raises(ValueError, match=r"has format 'granular_id.checkpoint/9', wanted"):
        run(tmp_path)


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(ValueError, match=r"holds 'thesis.tex' and no run.json: it is no checkpoint"):
        run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(NotADirectoryError, match="is or lies in a file, wanted a folder"):
        run(tmp_path / "thesis.tex")


OTHERS = {
    "samples": (make_data(seed=1), {}),
    "labels": (
        changed(make_data(), label=lambda r: {"oat": "peas", "peas": "oat"}.get(r.label, r.label)),
        {},
    ),
    "times": (changed(make_data(), start_time=lambda r: r.start_time + 1), {}),
    "seed": (make_data(), {"random_state": 1}),
    "counts": (make_data(), {"n_partitions": 4}),
    "classifier": (make_data(), {"classifier": ECOCClassifier(C=2.0)}),
    "space": (make_data(), {"spaces": {"raw": RawHFMH()}}),
    "controls": (make_data(), {"controls": True}),
    "protocol": (make_data(), {"protocol": "session"}),
}
PLAIN = {**SMALL, "spaces": {"raw": RawSignal()}, "protocol": "paper"}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return the folder of the evaluation `PLAIN`, which nothing may touch again."""
    folder = tmp_path_factory.mktemp("checkpoint") / "plain"
    evaluate(make_data(), checkpoint=folder, **PLAIN)
    return folder


@pytest.mark.parametrize("change", OTHERS)
def test_another_evaluation_is_refused(plain, change):
    before = {path.name: path.read_bytes() for path in plain.iterdir()}
    data, arguments = OTHERS[change]
    with pytest.raises(ValueError, match="belongs to another evaluation"):
        evaluate(data, checkpoint=plain, **{**PLAIN, **arguments})
    assert {path.name: path.read_bytes() for path in plain.iterdir()} == before


def test_threads_and_progress_make_no_other_evaluation(tmp_path):
    def spaces(threads):
        return make_pipeline(Tare(0.02), RawSignal(threads=threads))

    first = evaluate(make_data(), checkpoint=tmp_path, **{**PLAIN, "spaces": {"raw": spaces(None)}})
    threads = {**PLAIN, "spaces": {"raw": spaces(1)}, "n_jobs": 2, "progress": True}
    assert list(evaluate(make_data(), checkpoint=tmp_path, **threads).predictions()) == list(
        first.predictions()
    )


def test_a_control_and_a_space_of_one_name_do_not_meet(tmp_path):
    spaces = {"means": RawSignal(), "control means": RawHFMH(), "a/b": RawSignal(), "a?b": RawHFMH()}
    arguments = {**PLAIN, "spaces": spaces, "controls": True}
    first, again = (evaluate(make_data(), checkpoint=tmp_path, **arguments) for _ in range(2))
    without = evaluate(make_data(), **arguments)
    same(first, without)
    same(again, without)


def test_where_a_function_lies_in_memory_is_no_setting():
    assert describe_estimator(FunctionTransformer(flat))["func"] == "evaluation_cases.flat"
