"""`granular-id data`: what its commands print, write and refuse."""

from __future__ import annotations

import numpy as np
import pytest

from cli_cases import ended_well, refused, run, written
from granular_id.cli.errors import in_options
from granular_id.io import load, save
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize


@pytest.fixture(scope="module")
def pushes(tmp_path_factory):
    data = synthesize(["rice", "oat flakes"], n_per_class=4, seed=1)
    return save(data, tmp_path_factory.mktemp("data") / "pushes.npz")


# -- info


def test_info_says_what_is_there(folder, pushes, tmp_path):
    out = ended_well("data", "info", folder, "--json", tmp_path / "info.json")
    assert out.startswith("30 recordings, 3 materials, 60 samples at 125 Hz\n")
    for line in (
        "format: index.csv",
        "axes: fx fy fz (N), tx ty tz (N m)",
        "recordings: 30",
        "step 1: load: format=index.csv",
    ):
        assert line in out
    assert "SYNTHETIC" not in out
    told = written(tmp_path / "info.json")
    assert told["summary"] == load(folder).summary().to_dict()
    assert [step["step"] for step in told["history"]] == ["load"]
    assert "SYNTHETIC: 8 of 8 recordings" in ended_well("data", "info", pushes)


# -- convert


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("x.npz", ()),
        ("x", ("--to", "csv")),
        ("x", ("--to", "parquet")),
        ("x", ("--to", "csv", "--no-verify")),
    ],
)
def test_convert_by_ending_or_name(folder, tmp_path, target, words):
    pytest.importorskip("pyarrow")
    out = ended_well("data", "convert", folder, tmp_path / target, *words)
    assert f"wrote {tmp_path / target}" in out
    assert ("read back and found equal" in out) == ("--no-verify" not in words)
    assert load(tmp_path / target) == load(folder)


def test_convert_takes_the_steps_asked_for(pushes, tmp_path):
    out = ended_well(
        "data", "convert", pushes, tmp_path / "x.npz", "--rate-hz", 250, "--begin-at", "trigger",
        "--lead-s", 0.04, "--duration-s", 1, "--exclude", "rice",
    )  # fmt: skip
    for words in ("--exclude left out rice", "resample: rate_hz=250", "align: n_samples=250"):
        assert words in out
    data = load(tmp_path / "x.npz")
    assert data.X.shape == (4, 250, 6)
    assert {recording.trigger_index for recording in data} == {10}
    assert [step.step for step in data.history] == ["load", "select", "resample", "align", "load"]


def test_onsets_are_found_on_the_way_or_overruled(pushes, tmp_path):
    words = ("data", "convert", pushes, tmp_path / "x.npz", "--begin-at", "onset")
    ended_well(*words, "--lead-s", 0.05, "--n-samples", 1000)
    data = load(tmp_path / "x.npz")
    assert data.X.shape == (8, 1000, 6)
    assert "find_onsets" in [step.step for step in data.history]
    (tmp_path / "x.npz").unlink()
    stated = ("--onset-at", "rice_00=0.5", "--onset-at", "rice_01=none", "--on-short", "skip")
    assert "rice_01" in ended_well(*words, "--n-samples", 500, *stated)
    data, source = load(tmp_path / "x.npz"), load(pushes)
    assert "rice_01" not in data.names
    first = source[source.names.index("rice_00")].wrench[250:750]
    assert np.array_equal(data[data.names.index("rice_00")].wrench, first)


def test_where_no_onset_is_found_the_error_does_not_say_to_look_for_one(folder, tmp_path):
    words = ("data", "convert", folder, tmp_path / "x.npz", "--begin-at", "onset", "--n-samples", 9)
    said = refused(*words)
    assert "no onset in 30 of 30 recordings, the first is 'oat/oat_00.csv': state it with --onset-at" in said
    assert "add --begin-at onset" not in said


# -- check


def test_check_exits_with_3_on_errors_only(folder, pushes, tmp_path):
    ended_well("data", "check", pushes)
    data = load(folder)
    twins = Dataset([*data, Recording(data[0].wrench, rate_hz=125, label="other", name="copy")])
    save(twins, tmp_path / "twins.npz")
    result = run("data", "check", tmp_path / "twins.npz", "--json", tmp_path / "check.json")
    assert result.exit_code == 3, result.output
    assert "duplicate" in result.stdout
    assert "copy" in result.stdout
    assert any(finding["severity"] == "error" for finding in written(tmp_path / "check.json")["findings"])


