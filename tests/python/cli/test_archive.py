"""`archive`, `extract` and `identify -o`."""

from __future__ import annotations

import csv
import re
import shutil
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from archive_cases import poison, rewrite
from cli_cases import ended_well, make, recording, refused, run, saved
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
    assert re.match(
        rf"added 30 recordings to {tmp_path}/fleet, [\d,]+ recordings/s\n(note: .*\n)*look at it with: ", out
    )
    assert sorted_by_name(gid.load(tmp_path / "fleet")) == sorted_by_name(gid.load(folder))


def test_what_is_there_is_not_added_again(folder, tmp_path, pieces):
    archive = tmp_path / "fleet"
    append(archive, Dataset(gid.load(folder).recordings[:10]))
    out = ended_well("archive", "add", archive, folder, "--quiet")
    assert re.fullmatch(
        rf"added 20 recordings to {archive}, .*\n10 recordings were there already\n(note: .*\n)*", out
    )
    said = f"added 0 recordings to {archive}\n30 recordings were there already\n"
    assert ended_well("archive", "add", archive, folder, "-q").startswith(said)
    assert Archive(archive).n_recordings == 30


def test_what_was_interrupted_is_told_and_the_same_command_adds_the_rest(
    folder, tmp_path, pieces, monkeypatch
):
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
    assert f"added {2 * PIECE} recordings to {archive}" in ended.stdout
    assert ended.stderr == "Interrupted: no file was left half-written.\n"
    assert "16 recordings were there already" in ended_well("archive", "add", archive, folder)
    assert Archive(archive).n_recordings == 30


def pushes(n=20):
    """Recordings at rest, and in motion from 0.4 s on."""
    rng = np.random.default_rng(3)
    data = [recording(rng, i % 3, i, samples=250) for i in range(n)]
    for one in data:
        one.wrench.flags.writeable = True
        one.wrench[:50] = rng.normal(0, 0.01, (50, 6))
    return Dataset(data)


def test_add_counts_what_is_left_out_and_says_why(tmp_path, pieces):
    source = saved(make(), tmp_path / "source")
    for path in sorted(source.rglob("*_*.csv"))[:12]:
        path.write_text("nonsense\n", encoding="utf-8")
    refusal = refused("archive", "add", tmp_path / "fleet", source)
    assert refusal.endswith("; add --on-error skip to leave such files out")
    out = ended_well("archive", "add", tmp_path / "fleet", source, "--on-error", "skip")
    assert "added 18 recordings" in out
    assert "12 files skipped:\n" in out
    assert out.count(".csv, line 1") == 10
    assert "  ... and 2 more\n" in out


def test_refused_before_anything_is_read(folder, archive, tmp_path):
    other = tmp_path / "photos"
    other.mkdir()
    (other / "a.jpg").write_bytes(b"x")
    for words, said in [
        ((tmp_path / "new", tmp_path / "absent"), f"{tmp_path / 'absent'}: no such file or folder"),
        ((other, folder), f"{other}: holds 'a.jpg'; wanted an archive, or a new or empty folder"),
        ((archive, archive), "give the archive another place"),
        ((folder / "fleet", folder), "give the archive another place"),
        ((archive, archive / "samples"), "give the archive another place"),
    ]:
        assert said in refused("archive", "add", *words)
    assert not (tmp_path / "new").exists()


def test_another_rate_than_that_of_the_archive_is_refused_with_the_way_out(folder, archive, tmp_path):
    fleet = shutil.copytree(archive, tmp_path / "fleet")
    slow = gid.save(gid.load(folder).resample(62.5), tmp_path / "slow.npz")
    said = f"{slow}: recording 'oat/oat_00.csv' has 62.5 Hz, those of the archive {fleet} have 125 Hz: "
    convert = f"granular-id data convert {slow} NEW.npz --rate-hz 125"
    line = refused("archive", "add", fleet, slow)
    assert f"{said}make such by {convert}, or name another archive" in line
    assert Archive(fleet).n_recordings == 30
    new = tmp_path / "new.npz"
    ended_well(*convert.replace("NEW.npz", str(new)).split()[1:])
    ended_well("archive", "add", fleet, new)
    rng = np.random.default_rng(2)
    uneven = saved(Dataset([recording(rng, 0, 0, jitter=0.2)]), tmp_path / "uneven")
    assert "has no even rate, those of" in refused("archive", "add", fleet, uneven)


def test_an_archive_of_several_rates_takes_more_of_them(folder, tmp_path):
    data = gid.load(folder)
    append(tmp_path / "store", Dataset([data[0], data.resample(62.5)[1]]))
    ended_well("archive", "add", tmp_path / "store", saved(pushes(2), tmp_path / "pushes"))


