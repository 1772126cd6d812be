"""``granular-id record`` and ``granular-id live``, end to end with a simulated sensor."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import granular_id as gid
from cli_cases import ended_well, refused, run

SIM = "sim:?seed=4"

ENDED = r"Ended by SIGINT: (the robot is stopped, )?no file was left half-written\.\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live") / "pushes"
    words = ("--label", "rice,fine sugar", "--n", 6, "--speed", 20, "--duration-s", 1, "--session", "Monday")
    out = ended_well("record", "--source", SIM, *words, "-o", folder)
    assert "fine sugar 6/6: 500 samples, mean fx +" in out
    assert "wrote 12 SYNTHETIC recordings of 2 materials into" in out
    assert "session 'Monday'" in out
    return folder


@pytest.fixture(scope="module")
def model(folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "m.safetensors"
    ended_well("train", folder, "-o", path, "--space", "hfmh", "--quiet")
    return path


def test_what_was_recorded_loads_with_all_that_is_known(folder):
    data = gid.load(folder)
    assert len(data) == 12
    assert data.labels == ("fine sugar", "rice")
    for recording in data:
        assert (recording.n_samples, recording.rate_hz, recording.trigger_index) == (500, 500.0, 125)
        assert recording.session == "Monday"
        assert recording.meta["synthetic"]
        assert recording.meta["truth"] == recording.label
        assert recording.meta["trigger"] == "motion"
        assert recording.start_time is not None


def test_live_names_pushes_and_says_how_many_were_right(model, tmp_path):
    rows = tmp_path / "answers.jsonl"
    words = ("--source", "sim:unknown?materials=rice,fine_sugar&seed=3", "--speed", 20, "--model", model)
    out = ended_well("live", *words, "--n", 3, "--quiet", "--json", rows)
    assert out.count("final: margin") == 3
    assert "SYNTHETIC: 3 answers, " in out
    answers = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    assert len(answers) == 3
    for answer in answers:
        assert answer["synthetic"]
        assert answer["truth"] in ("rice", "fine sugar")
        assert answer["decision"]["final"]
        assert answer["failure"] is None
    before = rows.read_bytes()
    line = refused("live", *words, "--n", 1, "--quiet", "--json", rows)
    assert line == f"error: --json {rows}: there is such a file already; add --force to replace it"
    assert rows.read_bytes() == before
    ended_well("live", *words, "--n", 1, "--quiet", "--json", rows, "--force")
    assert len(rows.read_text(encoding="utf-8").splitlines()) == 1
    for other in (tmp_path / "other.npz", tmp_path / "other.json"):
        other.write_bytes(b"PK")
        line = refused("live", *words, "--json", other, "--force")
        assert line.startswith("error: --json")
        assert other.name in line
        assert other.read_bytes() == b"PK"


def test_a_full_disk_ends_a_session_with_whole_lines_and_one_error(model, tmp_path):
    rows = tmp_path / "answers.jsonl"
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1500, 1500))\n"
        "from granular_id.cli import main; main()"
    )
    words = ("live", "--source", "sim:rice?seed=3", "--speed", "20", "--model", model, "-q", "--json", rows)
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == f"error: cannot write {rows}: File too large\n"
    whole = rows.read_text("utf-8")
    assert whole.endswith("}\n")
    answers = [json.loads(line) for line in whole.splitlines()]
    assert [answer["truth"] for answer in answers] == ["rice"] * len(answers)
    assert len(whole) + len(whole) // len(answers) > 1500, "as many as there is room for"


def test_live_without_a_terminal_prints_lines_of_what_changes(model):
    words = ("--source", "sim:rice?seed=3", "--speed", 10, "--model", model, "--n", 1)
    out = ended_well("live", *words)
    assert re.search(r"^SYNTHETIC +[\d.]+ s +Done: rice \(final, after 1\.00 s", out, re.MULTILINE)


def test_what_is_like_no_known_material_is_told_and_counted(folder, tmp_path):
    strict = tmp_path / "strict.safetensors"
    ended_well("train", folder, "-o", strict, "--space", "hfmh", "--share-known", 0.01, "--quiet")
    words = ("--source", "sim:macaroni?seed=3", "--speed", 20, "--model", strict, "--n", 1)
    out = ended_well("live", *words)
    assert "Done: like no known material (final, after 1.00 s, nearest: " in out
    assert "SYNTHETIC: 1 answer, 1 right (100 %); 1 like no known material" in out


def interrupted(*words, after):
    """Press Ctrl-C after two lines of output that hold some text; return the rest of it, and the errors."""
    process = subprocess.Popen(
        [sys.executable, "-m", "granular_id", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        for _ in range(2):
            assert after in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    return out, error


def test_ctrl_c_ends_a_session_with_its_tally(model, heeding_interrupts):
    words = ("live", "--source", "sim:rice?seed=3", "--speed", "10", "--model", str(model), "--quiet")
    out, error = interrupted(*words, after="final: margin")
    assert re.fullmatch(ENDED, error), "the robot may stand between two pushes"
    assert re.fullmatch(r"SYNTHETIC: \d+ answers, \d+ right \(\d+ %\)", out.splitlines()[-1])


def test_a_page_is_offered(model):
    words = ("--source", "sim:rice?seed=3", "--speed", 10, "--model", model, "--n", 1, "--quiet")
    assert "page: http://127.0.0.1:" in ended_well("live", *words, "--view", "--no-browser")


def test_a_replay_that_is_over_ends_calmly_unless_nothing_was_answered(model, folder):
    words = ("live", "--source", f"replay:{folder}?pause_s=0.5", "--speed", 20, "--model", model)
    out = ended_well(*words)
    assert "Ended: the source came to its end" in out
    assert "SYNTHETIC: 12 answers, 12 right (100 %); the source came to its end" in out
    assert "Failed" not in out
    assert "the source came to its end before any push was answered" in refused(
        *words, "--trigger", "force", "--threshold-n", 1e6
    )


def test_misspelt_materials_are_found_before_the_first_push(tmp_path):
    line = refused("record", "--source", SIM, "--label", "rice,suger", "-o", tmp_path / "x")
    assert "'suger'; known: dry peas, rice" in line
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--label", ","), "--label must name at least one material"),
        (("--label", "rice,rice"), "--label must name each material once, got 'rice,rice'"),
        (("--label", "rice", "--speed", "1e9"), "--speed must be at most 1000, got 1e+09"),
        (("--label", "rice", "--buffer-s", "1e9"), "--buffer-s must be at most 600, got 1e+09"),
        (("--label", "rice", "--direction", "0,0,0"), "--direction must hold three numbers, not all 0"),
        (("--label", "rice", "--robot", "none", "--trigger", "motion"), "--trigger motion needs a robot"),
        (("--label", "rice", "--session", ""), "--session is empty"),
        (("--label", "rice,gravel,rice"), "--label must name each material once, got 'rice,gravel,rice'"),
        (("--label", "rice", "--n", 0), "--n must be at least 1, got 0"),
        (("--label", "rice", "--direction", "1,0"), "--direction must be X,Y,Z such as 0,-1,0, got '1,0'"),
        (("--label", "rice", "--speed-m-s", 0), "--speed-m-s must be positive and finite, got 0"),
        (("--label", "rice", "--pre-s", 9), "--pre-s must be at least 0 and below --duration-s 3.2, got 9"),
        (("--label", "rice", "--duration-s", 5), "a shorter push or a lower --speed-m-s is wanted"),
        (
            ("--label", "rice", "--robot", "source", "--trigger", "force", "--threshold-n", -1),
            "--threshold-n",
        ),
        (("--label", "rice", "--speed", -1), "--speed must be positive"),
        (("--label", "rice", "--max-lag-s", -1), "--max-lag-s must be at least 0 and finite, got -1"),
        (("--label", "rice,sa\u202elt"), "holds the control character"),
    ],
)
def test_record_refuses_what_cannot_be(tmp_path, words, part):
    assert part in refused("record", "--source", SIM, *words, "-o", tmp_path / "x")


def test_a_source_that_is_none_is_named(model, tmp_path):
    assert "'simm'; known: bota, franka, rdt" in refused("live", "--source", "simm:rice", "--model", model)
    assert "no option 'sped'; known:" in refused("live", "--source", "sim:rice?sped=2", "--model", model)
    line = refused("live", "--source", f"replay:{tmp_path}/none", "--model", model)
    assert "none" in line
    line = refused("live", "--source", "sim:rice?rate_hz=100", "--model", model)
    assert "the model is for 500 Hz, simulated rice delivers 100 Hz" in line
    assert "no.safetensors" in refused("live", "--source", "sim:rice", "--model", tmp_path / "no.safetensors")
    done = run("live", "--source", "ur://1.2.3.4", "--model", model)
    assert done.exit_code == 1
    assert "needs granular-id-contrib, which is not installed: pip install ./contrib" in done.stderr


def test_a_label_that_the_source_contradicts_is_told(tmp_path):
    words = ("--source", "sim:rice?seed=2", "--speed", 20, "--duration-s", 1, "--n", 2)
    out = ended_well("record", *words, "--label", "salt", "-o", tmp_path / "x")
    assert out.count("recorded as 'salt', but simulated rice says that it was 'rice'") == 1
    assert "wrote 2 SYNTHETIC recordings of 1 material into" in out


def test_options_that_do_nothing_or_harm_are_refused(model):
    words = ("live", "--source", "sim:rice?seed=3", "--model", model, "--n", 1, "--quiet")
    assert "--port is about the page: add --view" in refused(*words, "--port", 8000)
    assert "--no-browser is about the page: add --view" in refused(*words, "--no-browser")
    assert "--port must be between 0 and 65535, got 70000" in refused(*words, "--view", "--port", 70000)
    assert "--rerun is gone: examples/rerun_log.py in the repository" in refused(*words, "--rerun", "x.rrd")
    assert "--robot must be one of auto, none, manual, source or a URL" in refused(*words, "--robot", "ur")
    assert "--robot 'gantry:1' has the scheme 'gantry'; known: " in refused(*words, "--robot", "gantry:1")
    line = refused(*words, "--pre-s", 0.1)
    assert "--pre-s is 0.1, but the model was trained with 0.25 s of rest: leave it out" in line


def test_a_push_into_the_wall_speaks_of_options_that_live_has(model):
    words = ("--source", "sim:rice?seed=3", "--speed", 20, "--speed-m-s", 0.8, "--model", model, "--n", 1)
    line = refused("live", *words, "--quiet")
    assert "into the wall" in line
    assert "a lower --speed-m-s is wanted" in line
    assert "--duration-s" not in line


def test_early_without_a_rule_is_told(model):
    words = ("--speed", 20, "--model", model, "--n", 1, "--quiet")
    out = ended_well("live", "--source", "sim:rice?seed=3", *words, "--early")
    assert "note: the model has no early rule" in out


def test_live_does_not_write_into_its_model(model):
    before = Path(model).read_bytes()
    line = refused("live", "--source", "sim:rice", "--model", model, "--json", model)
    assert f"belongs to {model}, which is read" in line
    assert Path(model).read_bytes() == before


def test_more_answers_than_a_replay_has_is_an_error(model, folder):
    words = ("--source", f"replay:{folder}?pause_s=0.5", "--speed", 20, "--model", model, "-q", "--n", 13)
    assert "the source came to its end" in refused("live", *words)


def test_nobody_pushes(model):
    words = ("--source", "sim:rice?seed=3", "--speed", 20, "--robot", "none", "--timeout-s", 1, "--n", 1)
    line = refused("live", *words, "--model", model, "--quiet")
    assert "nothing triggered within 1 s" in line


def test_ctrl_c_leaves_whole_files_only(tmp_path, heeding_interrupts):
    words = ("record", "--source", "sim:rice?seed=1", "--label", "rice", "--speed", "10", "--n", "500")
    _, error = interrupted(*words, "-o", str(tmp_path / "x"), after="1600 samples")
    assert re.fullmatch(ENDED, error), "the robot may stand between two pushes"
    assert len(gid.load(tmp_path / "x")) >= 2
    assert not list((tmp_path / "x").rglob(".*"))


def test_help_has_examples():
    for command in ("record", "live"):
        assert "Examples" in run(command, "--help").stdout
