"""A refusal ends with the command that helps, complete: it is typed as it stands, and works."""

import os
import re
import shlex
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


def table(path, columns=AXES, *, above="", clock="time", **options):
    """Write a text table of noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    frame = pd.DataFrame(RNG.normal(size=(100, len(columns))).round(4), columns=columns)
    if clock:
        frame.insert(0, clock, np.arange(100) / 125)
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


def log_of(recordings, **about):
    """Return one recording of several, 9 s apart."""
    times = np.concatenate([9.0 * k + np.arange(60) / 125 for k in range(len(recordings))])
    return Recording(np.concatenate([one.wrench for one in recordings]), time_s=times, **about)


def log_with_pauses(folder):
    logs = [log_of(make(3)[3 * k : 3 * k + 3], label=label, name=label) for k, label in enumerate("ab")]
    return saved(Dataset(logs), folder)


def nameless(folder):
    for label in LABELS[:2]:
        for i in range(4):
            table(folder / f"{label}_{i}.csv")
    (folder / "index.csv").write_text(
        "file\n" + "".join(f"{path.name}\n" for path in sorted(folder.glob("*_*")))
    )
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
    "a decimal comma": lambda folder: each_label(folder, above="Lab 3\n", sep=";", decimal=","),
    "an array of another name": npz_of_another_name,
}
"""Each takes one command, or another one that its own refusal names."""

NAMED = {"stamps that are uneven, with gaps": "--max-gap-s", "two rates of stamps that are uneven": "100"}
"""What the first command has to hold."""


@pytest.mark.parametrize("kind", FOLDERS)
def test_refusal_is_followed_until_the_command_works(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    source = FOLDERS[kind](tmp_path / "in")
    words = way_out(refused("evaluate", source, "--spaces", "raw"))
    assert words[:2] == ["data", "convert"]
    assert NAMED.get(kind, "convert") in words
    for _ in range(3):
        result = run(*words)
        if result.exit_code == 0:
            break
        more = re.findall(r"\((--[^()]+)\)", " ".join(result.stderr.split()))
        words += more[0].split()
    assert result.exit_code == 0, result.output
    result = run("evaluate", words[3], "--spaces", "raw")
    assert result.exit_code in (0, 3), result.output


def test_each_other_way_out_works_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = refused("evaluate", unequal(tmp_path / "in"), "--spaces", "raw")
    convert = way_out(line)[:4]
    for way in re.findall(r"\((--[^()]+)\)", line):
        ended_well(*convert, *way.split(), "--force")
        ended_well("evaluate", convert[3], "--spaces", "raw")


# -- recordings that a model does not take


def others(**fields):
    """Return recordings like those that trained the small model, and not the same."""
    return Dataset([replace(one, wrench=1.1 * one.wrench) for one in make(4, **fields)])


MODELS = {
    "another rate": lambda: others().resample(250),
    "axes in another order": lambda: others().select(axes=("fy", "fx", "fz", "tx", "ty", "tz")),
    "too long": lambda: others(samples=90),
    "some too short": lambda: Dataset([*others(), recording(RNG, 0, 9, samples=20)]),
    "pauses": lambda: Dataset([log_of(others()[:2])]),
}


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        *((kind, "identify {model} {path}") for kind in MODELS),
        ("another rate", "adapt {model} {path} -o new --labelled"),
    ],
)
def test_what_a_model_does_not_take_is_prepared_by_its_command(model, tmp_path, monkeypatch, kind, command):
    monkeypatch.chdir(tmp_path)
    path = save(MODELS[kind](), tmp_path / "now.npz")
    if kind == "too long":  # a model of recordings with several leads asks where the motion begins
        made = [replace(one, trigger_index=i % 9) for i, one in enumerate(make())]
        model, source = tmp_path / "m.safetensors", save(Dataset(made), tmp_path / "t.npz")
        ended_well("train", source, "-o", model, "--space", "hfmh", "--quiet")
    converted = way_out(refused(*command.format(model=model, path=path).split()))
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


ARCHIVES = {
    "several rates": [Dataset(others()[:2]), Dataset(others().resample(62.5)[:2])],
    "unequal lengths": [Dataset([recording(RNG, 0, i, samples=60 + i) for i in (0, 1)])],
    "another rate": [others().resample(250)],
}


@pytest.mark.parametrize("kind", ARCHIVES)
def test_archive_that_does_not_fit_is_converted(model, tmp_path, monkeypatch, kind):
    pytest.importorskip("pyarrow.parquet")
    monkeypatch.chdir(tmp_path)
    for part in ARCHIVES[kind]:
        append("fleet", part)
    more = {"another rate": ("--model", model), "unequal lengths": ("--space", "raw")}.get(kind, ())
    converted = way_out(refused("extract", "fleet", "-o", "out", *more))
    assert converted[3] == "fleet-prepared.parquet"
    ended_well(*converted)
    ended_well("extract", converted[3], "-o", "out", *more)
    if kind == "another rate":
        assert way_out(refused("identify", model, "fleet", "-o", "answers")) == converted


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
    [("file;Stuff", "{file};{label}"), ("file,grain,operator,rig", "{file},{label},ann,r{i}")],
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


@pytest.mark.parametrize("options", [{"clock": ""}, {"above": "Units: N, Nmm\n", "clock": "tick"}])
def test_what_only_the_user_knows_is_no_command(tmp_path, options):
    for label in LABELS[:2]:
        table(tmp_path / "in" / label / "1.csv", **options)
    line = refused("data", "info", tmp_path / "in")
    assert "granular-id data convert" not in line or not re.search(
        "RATE|UNITS", line.partition("granular-id")[2]
    )


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


def test_refused_conversion_is_typed_again_with_more(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for day in ("d1", "d2"):
        each_label(tmp_path / "in" / day)
    line = refused("data", "convert", "in", "out.npz", "--resample-hz", "62.5")
    words = way_out(line)
    assert words[:6] == ["data", "convert", "in", "out.npz", "--resample-hz", "62.5"]
    ended_well(*words)
    assert (load("out.npz").rate_hz, set(load("out.npz").sessions)) == (62.5, {"d1", "d2"})


def test_array_of_the_training_that_is_missing_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = make()
    np.savez("one.npz", ft=data.X, y=data.y, fs=125)
    np.savez("two.npz", X=data.X / 2, y=data.y, fs=125)
    ended_well("data", "convert", "one.npz", "ft.npz", "--array", "ft")
    ended_well("train", "ft.npz", "-o", "m.safetensors", "--space", "hfmh", "--quiet")
    assert "array='ft' names no array" in " ".join(refused("identify", "m.safetensors", "two.npz").split())


def test_another_array_than_in_the_training_is_warned_of(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    X = make().X
    np.savez("in.npz", ft=X, ft_filtered=X / 2, y=make().y, fs=125)
    for array in ("ft", "ft_filtered"):
        ended_well("data", "convert", "in.npz", f"{array}.npz", "--array", array)
    ended_well("train", "ft.npz", "-o", "m.safetensors", "--space", "hfmh", "--quiet")
    said = run("identify", "m.safetensors", "ft_filtered.npz")
    assert "read_as 'array=ft_filtered', in training 'array=ft'" in " ".join(
        (said.stdout + said.stderr).split()
    )
