"""`archive`, `extract` and `identify -o`."""

from __future__ import annotations

import csv
import re
import shutil
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from cli_cases import ended_well, make, recording, refused, run, saved
from granular_id._progress import Display
from granular_id.archive import Archive, Features, append
from granular_id.io import load_parts
from granular_id.io.parquet.writing import save_parquet
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
    assert re.match(rf"added 30 recordings to {tmp_path}/fleet, [\d,]+ recordings/s\nlook at it with: ", out)
    assert sorted_by_name(gid.load(tmp_path / "fleet")) == sorted_by_name(gid.load(folder))
    assert list((tmp_path / "fleet").rglob(".*")) == []


def test_what_is_there_is_not_added_again(folder, tmp_path, pieces):
    archive = tmp_path / "fleet"
    append(archive, Dataset(gid.load(folder).recordings[:10]))
    out = ended_well("archive", "add", archive, folder, "--quiet")
    assert re.fullmatch(rf"added 20 recordings to {archive}, .*\n10 recordings were there already\n", out)
    assert ended_well("archive", "add", archive, folder, "-q") == (
        f"added 0 recordings to {archive}\n30 recordings were there already\n"
    )
    assert Archive(archive).n_recordings == 30


def test_what_was_interrupted_is_told_and_the_same_command_adds_the_rest(
    folder, tmp_path, pieces, monkeypatch
):
    archive = tmp_path / "fleet"
    calls = []

    def interrupted(*args):
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return append(*args)

    with monkeypatch.context() as patch:
        patch.setattr("granular_id.archive.append", interrupted)
        ended = run("archive", "add", archive, folder)
    assert ended.exit_code == 130
    assert f"added {2 * PIECE} recordings to {archive}" in ended.stdout
    assert ended.stderr == "Interrupted: no file was left half-written.\n"
    assert "16 recordings were there already" in ended_well("archive", "add", archive, folder)
    assert Archive(archive).n_recordings == 30


def test_each_piece_goes_through_the_steps(folder, tmp_path, pieces):
    words = ("--rate-hz", 50, "--duration-s", 0.4, "--window-s", 0.2, "--exclude", "oat,sugar")
    ended_well("archive", "add", tmp_path / "fleet", folder, *words)
    rice = gid.load(folder).select(labels="rice")
    wanted = rice.resample(50).align(duration_s=0.4).windows(0.2)
    assert sorted_by_name(gid.load(tmp_path / "fleet")) == sorted_by_name(wanted)


def pushes(n=20):
    """Recordings at rest, and in motion from 0.4 s on."""
    rng = np.random.default_rng(3)
    data = [recording(rng, i % 3, i, samples=250) for i in range(n)]
    for one in data:
        one.wrench.flags.writeable = True
        one.wrench[:50] = rng.normal(0, 0.01, (50, 6))
    return Dataset(data)


def test_onsets_are_found_and_stated_whatever_piece_they_are_in(tmp_path, pieces):
    source = saved(pushes(), tmp_path / "pushes")
    named = gid.load(source).names[-1]
    words = ("--begin-at", "onset", "--duration-s", 0.5, "--onset-at", f"{named}=1")
    ended_well("archive", "add", tmp_path / "fleet", source, *words)
    every = gid.load(source).find_onsets(overrule={named: 1.0}, replace=True)
    wanted = every.align(duration_s=0.5, trigger="recorded")
    assert sorted_by_name(gid.load(tmp_path / "fleet")) == sorted_by_name(wanted)


def test_names_that_no_recording_has_are_warned_of(tmp_path, pieces):
    words = ("--exclude", "flour", "--begin-at", "onset", "--duration-s", 0.1, "--onset-at", "x.csv=1")
    ended = run("archive", "add", tmp_path / "fleet", saved(pushes(), tmp_path / "pushes"), *words)
    assert ended.stderr.splitlines() == [
        "warning: --exclude names 'flour', which no recording has",
        "warning: --onset-at names 'x.csv', which no recording has",
    ]