def test_a_bad_file_named_directly_is_left_out_as_in_a_folder(folder, tmp_path):
    bad = tmp_path / "bad.npz"
    bad.write_bytes(b"nonsense")
    out = ended_well("archive", "add", tmp_path / "fleet", bad, folder, "--on-error", "skip")
    assert out.startswith("added 30 recordings")
    assert f"1 file skipped:\n  {bad}: " in out
    assert str(bad) in refused("archive", "add", tmp_path / "other", bad, folder)
    ended = run("archive", "add", tmp_path / "other", bad, "--on-error", "skip")
    assert (ended.exit_code, ended.stderr) == (2, "error: no recording is left to add\n")


def test_add_shows_how_many_recordings_are_in(folder, tmp_path, pieces, monkeypatch):
    told = []
    monkeypatch.setattr(
        "granular_id._progress.showing", lambda _: nullcontext(lambda *said: told.append(said))
    )
    ended_well("archive", "add", tmp_path / "fleet", folder)
    assert told[0] == (8, 0, f"recordings: {folder.name}")
    assert told[-1][0] == 30


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
    assert f"  {index}: " in out
    assert re.search(rf"  {part}, row group 1: cannot be decoded: .*; its 5 recordings left out\n", out)
    assert sorted_by_name(gid.load(tmp_path / "new")) == sorted_by_name(whole)


def test_an_unreadable_history_does_not_keep_an_archive_from_being_rescued(damaged):
    old, _, _, whole = damaged
    first = old / f"recordings-{Archive(old, unreadable=[]).keys[0]}.parquet"
    mark = parquet.read_metadata(first).metadata[b"granular_id"]
    rewrite(first, labels={"granular_id": mark, "history": "nonsense"})
    read = gid.load(old, on_error="skip")
    assert list(read) == whole
    assert len([row for row in read.history[-1].rows if "skipped" in row]) == 3


def test_an_archive_of_which_nothing_can_be_read_is_refused(damaged):
    old, *_ = damaged
    shutil.rmtree(old / "samples")
    with pytest.raises(ValueError, match="magic bytes not found"):
        gid.load(old, on_error="skip")


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
        assert f"{line}\n" in out or line.endswith(" ")
        assert line in out
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
        said = f"{path} is no archive; granular-id archive add ARCHIVE {path} makes one of recordings"
        for words in (("archive", "info", path), ("archive", "check", path), ("extract", path, "-o", "out")):
            assert refused(*words) == f"error: {said}"


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


# -- extract, identify


def test_extract_says_what_was_written_and_how_to_read_it(archive, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = ended_well("extract", archive, "-o", "features", "--quiet")
    done, read = out.splitlines()
    assert done.startswith("features: 30 recordings in 1 partition; ")
    namespace = {}
    exec(read.removeprefix("read them with: "), namespace)
    assert namespace["features"].X.shape == (30, 600)
    assert "1 of them there before" in ended_well("extract", archive, "-o", "features", "--jobs", 1)
    ended_well("extract", archive, "-o", "raw", "--space", "raw")
    assert Features("raw").X.shape == (30, 360)


def test_extract_takes_the_features_of_a_model(archive, model, tmp_path):
    ended_well("extract", archive, "-o", tmp_path / "features", "--model", model)
    assert Features(tmp_path / "features").X.shape == (30, 6 * 60 + 6 * 10)


def test_a_part_that_cannot_be_read_ends_with_2_and_its_name(archive, tmp_path):
    copy = shutil.copytree(archive, tmp_path / "copy")
    append(copy, pushes())
    big = max((copy / "samples").iterdir(), key=lambda path: path.stat().st_size)
    big.unlink()
    assert big.name in refused("extract", copy, "-o", tmp_path / "features")


@pytest.fixture
def half(folder, tmp_path, monkeypatch):
    """An archive of three partitions, one of which cannot be read."""
    data = gid.load(folder).recordings
    save_parquet(Dataset(data[:20]), tmp_path / "half", recordings_per_group=10)
    append(tmp_path / "half", Dataset(data[20:]))
    (tmp_path / "half" / Archive(tmp_path / "half").row_groups[-1].file).unlink()
    monkeypatch.setattr("granular_id.archive.partitions._MOST_RECORDINGS", 10)
    return tmp_path / "half"


def test_what_was_made_is_told_where_a_part_cannot_be_read(half, model, tmp_path):
    ended = run("extract", half, "-o", tmp_path / "features", "-q")
    assert ended.exit_code == 2
    assert "1 partition failed" in ended.stderr
    done, read = ended.stdout.splitlines()
    assert "20 recordings in 2 partitions; " in done
    namespace = {}
    exec(read.removeprefix("read them with: "), namespace)
    assert namespace["features"].X.shape == (20, 600)
    ended = run("identify", model, half, "-o", tmp_path / "answers")
    assert ended.exit_code == 2
    assert "Materials named in 20 recordings" in ended.stdout
    assert "not finished: these are the answers that there are" in ended.stdout
    exec(ended.stdout.splitlines()[-1].removeprefix("read them with: "), namespace)
    assert len(namespace["answers"]) == 20


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
        (line,) = ended.stderr.splitlines()
        assert ended.exit_code == (2 if isinstance(full, OSError) else 130)
        assert "the same command goes on from there" in line
        assert "o space left on device" in line or line.startswith(
            "Interrupted: no file was left half-written; "
        )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--scheduler", "tcp://h:1", "--jobs", 2), "--jobs are threads of this machine"),
        (("--jobs", 0), "--jobs must be at least 1, got 0"),
    ],
)
def test_workers_are_refused_alike(archive, model, tmp_path, words, said):
    assert said in refused("extract", archive, "-o", tmp_path / "out", *words)
    assert said in refused("identify", model, archive, "-o", tmp_path / "out", *words)
    assert not (tmp_path / "out").exists()


