"""Options that a feature space has no use for are refused, and a wrong path before anything slow is imported."""

import subprocess
import sys

import pytest

from cli_cases import ended_well, make, refused, saved

COMMANDS = {"train": ("-o", "m.safetensors"), "explain": ("oat", "rice"), "confidence": ()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(n=4), tmp_path_factory.mktemp("unused") / "recordings")


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--cutoff-hz", 11),
        ("--order", 4),
        ("--n-bins", 50),
        ("--bin-range", "auto"),
        ("--initial", "steady"),
        ("--block-weights", "unit"),
        ("--C", 3),
    ],
)
def test_best_refuses_options_of_other_spaces(folder, command, option, value):
    said = refused(command, folder, *COMMANDS[command], option, value)
    assert said.startswith(f"error: {option} ")
    assert "--space best" in said


@pytest.mark.parametrize("command", ["explain", "confidence"])
@pytest.mark.parametrize(
    ("space", "option", "value"),
    [
        ("multiband", "--C", 3),
        ("hfmh", "--block-weights", "unit"),
        ("dft", "--n-bins", 50),
        ("raw-histogram", "--bin-range", "-2,2"),
    ],
)
def test_every_space_refuses_what_would_change_nothing(folder, command, space, option, value):
    said = refused(command, folder, *COMMANDS[command], "--space", space, option, value)
    assert said.startswith(f"error: {option} must be left out with --space {space}, which ")


@pytest.mark.parametrize("command", [*COMMANDS, "evaluate"])
def test_blocks_of_multi_band_features_are_said_to_weigh_alike(folder, command):
    named = "--spaces" if command == "evaluate" else "--space"
    words = (*COMMANDS.get(command, ()), named, "multiband", "--block-weights", "unit")
    assert refused(command, folder, *words) == (
        f"error: --block-weights must be left out with {named} multiband, which always weighs its blocks alike"
    )


@pytest.mark.parametrize(
    ("spaces", "words", "message"),
    [
        ("best", ("--C", 3), "--C must be left out with --spaces best, which brings its own classifier"),
        (
            "best",
            ("--cutoff-hz", 5, "--n-bins", 7),
            "--cutoff-hz must be left out with --spaces best, which has",
        ),
        (
            "raw,dft",
            ("--n-bins", 7),
            "--n-bins must be left out with --spaces raw,dft, which have no use for it",
        ),
    ],
)
def test_evaluate_refuses_what_no_space_has_a_use_for(folder, spaces, words, message):
    assert refused("evaluate", folder, "--spaces", spaces, *words).startswith(f"error: {message}")


def test_select_refuses_what_no_space_has_a_use_for(folder):
    said = refused("select", folder, "--spaces", "raw,dft", "--n-bins", 7)
    assert said == "error: --n-bins must be left out with --spaces raw,dft, which have no use for it"


def test_evaluate_says_where_an_option_changes_nothing(folder):
    words = ("--spaces", "hfmh,raw,dft", "--train", 2, "--test", 1, "--partitions", 2, "--no-controls")
    said = ended_well("evaluate", folder, *words, "--n-bins", 7)
    assert "note: --n-bins changes nothing in raw, dft\n" in said
    assert "changes nothing" not in ended_well("evaluate", folder, *words)
    assert "changes nothing" not in ended_well("evaluate", folder, *words, "--n-bins", 7, "--quiet")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_wrong_path_is_told_before_anything_slow_is_imported(tmp_path, command):
    code = (
        "import sys; from granular_id.cli import main\n"
        "try: main()\n"
        "except SystemExit: print('slow', sorted({'sklearn', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    words = [command, str(tmp_path / "absent"), *COMMANDS[command]]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stderr == f"error: {tmp_path / 'absent'}: no such file or folder\n"
    assert done.stdout == "slow []\n"
