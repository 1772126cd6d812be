"""A refusal ends with the command that helps, complete: it is typed as it stands, and works."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from cli_cases import LABELS, ended_well, make, recording, refused, run, saved, way_out
from granular_id.archive import append
from granular_id.io import load, save
from granular_id.recording import Dataset, Recording

RNG = np.random.default_rng(5)
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


def table(path, columns=AXES, *, rate_hz=125, n=100, above="", clock="time", **options):
    """Write a text table of noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    frame = pd.DataFrame(RNG.normal(size=(n, len(columns))).round(4), columns=columns)
    if clock:
        frame.insert(0, clock, np.arange(n) / rate_hz)
    path.write_text(above + frame.to_csv(index=False, **options), encoding="utf-8")


def each_label(folder, **options):
    for label in LABELS[:2]:
        for i in range(4):
            table(folder / label / f"{i}.csv", **options)
    return folder


def irregular(folder):
    return saved(make(jitter=0.5), folder)


def with_gaps(folder):
    gap = recording(np.random.default_rng(3), 0, 90, jitter=0.5)
    late = Recording(
        gap.wrench, time_s=gap.time_s + 0.6 * (np.arange(60) > 20), label="oat", name="oat/oat_90.csv"
    )
    return saved(Dataset([*make(jitter=0.5), late]), folder)


def unequal(folder):
    rng = np.random.default_rng(3)
    return saved(Dataset([*make(), recording(rng, 1, 91, samples=50)]), folder)


def two_rates(folder):
    data = make()
    return saved(Dataset([*data[:15], *data[15:].resample(62.5)]), folder)


def two_uneven_rates(folder):
    slow = make(jitter=0.5)[3]
    fast = [replace(r, time_s=r.time_s / 5, name=f"{r.name}5") for r in make(jitter=0.5)]
    return saved(Dataset([*fast, slow]), folder)


def log_with_pauses(folder):
    times = np.concatenate([start + np.arange(60) / 100 for start in (0.0, 9.0, 20.0)])
    logs = [Recording(RNG.normal(size=(180, 6)), time_s=times, label=label, name=label) for label in "ab"]
    return saved(Dataset(logs), folder)


def nameless(folder):
    for label in LABELS[:2]:
        for i in range(4):
            table(folder / f"{label}_{i}.csv")
    (folder / "index.csv").write_text(
        "file\n" + "".join(f"{path.name}\n" for path in sorted(folder.glob("*_*")))
    )
    return folder


def broken_file(folder):
    each_label(folder)
    (folder / "oat" / "3.csv").write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,no\n")
    return folder


def two_levels(folder):
    for day in ("2025-03-04", "2025-03-05"):
        each_label(folder / day)
    return folder


def npz_of_another_name(folder):
    folder.mkdir()
    np.savez(folder / "a.npz", wrench=RNG.normal(size=(8, 60, 6)), y=np.repeat(LABELS[:2], 4), fs=100.0)
    return folder / "a.npz"


FOLDERS = {
    "stamps that are uneven": irregular,
    "stamps that are uneven, with gaps": with_gaps,
    "unequal lengths": unequal,
    "two rates": two_rates,
    "two rates of stamps that are uneven": two_uneven_rates,
    "pauses": log_with_pauses,
    "labels nowhere": nameless,
    "a broken file": broken_file,
    "two levels of folders": two_levels,
    "lines above the names": lambda folder: each_label(folder, above="Lab 3\nRig 2\n"),
    "a decimal comma": lambda folder: each_label(folder, sep=";", decimal=","),
    "other axes": lambda folder: each_label(folder, columns=("wx", "wy", "wz", "ax", "ay", "az")),
    "an array of another name": npz_of_another_name,
}
"""Each takes one command, or another one that its own refusal names."""


def test_one_of_another_rate_is_named(tmp_path):
    problem = refused("evaluate", two_uneven_rates(tmp_path / "in"), "--spaces", "raw")
    assert "was sampled at about 100 Hz and others at" in problem


