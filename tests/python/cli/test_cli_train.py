"""`train`: what it prints, writes and refuses; and what all commands around a model share."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from cli_cases import LABELS, SMALL_MODEL, ended_well, make, recording, refused, run, saved, written
from granular_id import save
from granular_id.identifier import Identifier, accuracy_over_time
from granular_id.io import load
from granular_id.recording import Dataset
from granular_id.synthetic import synthesize


def test_train_writes_the_model_of_the_library_and_says_what_it_may_be_worth(folder, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(sys, "argv", ["granular_id/__main__.py", "train", "my folder"])
    file, figure, figures = (tmp_path / name for name in ("m.safetensors", "o.png", "o.json"))
    out = ended_well("train", folder, "-o", file, *SMALL_MODEL, "--figure", figure, "--json", figures)
    data = load(folder)
    same = Identifier.fit(data, "raw+hfmh", n_bins=10, target_error=0.2)
    assert file.read_bytes() == same.core.to_bytes()
    assert out.startswith("30 recordings, 3 materials, 60 samples at 125 Hz\n")
    share = 100 * same.trained["estimate"]["accuracy"]
    for line in (
        f"accuracy, halves in time order: {share:.1f} %, 30 answers in 2 partitions\n",
        "chronological: by start time (session protocol left out: no recording says which session",
        "early answers: ",
        *(f"wrote {path}\n" for path in (file, figure, figures)),
    ):
        assert line in out
    assert out.endswith("repeat with: python -m granular_id train 'my folder' --force\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    course = accuracy_over_time(data, "raw+hfmh", n_bins=10, target_error=0.2)
    assert written(figures)["over_time"] == course.to_dict()
    assert written(figures)["estimate"] == same.trained["estimate"]


def test_train_takes_the_settings_of_the_method(folder, tmp_path):
    file = tmp_path / "m.safetensors"
    out = ended_well(
        "train", folder, "-o", file, "--space", "raw+hfmh", "--block-weights", "unit", "--bin-range", "auto",
        "--coding", "onevsall", "--posterior", "kullback_leibler", "--cutoff-hz", 11, "--order", 4,
        "--initial", "steady", "--C", 0.5, "--no-early",
        "--n-samples", 40, "--exclude", "sugar", "--seed", 4, "--quiet",
    )  # fmt: skip
    identifier = Identifier.load(file)
    settings = identifier.trained["settings"]
    assert (settings["classifier"]["C"], settings["classifier"]["random_state"]) == (0.5, 4)
    assert settings["features"]["block_weights"] == "unit"
    assert (identifier.spec.cutoff_hz, identifier.spec.order, identifier.spec.initial) == (11.0, 4, "steady")
    assert (identifier.n_samples, identifier.rate_hz, identifier.classes) == (40, 125.0, LABELS[:2])
    assert identifier.core.metadata["posterior"] == "kullback_leibler"
    assert identifier.core.early is None
    assert [step["step"] for step in identifier.trained["history"]] == ["load", "select", "align"]
    assert "repeat with" not in out
    out = ended_well("identify", file, folder, "--begin-at", "first", "--json", tmp_path / "a.json")
    assert "probability" in out, "the model has a posterior"
    assert all(0 < row["probability"] <= 1 for row in written(tmp_path / "a.json")["recordings"])


def test_one_recording_of_each_material_trains_without_an_estimate(tmp_path):
    data = saved(make(n=1), tmp_path / "few")
    out = ended_well("train", data, "-o", tmp_path / "m.safetensors", "--space", "hfmh")
    assert "accuracy: not known: class 'oat' has 1 recording" in out
    info = ended_well("model", "info", tmp_path / "m.safetensors")
    for what in ("early answers", "candidates", "unknown materials"):
        assert f"\n{what}: none: no recordings were held out\n" in info
    line = refused("train", data, "-o", tmp_path / "n.safetensors", "--figure", tmp_path / "f.png")
    assert line.startswith("error: --figure shows held-out recordings, and there are none: class 'oat' has 1")
    assert not (tmp_path / "n.safetensors").exists()


def test_what_the_data_check_says_is_no_failure_of_the_command(tmp_path):
    one = make(n=4)
    twice = saved(Dataset([*one, replace(one[0], name="again")]), tmp_path / "twice")
    out = ended_well("train", twice, "-o", tmp_path / "m.safetensors", *SMALL_MODEL)
    out += ended_well("evaluate", twice, "--spaces", "hfmh", "--train", 2, "--test", 1, "--partitions", 1)
    said = [line for line in out.splitlines() if "error: " in line]
    assert len(said) >= 2
    assert all(line.startswith("data check: error: ") for line in said)


def test_a_model_too_large_names_ways_out(tmp_path):
    rng = np.random.default_rng(0)
    data = Dataset([recording(rng, k % 3, 0, samples=1600, label=f"m{k:02d}") for k in range(24)])
    save(data, tmp_path / "many.npz")
    line = refused("train", tmp_path / "many.npz", "-o", tmp_path / "m", "--space", "raw+hfmh")
    assert "the model would take 21.8 MiB, more than the 16 MiB of a model file" in line
    assert (
        "ways out: the space 'hfmh' (600 features); shorter recordings, or a lower rate; the coding" in line
    )


def test_every_command_says_that_a_model_is_of_simulated_recordings(tmp_path):
    save(synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3), tmp_path / "x.npz")
    model = tmp_path / "m.safetensors"
    words = ("--space", "hfmh", "--quiet")
    assert "(SYNTHETIC recordings)" in ended_well("train", tmp_path / "x.npz", "-o", model, *words)
    assert ended_well("model", "info", model).startswith("SYNTHETIC: trained on simulated recordings")
    out = ended_well("identify", model, tmp_path / "x.npz")
    assert "a model of SYNTHETIC recordings and SYNTHETIC recordings" in out
    quiet = run("identify", model, tmp_path / "x.npz", "--quiet")
    assert "a model of SYNTHETIC recordings" in quiet.stderr
