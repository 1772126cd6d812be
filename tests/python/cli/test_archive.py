"""`archive`, `extract` and `identify -o`."""

from __future__ import annotations

import csv
import re
import shutil
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

import granular_id as gid
from archive_cases import poison
from cli_cases import ended_well, recording, refused, run, saved, way_out
from granular_id.archive import Archive, Features, append
from granular_id.io import load_parts
from granular_id.io.parquet.writing import Appender, save_parquet
from granular_id.recording import Dataset

parquet = pytest.importorskip("pyarrow.parquet")

PIECE = 8


@pytest.fixture
def pieces(monkeypatch):
    """Few recordings at a time, so that a small folder has several pieces."""
    monkeypatch.setattr(
        "granular_id.io.load_parts", lambda path, **given: load_parts(path, n_recordings=PIECE, **given)
    )


@pytest.fixture(scope="module")
def archive(folder, tmp_path_factory):
    """30 recordings of 3 materials."""
    made = tmp_path_factory.mktemp("archive") / "fleet"
    append(made, gid.load(folder))
    return made


def sorted_by_name(data):
    return sorted(data, key=lambda one: one.name)


# -- add


def test_an_archive_holds_what_was_added_once(folder, tmp_path, pieces):
    archive = tmp_path / "fleet"
    append(archive, Dataset(gid.load(folder).recordings[:10]))
    out = ended_well("archive", "add", archive, folder)
    assert re.match(rf"added 20 recordings to {archive}, [\d,]+ recordings/s", " ".join(out.split()))
    assert "10 recordings were there already\n" in out
    assert sorted_by_name(gid.load(archive)) == sorted_by_name(gid.load(folder))


def test_sessions_of_one_name_are_said_to_be_one(folder, tmp_path):
    data = gid.load(folder).recordings[:6]
    for k, name in enumerate(("monday.npz", "tuesday.npz")):
        gid.save(Dataset([replace(one, session="session 1") for one in data[k::2]]), tmp_path / name)
    words = ("archive", "add", tmp_path / "fleet")
    ended = run(*words, tmp_path / "monday.npz", tmp_path / "tuesday.npz", "-q")
    assert ended.stderr == "warning: session 1 of several sources is one session from now on\n"
    assert run(*words, tmp_path / "monday.npz", "-q").stderr == ""


def test_interrupted_add_says_what_it_has_added(folder, tmp_path, pieces, monkeypatch):
    answers, real = iter([True, True, False]), Appender.append

    def interrupted(*args):
        if next(answers):
            return real(*args)
        raise KeyboardInterrupt

    monkeypatch.setattr(Appender, "append", interrupted)
    ended = run("archive", "add", tmp_path / "fleet", folder)
    assert ended.exit_code == 130
    assert f"added {2 * PIECE} recordings to" in ended.stdout
    assert ended.stderr == "Interrupted: no file was left half-written.\n"
    assert Archive(tmp_path / "fleet").n_recordings == 2 * PIECE