def test_what_is_left_out_is_counted_with_the_first_reasons(tmp_path, pieces):
    data = make()
    short = [replace(one, wrench=one.wrench[:20]) if one.label == "oat" else one for one in data]
    source = saved(Dataset(short), tmp_path / "source")
    (source / "rice" / "rice_12.csv").write_text("nonsense\n", encoding="utf-8")
    words = ("--on-error", "skip", "--on-short", "skip", "--duration-s", 0.4)
    out = ended_well("archive", "add", tmp_path / "fleet", source, *words)
    assert "added 19 recordings" in out
    assert "1 file, 10 recordings skipped:\n" in out
    assert "rice_12.csv" in out
    assert "  ... and 1 more\n" in out
    assert "  oat/oat_00.csv: is too short: 20 samples, 50 wanted\n" in out
    nothing = refused(
        "archive", "add", tmp_path / "other", source, "--on-error", "skip", "--exclude", "oat,rice,sugar"
    )
    assert nothing == "error: no recording is left to add"
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--duration-s", 4, "--on-short", "skip"), "is too short: 60 samples, 500 wanted"),
        (
            ("--window-s", 4, "--on-short", "skip"),
            "is shorter than a window: 60 samples, 500 wanted",
        ),
        (
            ("--begin-at", "trigger", "--duration-s", 0.1, "--on-short", "skip"),
            "has no trigger",
        ),
        (("--rate-hz", 50, "--max-gap-s", 0.001, "--on-gap", "skip"), "gap of 0.00"),
    ],
)
def test_pieces_of_which_nothing_is_left_say_why_for_each_recording(tmp_path, pieces, words, reason):
    source = saved(make(2, jitter=0.2 if "--rate-hz" in words else 0.0), tmp_path / "source")
    ended = run("archive", "add", tmp_path / "fleet", source, *words)
    assert f"6 recordings skipped:\n  oat/oat_00.csv: {reason}" in ended.stdout
    assert ended.stderr == "error: no recording is left to add\n"


def test_refused_before_anything_is_read(folder, archive, tmp_path):
    other = tmp_path / "photos"
    other.mkdir()
    (other / "a.jpg").write_bytes(b"x")
    for words, said in [
        (
            (tmp_path / "new", folder, "--n-samples", "shortest"),
            "--n-samples shortest needs all recordings at once",
        ),
        ((tmp_path / "new", folder, "--onset-at", "a=1"), "add --begin-at onset"),
        ((tmp_path / "new", tmp_path / "absent"), f"{tmp_path / 'absent'}: no such file or folder"),
        ((other, folder), f"{other}: holds 'a.jpg'; wanted an archive, or a new or empty folder"),
        ((archive, archive), "give the archive another place"),
        ((folder / "fleet", folder), "give the archive another place"),
        ((archive, archive / "samples"), "give the archive another place"),
    ]:
        assert said in refused("archive", "add", *words)
    assert not (tmp_path / "new").exists()


def test_an_unreadable_file_is_refused_with_the_way_out_and_what_was_added_is_told(tmp_path, pieces):
    source = saved(make(), tmp_path / "source")
    (source / "sugar" / "sugar_29.csv").write_text("nonsense\n", encoding="utf-8")
    ended = run("archive", "add", tmp_path / "fleet", source)
    assert ended.exit_code == 2
    assert ended.stderr.endswith("; add --on-error skip to leave such files out\n")
    assert Archive(tmp_path / "fleet").n_recordings == int(re.match(r"added (\d+) ", ended.stdout)[1])


def test_another_rate_than_that_of_the_archive_is_refused_with_the_way_out(folder, archive, tmp_path):
    fleet = shutil.copytree(archive, tmp_path / "fleet")
    slow = gid.save(gid.load(folder).resample(62.5), tmp_path / "slow.npz")
    said = f"{slow}: recording 'oat/oat_00.csv' has 62.5 Hz, those of the archive {fleet} have 125 Hz: "
    assert f"{said}add --rate-hz 125, or name another archive" in refused("archive", "add", fleet, slow)
    assert Archive(fleet).n_recordings == 30
    ended_well("archive", "add", fleet, slow, "--rate-hz", 125)
    rng = np.random.default_rng(2)
    uneven = saved(Dataset([recording(rng, 0, 0, jitter=0.2)]), tmp_path / "uneven")
    assert "has no even rate, those of" in refused("archive", "add", fleet, uneven)


def test_the_first_recording_gives_a_new_archive_its_rate(folder, tmp_path, pieces):
    data = Dataset([*gid.load(folder)][:10] + [*gid.load(folder).resample(62.5)][10:])
    mixed = gid.save(data, tmp_path / "mixed.npz")
    ended = run("archive", "add", tmp_path / "fleet", mixed)
    assert ended.exit_code == 2
    assert "have 125 Hz: add --rate-hz 125, or name another archive" in ended.stderr
    ended_well("archive", "add", tmp_path / "other", mixed, "--rate-hz", 62.5)


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


def test_progress_moves_by_files_or_by_recordings_of_one(folder, archive, tmp_path, pieces, monkeypatch):
    told = []

    @contextmanager
    def displaying(progress):
        yield Display(progress if callable(progress) else lambda *said: told.append(said), print)

    monkeypatch.setattr("granular_id._progress.displaying", displaying)
    one = gid.save(gid.load(folder), tmp_path / "one.npz")
    for source, total, unit in ((one, 0, "recordings"), (archive, 30, "recordings"), (folder, 30, "files")):
        ended_well("archive", "add", tmp_path / f"of-{source.name}", source)
        assert told[-1][:2] == (30, total)
        assert told[-1][2].startswith(f"{unit}, 30 recordings added")
        assert len({done for done, *_ in told}) > 2
        told.clear()


