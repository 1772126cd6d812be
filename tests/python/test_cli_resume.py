"""An interrupted command goes on from where it stopped."""

import itertools
import json

import pytest

from cli_cases import SMALL, ended_well, make, run, saved
from granular_id.cli.session import kept_for
from granular_id.evaluation import runner

WORDS = (*SMALL, "--no-controls", "--protocol", "paper", "--partitions", "6", "--threads", "1")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GRANULAR_ID_CACHE", str(tmp_path / "cache"))
    return saved(make(), tmp_path / "recordings")


@pytest.fixture
def interrupted(folder, monkeypatch):
    """The command after Ctrl-C in the ninth partition."""
    saves = itertools.count()
    save = runner.Checkpoint.save

    def stopping(self, *args):
        if next(saves) == 8:
            raise KeyboardInterrupt
        save(self, *args)

    with monkeypatch.context() as patch:
        patch.setattr(runner.Checkpoint, "save", stopping)
        stopped = run("evaluate", folder, *WORDS)
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == (
        "Interrupted: 8 finished partitions are kept; the same command goes on from there (--fresh starts over)."
    )
    return folder


def predictions(folder, *words):
    out = ended_well("evaluate", folder, *WORDS, *words, "--json", folder.parent / "r.json", "--force")
    result = json.loads((folder.parent / "r.json").read_text(encoding="utf-8"))
    return out, [space["protocols"] for space in result["spaces"]]


def test_the_same_command_goes_on(interrupted, tmp_path):
    # `sys.argv`, which says what the command was, is that of the test process for both
    out, resumed = predictions(interrupted)
    assert "resumed: 8 partitions were finished by an earlier run" in out
    again, afresh = predictions(interrupted)
    assert "resumed" not in again, "what was kept is gone once the command has ended well"
    assert resumed == afresh
    assert list((tmp_path / "cache").iterdir()) == []


def test_replacing_files_is_the_same_work(monkeypatch, tmp_path):
    monkeypatch.setenv("GRANULAR_ID_CACHE", str(tmp_path))
    with kept_for("evaluate a --force", fresh=False) as one:
        folder = one.folder
    with kept_for("evaluate a", fresh=False) as other:
        assert other.folder == folder


def test_fresh_starts_over(interrupted):
    assert "resumed" not in predictions(interrupted, "--fresh")[0]


def test_other_recordings_start_over(interrupted):
    file = sorted((interrupted / "oat").iterdir())[0]
    lines = file.read_text(encoding="utf-8").splitlines()
    lines[-1] = ",".join((*lines[-1].split(",")[:-1], "9.5"))  # another torque at the end
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert "resumed" not in ended_well("evaluate", interrupted, *WORDS)


def test_without_a_place_to_keep_anything_the_command_runs(folder, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("GRANULAR_ID_CACHE", str(tmp_path / "file" / "cache"))
    assert "Accuracy" in ended_well("evaluate", folder, *WORDS)