def test_another_rate_is_refused_with_the_way_out(folder, archive, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fleet = shutil.copytree(archive, tmp_path / "fleet")
    slow = gid.save(gid.load(folder).resample(62.5), tmp_path / "slow.npz")
    words = way_out(refused("archive", "add", fleet, slow))
    assert Archive(fleet).n_recordings == 30
    ended_well(*words)
    ended_well("archive", "add", fleet, words[3])
    uneven = saved(Dataset([recording(np.random.default_rng(2), 0, 0, jitter=0.2)]), tmp_path / "uneven")
    assert "has no even rate, those of" in refused("archive", "add", fleet, uneven)
    other = gid.save(gid.load(slow).select(axes=["fx", "fy"]), tmp_path / "two.npz")
    line = refused("archive", "add", fleet, other)  # a rate alone would not help
    assert "two.npz has the axes fx fy, and the archive" in line


def test_what_is_whole_of_a_damaged_archive_is_rescued(folder, tmp_path, pieces):
    old, new, data = tmp_path / "old", tmp_path / "new", gid.load(folder).recordings
    save_parquet(Dataset(data[:20]), old, recordings_per_group=5)
    append(old, Dataset(data[20:25]))
    part, index = (old / Archive(old).row_groups[0].file, old / f"recordings-{Archive(old).keys[1]}.parquet")
    append(old, Dataset(data[25:]))
    index.write_bytes(b"nonsense")
    poison(part, 1)
    whole = [*data[:5], *data[10:20], *data[25:]]
    read = gid.load(old, on_error="skip")
    assert list(read) == whole
    (pieced,) = load_parts(old, on_error="skip")
    assert (list(pieced), pieced.history) == (whole, read.history)
    assert run("archive", "check", old, "--quiet").exit_code == 3
    assert "recordings" in refused("archive", "add", new, old)
    out = ended_well("archive", "add", new, old, "--on-error", "skip")
    assert "2 files skipped:\n" in out
    message = " ".join(out.split())
    assert f" {index}: " in message
    assert re.search(rf" {part}, row group 1: cannot be decoded: .*; its 5 recordings left out", message)
    assert sorted_by_name(gid.load(new)) == sorted_by_name(whole)


# -- info, check


def test_info_counts_all_kinds_by_the_index_alone(tmp_path):
    rng = np.random.default_rng(1)
    kinds = [
        recording(rng, 0, 0),
        replace(recording(rng, 0, 1, samples=90), label=None, session="a", meta={"synthetic": True}),
        recording(rng, 1, 2, jitter=0.2),
    ]
    append(tmp_path / "fleet", Dataset(kinds))
    shutil.rmtree(tmp_path / "fleet" / "samples")
    out = ended_well("archive", "info", tmp_path / "fleet")
    for line in (
        "3 recordings, 2 materials, 1 session\nSYNTHETIC: 1 of 3 recordings",
        "axes: fx fy fz tx ty tz",
        "rate: 125 Hz, 1 recording irregular in time\nlength: 60 to 90 samples, 0.48 to 0.72 s",
        "recorded: 2020-09-13 to 2020-09-13 (UTC)",
        "files: 1 of samples with 1 row group, 0.0 MB with their index",
    ):
        assert f"{line}\n" in out
    assert re.search(r"^oat +1 +0\n^rice +1 +0\n^no label +1 +1$", out, re.M)


def test_what_is_no_archive_becomes_one_by_its_command(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in ("archive info", "archive check", "extract -o out"):
        line = refused(*words.split(), folder)
        assert f"is no archive; granular-id archive add ARCHIVE {folder} makes one" in line
    ended_well(*way_out(line.removesuffix(" makes one of recordings")))
    ended_well("archive", "check", "ARCHIVE")


# -- extract, identify


def test_extract_says_how_to_read_what_was_written(archive, model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = ended_well("extract", archive, "-o", "features", "--quiet")
    assert out.startswith("features: 30 recordings in 1 partition; ")
    assert reader_of(out)["features"].X.shape == (30, 600)
    assert "1 of them there before" in ended_well("extract", archive, "-o", "features", "--jobs", 1)
    ended_well("extract", archive, "-o", "raw", "--space", "raw")
    assert Features("raw").X.shape == (30, 360)
    ended_well("extract", archive, "-o", "modelled", "--model", model)
    assert Features("modelled").X.shape == (30, 6 * 60 + 600)


def test_what_was_made_is_reported_where_a_part_failed(folder, model, tmp_path, monkeypatch):
    half, data = tmp_path / "half", gid.load(folder).recordings
    save_parquet(Dataset(data[:20]), half, recordings_per_group=10)
    append(half, Dataset(data[20:]))
    (half / Archive(half).row_groups[-1].file).unlink()
    monkeypatch.setattr("granular_id.archive.partitions._MOST_RECORDINGS", 10)
    ended = run("extract", half, "-o", tmp_path / "features", "-q")
    assert ended.exit_code == 2
    assert "1 partition failed" in " ".join(ended.stderr.split())
    assert "20 recordings in 2 partitions; " in " ".join(ended.stdout.split())
    assert reader_of(ended.stdout)["features"].X.shape == (20, 600)
    ended = run("identify", model, half, "-o", tmp_path / "answers")
    assert ended.exit_code == 2
    assert "not finished: these are the answers that there are" in ended.stdout
    assert len(reader_of(ended.stdout)["answers"]) == 20


@pytest.mark.parametrize(
    ("stop", "code", "words"),
    [
        (OSError(28, "No space left on device", "f"), 2, "No space left on device"),
        (KeyboardInterrupt(), 130, "Interrupted: no file was left half-written; "),
    ],
)
def test_what_stopped_goes_on_with_the_same_command(archive, tmp_path, monkeypatch, stop, code, words):
    monkeypatch.setattr("granular_id.archive.partitions.work_through", Mock(side_effect=stop))
    ended = run("extract", archive, "-o", tmp_path / "a")
    line = " ".join(ended.stderr.split())
    assert (ended.exit_code, words in line) == (code, True)
    assert "the same command goes on from there" in line


def test_workers_reach_the_work(archive, monkeypatch):
    given = []
    monkeypatch.setattr("granular_id.archive.extract", lambda *_, **more: given.append(more) or "done")
    ended_well("extract", archive, "-o", "x")
    ended_well("extract", archive, "-o", "x", "--jobs", 3)
    ended_well("extract", archive, "-o", "x", "--scheduler", "tcp://h:1", "-q")
    assert [{name: one[name] for name in ("n_jobs", "scheduler", "progress")} for one in given] == [
        {"n_jobs": -1, "scheduler": None, "progress": True},
        {"n_jobs": 3, "scheduler": None, "progress": True},
        {"n_jobs": None, "scheduler": "tcp://h:1", "progress": False},
    ]


def test_identify_answers_an_archive_as_it_does_in_memory(archive, model, tmp_path):
    out = ended_well("identify", model, archive, "-o", tmp_path / "answers")
    assert "Materials named in 30 recordings" in out
    assert f"{tmp_path / 'answers'}: 30 recordings in 1 partition; " in " ".join(out.split())
    ended_well("identify", model, archive, "--csv", tmp_path / "answers.csv", "--quiet")
    with (tmp_path / "answers.csv").open(encoding="utf-8", newline="") as file:
        in_memory = {row["recording"]: row["label"] for row in csv.DictReader(file)}
    table = reader_of(out)["answers"].table
    assert dict(zip(table["name"].to_pylist(), table["answer"].to_pylist(), strict=True)) == in_memory


def reader_of(printed):
    """Names that the line of Python makes which a command prints."""
    namespace = {}
    exec(" ".join(printed[printed.index("from granular_id") :].split()), namespace)
    return namespace
