"""The command line: what it prints, writes, refuses, and how it ends."""

import csv
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from granular_id.cli.app import app
from granular_id.cli.errors import in_options
from granular_id.cli.prepare import Preparation, prepare
from granular_id.io import save_csv
from granular_id.recording import Dataset, Recording

LABELS = ("oat", "rice", "sugar")


def recording(rng, k, i, *, samples=60, jitter=0.0, label=None):
    level = np.array([1.0, -1.0, 0.5, 0.1, 0.2, -0.1]) * (k + 1)
    wrench = level * rng.normal(1, 0.4) + rng.normal(0, 0.2 * (k + 1), (samples, 6))
    steps = np.full(samples - 1, 0.008) * (1 + jitter * rng.uniform(-1, 1, samples - 1))
    time = {"time_s": np.concatenate([[0.0], np.cumsum(steps)])} if jitter else {"rate_hz": 125.0}
    label = label or LABELS[k]
    name = f"{label}/{label}_{i:02d}.csv"
    return Recording(wrench, label=label, start_time=1.6e9 + 60.0 * (10 * i + k), name=name, **time)


def make(n=10, **fields):
    rng = np.random.default_rng(1)
    return Dataset([recording(rng, k, i, **fields) for k in range(len(LABELS)) for i in range(n)])


def saved(data, folder):
    save_csv(data, folder)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(), tmp_path_factory.mktemp("cli") / "uniform")


@pytest.fixture(scope="module")
def irregular(tmp_path_factory):
    return saved(make(jitter=0.5), tmp_path_factory.mktemp("cli") / "irregular")


SMALL = ["--train", "6", "--test", "3", "--partitions", "3", "--n-bins", "10"]


def run(*words, columns=200):
    return CliRunner().invoke(
        app, [str(word) for word in words], env={"COLUMNS": str(columns), "NO_COLOR": "1"}
    )


def ended_well(*words, **more):
    result = run(*words, **more)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(*words):
    """One line on standard error, exit code 2, no traceback."""
    result = run(*words)
    assert result.exit_code == 2, result.output
    line, end = result.stderr.split("\n")
    assert line.startswith("error: ")
    assert end == ""
    return line