def test_a_conversion_names_what_it_wrote(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = npz_of_another_name(tmp_path / "in")
    path = path.rename(path.with_stem("long" * 20))
    result = run("data", "convert", path, "b.npz", "--array", "wrench")
    assert result.exit_code == 0
    assert " data info b.npz --details" in result.stderr


@pytest.mark.parametrize("kind", FOLDERS)
@pytest.mark.parametrize("command", ["evaluate {} --spaces raw --quiet", "train {} -o m --space raw --quiet"])
def test_refusal_is_followed_until_the_command_works(tmp_path, monkeypatch, kind, command):
    monkeypatch.chdir(tmp_path)
    source = FOLDERS[kind](tmp_path / "in")
    line = refused(*command.format(source).split())
    words = way_out(line)
    assert words[:2] == ["data", "convert"]
    for _ in range(3):
        result = run(*words)
        if result.exit_code == 0:
            break
        more = re.findall(r"\((--[^()]+)\)", " ".join(result.stderr.split()))
        words += more[0].split()
    assert result.exit_code == 0, result.output
    result = run(*command.format(words[3]).split())
    assert result.exit_code in (0, 3), result.output


def test_each_other_way_out_works_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = refused("evaluate", unequal(tmp_path / "in"), "--spaces", "raw")
    convert = way_out(line)[:4]
    for way in re.findall(r"\((--[^()]+)\)", line):
        ended_well(*convert, *way.split(), "--force")
        ended_well("evaluate", convert[3], "--spaces", "raw")


def test_what_was_typed_stays_in_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = each_label(tmp_path / "in", columns=("wx", "wy", "wz"), above="Lab 3\n")
    line = refused("data", "info", source, "--axes", "wx,wy,wz", "--units", "rad/s")
    words = way_out(line)
    assert words[-6:] == ["--axes", "wx,wy,wz", "--units", "rad/s", "--csv", "skiprows=1"]
    ended_well(*words)
    assert load(words[3]).axes == ("wx", "wy", "wz")


# -- recordings that a model does not take


def others(**fields):
    """Return recordings like those that trained the small model, and not the same."""
    return Dataset([replace(one, wrench=1.1 * one.wrench) for one in make(4, **fields)])


MODELS = {
    "another rate": lambda: others().resample(250),
    "axes in another order": lambda: others().select(axes=("fy", "fx", "fz", "tx", "ty", "tz")),
    "too long": lambda: others(samples=90),
    "some too short": lambda: Dataset([*others(), recording(RNG, 0, 9, samples=20)]),
}


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("command", ["identify {model} {path}", "adapt {model} {path} -o new --labelled"])
def test_what_a_model_does_not_take_is_prepared_by_its_command(model, tmp_path, monkeypatch, kind, command):
    monkeypatch.chdir(tmp_path)
    path = save(MODELS[kind](), tmp_path / "now.npz")
    if kind == "too long":  # a model of recordings with several leads asks where the motion begins
        made = [replace(one, trigger_index=i % 9) for i, one in enumerate(make())]
        model = tmp_path / "m.safetensors"
        ended_well(
            "train", save(Dataset(made), tmp_path / "t.npz"), "-o", model, "--space", "hfmh", "--quiet"
        )
    words = command.format(model=model, path=path).split()
    converted = way_out(refused(*words))
    ended_well(*converted)
    ended_well(*command.format(model=model, path=converted[3]).split())


def test_frame_of_another_name_is_accepted_by_the_option(tmp_path):
    old, new = (
        save(Dataset([replace(one, meta={"frame": frame}) for one in data]), tmp_path / f"{frame}.npz")
        for frame, data in (("flange", make()), ("table", others()))
    )
    model = tmp_path / "m.safetensors"
    ended_well("train", old, "-o", model, "--space", "hfmh", "--quiet")
    (accept,) = re.findall(r"\((--accept [\w-]+)\)", refused("identify", model, new))
    assert accept in ended_well("setup", "show", model, new)
    ended_well("identify", model, new, *accept.split())


# -- archives


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("another rate", ("--model",)),
        ("axes in another order", ("--model",)),
        ("several rates", ()),
        ("unequal lengths", ("--space", "raw")),
    ],
)
def test_archive_that_does_not_fit_is_converted(model, tmp_path, monkeypatch, kind, words):
    pytest.importorskip("pyarrow.parquet")
    monkeypatch.chdir(tmp_path)
    fleet, data = tmp_path / "fleet", others()
    if kind == "several rates":
        append(fleet, Dataset([*data.resample(62.5)][:2]))
        append(fleet, Dataset([*data][:2]))
    elif kind == "unequal lengths":
        append(fleet, Dataset([recording(RNG, 0, i, samples=60 + i) for i in (0, 1)]))
    else:
        append(fleet, MODELS[kind]())
    more = (*words, model) if words == ("--model",) else words
    converted = way_out(refused("extract", fleet, "-o", "out", *more))
    assert converted[3] == "fleet-prepared.parquet"
    ended_well(*converted)
    ended_well("extract", converted[3], "-o", "out", *more)
    shutil.rmtree("out")
    if words == ("--model",):
        assert way_out(refused("identify", model, fleet, "-o", "answers")) == converted
        ended_well("identify", model, converted[3], "-o", "answers")


def test_what_is_no_archive_becomes_one_by_its_command(folder, tmp_path):
    line = refused("extract", folder, "-o", tmp_path / "out")
    words = way_out(
        line.replace(" makes one of recordings", "").replace(" ARCHIVE ", f" {tmp_path / 'fleet'} ")
    )
    ended_well(*words)
    ended_well("extract", tmp_path / "fleet", "-o", tmp_path / "out", "--quiet")


