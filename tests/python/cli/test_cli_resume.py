"""An interrupted evaluation goes on from its checkpoint."""

import itertools
import json

import pytest

from cli_cases import SMALL, ended_well, make, refused, run, saved
from granular_id.evaluation import runner

WORDS = (*SMALL, "--no-controls", "--protocol", "paper", "--partitions", "6", "--threads", "1")


@pytest.fixture
def folder(tmp_path):
    return saved(make(), tmp_path / "recordings")


@pytest.fixture
def stopping(monkeypatch):
    """Ctrl-C in the ninth partition, once."""
    saves = itertools.count()
    save = runner.Checkpoint.save

    def stopping(self, *args):
        if next(saves) == 8:
            raise KeyboardInterrupt
        save(self, *args)

    monkeypatch.setattr(runner.Checkpoint, "save", stopping)


def predictions(folder, *words):
    out = ended_well("evaluate", folder, *WORDS, *words, "--json", folder.parent / "r.json", "--force")
    result = json.loads((folder.parent / "r.json").read_text(encoding="utf-8"))
    return out, [space["protocols"] for space in result["spaces"]]


def test_the_same_command_goes_on_from_the_checkpoint(folder, stopping, tmp_path):
    kept = ("--checkpoint", tmp_path / "new" / "kept")
    stopped = run("evaluate", folder, *WORDS, *kept)
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == (
        f"Interrupted: 8 finished partitions are kept in {kept[1]}; the same command goes on from there."
    )
    out, resumed = predictions(folder, *kept)
    assert "resumed: 8 partitions were finished by an earlier run" in out
    out, again = predictions(folder, *kept)
    assert "resumed: 18 partitions" in out
    out, afresh = predictions(folder)
    assert "resumed" not in out
    assert resumed == again == afresh


def test_without_a_checkpoint_nothing_is_kept_and_the_option_is_named(folder, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("granular_id.evaluation.evaluate", interrupted)
    stopped = run("evaluate", folder, *WORDS)
    assert stopped.exit_code == 130
    assert stopped.stderr == (
        "Interrupted: no file was left half-written. A run with --checkpoint FOLDER can be continued.\n"
    )


def test_the_checkpoint_of_something_else_is_refused(folder, tmp_path):
    kept = tmp_path / "kept"
    ended_well("evaluate", folder, *WORDS, "--checkpoint", kept)
    line = refused("evaluate", folder, *WORDS, "--seed", 1, "--checkpoint", kept)
    assert line.startswith(f"error: --checkpoint {kept} belongs to another evaluation")


def test_a_folder_that_is_no_checkpoint_is_refused_before_anything_is_read(tmp_path):
    (tmp_path / "file").touch()
    line = refused("evaluate", tmp_path / "absent", "--checkpoint", tmp_path)
    assert line == f"error: --checkpoint {tmp_path} holds 'file' and is no checkpoint: give a new folder"
    assert "is or lies in a file" in refused("demo", "--checkpoint", tmp_path / "file")
    refused("evaluate", tmp_path / "absent", "--checkpoint", tmp_path / "new")
    assert not (tmp_path / "new").exists()
