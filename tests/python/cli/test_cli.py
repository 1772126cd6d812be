"""`evaluate` and `demo`: what they print and write."""

import csv
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from cli_cases import SMALL, ended_well, make, refused, run, saved, written
from granular_id.cli.method import chosen_spaces
from granular_id.cli.outputs import repeated_command
from granular_id.recording import Dataset


def test_evaluate_prints_tables_and_writes_what_it_prints(folder, tmp_path, monkeypatch, no_pictures):
    monkeypatch.setattr(sys, "argv", ["granular_id/__main__.py", "evaluate", "my folder"])
    out = ended_well(
        "evaluate", folder, *SMALL, "--json", tmp_path / "r.json", "--csv", tmp_path / "p.csv",
        "--report", tmp_path / "r.html",
    )  # fmt: skip
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "</html>" in page
    result = written(tmp_path / "r.json")
    with (tmp_path / "p.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(result["spaces"]) == ["raw+hfmh", "hfmh", "raw"]
    for name, figures in result["spaces"].items():
        own = [row for row in rows if row["space"] == name]
        recall = [
            np.mean([int(row["correct"]) for row in own if row["label"] == label])
            for label in result["labels"]
        ]
        assert figures["accuracy"] == pytest.approx(np.mean(recall))
        assert re.search(rf"^{re.escape(name)} +{100 * figures['accuracy']:.1f} %", out, re.M)
    assert out.startswith("30 recordings, 3 materials, 60 samples at 125 Hz\n")
    assert "paper*" not in out
    assert "right with halves in time order" in out
    assert result["synthetic"] is False
    assert result["command"] == "python -m granular_id evaluate 'my folder'"
    assert f"repeat with: {result['command']} --force\n" in out
    assert result["data"]["history"][0]["step"] == "load"


def test_the_line_to_repeat_names_how_the_program_was_started(tmp_path, monkeypatch):
    script = tmp_path / "granular-id"
    script.touch()
    for started, named in (
        ("granular_id/cli/__main__.py", "python -m granular_id.cli"),
        ("granular-id", "granular-id"),
        (str(script), str(script)),
    ):
        monkeypatch.setattr(sys, "argv", [started, "evaluate", "my folder"])
        assert repeated_command() == f"{named} evaluate 'my folder'"


def test_options_reach_the_evaluation(folder, tmp_path):
    ended_well(
        "evaluate", folder, *SMALL, "--spaces", "hfmh", "--hold-out", "random", "--cutoff-hz", 11,
        "--order", 4, "--bin-range", "-0.5,0.25", "--C", 0.125, "--seed", 9, "--exclude", "sugar",
        "--duration-s", 0.4, "--json", tmp_path / "r.json",
    )  # fmt: skip
    result = written(tmp_path / "r.json")
    settings = result["settings"]["transformers"]["hfmh"]
    assert (settings["cutoff_hz"], settings["order"], settings["n_bins"]) == (11.0, 4, 10)
    assert (settings["rate_hz"], settings["bin_range"]) == (125.0, [-0.5, 0.25])
    assert result["settings"]["classifier"]["C"] == 0.125
    assert (result["settings"]["seed"], result["settings"]["by"]) == (9, "random")
    assert result["labels"] == ["oat", "rice"]
    assert result["data"]["n_samples"] == 50
    assert [step["step"] for step in result["data"]["history"]] == ["load", "select", "align"]


def test_learned_ranges_halves_and_excluded_materials(folder):
    words = ("--bin-range", "auto", "--hold-out", "time", "--exclude", "oat")
    out = ended_well("evaluate", folder, *SMALL, *words)
    assert "right with halves in time order (chance 50.0 %)" in out
    assert "--exclude left out oat (10 recordings); 20 recordings, 2 materials remain\n" in out


def test_quiet_prints_accuracies_and_names_files_written_and_skipped(folder, tmp_path):
    data = saved(make(), tmp_path / "x")
    (data / "oat" / "oat_01.csv").write_text("nonsense\n", encoding="utf-8")
    words = ("--quiet", "--on-error", "skip", "--csv", tmp_path / "p.csv")
    out = ended_well("evaluate", data, *SMALL, *words)
    assert out.startswith("1 file skipped:\n  ")
    assert out.endswith(f"\nwrote {tmp_path / 'p.csv'}\n")
    assert "repeat with" not in out
    lines = ended_well("evaluate", folder, *SMALL, "--quiet").strip().splitlines()
    assert lines[0].startswith("raw+hfmh names ")
    assert [line.split()[0] for line in lines if "%" in line][-4:] == ["raw+hfmh", "hfmh", "raw", "(clock)"]


def test_the_space_asked_for_is_the_one_printed(folder):
    out = ended_well("evaluate", folder, *SMALL, "--confusion", "raw")
    assert "Confusion of raw, " in out
    assert "Confusion of raw+hfmh" not in out


def test_tables_fit_the_terminal(folder):
    out = ended_well("evaluate", folder, *SMALL, "--details", columns=80)
    rows = [line for line in out.splitlines() if line.startswith(("raw+hfmh  ", "hfmh  ", "raw  "))]
    assert len(rows) >= 6
    assert max(map(len, (line for line in rows))) <= 80


def test_help_names_every_option_with_examples():
    out = ended_well("evaluate", "--help", columns=120)
    options = (
        "rate-hz max-gap-s duration-s n-samples on-gap on-short on-error train test partitions hold-out "
        "paper accept baselines no-baselines details spaces cutoff-hz order n-bins bin-range initial tare-s "
        "block-weights C seed threads report json csv quiet"
    )
    for option in options.split():
        assert f"--{option}" in out
    assert "granular-id evaluate recordings --paper --train 40 --test 10" in out
    assert "granular-id demo -o somewhere --seed 1" in ended_well("demo", "--help", columns=120)
    for command in ("record", "live"):
        assert "Examples" in ended_well(command, "--help")
    assert re.fullmatch(r"granular-id \d+\.\d+\.\d+\S*\n", ended_well("--version"))


def test_paper_is_the_papers_table(folder, tmp_path):
    counts = ("--train", "6", "--test", "3", "--partitions", "2")
    spaces = ("--spaces", "raw,hfmh", "--no-baselines")  # those of the paper take long
    ended_well("evaluate", folder, "--paper", *counts, *spaces, "--json", tmp_path / "r.json")
    result = written(tmp_path / "r.json")
    assert len(result["folds"]) == 2
    assert result["settings"]["paper"] == [2, 6, 3]
    paper = chosen_spaces("paper")
    assert (paper[:2], paper[-1]) == (["raw+hfmh", "norm-raw+hfmh"], "time-permuted")


def test_what_spoils_the_figures_stands_above_them_and_ends_with_3_unless_accepted(tmp_path):
    apart = Dataset([replace(r, start_time=1e9 + 1e4 * ord(r.label[0]) + i) for i, r in enumerate(make())])
    data = saved(apart, tmp_path / "x")
    words = ("evaluate", data, "--spaces", "raw", "--no-baselines")
    result = run(*words)
    assert result.exit_code == 3
    out = result.stdout
    assert out.startswith("SPOILED by leak-clock: ") or "\nSPOILED by leak-clock: " in out
    assert "--accept leak-clock" in out
    assert "accepted: leak-clock" in ended_well(*words, "--accept", "leak-clock")


def test_copies_across_a_split_are_refused_with_the_option_that_accepts_them(tmp_path):
    data = make()
    twin = replace(data[0], name="oat/twin.csv", start_time=2e9)
    copies = saved(Dataset([*data, twin]), tmp_path / "x")
    line = refused("evaluate", copies, "--spaces", "raw")
    assert line.endswith("leave one out, give both one session, or add --accept duplicates")


def test_demo_says_that_it_is_synthetic_writes_its_files_and_what_to_open(tmp_path, monkeypatch, no_pictures):
    monkeypatch.setattr("granular_id.cli.demo.PER_CLASS", 4)
    monkeypatch.setattr("granular_id.cli.demo.LIVE_SPEED", 50)
    out = ended_well("demo", "-o", tmp_path / "demo")
    assert out.startswith("SYNTHETIC data: 44 simulated pushes through 11 materials")
    assert "of SYNTHETIC recordings right with held-out sessions" in out
    assert len(re.findall(r"^push \d: .+ \((right|wrong: it was .+)\)$", out, re.M)) == 3
    assert out.endswith(f"\nopen {tmp_path / 'demo' / 'report.html'} in a browser\n")
    files = {path.name for path in (tmp_path / "demo").iterdir()}
    assert files == {"report.html", "result.json", "predictions.csv"}
    shown = ended_well("demo", "--help")
    assert all(name in shown for name in files)
    result = written(tmp_path / "demo" / "result.json")
    assert result["synthetic"] is True
    assert len(result["labels"]) == 11
    assert list(result["spaces"]) == ["best", "multiband", "raw+hfmh"]
