"""An interrupted evaluation goes on from its checkpoint."""

import itertools

import pytest

from cli_cases import SMALL, ended_well, refused, run, written
from granular_id.evaluation import runner

WORDS = (*SMALL, "--no-controls", "--protocol", "paper", "--partitions", "6", "--threads", "1")


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


def test_the_same_command_goes_on_from_the_checkpoint(folder, stopping, tmp_path):
    def predictions(*words):
        out = ended_well("evaluate", folder, *WORDS, *words, "--json", tmp_path / "r.json", "--force")
        return out, [space["protocols"] for space in written(tmp_path / "r.json")["spaces"]]

    kept = ("--checkpoint", tmp_path / "new" / "kept")
    stopped = run("evaluate", folder, *WORDS, *kept)
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == (
        f"Interrupted: 8 finished partitions are kept in {kept[1]}; the same command goes on from there."
    )
    out, resumed = predictions(*kept)
    assert "resumed: 8 partitions were finished by an earlier run" in out
    out, again = predictions(*kept)
    assert "resumed: 18 partitions" in out
    out, afresh = predictions()
    assert "resumed" not in out
    assert resumed == again == afresh
    line = refused("evaluate", folder, *WORDS, "--seed", 1, *kept)
    assert line.startswith(f"error: --checkpoint {kept[1]} belongs to another evaluation")


def test_without_a_checkpoint_nothing_is_kept_and_the_option_is_named(folder, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("granular_id.evaluation.evaluate", interrupted)
    stopped = run("evaluate", folder, *WORDS)
    assert stopped.exit_code == 130
    assert stopped.stderr == (
        "Interrupted: no file was left half-written. A run with --checkpoint FOLDER can be continued.\n"
    )
