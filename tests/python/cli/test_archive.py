"""`archive`, `extract` and `identify -o`."""

from __future__ import annotations

import csv
import re
import shutil
from dataclasses import replace

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


def test_an_archive_holds_what_was_added_and_says_so(folder, tmp_path, pieces):
    out = ended_well("archive", "add", tmp_path / "fleet", folder)
    assert re.match(rf"added 30 recordings to {tmp_path}/fleet, [\d,]+ recordings/s", " ".join(out.split()))
    assert sorted_by_name(gid.load(tmp_path / "fleet")) == sorted_by_name(gid.load(folder))


def test_what_is_there_is_not_added_again(folder, tmp_path, pieces):
    archive = tmp_path / "fleet"
    append(archive, Dataset(gid.load(folder).recordings[:10]))
    out = ended_well("archive", "add", archive, folder, "--quiet")
    assert "added 20 recordings to" in out
    assert "10 recordings were there already\n" in out
    assert "note: " not in out
    assert "30 recordings were there already\n" in ended_well("archive", "add", archive, folder, "-q")
    assert Archive(archive).n_recordings == 30


def test_sessions_of_one_name_are_said_to_be_one(folder, tmp_path):
    data = gid.load(folder).recordings[:6]
    for k, name in enumerate(("monday.npz", "tuesday.npz")):
        gid.save(Dataset([replace(one, session="session 1") for one in data[k::2]]), tmp_path / name)
    words = ("archive", "add", tmp_path / "fleet")
    ended = run(*words, tmp_path / "monday.npz", tmp_path / "tuesday.npz", "-q")
    assert ended.stderr == "warning: session 1 of several sources is one session from now on\n"
    assert run(*words, tmp_path / "monday.npz", "-q").stderr == ""


def test_interrupted_add_goes_on_with_the_same_command(folder, tmp_path, pieces, monkeypatch):
    archive = tmp_path / "fleet"
    calls = []

    real = Appender.append

    def interrupted(*args):
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*args)

    with monkeypatch.context() as patch:
        patch.setattr(Appender, "append", interrupted)
        ended = run("archive", "add", archive, folder)
    assert ended.exit_code == 130
    assert f"added {2 * PIECE} recordings to" in ended.stdout
    assert ended.stderr == "Interrupted: no file was left half-written.\n"
    assert "16 recordings were there already" in ended_well("archive", "add", archive, folder)
    assert Archive(archive).n_recordings == 30


def test_refused_before_anything_is_read(folder, archive, tmp_path):
    other = tmp_path / "photos"
    other.mkdir()
    (other / "a.jpg").write_bytes(b"x")
    for words, message in [
        ((tmp_path / "new", tmp_path / "absent"), "absent: no such file or folder"),
        ((other, folder), "holds 'a.jpg'; wanted an archive, or a new or empty folder"),
        ((archive, archive), "give the archive another place"),
        ((folder / "fleet", folder), "give the archive another place"),
        ((archive, archive / "samples"), "give the archive another place"),
    ]:
        assert message in refused("archive", "add", *words)
    assert not (tmp_path / "new").exists()


