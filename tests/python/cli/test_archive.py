"""`archive`, `extract` and `identify -o`; `record` and `live` into archives."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from cli_cases import ended_well, make, recording, refused, run, saved
from granular_id.archive import Archive, Features, append
from granular_id.io import load_parts
from granular_id.recording import Dataset

pytest.importorskip("pyarrow")

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
    nothing = refused(
        "archive", "add", tmp_path / "other", source, "--on-error", "skip", "--exclude", "oat,rice,sugar"
    )
    assert nothing == "error: no recording is left to add"
    assert not (tmp_path / "other").exists()


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
    assert str(folder) in refused("archive", "info", folder)


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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--scheduler", "tcp://127.0.0.1:1"), "--scheduler is about Dask: add --engine dask"),
        (("--dashboard", ":0"), "--dashboard is about Dask: add --engine dask"),
        (
            ("--engine", "dask", "--tls-ca", "x"),
            "TLS needs --tls-ca, --tls-cert and --tls-key: add --tls-cert",
        ),
        (
            ("--engine", "dask", "--scheduler", "tcp://h:1", "--jobs", 2),
            "--jobs is for workers on this machine",
        ),
        (("--jobs", 0), "--jobs must be at least 1, got 0"),
    ],
)
def test_engines_are_refused_alike(archive, model, tmp_path, words, said):
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
    assert "make another archive of it by granular-id archive add --rate-hz 62.5" in mixed


def test_engines_reach_the_work(archive, model, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr("granular_id.archive.extract", lambda *_, **more: given.append(more) or "done")
    for name in ("ca", "cert", "key"):
        (tmp_path / name).touch()
    tls = [word for name in ("ca", "cert", "key") for word in (f"--tls-{name}", tmp_path / name)]
    ended_well("extract", archive, "-o", "x")
    ended_well("extract", archive, "-o", "x", "--engine", "dask", "--jobs", 3, "--dashboard", ":0")
    ended_well("extract", archive, "-o", "x", "--engine", "dask", "--scheduler", "tls://h:1", *tls, "-q")
    kept = [{name: one[name] for name in ("engine", "n_jobs", "scheduler", "progress")} for one in given]
    assert kept == [
        {"engine": "local", "n_jobs": -1, "scheduler": None, "progress": True},
        {"engine": "dask", "n_jobs": 3, "scheduler": None, "progress": True},
        {"engine": "dask", "n_jobs": None, "scheduler": "tls://h:1", "progress": False},
    ]
    assert given[1]["dashboard_address"] == ":0"
    assert [given[2][name].name for name in ("tls_ca_file", "tls_cert", "tls_key")] == ["ca", "cert", "key"]


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


def test_identify_refuses_an_engine_without_a_folder(archive, model):
    assert "--engine is about archives: add -o OUT" in refused("identify", model, archive, "--engine", "dask")


# -- record, live

SIM = ("--source", "sim:?seed=4", "--speed", 20, "--duration-s", 1)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """6 pushes that `record` has appended to an archive."""
    folder = tmp_path_factory.mktemp("live") / "pushes"
    words = ("--label", "rice,fine sugar", "--n", 3, "--session", "Monday", "--archive", folder)
    out = ended_well("record", *SIM, *words)
    assert f"wrote 6 SYNTHETIC recordings of 2 materials into {folder}, session 'Monday'" in out
    assert out.endswith(f"look at them with: granular-id archive info {folder}\n")
    return folder


def test_record_appends_each_push_to_an_archive(recorded):
    data = gid.load(recorded)
    assert [one.label for one in data] == ["rice"] * 3 + ["fine sugar"] * 3
    assert {(one.n_samples, one.trigger_index, one.session) for one in data} == {(500, 125, "Monday")}
    assert all(one.meta["synthetic"] and one.meta["truth"] == one.label for one in data)


def test_record_wants_a_folder_or_an_archive(tmp_path):
    words = ("record", *SIM, "--label", "rice")
    assert "wanted one of -o FOLDER (a file for each push) and --archive ARCHIVE, got neither" in refused(
        *words
    )
    both = refused(*words, "-o", tmp_path / "a", "--archive", tmp_path / "b")
    assert both.endswith("got both")


@pytest.fixture(scope="module")
def live(recorded, tmp_path_factory):
    """The words of a session that names pushes of rice, with a model of those recordings."""
    model = tmp_path_factory.mktemp("model") / "m.safetensors"
    ended_well("train", recorded, "-o", model, "--space", "hfmh", "--quiet")
    return ("live", "--source", "sim:rice?seed=3", "--speed", 20, "--model", model, "--quiet")


def test_live_keeps_each_push_with_its_answer(live, tmp_path):
    rows = tmp_path / "rows.jsonl"
    out = ended_well(*live, "--n", 2, "--archive", tmp_path / "seen", "--json", rows)
    assert out.endswith(f"kept 2 recordings in {tmp_path / 'seen'}\n")
    said = [json.loads(line)["decision"] for line in rows.read_text(encoding="utf-8").splitlines()]
    data = gid.load(tmp_path / "seen")
    assert [one.meta["answer"]["label"] for one in data] == [one["label"] for one in said]
    assert [one.meta["answer"]["margin"] for one in data] == [one["margin"] for one in said]
    assert [one.label for one in data] == ["rice"] * 2, "the truth, which a simulation knows"
    assert len({one.session for one in data}) == 1
    again = ended_well("identify", live[-2], tmp_path / "seen", "--quiet")
    assert [line.split("\t")[1] for line in again.splitlines()] == [one["label"] for one in said]


def test_an_answer_is_shown_and_a_push_that_cannot_be_kept_is_told(live, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device", "seen")

    monkeypatch.setattr("granular_id.io.parquet.writing.append", full)
    ended = run(*live, "--n", 2, "--archive", tmp_path / "seen")
    assert ended.exit_code == 2
    assert ended.stdout.count("final: margin") == 1
    assert "kept 0 recordings" in ended.stdout
    assert ended.stderr == "error: seen: no space left on device\n"


def test_live_refuses_an_archive_where_no_whole_push_is(live, tmp_path):
    for words in (("--early",), ("--hop-s", 0.5)):
        line = refused(*live, *words, "--archive", tmp_path / "seen")
        assert line.startswith(f"error: --archive keeps whole pushes, with {words[0]} there are none")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.txt").touch()
    assert "wanted an archive" in refused(*live, "--archive", tmp_path / "other")
