"""``identify`` and ``model info``: what they take, print, write and refuse."""

import csv
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from cli_cases import LABELS, SMALL_MODEL, ended_well, make, recording, refused, saved
from granular_id import _core, save
from granular_id.identifier import Identifier
from granular_id.recording import Dataset, SampleFlag


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(), tmp_path_factory.mktemp("cli") / "uniform")


@pytest.fixture(scope="module")
def model(folder, tmp_path_factory):
    file = tmp_path_factory.mktemp("model") / "m.safetensors"
    ended_well("train", folder, "-o", file, *SMALL_MODEL, "--quiet")
    return file


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """Recordings of the same materials that are 100 samples long, with a trigger at sample 30."""
    rng = np.random.default_rng(8)
    recordings = [recording(rng, k, i, samples=100) for k in range(3) for i in range(2)]
    data = Dataset([replace(r, trigger_index=30) for r in recordings])
    file = tmp_path_factory.mktemp("fresh") / "fresh.npz"
    save(data, file)
    return data, file


# -- identify


def table_of(out):
    return [re.split(r"\s{2,}", line.strip()) for line in out.splitlines()]


def test_identify_names_recordings_and_compares_with_what_is_known(folder, model, tmp_path):
    answers, table = tmp_path / "a.json", tmp_path / "a.csv"
    out = ended_well("identify", model, folder, "--json", answers, "--csv", table)
    identifier = Identifier.load(model)
    from granular_id.io import load

    data = load(folder)
    said = identifier.predict(data.X)
    right = int((said == data.y).sum())
    assert f"{right} of 30 recordings with a known material named rightly: {100 * right / 30:.1f} %" in out
    assert "the model was trained on exactly these recordings: this says nothing about new ones" in out
    written = json.loads(answers.read_text(encoding="utf-8"))
    assert [row["label"] for row in written["recordings"]] == said.tolist()
    assert (written["accuracy"], written["n_judged"], written["trained_on_these"]) == (right / 30, 30, True)
    losses = identifier.losses(data.X)
    for row, loss in zip(written["recordings"], losses, strict=True):
        assert [entry["mean_loss"] for entry in row["ranking"]] == sorted(loss.tolist())
        assert row["margin"] == row["ranking"][1]["mean_loss"] - row["ranking"][0]["mean_loss"]
        assert row["probability"] is None
    with table.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["recording"], row["label"], row["truth"]) for row in rows] == [
        (name, label, truth) for name, label, truth in zip(data.names, said, data.y, strict=True)
    ]
    assert [float(row["margin"]) for row in rows] == [row["margin"] for row in written["recordings"]]


def test_some_of_the_recordings_of_the_training_are_known_again(folder, model, fresh, tmp_path):
    answers, table = tmp_path / "a.json", tmp_path / "a.csv"
    out = ended_well("identify", model, folder / "oat", "--json", answers)
    assert "the model was trained on each of these recordings: this says nothing about new ones" in out
    assert "trained on" not in out.replace("was trained on", "")
    written = json.loads(answers.read_text(encoding="utf-8"))
    assert (written["n_trained_on"], written["trained_on_these"]) == (10, False)
    _, file = fresh
    words = ("--begin-at", "first", "--json", answers, "--csv", table, "--force")
    out = ended_well("identify", model, folder / "oat", file, *words)
    assert re.search(r"; of the others \d of 6 named rightly", out)
    assert (
        "the model was trained on 10 of these 16 recordings, whose answers say nothing about new ones" in out
    )
    written = json.loads(answers.read_text(encoding="utf-8"))
    assert written["n_trained_on"] == 10
    assert [row["trained_on"] for row in written["recordings"]] == [True] * 10 + [False] * 6
    with table.open(encoding="utf-8", newline="") as stream:
        assert [row["trained_on"] for row in csv.DictReader(stream)] == ["true"] * 10 + ["false"] * 6


def test_a_model_knows_its_recordings_one_by_one_where_they_are_not_too_many(folder, model, monkeypatch):
    from granular_id.identifier import batch, metadata
    from granular_id.io import load

    data = load(folder)
    monkeypatch.setattr(metadata, "_MOST_MARKS", 29)
    older = Identifier.fit(data, "hfmh", estimate=False)
    assert metadata.MARKS not in older.trained
    assert len(Identifier.load(model).trained[metadata.MARKS]) == 30 * 8
    answers = batch.identify_all(older, data)
    assert answers.trained_on_these
    assert answers.n_trained_on is None
    some = batch.identify_all(older, data[:3])
    assert {named.trained_on for named in some} == {None}
    assert "trained" not in str(some.table())


def test_answers_are_those_of_the_streaming_identification(model, folder):
    identifier = Identifier.load(model)
    from granular_id.identifier import identify_all
    from granular_id.io import load

    data = load(folder)
    for named, one in zip(identify_all(identifier, data), data, strict=True):
        decision = identifier.identify(one)
        assert (decision.label, decision.margin, decision.ranking) == (
            named.label,
            named.margin,
            named.ranking,
        )


