"""`select`: what it prints, and the command at its end, which trains what was chosen on the same recordings."""

import shlex

import pytest

from cli_cases import ended_well, make, saved
from granular_id.identifier import Identifier

FOLDS = ("--outer", 2, "--inner", 2)


def command_of(out):
    """The words behind the name of the program on the last line."""
    line = out.strip().splitlines()[-1]
    assert line.startswith("train it with: ")
    words = shlex.split(line.removeprefix("train it with: "))
    return words[words.index("train") :]


@pytest.mark.parametrize(
    ("words", "given"),
    [
        (("--spaces", "raw", "--duration-s", 0.4), ["--duration-s", "0.4", "--C", "--space", "raw"]),
        (("--spaces", "hfmh", "--n-bins", 10, "--cutoff-hz", 11), ["--cutoff-hz", "11", "--n-bins", "10"]),
        (("--spaces", "raw,multiband"), []),
        (("--spaces", "best", "--on-error", "skip"), ["--on-error", "skip", "--space", "best"]),
        (("--spaces", "raw-histogram,hfmh", "--exclude", "oat"), ["--exclude", "oat", "--space", "hfmh"]),
        (("--seed", 3, "--rate-hz", 100, "--n-samples", "shortest"), ["--rate-hz", "100", "--seed", "3"]),
    ],
)
def test_the_command_at_the_end_trains_the_choice(folder, tmp_path, monkeypatch, words, given):
    monkeypatch.chdir(tmp_path)
    command = command_of(ended_well("select", folder, *FOLDS, *words))
    assert command[:2] == ["train", str(folder)]
    assert set(given) <= set(command)
    assert command[-2:] == ["-o", "model.safetensors"]
    ended_well(*command, "--quiet")
    model = Identifier.load("model.safetensors")
    assert model.trained["settings"]["space"] == command[command.index("--space") + 1]


def test_options_that_the_choice_has_no_use_for_are_not_repeated(folder):
    command = command_of(ended_well("select", folder, *FOLDS, "--spaces", "multiband,hfmh", "--n-bins", 10))
    assert ("--n-bins" in command) == (command[command.index("--space") + 1] == "hfmh")


def test_names_with_blanks_are_quoted(tmp_path):
    data = saved(make(), tmp_path / "my folder")
    assert command_of(ended_well("select", data, *FOLDS, "--spaces", "raw", "--quiet"))[1] == str(data)