def test_another_rate_is_refused_with_the_way_out(folder, archive, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fleet = shutil.copytree(archive, tmp_path / "fleet")
    slow = gid.save(gid.load(folder).resample(62.5), tmp_path / "slow.npz")
    line = refused("archive", "add", fleet, slow)
    assert f"recording 'oat/oat_00.csv' has 62.5 Hz, those of the archive {fleet} have 125 Hz" in line
    assert Archive(fleet).n_recordings == 30
    words = way_out(line)
    ended_well(*words)
    ended_well("archive", "add", fleet, words[3])
    rng = np.random.default_rng(2)
    uneven = saved(Dataset([recording(rng, 0, 0, jitter=0.2)]), tmp_path / "uneven")
    assert "has no even rate, those of" in refused("archive", "add", fleet, uneven)
    other = gid.save(gid.load(slow).select(axes=["fx", "fy"]), tmp_path / "two.npz")
    ended = run("archive", "add", fleet, other)  # a rate alone would not help
    assert ended.stdout == ""
    assert "two.npz has the axes fx fy, and the archive" in " ".join(ended.stderr.split())


@pytest.fixture
def damaged(folder, tmp_path):
    """An archive of which a row group and an index file are damaged, and what of it is whole."""
    data = gid.load(folder).recordings
    old = tmp_path / "old"
    save_parquet(Dataset(data[:20]), old, recordings_per_group=5)
    append(old, Dataset(data[20:25]))
    part, index = (old / Archive(old).row_groups[0].file, old / f"recordings-{Archive(old).keys[1]}.parquet")
    append(old, Dataset(data[25:]))
    index.write_bytes(b"nonsense")
    poison(part, 1)
    return old, index, part, [*data[:5], *data[10:20], *data[25:]]


def test_what_is_whole_of_a_damaged_archive_is_rescued(damaged, tmp_path, pieces):
    old, index, part, whole = damaged
    with pytest.raises(ValueError, match="recordings"):
        gid.load(old)
    read = gid.load(old, on_error="skip")
    assert list(read) == whole
    (pieced,) = load_parts(old, on_error="skip")
    assert (list(pieced), pieced.history) == (whole, read.history)
    out = ended_well("archive", "add", tmp_path / "new", old, "--on-error", "skip")
    assert out.startswith("added 20 recordings")
    assert "2 files skipped:\n" in out
    message = " ".join(out.split())
    assert f" {index}: " in message
    assert re.search(rf" {part}, row group 1: cannot be decoded: .*; its 5 recordings left out", message)
    assert sorted_by_name(gid.load(tmp_path / "new")) == sorted_by_name(whole)


# -- info, check


def test_info_needs_the_index_alone(archive, tmp_path):
    copy = shutil.copytree(archive, tmp_path / "copy")
    shutil.rmtree(copy / "samples")
    out = ended_well("archive", "info", copy)
    for line in (
        "30 recordings, 3 materials, 0 sessions",
        "axes: fx fy fz tx ty tz",
        "rate: 125 Hz",
        "length: 60 samples, 0.48 s",
        "recorded: 2020-09-13 to 2020-09-13 (UTC)",
        "files: 1 of samples with 1 row group, 0.0 MB with their index",
    ):
        assert f"{line}\n" in out
    assert re.search(r"^oat +10 +0\n.*^rice +10 +0\n.*^sugar +10 +0$", out, re.M | re.S)
    assert "SYNTHETIC" not in out


def test_info_tells_of_all_kinds_of_recordings(tmp_path):
    rng = np.random.default_rng(1)
    kinds = [
        recording(rng, 0, 0),
        replace(recording(rng, 0, 1, samples=90), label=None, session="a", meta={"synthetic": True}),
        recording(rng, 1, 2, jitter=0.2),
    ]
    append(tmp_path / "fleet", Dataset(kinds))
    out = ended_well("archive", "info", tmp_path / "fleet")
    assert "3 recordings, 2 materials, 1 session\nSYNTHETIC: 1 of 3 recordings\n" in out
    assert "rate: 125 Hz, 1 recording irregular in time\nlength: 60 to 90 samples, 0.48 to 0.72 s\n" in out
    assert re.search(r"^no label +1 +1$", out, re.M)


def test_info_refuses_what_is_no_archive(folder, tmp_path):
    assert "no such file or folder" in refused("archive", "info", tmp_path / "absent")
    empty = tmp_path / "empty"
    empty.mkdir()
    for path in (folder, next(folder.rglob("*.csv")), empty):
        message = f"{path} is no archive; granular-id archive add ARCHIVE {path} makes one of recordings"
        for words in (("archive", "info", path), ("archive", "check", path), ("extract", path, "-o", "out")):
            assert refused(*words).endswith(message)


def test_check_ends_with_3_where_something_is_damaged(archive, tmp_path):
    assert run("archive", "check", archive).exit_code == 0
    copy = shutil.copytree(archive, tmp_path / "copy")
    (part,) = (copy / "samples").iterdir()
    content = bytearray(part.read_bytes())
    content[1000] ^= 255
    part.write_bytes(content)
    ended = run("archive", "check", copy, "--quiet")
    assert ended.exit_code == 3
    assert part.name in ended.stdout
    assert "30 recordings, 30 of them unreadable, 1 problem" in " ".join(ended.stdout.split())
    assert "archive add rescued" in " ".join(ended.stdout.split())


# -- extract, identify


def test_extract_says_how_to_read_what_was_written(archive, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = ended_well("extract", archive, "-o", "features", "--quiet")
    assert out.startswith("features: 30 recordings in 1 partition; ")
    assert reader_of(out)["features"].X.shape == (30, 600)
    assert "1 of them there before" in ended_well("extract", archive, "-o", "features", "--jobs", 1)
    ended_well("extract", archive, "-o", "raw", "--space", "raw")
    assert Features("raw").X.shape == (30, 360)


def test_extract_takes_the_features_of_a_model(archive, model, tmp_path):
    ended_well("extract", archive, "-o", tmp_path / "features", "--model", model)
    assert Features(tmp_path / "features").X.shape == (30, 6 * 60 + 600)


@pytest.fixture
def half(folder, tmp_path, monkeypatch):
    """An archive of three partitions, one of which cannot be read."""
    data = gid.load(folder).recordings
    save_parquet(Dataset(data[:20]), tmp_path / "half", recordings_per_group=10)
    append(tmp_path / "half", Dataset(data[20:]))
    (tmp_path / "half" / Archive(tmp_path / "half").row_groups[-1].file).unlink()
    monkeypatch.setattr("granular_id.archive.partitions._MOST_RECORDINGS", 10)
    return tmp_path / "half"


def test_what_was_made_is_reported_where_a_part_failed(half, model, tmp_path):
    ended = run("extract", half, "-o", tmp_path / "features", "-q")
    assert ended.exit_code == 2
    assert "1 partition failed" in " ".join(ended.stderr.split())
    assert "20 recordings in 2 partitions; " in " ".join(ended.stdout.split())
    assert reader_of(ended.stdout)["features"].X.shape == (20, 600)
    ended = run("identify", model, half, "-o", tmp_path / "answers")
    assert ended.exit_code == 2
    assert "Materials named in 20 recordings" in ended.stdout
    assert "not finished: these are the answers that there are" in ended.stdout
    assert len(reader_of(ended.stdout)["answers"]) == 20


@pytest.mark.parametrize("full", [OSError(28, "No space left on device", "f"), KeyboardInterrupt()], ids=type)
def test_what_stopped_goes_on_with_the_same_command(archive, model, tmp_path, monkeypatch, full):
    def stopped(*_args, **_options):
        raise full

    monkeypatch.setattr("granular_id.archive.partitions.work_through", stopped)
    for words in (
        ("extract", archive, "-o", tmp_path / "a"),
        ("identify", model, archive, "-o", tmp_path / "b"),
    ):
        ended = run(*words)
        line = " ".join(ended.stderr.split())
        assert ended.exit_code == (2 if isinstance(full, OSError) else 130)
        assert "the same command goes on from there" in line
        assert "o space left on device" in line or line.startswith(
            "Interrupted: no file was left half-written; "
        )


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