# -- plot


@pytest.mark.parametrize("what", ["recordings", "mean", "onset"])
def test_plots(pushes, tmp_path, what):
    out = ended_well("data", "plot", pushes, "-o", tmp_path / f"{what}.svg", "--what", what)
    assert (tmp_path / f"{what}.svg").read_text(encoding="utf-8").rstrip().endswith("</svg>")
    assert f"wrote {tmp_path / what}.svg" in out


# -- synthesize


def test_synthesize_writes_what_is_labelled_synthetic(tmp_path):
    out = ended_well(
        "data", "synthesize", tmp_path / "x.npz", "--materials", "rice,oat flakes", "--per-class", 2,
        "--rate-hz", 100, "--seed", 4,
    )  # fmt: skip
    assert "4 SYNTHETIC recordings of 2 materials" in out
    data = load(tmp_path / "x.npz")
    assert data == synthesize(["rice", "oat flakes"], n_per_class=2, rate_hz=100, seed=4)


def test_synthesize_writes_long_recordings_of_an_imu(tmp_path):
    ended_well(
        "data", "synthesize", tmp_path / "x.npz", "--materials", "oat_flakes", "--per-class", 2, "--sensor", "imu",
        "--rate-hz", 100, "--duration-s", 5,
    )  # fmt: skip
    drives = {"rate_hz": 100, "duration_s": 5, "sensor": "imu"}
    assert load(tmp_path / "x.npz") == synthesize("oat flakes", n_per_class=2, **drives)


# -- another sensor, in long recordings