@pytest.fixture
def damaged(folder, tmp_path):
    """An archive of which a row group and an index file are damaged, and what of it is whole."""
    data = gid.load(folder).recordings
    old = tmp_path / "old"
    save_parquet(Dataset(data[:20]), old, recordings_per_group=5)
    append(old, Dataset(data[20:25]))
    (index,) = (old / "recordings").iterdir()
    append(old, Dataset(data[25:]))
    index.write_bytes(b"nonsense")
    part = old / "samples" / "part-00000.parquet"
    content = bytearray(part.read_bytes())
    with parquet.ParquetFile(part) as opened:
        content[opened.metadata.row_group(1).column(0).data_page_offset + 100] ^= 255
    part.write_bytes(content)
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
    (old / "history.json").write_text("nonsense", encoding="utf-8")
    read = gid.load(old, on_error="skip")
    assert list(read) == whole
    assert [row["name"] for row in read.history[-1].rows if "skipped" in row][1:] == [
        "old",
        "part-00000.parquet",
    ]


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
        "files: 1 of samples with 1 row group, 0 B; index ",
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
    ended_well("extract", archive, "-o", "small", "--dtype", "float32", "--space", "raw")
    assert Features("small").X.dtype == np.float32


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
    next(path for path in (tmp_path / "half" / "samples").iterdir() if "part" not in path.name).unlink()
    monkeypatch.setattr("granular_id.archive.extraction._MOST_RECORDINGS", 10)
    return tmp_path / "half"


def test_what_was_made_is_told_where_a_part_cannot_be_read(half, model, tmp_path):
    ended = run("extract", half, "-o", tmp_path / "features", "-q")
    assert ended.exit_code == 2
    assert "1 of 3 partitions failed" in ended.stderr
    done, read = ended.stdout.splitlines()
    assert "20 recordings in 2 partitions; " in done
    namespace = {}
    exec(read.removeprefix("read them with: "), namespace)
    assert namespace["features"].X.shape == (20, 600)
    ended = run("identify", model, half, "-o", tmp_path / "answers")
    assert ended.exit_code == 2
    assert "Materials named in 20 recordings" in ended.stdout
    assert "1 partition failed and is left out" in ended.stdout
    exec(ended.stdout.splitlines()[-1].removeprefix("read them with: "), namespace)
    assert len(namespace["answers"]) == 20


@pytest.mark.parametrize("full", [OSError(28, "No space left on device", "f"), KeyboardInterrupt()], ids=type)
def test_what_stopped_goes_on_with_the_same_command(archive, model, tmp_path, monkeypatch, full):
    def stopped(*_args, **_options):
        raise full

    monkeypatch.setattr("granular_id.archive.extraction.run_tasks", stopped)
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
    assert f"granular-id archive add NEW {tmp_path / 'mixed'} --rate-hz 62.5" in mixed
    append(
        tmp_path / "lengths",
        Dataset([recording(np.random.default_rng(1), 0, i, samples=60 + i) for i in (0, 1)]),
    )
    lengths = refused("extract", tmp_path / "lengths", "-o", tmp_path / "out", "--space", "raw")
    assert (
        f"granular-id archive add NEW {tmp_path / 'lengths'} --n-samples 60, or take --space hfmh" in lengths
    )


def test_the_way_out_of_other_rates_axes_and_leads_is_another_archive(folder, model, tmp_path):
    data = gid.load(folder)
    append(tmp_path / "slow", data.resample(62.5))
    axes = ("fy", "fx", "fz", "tx", "ty", "tz")
    append(tmp_path / "axes", data.select(axes=axes))
    for name, option in (("slow", "--rate-hz 125"), ("axes", "--axes fx,fy,fz,tx,ty,tz")):
        said = f"granular-id archive add NEW {tmp_path / name} {option}"
        assert said in refused("identify", model, tmp_path / name, "-o", tmp_path / "out")
        assert said in refused("extract", tmp_path / name, "-o", tmp_path / "out", "-m", model)
    append(tmp_path / "long", pushes(3))
    trigger = refused("identify", model, tmp_path / "long", "-o", tmp_path / "out", "--begin-at", "trigger")
    assert "state --lead-s, pass --begin-at first, or answer over all of it: " in trigger
    assert trigger.endswith(f"granular-id archive add NEW {tmp_path / 'long'} --window-s SECONDS")


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
    out = ended_well("identify", model, archive, "-o", tmp_path / "answers", "--on-short", "skip")
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
        (("--begin-at", "onset"), "find onsets by granular-id archive add"),
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