def test_quiet_prints_recording_and_answer_only(folder, model):
    lines = ended_well("identify", model, folder, "--quiet").splitlines()
    assert len(lines) == 30
    assert lines[0].split("\t")[0] == "oat/oat_00.csv"
    assert {line.split("\t")[1] for line in lines} <= {*LABELS}


def test_a_folder_without_labels_is_read_file_by_file(folder, model, tmp_path):
    for number, file in enumerate(sorted((folder / "rice").iterdir())[:3]):
        (tmp_path / f"{'ab_c'[number]}x.csv").write_bytes(file.read_bytes())
    out = ended_well("identify", model, tmp_path)
    assert "3 recordings, 0 materials" in out
    assert "truth" not in out
    assert "named rightly" not in out
    (tmp_path / "zz.csv").write_text("fx\nno number\n", encoding="utf-8")
    assert "zz.csv" in refused("identify", model, tmp_path)
    out = ended_well("identify", model, tmp_path, "--on-error", "skip")
    assert "1 file skipped:" in out
    for file in tmp_path.iterdir():
        file.unlink()
    (tmp_path / "zz.csv").write_text("fx\nno number\n", encoding="utf-8")
    assert "none of 1 recording could be read" in refused("identify", model, tmp_path, "--on-error", "skip")


def test_several_paths_are_named_after_where_they_are(folder, model, fresh):
    _, file = fresh
    one = folder / "oat" / "oat_00.csv"
    one = one if one.exists() else next((folder / "oat").iterdir())
    lines = ended_well("identify", model, one, folder, file, "--quiet", "--begin-at", "first").splitlines()
    names = [line.split("\t")[0] for line in lines if "\t" in line]
    assert names[0] == str(one)
    assert names[1].startswith(str(folder))
    assert len(names) == 1 + 30 + 6


def test_labels_that_the_model_does_not_know_are_not_counted(model, tmp_path):
    rng = np.random.default_rng(3)
    data = Dataset(
        [recording(rng, 0, 0), recording(rng, 1, 0, label="salt"), recording(rng, 1, 1, label="salt")]
    )
    save(data, tmp_path / "x.npz")
    out = ended_well("identify", model, tmp_path / "x.npz")
    assert "of 1 recording with a known material" in out
    assert "labels that the model does not know, not counted: salt (2)" in out


def test_longer_recordings_begin_at_their_trigger_or_where_it_is_said(fresh, tmp_path):
    data, file = fresh
    cropped = make().align(50, trigger=[10] * 30, lead_s=0.04)
    leads = Dataset([replace(r, trigger_index=5) for r in cropped])
    save(leads, tmp_path / "train.npz")
    model = tmp_path / "m.safetensors"
    ended_well("train", tmp_path / "train.npz", "-o", model, *SMALL_MODEL, "--quiet")
    identifier = Identifier.load(model)
    assert identifier.lead_s == 0.04
    for words, start in (
        ((), 25),
        (("--begin-at", "first"), 0),
        (("--begin-at", "trigger", "--lead-s", 0.08), 20),
        (
            (
                "--begin-at",
                "onset",
                "--rest-s",
                0.08,
                *(f for r in data for f in ("--onset-at", f"{r.name}=0.4")),
            ),
            45,
        ),
    ):
        ended_well("identify", model, file, *words, "--csv", tmp_path / "a.csv", "--force")
        with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as stream:
            margins = [float(row["margin"]) for row in csv.DictReader(stream)]
        losses = np.sort(identifier.losses(data.X[:, start : start + 50]), axis=1)
        assert margins == (losses[:, 1] - losses[:, 0]).tolist(), words


def test_what_trained_a_model_is_taken_by_it_with_the_same_steps(folder, fresh, tmp_path):
    model = tmp_path / "m.safetensors"
    ended_well("train", folder, "-o", model, "--n-samples", 50, *SMALL_MODEL, "--quiet")
    assert "rest ahead of the motion: not known, recordings begin at their first sample" in ended_well(
        "model", "info", model
    )
    data, file = fresh
    for words in ((), ("--begin-at", "first")):
        out = ended_well("identify", model, file, "--json", tmp_path / "a.json", "--force", *words)
        assert ("note: begins at the first sample, as in the training" in out) == (words == ())
        answers = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["recordings"]
        want = Identifier.load(model).predict(data.X[:, :50])
        assert [answer["label"] for answer in answers] == want.tolist()


