"""Files that are written: whole or absent, refused early, named by what was requested."""

import stat
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from granular_id._files import (
    JSON,
    MODELS,
    PAGES,
    TABLES,
    check_target,
    made_folder,
    whole_file,
    whole_lines,
    write_json,
)
from granular_id.evaluation import EvaluationResult
from granular_id.identifier import Identifier
from granular_id.identifier.answers import Batch
from granular_id.io.formats import FORMATS


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def write_half_and_raise(target, error):
    with whole_file(target) as draft:
        draft.write_text("half")
        raise error


def test_whole_file_replaces_only_at_the_end(tmp_path):
    target = tmp_path / "r.csv"
    target.write_text("old")
    for error in (KeyboardInterrupt, ValueError):
        with pytest.raises(error):
            write_half_and_raise(target, error)
        assert target.read_text() == "old"
        assert names_in(tmp_path) == ["r.csv"]
    with whole_file(target) as draft:
        assert draft.suffix == ".csv"
        draft.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert names_in(tmp_path) == ["r.csv"]
    plain = tmp_path / "plain"
    plain.touch()
    assert stat.S_IMODE(target.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_targets_are_refused_early(tmp_path):
    with pytest.raises(IsADirectoryError, match="is a folder, wanted the name of a file"):
        check_target(tmp_path)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        write_json(tmp_path / "absent" / "r.json", {})
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "r.json", {"accuracy": float("nan")})
    with pytest.raises(OSError, match=r"cannot write .*: File name too long$"):
        check_target(tmp_path / ("x" * 300))
    with pytest.raises(FileExistsError, match="cannot write /dev/null: it is no ordinary file"):
        check_target("/dev/null")
    assert names_in(tmp_path) == []
    check_target(tmp_path / ("x" * 250))
    assert names_in(tmp_path) == []


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that says it can be written")
def test_a_folder_that_only_seems_writable_is_found_early():
    for attempt in (check_target, lambda path: write_half_and_raise(path, AssertionError)):
        with pytest.raises(OSError, match=r"^cannot write /proc/self/r.json: [^/]*$"):
            attempt("/proc/self/r.json")


def test_a_failed_write_names_the_target_not_the_temporary_file(tmp_path):
    target = tmp_path / "r.csv"
    with pytest.raises(OSError, match=r"cannot write .*/r.csv: No space left on device$"), whole_file(target):
        raise OSError(28, "No space left on device", ".r-0123.csv")
    assert names_in(tmp_path) == []


def test_a_folder_made_in_vain_is_removed_again(tmp_path):
    def fill(path, *, used):
        with made_folder(path) as folder:
            if used:
                (folder / "held").touch()
            raise KeyboardInterrupt

    for used in (False, True):
        with pytest.raises(KeyboardInterrupt):
            fill(tmp_path / "a" / "b", used=used)
        assert (tmp_path / "a" / "b").exists() is used
        assert (tmp_path / "a").exists() is used
    (tmp_path / "mine").mkdir()
    with pytest.raises(KeyboardInterrupt):
        fill(tmp_path / "mine", used=False)
    assert (tmp_path / "mine").is_dir()
    for place in (tmp_path / "a" / "b" / "held", tmp_path / "a" / "b" / "held" / "deeper"):
        with pytest.raises(NotADirectoryError, match="is or lies in a file, wanted a folder"):
            fill(place, used=False)


def test_lines_replace_what_was_there_and_none_leave_no_file(tmp_path):
    target = tmp_path / "a.jsonl"
    with whole_lines(target):
        pass
    assert names_in(tmp_path) == []
    target.write_text("old\n")
    with whole_lines(target):
        pass
    assert target.read_text() == "old\n"

    def interrupted():
        with whole_lines(target) as write:
            write("one")
            assert target.read_text() == "one\n"
            write("zwei ä")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert target.read_text("utf-8") == "one\nzwei ä\n"


@pytest.mark.parametrize(
    ("write", "own"),
    [
        (lambda path: write_json(path, {}), JSON),
        (lambda path: EvaluationResult.to_csv(None, path), TABLES),
        (lambda path: Batch.to_csv(MagicMock(), path), TABLES),
        (lambda path: Identifier.save(None, path), MODELS),
    ],
)
def test_names_of_other_kinds_of_files_are_refused(write, own, tmp_path):
    others = (*JSON, *PAGES, *TABLES, *MODELS, ".png")
    every = {*others, *(suffix for known in FORMATS for suffix in known.suffixes)} - {".txt"}
    for suffix in sorted(every - set(own)):
        there = tmp_path / f"there{suffix}"
        there.write_bytes(b"PK")
        with pytest.raises(ValueError, match=f"path must end in {own[0]}.* got .*there{suffix}"):
            write(there)
        assert there.read_bytes() == b"PK"
