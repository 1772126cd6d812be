"""``train``: what it prints, writes and refuses; and what all commands around a model share."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from cli_cases import LABELS, SMALL_MODEL, ended_well, make, recording, refused, run, saved
from granular_id import save
from granular_id.identifier import Identifier, accuracy_over_time
from granular_id.recording import Dataset
from granular_id.synthetic import synthesize


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(), tmp_path_factory.mktemp("cli") / "uniform")


# -- train


def test_train_writes_the_model_of_the_library_and_says_what_it_may_be_worth(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["granular_id/__main__.py", "train", "my folder"])
    file, figure, figures = (tmp_path / name for name in ("m.safetensors", "o.png", "o.json"))
    out = ended_well("train", folder, "-o", file, *SMALL_MODEL, "--figure", figure, "--json", figures)
    data = make()
    from granular_id.io import load

    loaded = load(folder)
    same = Identifier.fit(loaded, "raw+hfmh", n_bins=10, target_error=0.2)
    assert file.read_bytes() == same.core.to_bytes()
    assert out.startswith("30 recordings, 3 materials, 60 samples at 125 Hz\n")
    share = 100 * same.trained["estimate"]["accuracy"]
    assert f"accuracy, halves in time order: {share:.1f} %, 30 answers in 2 partitions\n" in out
    assert "chronological: by start time (session protocol left out: no recording says which session" in out
    assert "early answers: " in out
    for path in (file, figure, figures):
        assert f"wrote {path}\n" in out
    assert out.endswith("repeat with: python -m granular_id train 'my folder' --force\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    written = json.loads(figures.read_text(encoding="utf-8"))
    course = accuracy_over_time(loaded, "raw+hfmh", n_bins=10, target_error=0.2)
    assert written["over_time"] == course.to_dict()
    assert written["estimate"] == same.trained["estimate"]
    assert len(data) == 30


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


def test_one_recording_of_each_material_trains_without_an_estimate(tmp_path):
    data = saved(make(n=1), tmp_path / "few")
    out = ended_well("train", data, "-o", tmp_path / "m.safetensors", "--space", "hfmh")
    assert "accuracy: not known: class 'oat' has 1 recording" in out
    info = ended_well("model", "info", tmp_path / "m.safetensors")
    for what in ("early answers", "candidates", "unknown materials"):
        assert f"\n{what}: none: no recordings were held out\n" in info
    line = refused("train", data, "-o", tmp_path / "n.safetensors", "--figure", tmp_path / "f.png")
    assert line.startswith(
        "error: --figure shows held-out recordings, and there are none: class 'oat' has 1 recording"
    )
    assert not (tmp_path / "n.safetensors").exists()


def test_what_the_data_check_says_is_no_failure_of_the_command(tmp_path):
    one = make(n=4)
    twice = saved(Dataset([*one, replace(one[0], name="again")]), tmp_path / "twice")
    out = ended_well("train", twice, "-o", tmp_path / "m.safetensors", *SMALL_MODEL)
    out += ended_well("evaluate", twice, "--spaces", "hfmh", "--train", 2, "--test", 1, "--partitions", 1)
    said = [line for line in out.splitlines() if "error: " in line]
    assert len(said) >= 2
    assert all(line.startswith("data check: error: ") for line in said)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tare-s", "0.1"], "--tare-s is not for models, .*: leave it out$"),
        (["--space", "hfmh", "--tare-s", "0.1"], "--tare-s .*: leave it out; --initial steady keeps"),
        (["--space", "dft"], "--space must be one of 'best', 'multiband', 'raw', .*, got 'dft'"),
        (["--space", "raw", "--coding", "twice"], "coding must be one of"),
        (["--coding", "onevsall"], "--coding must be left out with --space best, which is always one-vs-one"),
        (
            ["--space", "raw", "--block-weights", "unit"],
            "--block-weights must be left out with --space raw, which has a single block",
        ),
        (
            ["--space", "raw", "--posterior", "wu_lin_weng", "--coding", "onevsall"],
            "--posterior wu_lin_weng needs one learner for each",
        ),
        (["--exclude", "oat,rice"], "at least 2 classes, got only 'sugar'"),
        (["--figure", "f.doc"], "--figure must end in .png, .svg or .pdf"),
        (["--json", "absent/r.json"], "the folder absent does not exist"),
        (["--n-bins", "50"], "--n-bins must be left out with --space best, which has no use for it"),
        (["--space", "raw", "--n-bins", "50"], "--n-bins must be left out with --space raw, which has no"),
        (["--space", "hfmh", "--cutoff-hz", "80"], "--cutoff-hz must be in .*, got 80"),
    ],
)
def test_bad_options_of_train_end_in_one_line(folder, tmp_path, words, message):
    assert re.search(message, refused("train", folder, "-o", tmp_path / "m", *words))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--coding", "nose"), "--coding must be one of 'onevsone', .*, got 'nose'"),
        (("--space", "nose"), "--space must be one of 'best', .*, got 'nose'"),
    ],
)
def test_names_that_do_not_exist_are_refused_before_anything_is_read(tmp_path, words, message):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"no recordings in here")
    words = ("--space", "hfmh", *words)
    assert re.search(message, refused("train", broken, "-o", tmp_path / "m", *words))


def test_a_model_too_large_names_ways_out(tmp_path):
    rng = np.random.default_rng(0)
    data = Dataset([recording(rng, k % 3, 0, samples=1600, label=f"m{k:02d}") for k in range(24)])
    save(data, tmp_path / "many.npz")
    line = refused("train", tmp_path / "many.npz", "-o", tmp_path / "m", "--space", "raw+hfmh")
    assert "the model would take 21.8 MiB, more than the 16 MiB of a model file" in line
    assert (
        "ways out: the space 'hfmh' (600 features); shorter recordings, or a lower rate; the coding 'one"
        in line
    )


def test_the_output_must_not_be_what_is_read(folder):
    file = next((folder / "rice").iterdir())
    assert "belongs to" in refused("train", folder, "-o", file)


@pytest.mark.parametrize("name", ["x.pkl", "x.onnx", "x.safetensor"])
def test_the_name_of_a_model_says_no_other_kind_of_file(folder, tmp_path, name):
    line = refused("train", folder, "-o", tmp_path / name, *SMALL_MODEL)
    assert line.startswith("error: --output writes a model: it must end in .safetensors, ")
    assert name in line
    assert list(tmp_path.iterdir()) == []


# -- synthetic


def test_every_command_says_that_a_model_is_of_simulated_recordings(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    save(data, tmp_path / "x.npz")
    model = tmp_path / "m.safetensors"
    assert "(SYNTHETIC recordings)" in ended_well("train", tmp_path / "x.npz", "-o", model, "--quiet")
    assert ended_well("model", "info", model).startswith("SYNTHETIC: trained on simulated recordings")
    out = ended_well("identify", model, tmp_path / "x.npz")
    assert "a model of SYNTHETIC recordings and SYNTHETIC recordings" in out
    quiet = run("identify", model, tmp_path / "x.npz", "--quiet")
    assert "a model of SYNTHETIC recordings" in quiet.stderr


# -- as a process


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from granular_id.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: print('exit', end.code)\n"
        "print('heavy', sorted({'sklearn', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    for words in (("train",), ("identify",), ("model", "info")):
        done = subprocess.run(
            [sys.executable, "-c", code, *words, "--help"],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        assert "exit 0\nheavy []" in done.stdout
        assert f"granular-id {words[0]}" in done.stdout


def test_ctrl_c_leaves_no_half_file(tmp_path):
    save(synthesize(n_per_class=20), tmp_path / "x.npz")
    output = tmp_path / "out"
    output.mkdir()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # shells' background jobs ignore Ctrl-C
    try:
        running = subprocess.Popen(
            [sys.executable, "-m", "granular_id.cli", "train", str(tmp_path / "x.npz"), "-o", str(output / "m")],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, before)
    try:
        assert running.stdout.readline().startswith("220 recordings, 11 materials")
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130
    assert errors == "Interrupted: no file was left half-written.\n"
    assert list(output.iterdir()) == []