def test_evaluate_prints_tables_and_writes_what_it_prints(folder, tmp_path):
    out = ended_well(
        "evaluate", folder, *SMALL, "--json", tmp_path / "r.json", "--csv", tmp_path / "p.csv",
        "--figures", tmp_path / "new" / "figures",
    )  # fmt: skip
    result = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    with (tmp_path / "p.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [space["name"] for space in result["spaces"]] == ["raw+hfmh", "hfmh", "raw"]
    assert list(result["partitions"]) == ["paper", "chronological"]
    for space in result["spaces"]:
        figures = space["protocols"]["paper"]
        mine = [r for r in rows if (r["space"], r["protocol"]) == (space["name"], "paper")]
        shares = [np.mean([int(r["correct"]) for r in mine if r["partition"] == str(j)]) for j in range(3)]
        assert figures["accuracies"] == pytest.approx(shares, abs=0)
        mean, sd = 100 * np.mean(shares), 100 * np.std(shares, ddof=1)
        assert re.search(rf"^{re.escape(space['name'])} .* {mean:.2f} ± {sd:.2f} %", out, re.M)
    assert "recordings: 30" in out
    assert "in percent of the true class" in out
    assert "training" in out
    assert "chronological: by start time" in out
    assert result["synthetic"] is False
    assert result["command"].startswith("granular-id ")
    assert result["data"]["history"][0]["step"] == "load"
    for figure in ("mean_forces.png", "confusion.png"):
        assert (tmp_path / "new" / "figures" / figure).read_bytes().startswith(b"\x89PNG")
        assert f"wrote {tmp_path / 'new' / 'figures' / figure}" in out


def test_same_seed_same_files_for_any_threads(folder, tmp_path):
    for threads, name in ((1, "one"), (2, "two")):
        ended_well("evaluate", folder, *SMALL, "--threads", threads, "--csv", tmp_path / name, "--quiet")
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_options_reach_the_evaluation(folder, tmp_path):
    ended_well(
        "evaluate", folder, *SMALL, "--spaces", "hfmh", "--protocol", "paper", "--cutoff-hz", 11,
        "--order", 4, "--bin-range", "-0.5,0.25", "--C", 0.125, "--seed", 9, "--exclude", "sugar",
        "--duration-s", 0.4, "--json", tmp_path / "r.json",
    )  # fmt: skip
    result = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    (space,) = result["spaces"]
    settings = space["settings"]
    assert (settings["cutoff_hz"], settings["order"], settings["n_bins"]) == (11.0, 4, 10)
    assert settings["rate_hz"] == 125.0
    assert settings["bin_range"] == [-0.5, 0.25]
    assert result["settings"]["classifier"]["C"] == 0.125
    assert (result["settings"]["seed"], result["settings"]["protocol"]) == (9, ["paper"])
    assert result["labels"] == ["oat", "rice"]
    assert result["data"]["n_samples"] == 50
    assert [step["step"] for step in result["data"]["history"]] == ["load", "select", "align"]


def test_learned_ranges_and_one_protocol(folder):
    out = ended_well("evaluate", folder, *SMALL, "--bin-range", "auto", "--protocol", "chronological")
    assert "random" not in out
    assert "1st->2nd half" in out


def test_quiet_prints_accuracies_only(folder):
    out = ended_well("evaluate", folder, *SMALL, "--quiet")
    assert out.strip().startswith("Accuracy on these recordings (30 recordings, 3 classes, chance 33.3 %)")
    assert "Seconds" not in out


def test_many_classes_on_a_narrow_terminal_become_a_list_of_mistakes(folder):
    assert "Confusion of" in ended_well("evaluate", folder, *SMALL, columns=80)
    assert "Most frequent" in ended_well("evaluate", folder, *SMALL, columns=20)


def test_tables_fit_eighty_columns(folder):
    out = ended_well("evaluate", folder, *SMALL, columns=80)
    rows = [line for line in out.splitlines() if line.startswith(("raw+hfmh  ", "hfmh  ", "raw  "))]
    assert len(rows) == 6
    assert all(re.search(r"\d$", line) for line in rows)


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
    assert "--max-gap-s 0.25" in line
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
    assert str(bad) in refused("evaluate", data, *SMALL)
    out = ended_well("evaluate", data, *SMALL, "--on-error", "skip")
    assert "skipped: 1" in out
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
    assert "moved_samples: 1" in out


def test_no_order_in_time_leaves_the_second_protocol_out_and_says_so(tmp_path):
    timed = make()
    one = timed[4]
    without = Recording(one.wrench, rate_hz=125.0, label=one.label, name=one.name)
    data = saved(Dataset([*timed[:4], without, *timed[5:]]), tmp_path / "x")
    out = ended_well("evaluate", data, *SMALL)
    assert "chronological protocol left out: no order for the chronological protocol: recording" in out
    assert "no start time" in refused("evaluate", data, *SMALL, "--protocol", "chronological")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--train", "50"], r"class 'oat' has 10 recordings, wanted 53 \(50 to train, 3 to test\)"),
        (["--train", "0"], "--train must be at least 1, got 0"),
        (["--partitions", "0"], "--partitions must be at least 1, got 0"),
        (["--seed", "-1"], "--seed must not be negative, got -1"),
        (["--spaces", "raw,dft"], "there is no feature space 'dft'; there are raw"),
        (["--spaces", ","], "at least one feature space"),
        (["--confusion", "dft"], "there is no feature space 'dft'"),
        (
            ["--spaces", "raw", "--confusion", "hfmh"],
            "--confusion hfmh is not among the spaces evaluated: raw",
        ),
        (["--bin-range", "wide"], "--bin-range must be LOW,HIGH such as -1.5,1.5, or auto, got 'wide'"),
        (["--n-samples", "few"], "--n-samples must be a whole number or 'shortest', got 'few'"),
        (["--n-samples", "10", "--duration-s", "1"], "give one of --duration-s and --n-samples, not both"),
        (["--n-samples", "999"], "too short"),
        (["--exclude", "salt"], "--exclude names 'salt', which is no label here; there are oat, rice, sugar"),
        (["--exclude", "oat,rice,sugar"], "--exclude leaves no recording"),
        (["--exclude", "oat,rice"], "at least 2 classes, got only 'sugar'"),
        (["--cutoff-hz", "80"], "cutoff"),
        (["--C", "0"], "C must be positive"),
        (["--rate-hz", "-5"], "--rate-hz"),
        (["--json", "absent/r.json"], "the folder absent does not exist"),
    ],
)
def test_bad_options_end_in_one_line(folder, words, message):
    assert re.search(message, refused("evaluate", folder, *SMALL, *words))


