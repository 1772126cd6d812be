"""``granular-id data``: what its commands print, write and refuse."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cli_cases import ended_well, make, refused, run, saved
from granular_id.io import load, save
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(), tmp_path_factory.mktemp("data") / "uniform")


@pytest.fixture(scope="module")
def pushes(tmp_path_factory):
    data = synthesize(["rice", "oat flakes"], n_per_class=4, seed=1)
    return save(data, tmp_path_factory.mktemp("data") / "pushes.npz")


def test_info_says_what_is_there(folder, pushes, tmp_path):
    out = ended_well("data", "info", folder, "--json", tmp_path / "info.json")
    assert out.startswith("30 recordings, 3 materials, 60 samples at 125 Hz\n")
    for line in (
        "format: index.csv",
        "axes: fx fy fz tx ty tz",
        "recordings: 30",
        "step 1: load: format=index.csv",
    ):
        assert line in out
    assert "SYNTHETIC" not in out
    written = json.loads((tmp_path / "info.json").read_text(encoding="utf-8"))
    assert written["summary"] == load(folder).summary().to_dict()
    assert [step["step"] for step in written["history"]] == ["load"]
    assert "SYNTHETIC: 8 of 8 recordings" in ended_well("data", "info", pushes)


def test_head_prints_the_first_samples(folder):
    out = ended_well("data", "head", folder, "-n", 2)
    data = load(folder)
    assert repr(data[0]) in out
    rows = [line.split() for line in out.splitlines() if line and line[0].isdigit()][1:]
    assert np.allclose(np.array(rows, float)[:, 1:], data[0].wrench[:2], rtol=1e-5)
    chosen = data.names[7]
    assert repr(chosen) in ended_well("data", "head", folder, "--name", chosen)
    assert "no recording is called 'rice_3'; there are" in refused("data", "head", folder, "--name", "rice_3")
    assert "-n must be at least 1, got 0" in refused("data", "head", folder, "-n", 0)


@pytest.mark.parametrize("target", ["x.npz", "x.h5"])
def test_convert_by_ending(folder, tmp_path, target):
    pytest.importorskip("h5py")
    out = ended_well("data", "convert", folder, tmp_path / target)
    assert f"wrote {tmp_path / target}, read back and found equal" in out
    assert load(tmp_path / target) == load(folder)


@pytest.mark.parametrize("to", ["csv", "parquet", "mcap", "npz"])
def test_convert_by_name(folder, tmp_path, to):
    pytest.importorskip("pyarrow")
    pytest.importorskip("mcap")
    target = tmp_path / ("x.npz" if to == "npz" else "x")
    ended_well("data", "convert", folder, target, "--to", to, "--no-verify")
    assert load(target) == load(folder)


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


def test_onsets_are_found_on_the_way(pushes, tmp_path):
    ended_well(
        "data",
        "convert",
        pushes,
        tmp_path / "x.npz",
        "--begin-at",
        "onset",
        "--lead-s",
        0.05,
        "--n-samples",
        1000,
    )
    data = load(tmp_path / "x.npz")
    assert data.X.shape == (8, 1000, 6)
    assert "find_onsets" in [step.step for step in data.history]


def test_where_no_onset_is_found_the_error_does_not_say_to_look_for_one(folder, tmp_path):
    words = ("data", "convert", folder, tmp_path / "x.npz", "--begin-at", "onset", "--n-samples", 9)
    said = refused(*words)
    assert "no onset in 30 of 30 recordings, the first is 'oat/oat_00.csv': state it with --onset-at" in said
    assert "add --begin-at onset" not in said


def test_convert_refuses_before_it_reads(folder, tmp_path):
    (tmp_path / "there.npz").write_bytes(b"mine")
    nowhere = tmp_path / "nowhere"
    for words, message in (
        ((nowhere, tmp_path / "there.npz"), "there is something already; nothing is overwritten"),
        ((nowhere, tmp_path / "x"), "does not say which format is wanted; give --to one of csv"),
        ((nowhere, tmp_path / "x.mat"), "can only be read"),
        ((nowhere, tmp_path / "no" / "x.npz"), "no such folder"),
        ((nowhere, tmp_path / "x", "--to", "excel"), "--to excel; wanted one of csv"),
        ((nowhere, tmp_path / "x.npz"), "nowhere: no such file or folder"),
        ((folder, tmp_path / "x.npz", "--begin-at", "trigger"), "add --duration-s or --n-samples"),
        ((folder, tmp_path / "x.npz", "--lead-s", 1), "add --begin-at trigger or onset"),
        ((folder, tmp_path / "x.npz", "--begin-at", "trigger", "--n-samples", 9), "have no trigger_index"),
    ):
        assert message in refused("data", "convert", *words)
    assert (tmp_path / "there.npz").read_bytes() == b"mine"
    assert [path.name for path in tmp_path.iterdir()] == ["there.npz"]


def test_check_is_content_with_clean_recordings(pushes):
    result = run("data", "check", pushes)
    assert result.exit_code == 0, result.output


def test_check_exits_with_3_on_errors(folder, tmp_path):
    data = load(folder)
    twins = Dataset([*data, Recording(data[0].wrench, rate_hz=125, label="other", name="copy")])
    save(twins, tmp_path / "twins.npz")
    result = run("data", "check", tmp_path / "twins.npz", "--json", tmp_path / "check.json")
    assert result.exit_code == 3, result.output
    assert "duplicate" in result.stdout
    assert "copy" in result.stdout
    written = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    assert any(finding["severity"] == "error" for finding in written["findings"])


def test_check_says_what_is_wrong_with_a_range(folder):
    assert "--sensor-range" in refused("data", "check", folder, "--sensor-range", "1,2,three")
    assert "--sensor-range" in refused("data", "check", folder, "--sensor-range", "1,2,3")
    assert "--sensor-range" in refused("data", "check", folder, "--sensor-range", "no such sensor")


@pytest.mark.parametrize("what", ["recordings", "mean", "onset"])
def test_plots(pushes, tmp_path, what):
    out = ended_well("data", "plot", pushes, "-o", tmp_path / f"{what}.svg", "--what", what)
    assert (tmp_path / f"{what}.svg").read_text(encoding="utf-8").rstrip().endswith("</svg>")
    assert f"wrote {tmp_path / what}.svg" in out


@pytest.mark.parametrize("ending", ["xyz", "raw", "pgf"])
def test_endings_that_make_no_picture_are_refused_before_anything_is_read(tmp_path, ending):
    line = refused("data", "plot", tmp_path, "-o", tmp_path / f"x.{ending}")
    assert "--output must end in .png, .svg or .pdf (" in line
    assert ".jpg, " in line
    assert f"work too), got '{tmp_path / 'x'}.{ending}'" in line
    assert f".{ending}," not in line


def test_plots_that_cannot_be_are_told(folder, tmp_path):
    assert "mixes units" in refused("data", "plot", folder, "-o", tmp_path / "x.png", "--axes", "fx,tx")
    assert "must name some of fx" in refused(
        "data", "plot", folder, "-o", tmp_path / "x.png", "--axes", "force"
    )
    assert list(tmp_path.iterdir()) == []


def test_synthesize_writes_what_is_labelled_synthetic(tmp_path):
    out = ended_well(
        "data", "synthesize", tmp_path / "x.npz", "--materials", "rice,oat flakes", "--per-class", 2,
        "--rate-hz", 100, "--seed", 4,
    )  # fmt: skip
    assert "4 SYNTHETIC recordings of 2 materials" in out
    data = load(tmp_path / "x.npz")
    assert data == synthesize(["rice", "oat flakes"], n_per_class=2, rate_hz=100, seed=4)
    assert (
        "no material"
        in refused("data", "synthesize", tmp_path / "y.npz", "--materials", "sand and stone").lower()
    )


def test_evaluate_takes_a_single_file(pushes):
    out = ended_well(
        "evaluate", pushes, "--train", 2, "--test", 1, "--partitions", 2, "--spaces", "raw", "--quiet"
    )
    assert "raw" in out


def test_onsets_can_be_overruled(pushes, tmp_path):
    out = ended_well(
        "data", "convert", pushes, tmp_path / "x.npz", "--begin-at", "onset", "--n-samples", 500,
        "--onset-at", "rice_00=0.5", "--onset-at", "rice_01=none", "--on-short", "skip",
    )  # fmt: skip
    assert "rice_01" in out
    data = load(tmp_path / "x.npz")
    assert "rice_01" not in data.names
    source = load(pushes)
    assert np.array_equal(
        data[data.names.index("rice_00")].wrench, source[source.names.index("rice_00")].wrench[250:750]
    )
    plot = ("data", "plot", pushes, "-o", tmp_path / "x.png", "--what", "onset", "--onset-at")
    assert "--onset-at must be NAME=SECONDS or NAME=none, got 'rice'" in refused(*plot, "rice")
    assert "names 'a' twice" in refused(*plot, "a=1", "--onset-at", "a=2")
    assert "--onset-at: no recording is called 'rice_0'; did you mean" in run(*plot, "rice_0=1").stderr


@pytest.mark.parametrize("words", [("data", "check"), ("data", "info"), ("evaluate",), ("select",)])
def test_what_is_read_is_not_overwritten(words, pushes, folder):
    before = pushes.read_bytes()
    assert "belongs to" in refused(*words, pushes, "--json", pushes)
    assert "belongs to" in refused(*words, folder, "--json", folder / "index.csv")
    assert pushes.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [(("onset", "--axes", "fx"), "--axes does not go with"), (("mean", "-n", 3), "-n does not go with")],
)
def test_options_that_a_picture_cannot_follow_are_refused(words, said, pushes, tmp_path):
    assert said in refused("data", "plot", pushes, "-o", tmp_path / "a.png", "--what", *words)


def test_missing_triggers_are_explained_in_options(folder, tmp_path):
    words = ("data", "convert", folder, tmp_path / "out.npz", "--begin-at", "trigger", "--n-samples", 10)
    line = refused(*words)
    assert "add --begin-at onset, state it with --onset-at NAME=SECONDS" in line


def test_an_onset_that_nothing_uses_is_refused(pushes, tmp_path):
    words = ("data", "convert", pushes, tmp_path / "out.npz", "--onset-at", "rice_00=0.2")
    assert "add --begin-at onset" in refused(*words)


def test_large_text_files_are_read_when_asked_for(tmp_path):
    (tmp_path / "a.csv").write_text(
        "time,fx,fy,fz,tx,ty,tz\n" + "".join(f"{i / 500},1,2,3,4,5,6\n" for i in range(3000))
    )
    assert "raise --max-file-mb to read it" in refused(
        "data", "info", tmp_path / "a.csv", "--max-file-mb", 0.05
    )
    assert "3000 samples" in ended_well("data", "info", tmp_path / "a.csv", "--max-file-mb", 1)


def test_names_of_columns_stay_what_they_are(tmp_path):
    (tmp_path / "index.csv").write_text("label\nrice\n")
    assert "'start_time', 'rate_hz', 'trigger_index'" in refused("data", "info", tmp_path)


def test_a_format_and_an_ending_that_disagree_are_refused(folder, tmp_path):
    assert "ends like another format" in refused("data", "convert", folder, tmp_path / "x.npz", "--to", "csv")
    line = refused("data", "convert", folder, tmp_path / "x", "--to", "matlab")
    assert line.endswith("--to matlab; wanted one of csv, npz, hdf5, parquet, mcap")
