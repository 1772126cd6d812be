"""`evaluate` and `demo`: what they print and write."""

import csv
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from cli_cases import SMALL, ended_well, make, refused, run, saved, written
from granular_id.cli.outputs import repeated_command
from granular_id.io import save
from granular_id.recording import Dataset


def test_evaluate_prints_and_writes_the_same_figures(folder, tmp_path, monkeypatch, no_pictures):
    monkeypatch.setattr(sys, "argv", ["granular_id/__main__.py", "evaluate", "my folder"])
    files = {"--json": tmp_path / "r.json", "--csv": tmp_path / "p.csv", "--report": tmp_path / "r.html"}
    out = ended_well("evaluate", folder, *SMALL, *(word for pair in files.items() for word in pair))
    assert "</html>" in files["--report"].read_text(encoding="utf-8")
    result = written(files["--json"])
    with files["--csv"].open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(result["spaces"]) == ["raw+hfmh", "hfmh", "raw"]
    for name, figures in result["spaces"].items():
        right = [int(row["correct"]) for row in rows if row["space"] == name]
        assert figures["accuracy"] == pytest.approx(np.mean(right)), "as many of each material"
        assert re.search(rf"^{re.escape(name)} +{100 * figures['accuracy']:.1f} %", out, re.M)
    assert out.startswith("raw+hfmh names ")
    assert " ".join(out.split()).endswith(" ".join(f"wrote {path}" for path in files.values()))
    assert result["command"] == "python -m granular_id evaluate 'my folder'"
    assert result["data"]["history"][0]["step"] == "load"


def test_command_of_a_run_names_the_program(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/bin/granular-id", "evaluate", "my folder"])
    assert repeated_command() == "granular-id evaluate 'my folder'"


def test_options_reach_the_evaluation(folder, tmp_path):
    words = ("--hold-out", "random", "--cutoff-hz", 11, "--bin-range", "-0.5,0.25", "--seed", 9, "--jobs", 1)
    ended_well("evaluate", folder, "--spaces", "hfmh", *words, "--json", tmp_path / "r.json")
    result = written(tmp_path / "r.json")
    settings = result["settings"]["transformers"]["hfmh"]
    assert (settings["cutoff_hz"], settings["rate_hz"], settings["bin_range"]) == (11.0, 125.0, [-0.5, 0.25])
    assert (result["settings"]["seed"], result["settings"]["by"]) == (9, "random")
    words = ("--paper", "2,6,3", "--spaces", "hfmh", "--json", tmp_path / "paper.json")
    ended_well("evaluate", folder, *words)
    assert written(tmp_path / "paper.json")["settings"]["paper"] == [2, 6, 3]


def test_quiet_prints_accuracies_and_files(folder, tmp_path):
    result = run("evaluate", folder, *SMALL, "--quiet", "--csv", tmp_path / "p.csv")
    lines = result.stdout.splitlines()
    assert lines[0].startswith("raw+hfmh names ")
    assert [line.split()[0] for line in lines if re.search(r" %  +[\d.]+ %", line)] == [
        *("raw+hfmh", "hfmh", "raw", "(clock)")
    ]
    assert lines[-1].split()[-1] == str(tmp_path / "p.csv")
    assert result.stderr == ""


def test_paper_is_the_papers_table(folder, tmp_path):
    words = ("--paper", "2,6,3", "--spaces", "raw,hfmh")  # those of the paper take long
    ended_well("evaluate", folder, *words, "--json", tmp_path / "r.json")
    result = written(tmp_path / "r.json")
    assert len(result["folds"]) == 2
    assert result["settings"]["paper"] == [2, 6, 3]


def test_finding_that_spoils_ends_with_3_unless_accepted(tmp_path):
    apart = Dataset([replace(r, start_time=1e9 + 1e4 * ord(r.label[0]) + i) for i, r in enumerate(make())])
    data = saved(apart, tmp_path / "x")
    words = ("evaluate", data, "--spaces", "raw")
    result = run(*words)
    assert result.exit_code == 3
    assert result.stdout.startswith("SPOILED by leak-clock: ")
    accept = re.search(r"where it is known: (.*)", result.stdout)[1].split()
    assert "accepted: leak-clock" in ended_well(*words, *accept)


def test_copies_across_a_split_are_accepted_by_the_option(tmp_path):
    data = make()
    twin = replace(data[0], name="oat/twin.csv", start_time=2e9)
    copies = saved(Dataset([*data, twin]), tmp_path / "x")
    line = refused("evaluate", copies, "--spaces", "raw")
    (accept,) = re.findall(r"\((--accept [\w-]+)\)", line)
    ended_well("evaluate", copies, "--spaces", "raw", *accept.split())


def test_demo_says_that_it_is_synthetic_and_writes_files(tmp_path, monkeypatch, no_pictures):
    monkeypatch.setattr("granular_id.cli.demo.PER_CLASS", 4)
    monkeypatch.setattr("granular_id.cli.demo.LIVE_SPEED", 50)
    monkeypatch.chdir(tmp_path)
    result = run("demo")
    assert len(result.output.splitlines()) <= 24, result.output
    out = result.stdout
    assert "of SYNTHETIC recordings right with held-out sessions" in out
    assert len(re.findall(r"^push \d: .+ \((right|wrong: it was .+)\)$", out, re.M)) == 3
    assert " ".join(out.split()).endswith("open demo/report.html in a browser")
    files = {path.name for path in (tmp_path / "demo").iterdir()}
    assert files == {"report.html", "result.json", "predictions.csv"}
    result = written(tmp_path / "demo" / "result.json")
    assert result["synthetic"] is True
    assert list(result["spaces"]) == ["best", "multiband", "raw+hfmh"]


# -- a condition held out


@pytest.fixture(scope="module")
def tools(tmp_path_factory):
    """Recordings of three tools, each material with every one, as one file."""
    tool = ("wide", "thin", "long")
    data = Dataset([replace(r, meta={"tool": tool[k % 3]}) for k, r in enumerate(make(9))])
    return save(data, tmp_path_factory.mktemp("hold") / "tools.npz")


def test_held_out_values_are_printed_and_written(tools, tmp_path):
    words = ("--hold-out", "tool", "--spaces", "hfmh", "--details", "--json", tmp_path / "r.json")
    out = ended_well("evaluate", tools, *words)
    assert "right with another tool" in out
    assert "tool: 3 values, held out one by one" in out
    result = written(tmp_path / "r.json")
    assert [fold["held_out"] for fold in result["folds"]] == ["wide", "thin", "long"]
    assert len(result["spaces"]["hfmh"]["at_random"]) == 19
    out = ended_well("train", tools, "-o", tmp_path / "m", "--hold-out", "tool", "--space", "hfmh")
    assert out.startswith("accuracy, another tool: ")
