"""`record` and `live`, end to end with a simulated sensor."""

import json
import re
import shlex
import signal
from contextlib import nullcontext
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

import granular_id as gid
from cli_cases import ended_well, refused, run
from granular_id.live import CallbackRobot, LiveIdentifier, Recorder, SourceInfo, ThreadedSource

SIM = "sim:?seed=4&speed=20"


@pytest.fixture(scope="module")
def pushes(tmp_path_factory):
    """12 pushes that `record` has written."""
    folder = tmp_path_factory.mktemp("live") / "pushes"
    words = ("--label", "rice,fine sugar", "--n", 6, "--duration-s", 1, "--session", "Monday")
    out = ended_well("record", "--source", SIM, *words, "-o", folder)
    assert "fine sugar 6/6: 500 samples, mean fx +" in out
    assert "wrote 12 SYNTHETIC recordings of 2 materials into" in out
    assert "session 'Monday'" in out
    return folder


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Of four sessions: one alone does not show what others do, and those are refused."""
    path = tmp_path_factory.mktemp("model") / "m.safetensors"
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=24, sessions=4, duration_s=1.5, seed=4)
    days = gid.save(data.align(trigger="recorded", lead_s=0.1, n_samples=400), path.parent / "days.npz")
    ended_well("train", days, "-o", path, "--space", "hfmh", "--quiet")
    return path


@pytest.fixture
def live(model):
    """The words of a session that names pushes of rice."""
    return ("live", "--source", "sim:rice?seed=4&speed=20", "--model", model)


def test_label_that_the_source_contradicts_is_warned_of(tmp_path):
    words = ("--source", "sim:rice?seed=2&speed=20", "--duration-s", 1, "--n", 2)
    out = ended_well("record", *words, "--label", "salt", "-o", tmp_path / "x")
    assert out.count("recorded as 'salt', but simulated rice says that it was 'rice'") == 1
    assert "wrote 2 SYNTHETIC recordings of 1 material into" in out


# -- answers


def test_live_names_pushes_and_says_how_many_were_right(model, tmp_path):
    rows = tmp_path / "answers.jsonl"
    words = ("--source", "sim:rice,fine_sugar?seed=3&speed=20", "--model", model)
    out = ended_well("live", *words, "--n", 3, "--quiet", "--json", rows)
    assert out.count("final: margin") == 3
    assert "SYNTHETIC: 3 answers, " in out
    answers = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    known = [(one["synthetic"], one["decision"]["final"], one["failure"]) for one in answers]
    assert known == [(True, True, None)] * 3
    assert {one["truth"] for one in answers} <= {"rice", "fine sugar"}


def test_live_prints_what_changes_and_offers_a_page(live):
    out = ended_well(*live, "--n", 1, "--view", "--no-browser")
    assert re.search(r"^SYNTHETIC +[\d.]+ s +Done: rice \(final, after 0\.80 s", out, re.MULTILINE)
    assert "page: http://127.0.0.1:" in out
    assert "note: the model has no early rule" in ended_well(*live, "--n", 1, "--quiet", "--early")


def test_replay_that_is_over_ends_calmly(model, pushes):
    words = ("live", "--source", f"replay:{pushes}?pause_s=0.5&speed=20", "--model", model)
    out = ended_well(*words)
    assert "Ended: the source came to its end" in out
    assert out.endswith("SYNTHETIC: 12 answers, 12 right (100 %)\n")
    assert "Failed" not in out
    nothing = refused(*words, "--trigger", "force", "--threshold-n", 1e6)
    assert "the source came to its end before any push was answered" in nothing
    assert "the source came to its end" in refused(*words, "-q", "--n", 13)


# -- ends


def after_two(call):
    """Return a method that Ctrl-C ends at its third call."""
    calls = count()

    def interrupted(*args, **more):
        if next(calls) == 2:
            signal.raise_signal(signal.SIGINT)
        return call(*args, **more)

    return interrupted


def test_ctrl_c_ends_sessions_with_what_there_is(live, tmp_path, monkeypatch, heeding_interrupts):
    monkeypatch.setattr(Recorder, "record", after_two(Recorder.record))
    monkeypatch.setattr(LiveIdentifier, "_push", after_two(LiveIdentifier._push))
    record = ("record", "--source", SIM, "--label", "rice", "--duration-s", 0.5, "-o", tmp_path / "x")
    for words, last in (
        (record, "wrote 2 SYNTHETIC recordings of 1 material"),
        ((*live, "--n", 3), "SYNTHETIC: 2 answers, "),
    ):
        ended = run(*words)
        assert ended.exit_code == 130
        assert ended.stderr == "Ended by SIGINT: no file was left half-written.\n"
        assert last in ended.stdout


# -- refusals


class Real(ThreadedSource):
    """A sensor that is no simulation, part of an arm that cannot go back."""

    def __init__(self, _url):
        super().__init__(SourceInfo("a bench", 500, device_clock=True))

    def deliver(self, buffer, stopping):
        buffer.push(np.zeros(6), 0.0)
        stopping.wait()

    def robot(self):
        return CallbackRobot(pytest.fail, lambda: None)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--label rice,salt --n 1", "--label names 2 materials, somebody must change them"),
        ("--label rice --n 2 --robot source", "--n 2: somebody must bring the robot back after each push"),
    ],
)
def test_record_without_a_terminal_refuses_to_need_hands(tmp_path, monkeypatch, words, message):
    point = SimpleNamespace(name="bench", load=lambda: Real)
    monkeypatch.setattr("granular_id.live.source.entry_points", lambda group: [point])
    line = refused("record", "--source", "bench://here", *shlex.split(words), "-o", tmp_path / "x")
    assert message in line
    assert "standard input is no terminal" in line
    assert not list(tmp_path.iterdir())


def test_options_of_a_push_reach_the_identifier(live, monkeypatch):
    given = {}

    def identifier(*_, **more):
        given.update(more)
        raise gid.GranularIdError("seen")

    monkeypatch.setattr("granular_id.live.LiveIdentifier", identifier)
    words = "--max-gap 3 --pre-s 0.2 --max-force-n 9 --max-torque-n-m 2 --timeout-s 5 --speed-m-s 0.02"
    assert refused(*live, *words.split(), "--direction", "0,1,0", "--accept", "frame") == "error: seen"
    wanted = {"max_gap": 3, "pre_s": 0.2, "max_force_n": 9, "max_torque_n_m": 2, "timeout_s": 5}
    wanted |= {"speed_m_s": 0.02, "direction": (0, 1, 0), "accept": ["frame"], "early": False}
    assert wanted.items() <= given.items()


def test_extra_of_a_source_is_named(model):
    done = run("live", "--source", "ur://1.2.3.4", "--model", model)
    assert done.exit_code == 1
    assert "needs granular-id-contrib, which is not installed: pip install ./contrib" in " ".join(
        done.stderr.split()
    )


# -- answers that go on, of models of other sensors

IMU = ("wx", "wy", "wz", "ax", "ay", "az")


def drive(path, k, seconds, seed):
    """A CSV file of an IMU, with one column more than its axes."""
    rng = np.random.default_rng(seed)
    samples = rng.normal(0, 0.3 * (k + 1), (round(100 * seconds), 6))
    rows = [f"{i / 100:.2f},{','.join(f'{v:.5f}' for v in row)},12.1" for i, row in enumerate(samples)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([f"time,{','.join(IMU)},battery", *rows, ""]), encoding="utf-8")


@pytest.fixture(scope="module")
def grounds(tmp_path_factory):
    """A model of windows of drives, and the file of another drive."""
    place = tmp_path_factory.mktemp("grounds")
    for k, name in enumerate(("asphalt", "gravel")):
        for i in range(3):
            drive(place / "drives" / name / f"drive_{i}.csv", k, 5, 10 * k + i)
    drive(place / "long.csv", 1, 8, 99)
    words = ("--axes", ",".join(IMU), "--units", "rad/s,m/s2", "--window-s", 0.5)
    ended_well("data", "convert", place / "drives", place / "drives.npz", *words)
    ended_well("train", place / "drives.npz", "--space", "raw", "--quiet", "-o", place / "m.safetensors")
    return place / "m.safetensors", place / "long.csv"


def test_live_with_a_hop_answers_as_identify_does(grounds, tmp_path):
    model, file = grounds
    table = tmp_path / "a.csv"
    ended_well("identify", model, file, "--hop-s", 0.5, "--csv", table)
    labels = [row.split(",")[3] for row in table.read_text(encoding="utf-8").splitlines()[1:]]
    rows = tmp_path / "live.jsonl"
    words = ("--source", f"replay:{file}?speed=20", "--model", model, "--hop-s", 0.5, "--json", rows)
    out = ended_well("live", *words, "--quiet")
    answers = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    assert [one["decision"]["label"] for one in answers] == labels
    assert [one["time_s"] for one in answers][:2] == pytest.approx([0.49, 0.99])
    assert out.splitlines()[0].startswith("0.49 s: ")
    assert "16 answers" in out
    assert "Answering: " in ended_well("live", *words[:-2], "--n", 3)


# -- into archives


def test_live_keeps_each_push_with_its_answer(live, model, tmp_path):
    pytest.importorskip("pyarrow.parquet")
    rows = tmp_path / "rows.jsonl"
    out = ended_well(*live, "--n", 2, "--quiet", "--archive", tmp_path / "seen", "--json", rows)
    assert "stored 2 recordings in" in out
    message = [json.loads(line)["decision"] for line in rows.read_text(encoding="utf-8").splitlines()]
    data = gid.load(tmp_path / "seen")
    assert [one.meta["answer"]["label"] for one in data] == [one["label"] for one in message]
    assert [one.label for one in data] == ["rice"] * 2, "the truth, which a simulation knows"
    assert len({one.session for one in data}) == 1
    again = ended_well("identify", model, tmp_path / "seen", "--quiet")
    assert all(one["label"] in line for line, one in zip(again.splitlines(), message, strict=True))


@pytest.mark.parametrize("option", ["--archive", "--json"])
def test_push_on_a_full_disk_is_answered(live, tmp_path, monkeypatch, option):
    def full(*_):
        raise OSError(28, "No space left on device", "seen")

    monkeypatch.setattr("granular_id.io.parquet.writing.Appender.append", full)
    monkeypatch.setattr("granular_id._files.whole_lines", lambda _: nullcontext(full))
    ended = run(*live, "--n", 2, "--quiet", option, tmp_path / "seen")
    assert ended.exit_code == 2
    assert ended.stdout.count("final: margin") == 1
    assert ("stored 0 recordings" in ended.stdout, "wrote" in ended.stdout) == (option == "--archive", False)
    assert ended.stderr == "error: seen: no space left on device\n"


def test_record_appends_to_an_archive(pushes, tmp_path):
    words = ("--source", SIM, "--label", "rice", "--n", 2, "--duration-s", 1)
    ended_well("record", *words, "-o", tmp_path / "new.parquet")
    assert "2 recordings" in ended_well("archive", "info", tmp_path / "new.parquet")
    ended_well("archive", "add", tmp_path / "fleet", pushes)
    ended_well("record", *words, "-o", tmp_path / "fleet")
    assert len(gid.load(tmp_path / "fleet")) == 14
    assert {path.suffix for path in tmp_path.rglob("*") if path.is_file()} == {".parquet"}


def test_session_without_a_push_leaves_no_empty_folder(live, tmp_path):
    words = ("--robot", "none", "--timeout-s", 1, "--n", 1, "--quiet", "--archive", tmp_path / "new" / "seen")
    assert "nothing triggered within 1 s" in refused(*live, *words)
    assert not list(tmp_path.iterdir())