def test_spaces_that_do_not_fit_are_refused_in_options(archive, folder, model, tmp_path):
    words = ("extract", archive, "-o", tmp_path / "out")
    assert "give one of them" in refused(*words, "--space", "raw", "--model", model)
    learns = refused(*words, "--space", "multiband")
    assert "granular-id train --space multiband, and add --model" in learns
    append(tmp_path / "mixed", Dataset([*gid.load(folder).resample(62.5)][:2]))
    append(tmp_path / "mixed", Dataset([*gid.load(folder)][:2]))
    mixed = refused("extract", tmp_path / "mixed", "-o", tmp_path / "out")
    assert f"granular-id data convert {tmp_path / 'mixed'} NEW --to parquet --rate-hz 62.5" in mixed
    append(
        tmp_path / "lengths",
        Dataset([recording(np.random.default_rng(1), 0, i, samples=60 + i) for i in (0, 1)]),
    )
    lengths = refused("extract", tmp_path / "lengths", "-o", tmp_path / "out", "--space", "raw")
    convert = f"granular-id data convert {tmp_path / 'lengths'} NEW --to parquet --n-samples 60"
    assert f"{convert}, or take --space hfmh" in lengths
    new = tmp_path / "new"
    ended_well(*convert.replace("NEW", str(new)).split()[1:])
    ended_well("extract", new, "-o", tmp_path / "out", "--space", "raw")


def test_the_way_out_of_other_rates_and_axes_is_another_archive(folder, model, tmp_path):
    data = gid.load(folder)
    append(tmp_path / "slow", data.resample(62.5))
    axes = ("fy", "fx", "fz", "tx", "ty", "tz")
    append(tmp_path / "axes", data.select(axes=axes))
    for name, option in (("slow", "--rate-hz 125"), ("axes", "--axes fx,fy,fz,tx,ty,tz")):
        said = f"granular-id data convert {tmp_path / name} NEW --to parquet {option}"
        assert said in refused("identify", model, tmp_path / name, "-o", tmp_path / "out")
        assert said in refused("extract", tmp_path / name, "-o", tmp_path / "out", "-m", model)


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
    assert f"\n{tmp_path / 'answers'}: 30 recordings in 1 partition; " in out
    namespace = {}
    exec(out.splitlines()[-1].removeprefix("read them with: "), namespace)
    ended_well("identify", model, archive, "--csv", tmp_path / "answers.csv", "--quiet")
    with (tmp_path / "answers.csv").open(encoding="utf-8", newline="") as file:
        in_memory = {row["recording"]: row["label"] for row in csv.DictReader(file)}
    table = namespace["answers"].table
    assert dict(zip(table["name"].to_pylist(), table["answer"].to_pylist(), strict=True)) == in_memory


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--rate-hz", 50), "--rate-hz does not go with -o"),
        (("--on-error", "skip"), "--on-error does not go with -o"),
        (("--begin-at", "onset"), "--begin-at does not go with -o"),
        (("--hop-s", 0.1), "--hop-s does not go with -o"),
        (("--csv", "x.csv"), "--csv does not go with -o, whose folder holds the answers"),
        (("another",), "-o takes the answers about one archive, got 2"),
    ],
)
def test_identify_refuses_beside_answers_in_a_folder(archive, model, tmp_path, words, said):
    assert said in refused("identify", model, archive, "-o", tmp_path / "answers", *words)
    assert not (tmp_path / "answers").exists()


def test_identify_says_what_is_no_archive(folder, model, tmp_path):
    said = refused("identify", model, folder, "-o", tmp_path / "answers")
    assert said.startswith(f"error: {folder} is no archive; granular-id archive add ARCHIVE ")


def test_identify_refuses_workers_without_a_folder(archive, model):
    assert "--jobs is about archives: add -o OUT" in refused("identify", model, archive, "--jobs", 2)