def test_bad_folders_end_in_one_line(folder, tmp_path):
    assert "no such file or folder" in refused("evaluate", tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    assert "holds no CSV recordings" in refused("evaluate", tmp_path / "empty")
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


def test_help_names_every_option_with_examples():
    out = ended_well("evaluate", "--help", columns=120)
    options = (
        "rate-hz max-gap-s duration-s n-samples on-gap on-short on-error train test partitions protocol "
        "spaces cutoff-hz order n-bins bin-range C seed threads json csv figures quiet"
    )
    for option in options.split():
        assert f"--{option}" in out
    assert "granular-id evaluate recordings --train 40 --test 10" in out
    assert "granular-id demo -o somewhere --quick" in ended_well("demo", "--help", columns=120)
    assert re.fullmatch(r"granular-id \d+\.\d+\.\d+\S*\n", ended_well("--version"))


def test_demo_says_that_it_is_synthetic_and_writes_its_files(tmp_path):
    out = ended_well("demo", "--quick", "-o", tmp_path / "demo")
    assert out.startswith("SYNTHETIC data: 132 simulated pushes through 11 materials")
    assert "Accuracy on SYNTHETIC recordings: says nothing about real materials" in out
    files = {path.name for path in (tmp_path / "demo").iterdir()}
    assert files == {"result.json", "predictions.csv", "mean_forces.png", "confusion.png"}
    result = json.loads((tmp_path / "demo" / "result.json").read_text(encoding="utf-8"))
    assert result["synthetic"] is True
    assert len(result["labels"]) == 11
    for space in result["spaces"]:
        # wide bands: far above the chance of 9 %, and no claim beyond that
        assert space["protocols"]["paper"]["accuracy_mean"] > 0.4


def test_messages_speak_in_options():
    assert in_options("raise max_gap_s=0.25\n or on_gap='skip'") == "raise --max-gap-s 0.25 or --on-gap skip"
    assert in_options("train_per_class must be 1") == "--train must be 1"
    for untouched in ("/data/n_bins/x.csv: broken", "'n_bins'", "the order of files", "no_rate_hz"):
        assert in_options(untouched) == untouched


def test_rates_that_differ_are_refused_with_the_lowest_proposed():
    slow = Recording(np.zeros((9, 6)), rate_hz=50.0, label="a", name="slow")
    fast = Recording(np.zeros((9, 6)), rate_hz=500.0, label="a", name="fast")
    plain = Preparation(rate_hz=None, max_gap_s=0.25, duration_s=None, n_samples=None)
    with pytest.raises(
        ValueError, match="sampled at 50 to 500 Hz; nothing is resampled unasked: add --rate-hz 50"
    ):
        prepare(Dataset([slow, fast]), plain, print)


# -- as processes ----------------------------------------------------------------------------------------

ENVIRONMENT = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1", "COLUMNS": "120"}


def process(*words, code=None):
    start = [sys.executable, "-c", code] if code else [sys.executable, "-m", "granular_id.cli"]
    return subprocess.run(
        [*start, *map(str, words)], capture_output=True, text=True, env=ENVIRONMENT, timeout=60, check=False
    )


def test_the_module_runs_and_loads_nothing_heavy_for_help():
    code = (
        "import sys; from granular_id.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: print('exit', end.code)\n"
        "print('heavy', sorted({'sklearn', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    done = process("--help", code=code)
    assert "evaluate" in done.stdout
    assert "exit 0" in done.stdout
    assert "heavy []" in done.stdout


def test_a_bad_folder_as_a_process(tmp_path):
    done = process("evaluate", tmp_path / "absent")
    assert done.returncode == 2
    assert done.stderr == f"error: {tmp_path / 'absent'}: no such file or folder\n"
    assert done.stdout == ""


@pytest.mark.parametrize("missing", ["typer", "rich"])
def test_a_missing_extra_is_named(missing):
    code = f"import sys; sys.modules[{missing!r}] = None; from granular_id.cli import main; main()"
    done = process("demo", code=code)
    assert done.returncode == 1
    assert done.stderr == f"granular-id: the command line needs {missing}: pip install 'granular-id[app]'\n"


def test_missing_matplotlib_is_named_before_any_work(tmp_path):
    code = "import sys; sys.modules['matplotlib'] = None; from granular_id.cli import main; main()"
    done = process("evaluate", tmp_path, "--figures", tmp_path / "figures", code=code)
    assert done.returncode == 1
    assert done.stderr == "error: figures need matplotlib: pip install 'granular-id[app]'\n"


def test_the_library_evaluates_without_the_extra():
    code = (
        "import sys\n"
        "for name in ('typer', 'rich', 'matplotlib'): sys.modules[name] = None\n"
        "from granular_id.evaluation import evaluate\n"
        "from granular_id.synthetic import synthesize\n"
        "data = synthesize(['rice', 'fine sugar'], n_per_class=4, duration_s=0.5)\n"
        "print(evaluate(data, 'raw', n_partitions=2, train_per_class=3, test_per_class=1))"
    )
    done = process(code=code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Accuracy on SYNTHETIC recordings")


def test_ctrl_c_exits_with_130_and_leaves_no_half_file(folder, tmp_path):
    words = ("evaluate", folder, "--train", 6, "--test", 3, "--partitions", 4000)
    outputs = ("--json", tmp_path / "r.json", "--csv", tmp_path / "p.csv")
    running = subprocess.Popen(
        [sys.executable, "-m", "granular_id.cli", *map(str, (*words, *outputs))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    try:
        assert running.stdout.readline().startswith("load:")
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130
    assert errors == "Interrupted: no file was left half-written.\n"
    assert list(Path(tmp_path).iterdir()) == []


class Terminal:
    """A process whose standard error is a pseudo-terminal."""

    def __init__(self, words):
        self.screen, theirs = os.openpty()
        self.shown = ""
        self.running = subprocess.Popen(
            [sys.executable, "-m", "granular_id.cli", *words],
            stdout=subprocess.PIPE,
            stderr=theirs,
            text=True,
            env={**ENVIRONMENT, "TERM": "xterm"},
        )
        os.close(theirs)

    def read(self):
        try:
            more = os.read(self.screen, 65536).decode(errors="replace")
        except OSError:  # how Linux says that the other end was closed
            more = ""
        self.shown += more
        return more

    def read_until(self, text):
        while text not in self.shown and self.read():
            pass

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.running.kill()
        self.running.communicate()
        os.close(self.screen)


needs_terminal = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo-terminal")


@needs_terminal
def test_a_terminal_gets_a_progress_bar_that_leaves_nothing_behind(folder):
    words = [str(word) for word in ("evaluate", folder, *SMALL, "--partitions", 40, "--spaces", "raw")]
    with Terminal(words) as terminal:
        terminal.read_until("a text that never comes")
        out, _ = terminal.running.communicate(timeout=60)
        assert terminal.running.returncode == 0
    assert "raw: paper, partition" in terminal.shown
    assert terminal.shown.rstrip().endswith(("\x1b[2K", "\x1b[?25h"))
    assert "partition 4" not in out
    assert f"repeat with: granular-id {shlex.join(words)}\n" in out


@needs_terminal
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_amid_the_partitions_ends_the_bar_too(folder, tmp_path, threads):
    words = ("evaluate", folder, "--train", 6, "--test", 3, "--partitions", 4000, "--threads", threads)
    with Terminal([str(word) for word in (*words, "--csv", tmp_path / "p.csv")]) as terminal:
        terminal.read_until("paper, partition")
        assert "paper, partition" in terminal.shown
        terminal.running.send_signal(signal.SIGINT)
        terminal.read_until("a text that never comes")
        terminal.running.communicate(timeout=30)
        assert terminal.running.returncode == 130
    assert "Traceback" not in terminal.shown
    assert terminal.shown.rstrip().endswith("Interrupted: no file was left half-written.")
    assert list(Path(tmp_path).iterdir()) == []