def test_clock_of_another_name_is_named_by_the_option(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = each_label(tmp_path / "in", clock="tick")
    ended_well(*way_out(refused("evaluate", folder)))
    assert load("in-prepared.npz")[0].rate_hz == 125


# -- what a refusal prints is typed as it stands


def index_of(folder, header, row):
    """Write recordings whose names say nothing, and an index."""
    lines = [header]
    for i in range(8):
        table(folder / f"rec_{i}.csv")
        lines.append(row.format(file=f"rec_{i}.csv", label=LABELS[i % 2], i=i % 3))
    (folder / "index.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("file,material", "{file},{label}"),
        ("file;Class", "{file};{label}"),
        ("file,grain,operator", "{file},{label},ann"),
        ("file,grain,rig", "{file},{label},r{i}"),
    ],
)
def test_labels_of_an_index_are_taken_as_it_says(tmp_path, monkeypatch, header, row):
    monkeypatch.chdir(tmp_path)
    words = way_out(refused("evaluate", index_of(tmp_path / "in", header, row)))
    ended_well(*words)
    assert load(words[3]).y.tolist() == list(LABELS[:2]) * 4


def test_label_that_nothing_says_is_not_guessed(tmp_path):
    for i in range(3):
        table(tmp_path / "in" / f"{i}.csv")
    assert "data convert" not in refused("evaluate", tmp_path / "in")


STAMPS = {
    "time": ("ms", np.arange(100) * 8),
    "t": ("us", np.arange(100) * 8000),
    "stamp": ("ns", 1_700_000_000_000_000_000 + np.arange(100) * 8_000_000),
}


@pytest.mark.parametrize("clock", STAMPS)
def test_unit_of_stamps_is_named_and_no_file_left_out(tmp_path, monkeypatch, clock):
    monkeypatch.chdir(tmp_path)
    unit, stamps = STAMPS[clock]
    for label in LABELS[:2]:
        folder = tmp_path / "in" / label
        folder.mkdir(parents=True)
        frame = pd.DataFrame(RNG.normal(size=(100, 6)), columns=AXES)
        frame.insert(0, clock, stamps)
        frame.to_csv(folder / "1.csv", index=False)
    line = refused("data", "check", tmp_path / "in")
    assert "--on-error" not in line
    words = way_out(line)
    assert words[-2:] == ["--time-unit", unit]
    ended_well(*words)
    assert load(words[3]).rate_hz == 125


@pytest.mark.parametrize("options", [{"clock": ""}, {"above": "Units: N, Nmm\n", "clock": "tick"}])
def test_what_only_the_user_knows_is_no_command(tmp_path, options):
    for label in LABELS[:2]:
        table(tmp_path / "in" / label / "1.csv", **options)
    line = refused("data", "info", tmp_path / "in")
    assert "granular-id data convert" not in line or not re.search(
        "RATE|UNITS", line.partition("granular-id")[2]
    )


def test_log_with_pauses_is_split_for_a_model(model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    times = np.concatenate([start + np.arange(60) / 125 for start in (0.0, 9.0)])
    wrench = np.concatenate([one.wrench for one in make(1)[:2]])
    path = save(Dataset([Recording(wrench, time_s=times, name="log")]), tmp_path / "log.npz")
    words = way_out(refused("identify", model, path))
    assert words[4:6] == ["--split-gap-s", "1"]
    ended_well(*words)
    ended_well("identify", model, words[3])


def test_options_of_a_training_stand_in_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for label in LABELS[:2]:
        for i in range(5):
            table(tmp_path / "in" / label / f"{i}.csv", ("wx", "wy", "wz"), clock="")
    options = ("--axes", "wx,wy,wz", "--units", "rad/s", "--recorded-hz", "62.5")
    ended_well("data", "convert", "in", "in.npz", *options)
    ended_well("train", "in.npz", "-o", "m.safetensors", "--space", "hfmh", "--quiet")
    table(tmp_path / "now.csv", ("wx", "wy", "wz", "temp \N{DEGREE SIGN}C"), clock="")
    text = (tmp_path / "now.csv").read_text()
    (tmp_path / "now.csv").write_bytes(text.encode("cp1252"))
    words = way_out(refused("identify", "m.safetensors", "now.csv"))
    assert "62.5" in words
    ended_well(*words)
    ended_well("identify", "m.safetensors", words[3])


def test_lines_of_python_are_a_command_that_saves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("in.npz", force=np.ones((4, 60, 3)), torque=np.ones((4, 60, 3)), y=[*"abab"], fs=200)
    line = run("data", "info", "in.npz").stderr.splitlines()[-1]
    assert line.startswith("python -c ")
    subprocess.run(shlex.split(line.replace("python", sys.executable, 1)), check=True, env=os.environ)
    assert load("in-prepared.npz").y.tolist() == [*"abab"]
