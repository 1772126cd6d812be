"""The command line: what it refuses, in one line that names the option to use."""

import json
import re

import numpy as np
import pytest

from cli_cases import LABELS, SMALL, ended_well, make, out_of_bounds, recording, refused, run, saved
from granular_id._checks import argument_error
from granular_id.cli.errors import in_options, words_of
from granular_id.cli.recordings import refuse_unequal
from granular_id.recording import Dataset, Recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(), tmp_path_factory.mktemp("cli") / "uniform")


@pytest.fixture(scope="module")
def irregular(tmp_path_factory):
    return saved(make(jitter=0.5), tmp_path_factory.mktemp("cli") / "irregular")


def test_irregular_stamps_need_a_rate_and_the_proposed_one_works(irregular, tmp_path):
    line = refused("evaluate", irregular, *SMALL)
    assert "30 of 30 recordings are sampled irregularly, with a median step of" in line
    (rate,) = re.findall(r"add (--rate-hz \d+)$", line)
    assert rate == "--rate-hz 100"
    line = refused("evaluate", irregular, *SMALL, *rate.split())
    (crop,) = re.findall(r"add (--n-samples shortest)", line)
    out = ended_well(
        "evaluate", irregular, *SMALL, *rate.split(), *crop.split(), "--json", tmp_path / "r.json"
    )
    assert "resample: rate_hz=100, method=linear, max_gap_s=0.25" in out
    assert "dropped_samples" in out
    history = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["data"]["history"]
    assert [step["step"] for step in history] == ["load", "resample", "align"]
    assert len(history[1]["rows"]) == 30


def test_gaps_and_short_recordings_are_left_out_when_asked(tmp_path):
    rng = np.random.default_rng(3)
    hole = recording(rng, 0, 90, jitter=0.5)
    hole = Recording(
        hole.wrench, time_s=hole.time_s + (np.arange(60) > 20), label="oat", name="oat/oat_90.csv"
    )
    short = recording(rng, 1, 91, samples=30, jitter=0.5)
    saved(Dataset([*make(jitter=0.5), hole, short]), tmp_path / "x")
    words = ("evaluate", tmp_path / "x", *SMALL, "--rate-hz", 100, "--protocol", "paper")
    line = refused(*words)
    assert "'oat/oat_90.csv' has a gap of 1" in line
    assert "beyond --max-gap-s 0.25; 1 of 32 recordings has such a gap, the largest 1.0" in line
    assert "--on-gap skip" in line
    line = refused(*words, "--on-gap", "skip", "--n-samples", 40)
    assert "'rice/rice_91.csv' is too short" in line
    assert "--on-short skip" in line
    out = ended_well(*words, "--on-gap", "skip", "--n-samples", 40, "--on-short", "skip")
    assert re.search(r"oat/oat_90\.csv +gap of 1", out)
    assert re.search(r"rice/rice_91\.csv .*is too short", out)
    assert "largest_gap_s: 1" in ended_well(*words, "--max-gap-s", "inf", "--n-samples", "shortest")


def test_files_without_time_need_the_rate_they_were_recorded_at(tmp_path):
    rng = np.random.default_rng(0)
    for label in LABELS[:2]:
        (tmp_path / label).mkdir()
        for i in range(9):
            rows = "\n".join(",".join(f"{x:.4f}" for x in row) for row in rng.normal(size=(50, 6)))
            (tmp_path / label / f"{i}.csv").write_text(f"fx,fy,fz,tx,ty,tz\n{rows}\n")
    line = refused("evaluate", tmp_path, *SMALL)
    assert "has no time column and no rate is stated; pass --recorded-hz, or a rate_hz column" in line
    out = ended_well("evaluate", tmp_path, *SMALL, "--recorded-hz", 500)
    assert "chronological: by file order: the recordings carry no start time" in out


def test_broken_files_are_refused_or_listed(folder, tmp_path):
    data = saved(make(), tmp_path / "x")
    bad = min((data / "rice").glob("*.csv"))
    bad.write_text(bad.read_text(encoding="utf-8").replace("fx", "fq", 1), encoding="utf-8")
    line = refused("evaluate", data, *SMALL)
    assert str(bad) in line
    assert line.endswith("; add --on-error skip to leave such files out")
    out = ended_well("evaluate", data, *SMALL, "--on-error", "skip")
    assert "1 file skipped:\n" in out
    assert bad.name in out


