"""`identify --hop-s`: answers over all of a long recording, in a table, files and a figure."""

import csv

import numpy as np
import pytest

from cli_cases import ended_well, make, refused, run, written
from granular_id import save
from granular_id.identifier import Identifier
from granular_id.io import load
from granular_id.recording import Dataset, Recording


def long(n, name="drive", label="rice", **fields):
    """Recordings one after another as one of n windows of the model's length."""
    samples = np.concatenate([one.wrench for one in make(n).select(labels=[label])])
    return Recording(samples[: 60 * n], rate_hz=125.0, name=name, **fields)


@pytest.fixture
def drive(tmp_path):
    save(Dataset([long(5, label="oat")]), tmp_path / "drive.npz")
    return tmp_path / "drive.npz"


def test_answers_are_those_of_the_library(model, drive, tmp_path):
    pytest.importorskip("matplotlib")
    table, answers, figure = (tmp_path / name for name in ("a.csv", "a.json", "a.png"))
    out = ended_well(
        "identify", model, drive, "--hop-s", 0.24, "--csv", table, "--json", answers, "--figure", figure
    )
    same = Identifier.load(model).predict_over(load(drive)[0], 0.24)
    assert f"Answers over {same.name}" in out
    for stretch in same.stretches:
        assert f"{stretch.from_s:.2f} to {stretch.to_s:.2f}" in out
    assert f"{len(same)} answers, one each 0.24 s about the last 0.48 s" in out
    assert written(answers)["recordings"] == [same.to_dict()]
    with table.open() as stream:
        assert [row["label"] for row in csv.DictReader(stream)] == same.labels.tolist()
    assert figure.read_bytes().startswith(b"\x89PNG")
    # again: only with --force, and only over files of the same kind
    assert "--force" in refused("identify", model, drive, "--hop-s", 0.24, "--csv", table)
    ended_well("identify", model, drive, "--hop-s", 0.24, "--csv", table, "--force")


def test_several_recordings_have_a_line_each(model, tmp_path):
    save(Dataset([long(4, "a"), long(3, "b")]), tmp_path / "two.npz")
    lines = ended_well("identify", model, tmp_path / "two.npz", "--hop-s", 0.48).splitlines()
    assert [line.partition(": ")[0] for line in lines[1:]] == ["a", "b"]
    quiet = run("identify", model, tmp_path / "two.npz", "--hop-s", 0.48, "--quiet")
    assert [line.partition("\t")[0] for line in quiet.stdout.splitlines()] == ["a", "b"]
    line = refused("identify", model, tmp_path / "two.npz", "--hop-s", 0.48, "--figure", tmp_path / "a.png")
    assert "--figure draws one recording, got 2" in line


def test_labels_and_windows_of_the_training_are_told_of_several_recordings(model, folder):
    out = ended_well("identify", model, folder, "--hop-s", 0.48)
    each = [Identifier.load(model).predict_over(one, 0.48) for one in load(folder)]
    n_right = sum(one.n_right for one in each)
    assert (
        f"{n_right} of 30 answers about recordings with a known label name it: {100 * n_right / 30:.1f} %"
        in out
    )
    assert "the model was trained on 30 of these 30 windows" in out


def test_what_is_too_short_is_refused_or_left_out(model, tmp_path):
    short = Recording(np.zeros((20, 6)) + np.arange(20)[:, None], rate_hz=125.0, name="short")
    save(Dataset([long(4, "a"), short]), tmp_path / "two.npz")
    assert "'short' has 20 samples" in refused("identify", model, tmp_path / "two.npz", "--hop-s", 0.48)
    out = ended_well("identify", model, tmp_path / "two.npz", "--hop-s", 0.48, "--on-short", "skip")
    assert "left out 1 recording shorter than the model's 0.48 s" in out


def test_without_a_hop_it_says_how_little_was_looked_at(model, drive):
    line = refused("identify", model, drive)
    assert "--begin-at first, or answer over all of it with --hop-s" in line
    out = ended_well("identify", model, drive, "--begin-at", "first")
    assert "only 0.48 s of up to 2.4 s were looked at; --hop-s 0.48 answers over all of it" in out
    quiet = run("identify", model, drive, "--begin-at", "first", "--quiet")
    assert quiet.stdout.count("\n") == 1
    assert "--hop-s 0.48" in quiet.stderr


REFUSED = [
    (("--figure", "a.png"), "--figure draws answers over time: add --hop-s"),
    (("--hop-s", 0.5, "--begin-at", "first"), "--begin-at says where the one answer begins"),
    (("--hop-s", 0.5, "--lead-s", 0.1), "--lead-s says where the one answer begins"),
    (("--hop-s", 0), "--hop-s must be positive and finite, got 0"),
    (("--hop-s", 0.001), "--hop-s 0.001 is less than a sample: at 125 Hz at least 0.008"),
]


@pytest.mark.parametrize(("words", "said"), REFUSED)
def test_options_that_make_no_sense_together_are_refused(model, drive, words, said):
    assert said in refused("identify", model, drive, *words)


def test_files_that_are_not_there_are_said_before_anything_is_imported(model, tmp_path, monkeypatch):
    monkeypatch.setattr(Identifier, "load", None)  # would fail otherwise
    assert "nothing.npz: no such file or folder" in refused("identify", model, tmp_path / "nothing.npz")
