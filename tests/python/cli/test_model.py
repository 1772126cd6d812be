"""`train`, `model`, `identify`, `adapt` and `explain`: what they print and write is what the library says."""

import csv
import re
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from cli_cases import LABELS, SMALL_MODEL, ended_well, make, refused, run, saved, written
from granular_id import _core, save
from granular_id.identifier import Identifier, adapt as adapting
from granular_id.io import load
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize
from multiband_cases import louder

# -- train and model


def test_train_writes_the_model_of_the_library(folder, tmp_path):
    pytest.importorskip("matplotlib")
    file, figure, figures = (tmp_path / name for name in ("m.safetensors", "o.png", "o.json"))
    out = ended_well("train", folder, "-o", file, *SMALL_MODEL, "--figure", figure, "--json", figures)
    same = Identifier.fit(load(folder), "raw+hfmh", target_error=0.2)
    assert Identifier.load(file).core.coef.tobytes() == same.core.coef.tobytes()
    assert Identifier.load(file).trained["estimate"] == same.trained["estimate"]
    share = 100 * same.trained["estimate"]["accuracy"]
    assert out.startswith(f"accuracy, halves in time order: {share:.1f} %, 30 answers in 2 folds\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert written(figures)["over_time"] == same.over_time_.to_dict()
    assert written(figures)["estimate"] == same.trained["estimate"]


def test_train_takes_settings_and_background(folder, tmp_path):
    file = tmp_path / "m.safetensors"
    words = ("--space", "raw+hfmh", "--bin-range", "auto", "--cutoff-hz", 11, "--background", LABELS[0])
    ended_well("train", folder, "-o", file, *words, "--seed", 4, "--quiet")
    identifier = Identifier.load(file)
    assert (identifier.spec.cutoff_hz, identifier.classes) == (11.0, LABELS[1:])
    assert f"background, never named: {LABELS[0]} (10)" in ended_well("model", file, "--details")


def test_one_recording_of_each_material_gives_no_estimate(tmp_path):
    data = saved(make(n=1), tmp_path / "few")
    out = ended_well("train", data, "-o", tmp_path / "m.safetensors", "--space", "hfmh")
    why = "fewer than two materials have more than one recording"
    assert f"accuracy: not known: {why}" in out
    assert "\ncandidates: none: no recordings" in ended_well("model", tmp_path / "m.safetensors")
    line = refused("train", data, "-o", tmp_path / "n.safetensors", "--figure", tmp_path / "f.png")
    assert line.startswith(f"error: --figure shows held-out recordings, and there are none: {why}")
    assert not (tmp_path / "n.safetensors").exists()


def test_model_prints_and_writes_what_the_file_holds(model, tmp_path):
    out = ended_well("model", model, "--details", "--json", tmp_path / "i.json")
    identifier = Identifier.load(model)
    for words in ("materials: 3: oat, rice, sugar\n", "classifier: 3 learners, hinge loss\n"):
        assert words in out, words
    numbers = written(tmp_path / "i.json")
    assert numbers["trained"] == identifier.trained
    assert numbers["training_sha256"] == identifier.core.metadata["training_sha256"]


def test_every_command_says_that_a_model_is_simulated(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    path, model = save(data, tmp_path / "x.npz"), tmp_path / "m.safetensors"
    words = ("--space", "hfmh", "--quiet")
    assert "(SYNTHETIC recordings)" in ended_well("train", path, "-o", model, *words)
    assert ended_well("model", model).startswith("SYNTHETIC: trained on simulated recordings")
    assert "SYNTHETIC recordings and a model of such" in ended_well("identify", model, path)
    assert "SYNTHETIC recordings and a model of such" in run("identify", model, path, "--quiet").stderr
    out = ended_well("adapt", model, path, "-o", tmp_path / "n.safetensors", "--all-materials")
    assert "SYNTHETIC recordings and a model of such: this says nothing about real" in out


# -- identify


def rows_of(table):
    with table.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_identify_answers_as_the_library(folder, model, tmp_path):
    answers, table = tmp_path / "a.json", tmp_path / "a.csv"
    out = ended_well("identify", model, folder, "--json", answers, "--csv", table)
    identifier, data = Identifier.load(model), load(folder)
    labels = identifier.predict(data.X)
    right = int((labels == data.y).sum())
    assert f"{right} of 30 recordings with a known material named rightly: {100 * right / 30:.1f} %" in out
    assert "the model was trained on each of these recordings" in out
    numbers = written(answers)
    assert [row["label"] for row in numbers["recordings"]] == labels.tolist()
    assert (numbers["accuracy"], numbers["n_judged"], numbers["n_trained_on"]) == (right / 30, 30, 30)
    for row, loss in zip(numbers["recordings"], identifier.losses(data.X), strict=True):
        assert [entry["mean_loss"] for entry in row["ranking"]] == sorted(loss.tolist())
    columns = [(row["recording"], row["label"], row["truth"]) for row in rows_of(table)]
    assert columns == list(zip(data.names, labels, data.y, strict=True))


def test_several_paths_are_named_and_quiet_prints_answers(folder, model):
    one = next((folder / "oat").iterdir())
    words = (one, folder, "--quiet")
    rows = [line.split("\t") for line in ended_well("identify", model, *words).splitlines() if "\t" in line]
    assert rows[0][0] == str(one)
    assert rows[1][0].startswith(str(folder))
    assert len(rows) == 1 + 30
    assert {row[1] for row in rows} <= {*LABELS}
    assert ended_well("identify", model, folder, "--quiet").startswith("oat/oat_00.csv\t")


def test_names_of_files_are_labels_with_blanks(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    model = tmp_path / "m.safetensors"
    ended_well("train", save(data, tmp_path / "x.npz"), "-o", model, "--space", "hfmh", "--quiet")
    (tmp_path / "fresh").mkdir()
    for k, one in enumerate(data):
        name = f"{one.label.replace(' ', '_')}_{k}.npz"
        save(Dataset([replace(one, label=None)]), tmp_path / "fresh" / name)
    assert "of 8 recordings with a known material" in ended_well("identify", model, tmp_path / "fresh")


EXPORT = "Lab 3\nwx;wy;wz;steps;extra\n"


def test_recordings_are_read_as_those_of_the_training(tmp_path):
    rng = np.random.default_rng(4)
    for k, label in enumerate(LABELS):
        for i in range(5):
            path = tmp_path / ("later" if i == 4 else "first") / "monday" / label / f"{i}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            rows = np.column_stack([rng.normal(0, k + 1, (80, 3)), np.arange(80), np.zeros(80)])
            path.write_text(EXPORT + "\n".join(";".join(f"{x:.3f}" for x in row) for row in rows) + "\n")
    read = ("--axes", "wx,wy,wz", "--units", "deg/s", "--recorded-hz", 100)
    places = ("--csv", "skiprows=1", "--label", "folder", "--session", "parent")
    ended_well("data", "convert", tmp_path / "first", tmp_path / "first.npz", *read, *places)
    model = tmp_path / "m.safetensors"
    ended_well("train", tmp_path / "first.npz", "-o", model, "--space", "raw", "--quiet")
    out = ended_well("identify", model, tmp_path / "later")
    assert "of 3 recordings with a known material" in out
    assert "set-up" not in out
    ended_well("identify", model, tmp_path / "later" / "monday" / "oat" / "4.csv", tmp_path / "first.npz")


# -- identify --hop-s


def long(n, name="drive", label="rice", **fields):
    """Recordings one after another as one of n windows of the model's length."""
    samples = np.concatenate([one.wrench for one in make(n).select(labels=[label])])
    return Recording(samples[: 60 * n], rate_hz=125.0, name=name, **fields)


def test_answers_over_one_recording_are_those_of_the_library(model, tmp_path):
    pytest.importorskip("matplotlib")
    drive = save(Dataset([long(5, label="oat")]), tmp_path / "drive.npz")
    table, answers, figure = (tmp_path / name for name in ("a.csv", "a.json", "a.png"))
    words = ("--hop-s", 0.24, "--csv", table, "--json", answers, "--figure", figure)
    out = ended_well("identify", model, drive, *words)
    same = Identifier.load(model).predict_over(load(drive)[0], 0.24)
    for stretch in same.stretches:
        assert f"{stretch.from_s:.2f} to {stretch.to_s:.2f}" in out
    assert f"{len(same)} answers, one each 0.24 s about the last 0.48 s" in out
    assert written(answers)["recordings"] == [same.to_dict()]
    assert [row["label"] for row in rows_of(table)] == same.labels.tolist()
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert ended_well("identify", model, drive, "--hop-s", 0.48, "--quiet").startswith("drive\t")


def test_answers_over_several_recordings_are_a_line_each(model, tmp_path):
    save(Dataset([long(4, "a"), long(3, "b")]), tmp_path / "two.npz")
    lines = ended_well("identify", model, tmp_path / "two.npz", "--hop-s", 0.48).splitlines()
    assert [line.partition(": ")[0] for line in lines if line[1:2] == ":"] == ["a", "b"]
    line = refused("identify", model, tmp_path / "two.npz", "--hop-s", 0.48, "--figure", tmp_path / "a.png")
    assert "--figure draws one recording, got 2" in line


# -- adapt


def moved(n, *, labels=True, **fields):
    """The small recordings in another set-up: other gains, another zero, another session."""
    return Dataset(
        [
            replace(r, wrench=1.2 * r.wrench + 0.3, session="elsewhere", label=r.label if labels else None)
            for r in make(n, **fields)
        ]
    )


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """Five labelled recordings of each material."""
    return saved(moved(5), tmp_path_factory.mktemp("adapt") / "elsewhere")


def weights(model):
    return model.core.coef.tobytes(), model.core.intercept.tobytes()


@pytest.mark.parametrize("word", ["--labelled", "--all-materials"])
def test_adapt_writes_the_model_of_the_library(model, elsewhere, tmp_path, word):
    before = model.read_bytes()
    out = ended_well("adapt", model, elsewhere, "-o", tmp_path / "new.safetensors", word)
    assert out.startswith("adapted by 15 ")
    data = load(elsewhere)
    way = {"labels": data.y} if word == "--labelled" else {"all_materials": True}
    wanted = Identifier.load(model).adapt(data, **way)
    assert weights(Identifier.load(tmp_path / "new.safetensors")) == weights(wanted)
    assert model.read_bytes() == before
    assert "\nadapted: by 15 " in ended_well("model", tmp_path / "new.safetensors")


def test_missing_materials_are_allowed_by_the_option(model, tmp_path):
    some = save(moved(4)[np.arange(8)], tmp_path / "some.npz")
    words = ("adapt", model, some, "-o", tmp_path / "new.safetensors", "--labelled")
    line = refused(*words)
    assert "sugar is missing" in line
    (allow,) = re.findall(r"\((--allow-missing)\)", line)
    assert "gain nothing: sugar" in " ".join(ended_well(*words, allow).split())


def test_model_itself_is_replaced_by_force_only(model, elsewhere, tmp_path, monkeypatch):
    own = tmp_path / "own.safetensors"
    own.write_bytes(model.read_bytes())
    words = ("adapt", own, elsewhere, "-o", own, "--labelled")
    assert "is MODEL itself: give the new model another name, or add --force" in refused(*words)
    with monkeypatch.context() as patch:
        patch.setattr(adapting, "_new_model", Mock(side_effect=_core.GranularIdError("full")))
        refused(*words, "--force")
    assert own.read_bytes() == model.read_bytes()
    ended_well(*words, "--force")
    assert "adapted" in Identifier.load(own).trained


# -- explain


@pytest.fixture(scope="module")
def loud(tmp_path_factory):
    """Two materials in three sessions, which differ along fz."""
    data = [
        Recording(wrench, 500.0, label=str(label), session=f"day {number % 3}", name=f"{number:02d}")
        for number, (wrench, label) in enumerate(zip(*louder(), strict=True))
    ]
    return save(Dataset(data), tmp_path_factory.mktemp("explain") / "loud.npz")


def test_explain_prints_and_writes_contributions(loud, tmp_path):
    pytest.importorskip("matplotlib")
    words = ("explain", loud, "rice", "oat", "--space", "multiband")
    out = ended_well(*words, "--figure", tmp_path / "why.png", "--json", tmp_path / "why.json")
    assert re.search(r"^block +fx +fy +fz +(tx +ty +tz +)?sum$", out, re.M)
    assert (tmp_path / "why.png").stat().st_size > 10_000
    read = written(tmp_path / "why.json")
    assert sum(read["features"]["contributions"]) == pytest.approx(read["difference"])
    assert "\nband " in ended_well(*words, "--details")


def test_explain_trains_the_model_of_train(loud, tmp_path):
    out = ended_well("explain", loud, "rice", "oat", "--json", tmp_path / "best.json")
    read = written(tmp_path / "best.json")
    assert read["model"].startswith("trained on 16 of 24 recordings; the mean of the candidate models")
    assert f"best: {read['model']}; explained on recordings held out: " in " ".join(out.split())
    assert max(read["by_axis"], key=read["by_axis"].get) == "fz"
    assert (len(read["split"]["train"]), len(read["split"]["explained"])) == (16, 8)


def test_labels_with_blanks_are_typed_with_underscores(loud, tmp_path):
    data = [replace(one, label={"rice": "red clay"}.get(one.label, "peas")) for one in load(loud)]
    rye = [replace(each, label="rye", session="day 9") for each in data[::2]]
    three = save(Dataset([*data, *rye]), tmp_path / "three.npz")
    assert "\nred clay " in ended_well("explain", three, "red_clay", "peas", "--space", "raw")
    words = ("--space", "raw", "--background", "red_clay", "--quiet")
    ended_well("train", three, "-o", tmp_path / "m.safetensors", *words)
    assert Identifier.load(tmp_path / "m.safetensors").classes == ("peas", "rye")


# -- confidence


def test_confidence_writes_what_it_prints(tmp_path):
    pytest.importorskip("matplotlib")
    folder = saved(make(6), tmp_path / "set")
    figure, json_file = tmp_path / "f.svg", tmp_path / "c.json"
    words = ["--space", "hfmh", "--levels", "0.6,0.8", "--share-known", "0.9"]
    out = ended_well("confidence", folder, *words, "--figure", figure, "--json", json_file)
    assert "refused while 10 % of the known are" in " ".join(out.split())
    stored = written(json_file)
    assert [one["level"] for one in stored["coverage"]] == [0.6, 0.8]
    assert (stored["data"]["n_recordings"], stored["space"], stored["share_known"]) == (18, "hfmh", 0.9)
    assert figure.read_text().startswith("<?xml")