def test_backward_time_is_refused_or_repaired(tmp_path):
    data = saved(make(jitter=0.5), tmp_path / "x")
    bad = data / "oat" / "oat_03.csv"
    lines = bad.read_text(encoding="utf-8").splitlines()
    lines[5], lines[6] = lines[6], lines[5]
    bad.write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = ("evaluate", data, *SMALL, "--rate-hz", 100, "--n-samples", "shortest")
    line = refused(*words)
    assert str(bad) in line
    assert "--on-time-error repair" in line
    out = ended_well(*words, "--on-time-error", "repair")
    assert "time repaired in 1 recording (1 sample moved): oat/oat_02.csv\n" in out
    assert "30 recordings, 3 materials, 60 samples, irregular in time\n" in out


def test_a_file_that_may_be_cut_off_is_mentioned(tmp_path):
    data = saved(make(), tmp_path / "x")
    cut = data / "oat" / "oat_03.csv"
    cut.write_text(cut.read_text(encoding="utf-8").rstrip("\n"), encoding="utf-8")
    out = ended_well("evaluate", data, *SMALL)
    assert "may be cut off, in 1 recording: oat/oat_02.csv\n" in out


def test_no_order_in_time_leaves_the_second_protocol_out_and_says_so(tmp_path):
    timed = make()
    one = timed[4]
    without = Recording(one.wrench, rate_hz=125.0, label=one.label, name=one.name)
    data = saved(Dataset([*timed[:4], without, *timed[5:]]), tmp_path / "x")
    out = ended_well("evaluate", data, *SMALL)
    assert f"chronological protocol left out: recording {one.name!r} has no start time" in out
    assert "no start time" in refused("evaluate", data, *SMALL, "--protocol", "chronological")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--train", "50"], r"class 'oat' has 10 recordings, wanted 53 \(50 .*: add --train 9 --test 1$"),
        (["--spaces", "raw,dtf"], "there is no feature space 'dtf'; there are raw"),
        (["--bin-range", "wide"], "--bin-range must be LOW,HIGH such as -1.5,1.5, or auto, got 'wide'"),
        (["--n-samples", "few"], "--n-samples must be a whole number or 'shortest', got 'few'"),
        (["--n-samples", "999"], "too short"),
        (["--exclude", "salt"], "--exclude names 'salt', which is no label here; there are oat, rice, sugar"),
        (["--exclude", "oat,rice,sugar"], "--exclude leaves no recording"),
        (["--exclude", "oat,rice"], "at least 2 classes, got only 'sugar'"),
        (["--cutoff-hz", "80"], "--cutoff-hz must be in .*, got 80"),
        (["--rate-hz", "-5"], "--rate-hz"),
        (["--json", "absent/r.json"], "the folder absent does not exist"),
    ],
)
def test_bad_options_end_in_one_line(folder, words, message):
    assert re.search(message, refused("evaluate", folder, *SMALL, *words))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--spaces", "raw,dtf"], "there is no feature space 'dtf'"),
        (["--spaces", ","], "--spaces must name at least one feature space, got ','"),
        (["--spaces", "raw,raw"], "--spaces must name each feature space once"),
        (["--confusion", "dtf"], "there is no feature space 'dtf'"),
        (["--spaces", "raw", "--confusion", "hfmh"], "--confusion hfmh is not among"),
        (["--cutoff-hz", "80", "--rate-hz", "100"], "--cutoff-hz must be in .*, got 80"),
        (["--order", "0"], "--order must be an integer from 1 to 32, got 0"),
        (["--n-bins", "0"], "--n-bins must be an integer"),
        (["--bin-range", "2,1"], "--bin-range must be finite with low < high"),
        (["--rate-hz", "inf"], "--rate-hz must be positive and finite, got inf"),
        (["--recorded-hz", "0"], "--recorded-hz must be positive and finite, got 0"),
        (["--max-gap-s", "nan"], "--max-gap-s must be positive, got nan"),
        (["--n-samples", "0"], "--n-samples must be at least 1, got 0"),
        (["--duration-s", "-1"], "--duration-s must be positive and finite, got -1"),
        (["--n-samples", "10", "--duration-s", "1"], "one of --duration-s and --n-samples, not both"),
    ],
)
def test_options_are_checked_before_any_file_is_read(tmp_path, words, message):
    assert re.search(message, refused("evaluate", tmp_path / "absent", *words))


