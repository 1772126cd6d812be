"""`evaluate` and `train` with --hold-out: what is held out, and what it cannot stand beside."""

from dataclasses import replace

import pytest

from cli_cases import ended_well, make, refused, written
from granular_id.io import save
from granular_id.recording import Dataset

SPACES = ("--spaces", "hfmh", "--n-bins", 10, "--no-baselines")


@pytest.fixture(scope="module")
def tools(tmp_path_factory):
    """Recordings of three tools, each material with every one, as one file."""
    data = Dataset(
        [replace(r, meta={"tool": ("wide", "thin", "long")[k % 3]}) for k, r in enumerate(make(9))]
    )
    return save(data, tmp_path_factory.mktemp("hold") / "tools.npz")


def test_held_out_values_are_printed_and_written(tools, tmp_path):
    out = ended_well(
        "evaluate", tools, "--hold-out", "tool", *SPACES, "--details", "--json", tmp_path / "r.json"
    )
    assert "right with another tool" in out
    assert "tool: 3 values, held out one by one" in out
    saved = written(tmp_path / "r.json")
    assert saved["settings"]["by"] == "tool"
    assert [fold["held_out"] for fold in saved["folds"]] == ["wide", "thin", "long"]
    assert len(saved["spaces"]["hfmh"]["at_random"]) == 19


def test_a_condition_that_nobody_states_is_refused_with_those_that_are(tools):
    line = refused("evaluate", tools, "--hold-out", "speed", *SPACES)
    assert (
        "--hold-out speed cannot be held out, as no recording states it; those that can be: tool (3 values)"
        in line
    )


def test_it_does_not_go_with_the_papers_partitions(tools):
    line = refused("evaluate", tools, "--hold-out", "tool", "--paper")
    assert line == "error: --paper is random partitions: leave out --hold-out tool"
    line = refused("evaluate", tools, "--train", 3)
    assert line == "error: --train, --test and --partitions are of --paper: add it, or leave them out"


def test_a_model_is_measured_on_held_out_values(tools, tmp_path):
    words = ("--space", "hfmh", "--n-bins", 10, "--target-error", 0.3)
    out = ended_well("train", tools, "-o", tmp_path / "m.safetensors", "--hold-out", "tool", *words)
    assert "accuracy, another tool: " in out
    assert "  tool: 3 values, held out one by one\n" in out
    line = refused("train", tools, "-o", tmp_path / "n.safetensors", "--hold-out", "speed", *words)
    assert line.startswith("error: --hold-out speed cannot be held out, as no recording states it")