IMU = ("--axes", "wx,wy,wz,ax,ay,az", "--units", "rad/s,m/s2")


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Two grounds, two drives each of 20 s at 50 Hz, one with uneven stamps and a column of its own."""
    folder, rng = tmp_path_factory.mktemp("drives"), np.random.default_rng(5)
    for ground in ("mud", "sand"):
        (folder / ground).mkdir()
        for k in (1, 2):
            time_s = np.arange(1000) / 50 + (rng.uniform(0, 0.005, 1000) if (ground, k) == ("mud", 2) else 0)
            columns = np.column_stack([time_s, rng.normal(size=(1000, 7))])
            head = "time,wx,wy,wz,ax,ay,az,speed"
            np.savetxt(
                folder / ground / f"drive_{k}.csv",
                columns,
                delimiter=",",
                header=head,
                comments="",
                fmt="%.5f",
            )
    return folder


def test_a_folder_of_another_sensor_is_refused_with_the_way_in(drives):
    said = refused("data", "info", drives)
    assert "; for other axes pass --axes wx,wy,wz,ax,ay,az,speed" in said


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        ("a.csv: for other axes pass axes='acc x,acc y'", "a.csv: for other axes pass --axes 'acc x,acc y'"),
        ("call .select(axes=['wx', 'wy z'])", "add --axes 'wx,wy z'"),
        ("pass csv={'skiprows': 7}", "pass --csv skiprows=7"),
        (
            "pass csv={'na_values': '--', 'names': ['a', 'b']}",
            "pass --csv na_values=-- --csv 'names=['\"'\"'a'\"'\"', '\"'\"'b'\"'\"']'",
        ),
        ("is ignored: rate_hz=RATE", "is ignored: --recorded-hz RATE"),
        ("the axes of units, in one session", "the axes of units, in one session"),
    ],
)
def test_ways_out_are_said_in_options(problem, said):
    assert in_options(problem).endswith(said)


WINDOWS = ("--rate-hz", 50, "--window-s", 1.7, "--hop-s", 0.85)


@pytest.mark.parametrize(
    ("command", "lines"),
    [
        (
            ("info",),
            (
                "axes: wx wy wz (rad/s), ax ay az (m/s2)",
                "meta: read_as, units, window",
                "mud    44          85",
                "step 3: windows",
            ),
        ),
        (("check", "--hop-s", 1.7), ("44 recordings checked", "fewer than 10 recordings")),
    ],
)
def test_windows_of_another_sensor(drives, command, lines):
    name, *more = command
    said = ended_well("data", name, drives, *IMU, *WINDOWS, *more)
    for line in ("columns that are not read: 'speed'", *lines):
        assert line in said


def test_windows_of_uneven_recordings_need_a_rate(drives):
    said = refused("data", "info", drives, *IMU, "--window-s", 1.7)
    assert "sampled irregularly" in said
    assert said.endswith("nothing is resampled unasked: add --rate-hz 50")
    assert "add --window-s" in refused("data", "info", drives, *IMU, "--hop-s", 1)


def test_a_plot_of_another_sensor(drives, tmp_path):
    ended_well("data", "plot", drives, *IMU, *WINDOWS, "-o", tmp_path / "a.png")
    ended_well("data", "plot", drives, *IMU, "--draw", "ax,az", "-o", tmp_path / "b.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]


@pytest.mark.parametrize("to", ["csv", "npz"])
def test_another_sensor_is_converted(drives, tmp_path, to):
    path = tmp_path / ("x.npz" if to == "npz" else "x")
    said = ended_well("data", "convert", drives, path, "--to", to, *IMU, *WINDOWS, "--session", "folder")
    assert "read back and found equal" in said
    data = load(path)
    assert data.X.shape == (88, 85, 6)
    assert set(data.sessions) == {"mud", "sand"}


def test_windows_are_cut_after_all_else(drives):
    said = ended_well("data", "info", drives, *IMU, "--rate-hz", 50, "--duration-s", 4, "--window-s", 2)
    assert "align" in said
    assert "windows: 8" in said


def test_a_model_of_another_sensor_reads_the_axes_it_was_trained_on(drives, tmp_path):
    model, file = tmp_path / "m.safetensors", drives / "sand" / "drive_1.csv"
    ended_well("train", drives, "-o", model, "--space", "raw", "--target-error", 0.2, *IMU, *WINDOWS)
    assert "drive_1.csv" in ended_well("identify", model, file, "--begin-at", "first")
    said = refused("identify", model, file, "--begin-at", "first", "--axes", "ax,wy,wz,wx,ay,az")
    assert said.endswith("the model was trained on wx wy wz ax ay az: add --axes wx,wy,wz,ax,ay,az")


# -- what only text tables need


EXPORT = (
    "Lab 3\nTorque Units: N-mm\nfx;fy;fz;tx;ty;tz;push\n" + "1,5;2;3;4;5;6;1\n" * 4 + "2,5;2;3;4;5;6;2\n" * 4
)
TOLD = ("--csv", "skiprows=2", "--csv", "decimal=,", "--recorded-hz", 500, "--id", "push")


@pytest.mark.parametrize("command", [("info",), ("check",), ("plot", "-o", "a.png"), ("convert", "x.npz")])
def test_options_of_tables_are_told_to_pandas(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    for label in ("rice", "peas"):
        (tmp_path / "in" / label).mkdir(parents=True)
        (tmp_path / "in" / label / "1.csv").write_text(EXPORT)
    name, *more = command
    assert "pass --csv skiprows=2" in refused("data", name, "in", *more)
    words = [
        "data",
        name,
        "in",
        *(more if name == "convert" else ()),
        *TOLD,
        *(more if name == "plot" else ()),
    ]
    result = run(*words)
    assert result.exit_code in (0, 3), result.output
    assert "note: label: folder ('peas' of peas/1.csv, 'rice' of rice/1.csv)" in result.output
    if name == "convert":
        data = load("x.npz")
        assert [r.wrench[0, 0] for r in data] == [1.5, 2.5] * 2
        assert data[0].wrench[0, 5] == 0.006


@pytest.mark.parametrize("text", ["skiprows", "=7", "no key=7"])
def test_an_option_of_pandas_is_a_key_and_a_value(folder, text):
    assert f"--csv must be KEY=VALUE, an option of pandas.read_csv, got '{text}'" in refused(
        "data", "info", folder, "--csv", text
    )
    assert "invalid_option" in refused("data", "info", folder, "--csv", "invalid_option=7")
