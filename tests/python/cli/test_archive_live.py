"""`record` and `live` into archives."""

from __future__ import annotations

import json

import pytest

import granular_id as gid
from cli_cases import ended_well, refused, run

pytest.importorskip("pyarrow.parquet")

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


def test_small_appends_are_gathered_into_two_files(recorded, tmp_path):
    ended_well("archive", "add", tmp_path / "new", recorded, "--quiet")
    count = [sum(path.is_file() for path in place.rglob("*")) for place in (recorded, tmp_path / "new")]
    assert count == [12, 2]
    assert list(gid.load(tmp_path / "new")) == list(gid.load(recorded))


def test_record_writes_no_files_into_an_archive(recorded):
    before = sorted(recorded.rglob("*"))
    line = refused("record", *SIM, "--label", "rice", "-o", recorded)
    assert line == f"error: -o {recorded} is an archive: give it by --archive, or name another folder"
    assert sorted(recorded.rglob("*")) == before


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
    return ("live", "--source", "sim:rice?seed=4", "--speed", 20, "--model", model, "--quiet")


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
    assert all(one["label"] in line for line, one in zip(again.splitlines(), said, strict=True))


def test_an_answer_is_shown_and_a_push_that_cannot_be_kept_is_told(live, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device", "seen")

    monkeypatch.setattr("granular_id.io.parquet.writing.Appender.append", full)
    ended = run(*live, "--n", 2, "--archive", tmp_path / "seen")
    assert ended.exit_code == 2
    assert ended.stdout.count("final: margin") == 1
    assert "kept 0 recordings" in ended.stdout
    assert ended.stderr == "error: seen: no space left on device\n"


def test_a_session_without_a_push_leaves_no_empty_folder(live, tmp_path):
    words = ("--robot", "none", "--timeout-s", 1, "--n", 1, "--archive", tmp_path / "new" / "seen")
    assert "nothing triggered within 1 s" in refused(*live, *words)
    assert not list(tmp_path.iterdir())
    (tmp_path / "empty").mkdir()
    refused(*live, *words[:-1], tmp_path / "empty")
    assert [path.name for path in tmp_path.iterdir()] == ["empty"], "which was there before"


def test_live_refuses_an_archive_where_no_whole_push_is(live, tmp_path):
    for words in (("--early",), ("--hop-s", 0.5)):
        line = refused(*live, *words, "--archive", tmp_path / "seen")
        assert line.startswith(f"error: --archive keeps whole pushes, with {words[0]} there are none")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.txt").touch()
    assert "wanted an archive" in refused(*live, "--archive", tmp_path / "other")
