"""`train`, `identify` and `model info`: what they take, print, write and refuse."""

import csv
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from cli_cases import LABELS, SMALL_MODEL, ended_well, make, recording, refused, run, saved, written
from granular_id import ECOCClassifier, RawHFMH, _core, save
from granular_id.identifier import Identifier, identify_all, model as model_file
from granular_id.io import load
from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.synthetic import synthesize

# -- train


def test_train_writes_the_model_of_the_library_and_says_what_it_may_be_worth(folder, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(sys, "argv", ["granular_id/__main__.py", "train", "my folder"])
    file, figure, figures = (tmp_path / name for name in ("m.safetensors", "o.png", "o.json"))
    out = ended_well("train", folder, "-o", file, *SMALL_MODEL, "--figure", figure, "--json", figures)
    data = load(folder)
    pipeline = make_pipeline(RawHFMH(rate_hz=125, n_bins=10), ECOCClassifier())
    same = Identifier.fit(data, pipeline, target_error=0.2)
    assert Identifier.load(file).core.coef.tobytes() == same.core.coef.tobytes()
    assert Identifier.load(file).trained["estimate"] == same.trained["estimate"]
    assert out.startswith("30 recordings, 3 materials, 60 samples at 125 Hz\n")
    share = 100 * same.trained["estimate"]["accuracy"]
    for line in (
        f"accuracy, halves in time order: {share:.1f} %, 30 answers in 2 folds\n",
        "early answers: ",
        *(f"wrote {path}\n" for path in (file, figure, figures)),
    ):
        assert line in out
    assert out.endswith("repeat with: python -m granular_id train 'my folder' --force\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert written(figures)["over_time"] == same.over_time_.to_dict()
    assert written(figures)["estimate"] == same.trained["estimate"]


def test_train_takes_the_settings_of_the_method(folder, tmp_path):
    file = tmp_path / "m.safetensors"
    out = ended_well(
        "train", folder, "-o", file, "--space", "raw+hfmh", "--block-weights", "unit", "--bin-range", "auto",
        "--cutoff-hz", 11, "--order", 4,
        "--initial", "steady", "--C", 0.5, "--no-early",
        "--n-samples", 40, "--exclude", "sugar", "--seed", 4, "--quiet",
    )  # fmt: skip
    identifier = Identifier.load(file)
    settings = identifier.trained["settings"]
    assert settings["steps"][-1]["C"] == 0.5
    assert settings["steps"][0]["block_weights"] == "unit"
    assert (identifier.spec.cutoff_hz, identifier.spec.order, identifier.spec.initial) == (11.0, 4, "steady")
    assert (identifier.n_samples, identifier.rate_hz, identifier.classes) == (40, 125.0, LABELS[:2])
    assert identifier.core.early is None
    assert [step["step"] for step in identifier.trained["history"]] == ["load", "select", "align"]
    assert "repeat with" not in out


def test_one_recording_of_each_material_trains_without_an_estimate(tmp_path):
    data = saved(make(n=1), tmp_path / "few")
    out = ended_well("train", data, "-o", tmp_path / "m.safetensors", "--space", "hfmh")
    why = "fewer than two materials have more than one recording"
    assert f"accuracy: not known: {why}" in out
    info = ended_well("model", "info", tmp_path / "m.safetensors")
    for what in ("early answers", "candidates", "unknown materials"):
        assert f"\n{what}: none: no recordings were held out\n" in info
    line = refused("train", data, "-o", tmp_path / "n.safetensors", "--figure", tmp_path / "f.png")
    assert line.startswith(f"error: --figure shows held-out recordings, and there are none: {why}")
    assert not (tmp_path / "n.safetensors").exists()


def test_what_the_data_check_says_is_no_failure_of_the_command(tmp_path):
    one = make(n=4)
    twice = saved(Dataset([*one, replace(one[0], name="again")]), tmp_path / "twice")
    out = ended_well("train", twice, "-o", tmp_path / "m.safetensors", *SMALL_MODEL)
    out += ended_well("evaluate", twice, "--spaces", "hfmh", "--accept", "duplicates")
    said = [line for line in out.splitlines() if "error: " in line]
    assert said
    assert all(line.startswith("data check: error: ") for line in said)


def test_background_materials_are_trained_on_and_not_named(tmp_path):
    folder = saved(make(n=6), tmp_path / "set")
    ended_well("train", folder, "-o", tmp_path / "m.safetensors", *SMALL_MODEL, "--background", LABELS[0])
    out = ended_well("model", "info", tmp_path / "m.safetensors")
    assert f"background, never named: {LABELS[0]} (6)" in out
    assert f"materials: {len(LABELS) - 1}: " in out
    line = refused("train", folder, "-o", tmp_path / "n.safetensors", *SMALL_MODEL, "--background", "gravel")
    assert "background names 'gravel', of which there is no recording" in line


def test_a_model_too_large_names_ways_out(tmp_path):
    rng = np.random.default_rng(0)
    data = Dataset([recording(rng, k % 3, 0, samples=1600, label=f"m{k:02d}") for k in range(36)])
    save(data, tmp_path / "many.npz")
    line = refused("train", tmp_path / "many.npz", "-o", tmp_path / "m", "--space", "raw+hfmh")
    assert "the model would take 49.3 MiB, more than the 32 MiB of a model file" in line
    assert (
        "ways out: shorter recordings, a lower rate, fewer bins, --space hfmh, or a pipeline that ends"
        in line
    )


def test_every_command_says_that_a_model_is_of_simulated_recordings(tmp_path):
    save(synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3), tmp_path / "x.npz")
    model = tmp_path / "m.safetensors"
    words = ("--space", "hfmh", "--quiet")
    assert "(SYNTHETIC recordings)" in ended_well("train", tmp_path / "x.npz", "-o", model, *words)
    assert ended_well("model", "info", model).startswith("SYNTHETIC: trained on simulated recordings")
    out = ended_well("identify", model, tmp_path / "x.npz")
    assert "SYNTHETIC recordings and a model of such" in out
    quiet = run("identify", model, tmp_path / "x.npz", "--quiet")
    assert "SYNTHETIC recordings and a model of such" in quiet.stderr


@pytest.mark.parametrize(("unit", "said"), [("m/s2", " m/s2"), (None, "")])
def test_model_info_has_the_units_of_the_model_where_they_are_known(tmp_path, unit, said):
    rng = np.random.default_rng(2)
    axes = ("ax", "ay", "az")
    meta = {} if unit is None else {"units": dict.fromkeys(axes, unit)}
    each = [
        Recording(rng.normal(0, k + 1, (60, 3)), rate_hz=125.0, axes=axes, label=LABELS[k], meta=meta)
        for k in range(2)
        for _ in range(6)
    ]
    Identifier.fit(Dataset(each), "hfmh", estimate=False).save(tmp_path / "m.safetensors")
    lines = ended_well("model", "info", tmp_path / "m.safetensors").splitlines()
    assert any(f"-1.5 to 1.5{said}, above" in line for line in lines)
    assert not any("N m" in line for line in lines)


# -- identify


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """Recordings of the same materials that are 100 samples long, with a trigger at sample 30."""
    rng = np.random.default_rng(8)
    recordings = [recording(rng, k, i, samples=100) for k in range(3) for i in range(2)]
    data = Dataset([replace(r, trigger_index=30) for r in recordings])
    file = tmp_path_factory.mktemp("fresh") / "fresh.npz"
    save(data, file)
    return data, file


def rows_of(table):
    with table.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_identify_names_recordings_and_compares_with_what_is_known(folder, model, tmp_path):
    answers, table = tmp_path / "a.json", tmp_path / "a.csv"
    out = ended_well("identify", model, folder, "--json", answers, "--csv", table)
    assert out == ended_well(
        "identify", folder, "--model", model, "--json", answers, "--csv", table, "--force"
    )
    identifier, data = Identifier.load(model), load(folder)
    said = identifier.predict(data.X)
    right = int((said == data.y).sum())
    assert f"{right} of 30 recordings with a known material named rightly: {100 * right / 30:.1f} %" in out
    assert "the model was trained on each of these recordings: this says nothing about new ones" in out
    told = written(answers)
    assert [row["label"] for row in told["recordings"]] == said.tolist()
    assert (told["accuracy"], told["n_judged"], told["n_trained_on"]) == (right / 30, 30, 30)
    for row, loss in zip(told["recordings"], identifier.losses(data.X), strict=True):
        assert [entry["mean_loss"] for entry in row["ranking"]] == sorted(loss.tolist())
        assert row["margin"] == row["ranking"][1]["mean_loss"] - row["ranking"][0]["mean_loss"]
    shares = identifier.predict_proba(data.X).max(axis=1)
    assert [row["probability"] for row in told["recordings"]] == pytest.approx(shares.tolist())
    rows = rows_of(table)
    assert [(row["recording"], row["label"], row["truth"]) for row in rows] == [
        (name, label, truth) for name, label, truth in zip(data.names, said, data.y, strict=True)
    ]
    assert [float(row["margin"]) for row in rows] == [row["margin"] for row in told["recordings"]]
    for row, one in zip(told["recordings"], data, strict=True):
        decision = identifier.identify(one)  # as in a stream
        assert (decision.label, decision.margin) == (row["label"], row["margin"])
        assert decision.ranking == tuple((known["label"], known["mean_loss"]) for known in row["ranking"])


def test_some_of_the_recordings_of_the_training_are_known_again(folder, model, fresh, tmp_path):
    answers, table = tmp_path / "a.json", tmp_path / "a.csv"
    out = ended_well("identify", model, folder / "oat", "--json", answers)
    assert "the model was trained on each of these recordings: this says nothing about new ones" in out
    assert "trained on" not in out.replace("was trained on", "")
    assert written(answers)["n_trained_on"] == 10
    words = ("--begin-at", "first", "--json", answers, "--csv", table, "--force")
    out = ended_well("identify", model, folder / "oat", fresh[1], *words)
    assert re.search(r"; of the others \d of 6 named rightly", out)
    assert "the model was trained on 10 of these 16 recordings, whose answers say nothing about new" in out
    assert written(answers)["n_trained_on"] == 10
    assert [row["trained_on"] for row in written(answers)["recordings"]] == [True] * 10 + [False] * 6
    assert [row["trained_on"] for row in rows_of(table)] == ["true"] * 10 + ["false"] * 6


def test_a_model_knows_its_recordings_one_by_one_where_they_are_not_too_many(folder, model, monkeypatch):
    data = load(folder)
    monkeypatch.setattr(model_file, "_MOST_MARKS", 29)
    older = Identifier.fit(data, "hfmh", estimate=False)
    assert model_file.MARKS not in older.trained
    assert len(Identifier.load(model).trained[model_file.MARKS]) == 30 * 8
    answers = identify_all(older, data)
    some = identify_all(older, data[:3])
    assert answers.trained_on is some.trained_on is None
    assert "trained" not in str(some.table())


def test_several_paths_are_named_after_where_they_are_and_quiet_prints_names_and_answers(
    folder, model, fresh
):
    _, file = fresh
    one = next((folder / "oat").iterdir())
    words = (one, folder, file, "--quiet", "--begin-at", "first")
    rows = [line.split("\t") for line in ended_well("identify", model, *words).splitlines() if "\t" in line]
    assert rows[0][0] == str(one)
    assert rows[1][0].startswith(str(folder))
    assert len(rows) == 1 + 30 + 6
    assert {row[1] for row in rows} <= {*LABELS}
    assert ended_well("identify", model, folder, "--quiet").startswith("oat/oat_00.csv\t")


def test_a_folder_without_labels_is_read_file_by_file(folder, model, tmp_path):
    for number, file in enumerate(sorted((folder / "rice").iterdir())[:3]):
        (tmp_path / f"{number}.csv").write_bytes(file.read_bytes())
    out = ended_well("identify", model, tmp_path)
    assert "3 recordings, 0 materials" in out
    assert "truth" not in out
    assert "named rightly" not in out
    (tmp_path / "99.csv").write_text("fx\nno number\n", encoding="utf-8")
    assert "99.csv" in refused("identify", model, tmp_path)
    assert "1 file skipped:" in ended_well("identify", model, tmp_path, "--on-error", "skip")
    for file in tmp_path.glob("[0-9].csv"):
        file.unlink()
    assert "none of 1 recording could be read" in refused("identify", model, tmp_path, "--on-error", "skip")


def test_unknown_labels_are_not_counted_and_flagged_samples_are_told(model, tmp_path):
    rng = np.random.default_rng(3)
    flags = np.zeros(60, np.uint8)
    flags[:4] = SampleFlag.SATURATED
    known = replace(recording(rng, 0, 0), flags=flags)
    save(Dataset([known, *(recording(rng, 1, i, label="salt") for i in range(2))]), tmp_path / "x.npz")
    out = ended_well("identify", model, tmp_path / "x.npz")
    assert "of 1 recording with a known material" in out
    assert "labels that the model does not know, not counted: salt (2)" in out
    assert "4 saturated" in out


def test_longer_recordings_begin_at_their_trigger_or_where_it_is_said(fresh, tmp_path):
    data, file = fresh
    begun = Dataset([replace(r, trigger_index=10) for r in make()])
    cropped = begun.align(50, trigger="recorded", lead_s=0.04)
    save(Dataset([replace(r, trigger_index=5) for r in cropped]), tmp_path / "train.npz")
    model = tmp_path / "m.safetensors"
    ended_well("train", tmp_path / "train.npz", "-o", model, *SMALL_MODEL, "--quiet")
    identifier = Identifier.load(model)
    assert identifier.lead_s == 0.04
    stated = [word for r in data for word in ("--onset-at", f"{r.name}=0.4")]
    for words, start in (
        ((), 25),
        (("--begin-at", "first"), 0),
        (("--begin-at", "trigger", "--lead-s", 0.08), 20),
        (("--begin-at", "onset", "--rest-s", 0.08, *stated), 45),
    ):
        ended_well("identify", model, file, *words, "--csv", tmp_path / "a.csv", "--force")
        losses = np.sort(identifier.losses(data.X[:, start : start + 50]), axis=1)
        margins = [float(row["margin"]) for row in rows_of(tmp_path / "a.csv")]
        assert margins == (losses[:, 1] - losses[:, 0]).tolist(), words


def test_what_trained_a_model_is_taken_by_it_with_the_same_steps(folder, fresh, tmp_path):
    model = tmp_path / "m.safetensors"
    ended_well("train", folder, "-o", model, "--n-samples", 50, *SMALL_MODEL, "--quiet")
    info = ended_well("model", "info", model)
    assert "rest ahead of the motion: not known, recordings begin at their first sample" in info
    data, file = fresh
    for words in ((), ("--begin-at", "first")):
        out = ended_well("identify", model, file, "--json", tmp_path / "a.json", "--force", *words)
        assert ("note: begins at the first sample, as in the training" in out) == (words == ())
        want = Identifier.load(model).predict(data.X[:, :50])
        assert [answer["label"] for answer in written(tmp_path / "a.json")["recordings"]] == want.tolist()


def test_recordings_that_do_not_fit_are_refused_with_the_option_that_helps(model, fresh, tmp_path):
    _, file = fresh
    line = refused("identify", model, file)  # 100 samples, a trigger, and a model that knows no lead
    for part in ("has 100 samples, the model takes 60, and does not know", "--lead-s", "--begin-at first"):
        assert part in line
    ended_well("identify", model, file, "--lead-s", 0.08)
    rng = np.random.default_rng(0)
    slow = saved(Dataset([recording(rng, 0, 0, jitter=0.5, samples=90)]), tmp_path / "irregular")
    line = refused("identify", model, slow)
    assert "is sampled irregularly, the model was trained at 125 Hz; nothing is resampled unasked" in line
    assert line.endswith("add --rate-hz 125")
    ended_well("identify", model, slow, "--rate-hz", 125, "--begin-at", "first")
    short = saved(Dataset([recording(rng, 0, 0, samples=40), recording(rng, 0, 1)]), tmp_path / "short")
    line = refused("identify", model, short)
    assert "has 40 samples (0.32 s), the model takes 60 (0.48 s); 1 of 2 recordings is shorter" in line
    assert "--on-short skip" in line
    out = ended_well("identify", model, short, "--on-short", "skip")
    assert "1 recording skipped:" in out or "recordings_skipped: 1" in out


def test_model_info_prints_and_writes_what_is_in_the_file(model, tmp_path):
    out = ended_well("model", "info", model, "--json", tmp_path / "i.json")
    identifier = Identifier.load(model)
    for words in (
        "materials: 3: oat, rice, sugar\n",
        "trained on: 30 recordings, 10 of each material\n",
        "takes: 60 samples at 125 Hz (0.48 s) of fx fy fz tx ty tz",
        "features: raw+hfmh, 420 numbers; histogram of 10 bins, -1.5 to 1.5 N and N m, above 23 Hz\n",
        "classifier: 3 learners, hinge loss\n",
        "accuracy, halves in time order: ",
        f"granular-id {_core.__version__}",
    ):
        assert words in out, words
    told = written(tmp_path / "i.json")
    assert told["trained"] == identifier.trained
    assert told["classes"] == list(LABELS)
    assert told["spec"]["n_bins"] == 10
    assert told["training_sha256"] == identifier.core.metadata["training_sha256"]