def test_recordings_that_do_not_fit_are_refused_with_the_option_that_helps(folder, model, fresh, tmp_path):
    _, file = fresh
    line = refused("identify", model, file)  # 100 samples, a trigger, and a model that knows no lead
    assert (
        "has 100 samples, the model takes 60, and does not know how much rest comes before the motion" in line
    )
    assert "--lead-s" in line
    assert "--begin-at first" in line
    ended_well("identify", model, file, "--lead-s", 0.08)
    rng = np.random.default_rng(0)
    slow = saved(Dataset([recording(rng, 0, 0, jitter=0.5, samples=90)]), tmp_path / "irregular")
    line = refused("identify", model, slow)
    assert (
        "is sampled irregularly, the model was trained at 125 Hz; nothing is resampled unasked: add --rate-hz 125"
        in line
    )
    ended_well("identify", model, slow, "--rate-hz", 125, "--begin-at", "first")
    short = saved(Dataset([recording(rng, 0, 0, samples=40), recording(rng, 0, 1)]), tmp_path / "short")
    line = refused("identify", model, short)
    assert "has 40 samples (0.32 s), the model takes 60 (0.48 s); 1 of 2 recordings is shorter" in line
    assert "--on-short skip" in line
    out = ended_well("identify", model, short, "--on-short", "skip")
    assert "1 recording skipped:" in out or "recordings_skipped: 1" in out
    assert "--lead-s is time kept" in refused("identify", model, file, "--lead-s", 1, "--begin-at", "first")
    assert "add --begin-at onset" in refused("identify", model, file, "--onset-at", "a=1")


def test_flagged_samples_are_told(model, tmp_path):
    rng = np.random.default_rng(3)
    flags = np.zeros(60, np.uint8)
    flags[:4] = SampleFlag.SATURATED
    save(Dataset([replace(recording(rng, 0, 0), flags=flags), recording(rng, 1, 0)]), tmp_path / "x.npz")
    assert "4 saturated" in ended_well("identify", model, tmp_path / "x.npz")


def test_probabilities_are_shown_where_the_model_has_them(folder, tmp_path):
    model = tmp_path / "m.safetensors"
    ended_well(
        "train", folder, "-o", model, "--space", "hfmh", "--posterior", "wu_lin_weng", "--no-early", "--quiet"
    )
    out = ended_well("identify", model, folder, "--json", tmp_path / "a.json")
    assert "probability" in out
    shares = [row["probability"] for row in json.loads((tmp_path / "a.json").read_text())["recordings"]]
    assert all(0 < share <= 1 for share in shares)


def test_identify_says_what_is_missing(folder, model):
    for words, got in (((), "neither"), ((folder,), f"{folder} alone")):
        line = refused("identify", *words)
        assert line.startswith(
            f"error: a model file and recordings are needed, got {got}: granular-id identify"
        )
    turned = refused("identify", folder, model)
    assert (
        turned
        == f"error: {folder}: is a directory; the model comes first: granular-id identify MODEL PATH..."
    )
    named = refused("identify", "-m", folder / "absent.safetensors", model)
    assert named == f"error: {folder / 'absent.safetensors'}: no such file or directory"
    alone = refused("identify", "-m", model)
    assert alone == "error: no recordings given: granular-id identify -m MODEL PATH..."
    assert ended_well("identify", folder, "--model", model) == ended_well("identify", model, folder)


@pytest.mark.parametrize("command", [("identify",), ("model", "info")])
def test_no_model_is_refused_by_name(folder, tmp_path, command):
    absent = tmp_path / "absent.safetensors"
    paths = [folder] if command == ("identify",) else []
    assert f"{absent}" in refused(*command, absent, *paths)
    absent.write_bytes(b"no model at all")
    assert f"{absent}" in refused(*command, absent, *paths)


# -- model info


def test_model_info_prints_and_writes_what_is_in_the_file(model, tmp_path):
    out = ended_well("model", "info", model, "--json", tmp_path / "i.json")
    identifier = Identifier.load(model)
    for words in (
        "materials: 3: oat, rice, sugar\n",
        "trained on: 30 recordings, 10 of each material\n",
        "takes: 60 samples at 125 Hz (0.48 s) of fx fy fz tx ty tz",
        "features: raw+hfmh, 420 numbers; histogram of 10 bins, -1.5 to 1.5 N and N m, above 23 Hz\n",
        "classifier: 3 learners (onevsone), hinge loss, loss-weighted decoding\n",
        "accuracy, halves in time order: ",
        f"granular-id {_core.__version__}",
    ):
        assert words in out, words
    written = json.loads((tmp_path / "i.json").read_text(encoding="utf-8"))
    assert written["trained"] == identifier.trained
    assert written["classes"] == list(LABELS)
    assert written["spec"]["n_bins"] == 10
    assert written["training_sha256"] == identifier.core.metadata["training_sha256"]
    assert "belongs to" in refused("model", "info", model, "--json", model)


def test_model_info_does_not_wait_for_what_trains(model):
    code = (
        "import sys; from granular_id.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: print('exit', end.code)\n"
        "print('heavy', sorted({'sklearn', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    words = [sys.executable, "-c", code, "model", "info", str(model)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    assert "candidates: hold the right material" in done.stdout
    assert "heavy []" in done.stdout