@pytest.mark.parametrize(
    ("command", "option", "value", "message"),
    [
        ("evaluate", "--train", 0, "must be at least 1, got 0"),
        ("evaluate", "--test", 0, "must be at least 1, got 0"),
        ("evaluate", "--partitions", 0, "must be at least 1, got 0"),
        ("evaluate", "--folds", 1, "must be at least 2, got 1"),
        ("evaluate", "--seed", -1, "must be at least 0, got -1"),
        ("evaluate", "--threads", 0, "must be at least 1, got 0"),
        ("evaluate", "--tare-s", 0, "must be positive and finite, got 0"),
        ("evaluate", "--cutoff-hz", 0, "must be positive and finite, got 0"),
        ("evaluate", "--C", "nan", "must be positive and finite, got nan"),
        ("select", "--outer", 1, "must be at least 2, got 1"),
        ("select", "--inner", 1, "must be at least 2, got 1"),
        ("confidence", "--seeds", 0, "must be at least 1, got 0"),
        ("confidence", "--known", 1, "must lie between 0 and 1, got 1"),
        ("demo", "--seed", -1, "must be at least 0, got -1"),
        ("demo", "--threads", 0, "must be at least 1, got 0"),
        ("train", "--target-error", 1.5, "must lie between 0 and 1, got 1.5"),
        ("train", "--coverage", 0, "must lie between 0 and 1, got 0"),
        ("train", "--share-known", 1, "must lie between 0 and 1, got 1"),
        ("train", "--folds", 1, "must be at least 2, got 1"),
    ],
)
def test_bounds_of_options_are_checked_before_anything_else(tmp_path, command, option, value, message):
    words = {"demo": ("-o", tmp_path / "new"), "train": (tmp_path / "absent", "-o", tmp_path / "new")}
    said = out_of_bounds(command, *words.get(command, (tmp_path / "absent",)), option, value)
    assert f"Invalid value for '{option}': {message}" in said
    assert list(tmp_path.iterdir()) == []


def test_a_file_and_an_index_without_labels_are_told(tmp_path):
    file = tmp_path / "x.csv"
    file.write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n", encoding="utf-8")
    assert f"{file}: no recording has a label" in refused("evaluate", file)
    (tmp_path / "index.csv").write_text("file,material\nx.csv,rice\n", encoding="utf-8")
    line = refused("evaluate", tmp_path)
    assert line.endswith(f"{tmp_path}: index.csv has no column label (found: file, material)")


