"""`granular-id data` and `setup`: what their commands print and write."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import granular_id as gid
from cli_cases import ended_well, make, recording, refused, run, saved, way_out, written
from granular_id.io import load, save
from granular_id.recording import Dataset, Payload, Recording
from granular_id.synthetic import simulate_rests, synthesize


@pytest.fixture(scope="module")
def pushes(tmp_path_factory):
    data = synthesize(["rice", "oat flakes"], n_per_class=4, duration_s=0.6, seed=1)
    return save(data, tmp_path_factory.mktemp("data") / "pushes.npz")


# -- info, check, plot


def test_info_prints_and_writes_what_is_there(folder, pushes, tmp_path):
    result = run("data", "info", folder, "--json", tmp_path / "info.json")
    assert result.stderr.startswith(
        "30 recordings, 3 materials, 60 samples at 125 Hz\nnote: label: index.csv"
    )
    for line in (
        "recordings: 30",
        "axes: fx fy fz (N), tx ty tz (N m)",
        "format: index.csv",
        "step 1: load: ",
    ):
        assert line in result.stdout
    assert "SYNTHETIC" not in result.stdout
    shown = written(tmp_path / "info.json")
    assert shown["summary"] == load(folder).summary().to_dict()
    assert [step["step"] for step in shown["history"]] == ["load"]
    assert "SYNTHETIC: 8 of 8 recordings" in ended_well("data", "info", pushes)


def test_check_exits_with_3_on_errors_only(folder, pushes, tmp_path):
    ended_well("data", "check", pushes)
    data = load(folder)
    twins = Dataset([*data, Recording(data[0].wrench, rate_hz=125, label="other", name="copy")])
    save(twins, tmp_path / "twins.npz")
    result = run("data", "check", tmp_path / "twins.npz", "--json", tmp_path / "check.json")
    assert result.exit_code == 3, result.output
    assert "copy" in result.stdout
    assert any(finding["severity"] == "error" for finding in written(tmp_path / "check.json")["findings"])


def test_check_names_each_unreadable_file_and_goes_on(tmp_path, monkeypatch):
    source = saved(make(), tmp_path / "in")
    bad = sorted(source.glob("*/*.csv"))[1:25:2]
    for path in bad:
        path.write_text("nonsense\n", encoding="utf-8")
    result = run("data", "check", source, "--json", tmp_path / "check.json")
    assert result.exit_code == 3, result.output
    assert result.stdout.startswith("12 files cannot be read:\n")
    assert "18 recordings checked" in result.stdout
    unreadable = written(tmp_path / "check.json")["unreadable"]
    assert [path.name in text for path, text in zip(bad, unreadable, strict=True)] == [True] * 12
    monkeypatch.chdir(tmp_path)
    report = run("data", "convert", "in", "x.npz", "--on-error", "skip").stderr
    (rest,) = re.findall(r"more lines: granular-id (.*)", report)
    assert bad[1].name in run(*rest.split()).stdout


def test_check_says_where_set_ups_differ(pushes, tmp_path):
    data = load(pushes)
    save(Dataset([*data[:4], *data[4:].tare(lead_s=0.1)]), tmp_path / "half.npz")
    out = ended_well("data", "check", tmp_path / "half.npz", "--json", tmp_path / "c.json")
    shown = "recordings differ in their tare: 'rest', not stated"
    assert shown in " ".join(out.split())
    assert shown in written(tmp_path / "c.json")["setup"][0]


@pytest.mark.parametrize("what", ["recordings", "mean", "onset"])
def test_plot_draws(pushes, tmp_path, what):
    out = ended_well("data", "plot", pushes, "-o", tmp_path / f"{what}.svg", "--what", what)
    assert (tmp_path / f"{what}.svg").read_text(encoding="utf-8").rstrip().endswith("</svg>")
    assert f"{what}.svg" in out


# -- convert


@pytest.mark.parametrize("target", ["x.npz", "x", "x.parquet"])
def test_convert_chooses_the_format_by_the_name(folder, tmp_path, target):
    pytest.importorskip("pyarrow")
    out = ended_well("data", "convert", folder, tmp_path / target)
    assert "read back and found equal" in " ".join(out.split())
    assert load(tmp_path / target) == load(folder)


def test_convert_takes_steps_in_order(pushes, tmp_path):
    words = shlex.split("--resample-hz 250 --tare-s 0.1 --begin-at trigger --lead-s 0.04 --duration-s 0.4")
    ended_well("data", "convert", pushes, tmp_path / "x.npz", *words, "--window-s", 0.2)
    data = load(pushes).resample(250).tare(lead_s=0.1)
    data = data.align(duration_s=0.4, trigger="recorded", lead_s=0.04).windows(0.2)
    assert list(load(tmp_path / "x.npz")) == list(data)
    steps = [step.step for step in load(tmp_path / "x.npz").history]
    assert steps == ["load", "resample", "tare", "align", "windows", "load"]


def test_convert_finds_onsets(pushes, tmp_path):
    words = ("--begin-at", "onset", "--lead-s", 0.05, "--duration-s", "shortest")
    ended_well("data", "convert", pushes, tmp_path / "x.npz", *words)
    found = load(pushes).find_onsets(replace=True).align("shortest", trigger="recorded", lead_s=0.05)
    assert (load(tmp_path / "x.npz").X == found.X).all()
    plain = save(Dataset([replace(one, trigger_index=None) for one in load(pushes)]), tmp_path / "u.npz")
    words = ("data", "convert", plain, tmp_path / "t.npz", "--tare-s", 0.05)
    (way,) = re.findall(r"\((--begin-at onset)\)", refused(*words))
    ended_well(*words, *way.split())
    assert load(tmp_path / "t.npz")[0].meta["tare"] == "rest"


def test_recordings_without_enough_rest_are_left_out(pushes, tmp_path):
    first, *others = load(pushes)
    save(Dataset([replace(first, trigger_index=20), *others]), tmp_path / "short.npz")
    words = ("data", "convert", tmp_path / "short.npz", tmp_path / "t.npz", "--tare-s", 0.1)
    assert "0.1 s are wanted" in refused(*words)
    ended_well(*words, "--on-error", "skip")
    assert list(load(tmp_path / "t.npz").names) == [one.name for one in others]


def test_broken_files_gaps_and_short_ones_are_left_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    hole = recording(rng, 0, 90, jitter=0.5)
    hole = Recording(
        hole.wrench, time_s=hole.time_s + (np.arange(60) > 20), label="oat", name="oat/oat_90.csv"
    )
    short = recording(rng, 1, 91, samples=30, jitter=0.5)
    source = saved(Dataset([*make(jitter=0.5), hole, short]), tmp_path / "in")
    (source / "oat" / "oat_03.csv").write_text("nonsense\n", encoding="utf-8")
    words = ("data", "convert", "in", "x.npz", "--resample-hz", 100, "--duration-s", 0.4)
    result = run(*words, "--on-error", "skip")
    assert result.exit_code == 0, result.output
    for name in ("oat_90.csv", "rice_91.csv", "oat_03.csv"):
        assert name in result.output
    data = load(tmp_path / "x.npz")
    assert data.X.shape == (29, 40, 6)


def test_pushes_that_are_dropped_are_warned_of(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pushes = synthesize(["rice", "oat flakes"], n_per_class=4, duration_s=0.6)
    logs = [
        Recording(np.concatenate([one.wrench for one in pushes.select(labels=[label])]), 500, label=label)
        for label in pushes.labels
    ]
    save(Dataset([replace(one, name=one.label) for one in logs]), tmp_path / "logs.npz")
    words = ("data", "convert", "logs.npz", "one.npz", "--begin-at", "onset", "--lead-s", 0.05)
    report = run(*words, "--duration-s", 0.4).stderr
    assert "warning: 83% of the samples are dropped" in report
    (cut,) = re.findall(r"\((?:data convert )(--window-s)\)", refused("evaluate", "one.npz"))
    assert "dropped:" not in run("data", "convert", "logs.npz", "all.npz", cut, 0.6).stderr
    assert len(load(tmp_path / "all.npz")) == 8
    ended_well("evaluate", "all.npz", "--spaces", "hfmh")


EXPORT = (
    "Lab 3\nTorque Units: N-mm\nfx;fy;fz;tx;ty;tz;push\n" + "1,5;2;3;4;5;6;1\n" * 4 + "2,5;2;3;4;5;6;2\n" * 4
)


def test_options_of_tables_reach_pandas(tmp_path):
    for label in ("rice", "peas"):
        (tmp_path / "in" / label).mkdir(parents=True)
        (tmp_path / "in" / label / "1.csv").write_text(EXPORT)
    words = ("--csv", "skiprows=2", "--csv", "decimal=,", "--recorded-hz", 500, "--id", "push")
    ended_well("data", "convert", tmp_path / "in", tmp_path / "x.npz", *words)
    data = load(tmp_path / "x.npz")
    assert [r.wrench[0, 0] for r in data] == [1.5, 2.5] * 2
    assert data[0].wrench[0, 5] == 0.006


# -- synthesize


def test_synthesize_writes_what_the_library_makes(tmp_path):
    words = ("--materials", "rice,oat_flakes", "--n-per-class", 2, "--rate-hz", 100, "--seed", 4)
    out = ended_well("data", "synthesize", tmp_path / "x.npz", *words)
    assert "4 SYNTHETIC recordings of 2 materials" in " ".join(out.split())
    assert load(tmp_path / "x.npz") == synthesize(["rice", "oat flakes"], n_per_class=2, rate_hz=100, seed=4)
    words = shlex.split("--materials oat_flakes --n-per-class 2 --sensor imu --rate-hz 100 --duration-s 5")
    ended_well("data", "synthesize", tmp_path / "x.npz", *words, "--force")
    drives = {"rate_hz": 100, "duration_s": 5, "sensor": "imu"}
    assert load(tmp_path / "x.npz") == synthesize("oat flakes", n_per_class=2, **drives)


# -- another set-up

TRUE = Payload(0.306, (0.002, -0.003, 0.05), bias=(5, 42, 3, 0.78, -0.16, 0.11), frame="flange")
DOWN = Rotation.random(6, random_state=4).inv().apply([0, 0, -1])


@pytest.fixture(scope="module")
def tool(tmp_path_factory):
    """What `setup payload` writes of six rests, whose metadata say where gravity points."""
    place = tmp_path_factory.mktemp("payload")
    rests = save(simulate_rests(TRUE, DOWN, duration_s=1.0, rate_hz=100), place / "rests.npz")
    out = ended_well("setup", "payload", rests, "-o", place / "tool.json")
    assert re.search(r"mass +0\.30\d\d kg", out)
    assert re.search(r"zero of tz +0\.1\d* N m +[\d.e-]+ N m", out)
    assert "condition number" in out
    assert Payload.load(place / "tool.json") == Payload.fit(load(rests), gravity=DOWN)
    assert "add --force to replace it" in refused("setup", "payload", rests, "-o", place / "tool.json")
    return place / "tool.json"


def test_convert_takes_a_payload_off_and_turns(pushes, tool, tmp_path):
    there, new = tmp_path / "there.npz", tmp_path / "new.npz"
    ended_well("data", "convert", pushes, there, "--frame", "flange")
    words = ("--compensate", tool, "--gravity", "0,0,1", "--frame", "tool=0,0,90")
    ended_well("data", "convert", there, new, *words)
    expected = load(pushes).transform(frame="flange").compensate(Payload.load(tool), [0, 0, 1])
    expected = expected.transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], frame="tool")
    assert (load(new).X == expected.X).all()
    assert load(new)[0].meta == expected[0].meta
    line = refused("data", "convert", pushes, new, "--compensate", tool, "--force")
    assert "gravity must be given" in line
    ended_well("data", "convert", new, there, "--frame", "same=0,0,0,1", "--flip", "fx,tx", "--force")
    assert (load(there).X == load(new).transform(flip=("fx", "tx")).X).all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.npz", "there.npz"]


def test_right_angles_there_and_back_change_no_bit(pushes, tmp_path):
    there, back = tmp_path / "there.npz", tmp_path / "back.npz"
    ended_well("data", "convert", pushes, there, "--frame", "turned=0,-90,0")
    ended_well("data", "convert", there, back, "--frame", "flange=0,90,0")
    assert (load(back).X == load(pushes).X).all()
    assert not (load(there).X == load(pushes).X).all()


# -- setup show


@pytest.fixture(scope="module")
def trained(pushes, tmp_path_factory):
    data = Dataset([replace(one, meta={"frame": "flange", "tool": "cylinder"}) for one in load(pushes)])
    path = tmp_path_factory.mktemp("show") / "m.safetensors"
    gid.Identifier.fit(data.align(n_samples=200), "hfmh", estimate=False).save(path)
    return path


def lines_of(*words):
    """Thing -> what is printed of it."""
    out = ended_well("setup", "show", *words)
    return dict(re.findall(r"^(\w+) {2,}(.*?) *$", out, re.M)), out


def test_show_says_all_of_recordings_and_models(pushes, trained, tmp_path):
    data = load(pushes)
    tools = [replace(one, meta={"tool": "spoon" if k else "fork"}) for k, one in enumerate(data)]
    shown, _ = lines_of(save(Dataset(tools), tmp_path / "two.npz"))
    assert (shown["tool"], shown["rate"], shown["tare"]) == ("spoon (7), fork (1)", "500 Hz", "not stated")
    assert len(shown) == 17
    shown, out = lines_of(trained)
    assert (shown["frame"], shown["tool"], shown["sign"]) == ("flange", "cylinder", "not stated")
    assert shown["axes"] == "fx fy fz (N), tx ty tz (N m)"
    assert "model of 2 materials" in " ".join(out.split())


@pytest.mark.parametrize("swapped", [False, True])
def test_show_says_what_follows(trained, pushes, tmp_path, swapped):
    meta = {"frame": "table", "tool": "cylinder", "tare": "rest"}
    now = Dataset([replace(one, meta=meta) for one in load(pushes).resample(100)])
    now = save(now, tmp_path / "now.npz")
    shown, out = lines_of(*((now, trained) if swapped else (trained, now)))
    assert shown["frame"].split() == ["refused", "flange", "table"]
    assert shown["tool"].split() == ["fine", "cylinder", "the", "same"]
    assert shown["tare"].split() == ["warning", "not", "stated", "rest"]
    assert shown["rate"].startswith("refused")
    assert "rate: data convert --resample-hz" in out
    whole = ended_well("setup", "show", trained, now, "--details")
    assert "\nframe: refused\n  training  flange\n  now       table\n" in whole


def test_a_recording_that_was_cut_off_is_left_out_first(tmp_path):
    short = recording(np.random.default_rng(0), 0, 9, samples=30)
    file = save(Dataset([*make(4), short]), tmp_path / "cut.npz")
    report = " ".join(run("data", "convert", file, tmp_path / "same.npz").stderr.split())
    assert "far shorter than the usual 0.472 s, the shortest is 'oat/oat_09.csv'" in report
    words = ("--duration-s", "0.48", "--on-error", "skip")
    assert f"{' '.join(words)}) [oat/oat_09.csv]" in report
    assert way_out(refused("evaluate", file))[4:] == [*words]
    ended_well("data", "convert", file, tmp_path / "whole.npz", *words)
    assert len(load(tmp_path / "whole.npz")) == 12