def test_folders_that_cannot_be_are_told_and_those_made_in_vain_removed(tmp_path):
    file = tmp_path / "file"
    file.touch()
    for words in (("evaluate", tmp_path, "--figures", file), ("demo", "-o", file)):
        assert f"{file} is or lies in a file, wanted a folder" in refused(*words)
    refused("evaluate", tmp_path / "absent", "--figures", tmp_path / "new" / "deeper")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_bad_folders_end_in_one_line(folder, tmp_path):
    assert "no such file or folder" in refused("evaluate", tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    assert "holds no recordings" in refused("evaluate", tmp_path / "empty")
    one = saved(make()[:10], tmp_path / "one")
    assert "at least 2 classes, got only 'oat'" in refused("evaluate", one, *SMALL)


def test_outputs_are_checked_before_anything_is_read(tmp_path):
    line = refused("evaluate", tmp_path / "absent", "--csv", tmp_path)
    assert "is a folder, wanted the name of a file" in line


def test_unknown_options_and_missing_words_exit_with_two():
    for words in (
        ["evaluate"],
        ["evaluate", "x", "--frobnicate"],
        ["nonsense"],
        ["evaluate", "x", "--train", "ten"],
    ):
        result = run(*words)
        assert result.exit_code == 2
        assert "Traceback" not in result.output


def test_an_error_that_is_not_the_users_keeps_its_traceback(folder, monkeypatch):
    def broken(*args, **kwargs):
        raise ZeroDivisionError

    monkeypatch.setattr("granular_id.io.load", broken)
    assert isinstance(run("evaluate", folder).exception, ZeroDivisionError)


def test_debug_variable_keeps_the_traceback(folder, monkeypatch):
    monkeypatch.setenv("GRANULAR_ID_DEBUG", "1")
    assert isinstance(run("evaluate", folder, "--train", 99).exception, ValueError)


def test_messages_speak_in_options():
    assert in_options("raise max_gap_s=0.25\n or on_gap='skip'") == "raise --max-gap-s 0.25 or --on-gap skip"
    assert in_options("train_per_class must be 1") == "--train must be 1"
    for untouched in (
        "/data/n_bins/x.csv: broken",
        "'n_bins'",
        "the order of files",
        "files in order must",
        "no_rate_hz",
    ):
        assert in_options(untouched) == untouched


def test_errors_that_hold_an_argument_speak_of_its_option():
    for argument, option in {"C": "--C", "order": "--order", "n_folds": "--folds", "format": "--to"}.items():
        assert words_of(argument_error(ValueError, argument, "is wrong")) == f"{option} is wrong"
    gap = argument_error(ValueError, "on_gap", "='x'; wanted 'raise' or 'skip'")
    assert str(gap) == "on_gap='x'; wanted 'raise' or 'skip'"
    assert words_of(gap) == "--on-gap x; wanted 'raise' or 'skip'"
    rate = argument_error(ValueError, "rate_hz", "must be positive")
    assert words_of(rate, rate_option="--recorded-hz") == "--recorded-hz must be positive"


def test_recordings_of_one_sample_are_refused(tmp_path):
    for name in ("oat_1", "oat_2", "rice_1", "rice_2"):
        (tmp_path / f"{name}.csv").write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n", encoding="utf-8")
    line = refused("evaluate", tmp_path)
    assert "4 of 4 recordings hold a single sample, the first is 'oat_1.csv'" in line


def test_rates_that_differ_are_refused_with_the_lowest_proposed():
    slow = Recording(np.zeros((9, 6)), rate_hz=50.0, label="a", name="slow")
    fast = Recording(np.zeros((9, 6)), rate_hz=500.0, label="a", name="fast")
    with pytest.raises(
        ValueError, match="sampled at 50 to 500 Hz; nothing is resampled unasked: add --rate-hz 50"
    ):
        refuse_unequal(Dataset([slow, fast]))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--space", "paper"], "there is no feature space 'paper'; there are raw"),
        (["--space", "raw,hfmh"], "there is no feature space 'raw,hfmh'"),
        (["--figure", "f.xyz"], "--figure must end in .png, .svg or .pdf ("),
        (["--figure", "one.svg", "--json", "one.svg"], "one.svg would be written twice"),
        (["--json", "no/where.json"], "the folder no does not exist"),
    ],
)
def test_explain_is_refused_before_anything_is_read(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused("explain", tmp_path, "oat", "rice", *words)
    assert list(tmp_path.iterdir()) == []


def test_a_topic_is_refused_for_files_that_are_no_bags(folder):
    line = refused("data", "info", folder, "--topic", "/wrench")
    assert line.startswith(
        "error: --topic must be left out where no file is a bag or MCAP: 30 files, the first is "
    )
    assert str(folder / "oat" / "oat_") in line


def test_no_output_is_written_over_another(tmp_path):
    line = refused("evaluate", tmp_path, "--json", tmp_path / "r", "--csv", tmp_path / "." / "r")
    assert "would be written twice" in line


def test_a_result_that_is_not_there_is_told_in_words(tmp_path):
    (tmp_path / "folder").mkdir()
    assert (
        refused("report", tmp_path / "none.json") == f"error: {tmp_path}/none.json: no such file or directory"
    )
    line = refused("report", tmp_path / "folder", "-o", tmp_path / "a.html")
    assert line == f"error: {tmp_path}/folder: is a directory"


def test_a_model_is_no_result_and_nothing_is_said_of_bytes(tmp_path):
    model = tmp_path / "kitchen.safetensors"
    model.write_bytes(b"\x90\x10\x00\x00{}")
    line = refused("report", model)
    assert line == f"error: {model} is no JSON of an evaluation, as granular-id evaluate --json writes it"


@pytest.mark.parametrize(
    ("spaces", "own"),
    [
        ("multiband,best", "'multiband' and 'best', with a classifier of their own"),
        ("raw,best", "'best', with a classifier of its own"),
        ("all", "'multiband' and 'best', with a classifier of their own"),
    ],
)
def test_select_refuses_spaces_with_a_classifier_before_anything_is_read(tmp_path, spaces, own):
    line = refused("select", tmp_path / "absent", "--spaces", spaces)
    assert f"--spaces must leave out {own}: granular-id evaluate --spaces " in line
    assert spaces == "all" or f"evaluate --spaces {spaces}, or" in line


def test_one_material_is_no_pair(tmp_path):
    line = refused("explain", tmp_path / "absent", "oat", "oat")
    assert "FIRST and SECOND must be two materials, got 'oat' twice" in line


@pytest.mark.parametrize("option", [("--max-gap-s", 1), ("--on-gap", "skip")])
def test_gaps_are_nothing_to_talk_of_where_nothing_is_resampled(tmp_path, option):
    said = refused("data", "convert", tmp_path, tmp_path / "x.npz", *option)
    assert said == f"error: {option[0]} is about gaps that resampling fills: add --rate-hz"


def test_the_default_of_gaps_is_that_of_the_library():
    from granular_id.cli.recordings import MAX_GAP_S
    from granular_id.recording import resampling

    assert MAX_GAP_S == resampling.MAX_GAP_S


def test_check_refuses_a_rate_of_false_alarms_before_it_reads(tmp_path):
    said = refused("data", "check", tmp_path / "nowhere", "--false-alarm-rate", 2)
    assert said == "error: --false-alarm-rate must lie between 0 and 1, got 2"
