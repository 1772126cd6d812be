"""The command line as a process: exit codes, what is imported, missing extras, Ctrl-C, the progress bar."""

import os
import re
import signal
import subprocess
import time
from contextlib import suppress
from unittest.mock import Mock

import pytest

from cli_cases import run, saved, started
from effort import cases
from granular_id import save
from granular_id._text import install
from granular_id.synthetic import synthesize

pytestmark = pytest.mark.usefixtures("heeding_interrupts")

RUN = """
import sys
from granular_id.cli import main

given = sys.argv[1:]

def run(*words):
    sys.argv = ["granular-id", *words]
    try:
        main()
    except SystemExit as end:
        print("exit", end.code)
"""


def process(code, *words):
    running = started(*words, code=RUN + code)
    out, errors = running.communicate(timeout=60)
    assert running.returncode == 0, errors
    return out, errors


def test_help_and_refusals_wait_for_nothing_heavy(model):
    code = (
        "for command in ('', 'train', 'identify', 'model'): run(*command.split(), '--help')\n"
        "run('model', *given)\n"
        "for rest in ('train absent -o m', 'explain absent oat rice', 'confidence absent'): run(*rest.split())\n"
        "print('heavy', sorted({'sklearn', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    out, errors = process(code, model)
    assert re.findall(r"^exit \d+", out, re.M) == ["exit 0"] * 5 + ["exit 2"] * 3
    for words in (
        "evaluate",
        "granular-id train",
        "granular-id identify",
        "candidates: hold the right material",
    ):
        assert words in out
    assert errors == "error: absent: no such file or folder\n" * 3
    assert out.endswith("heavy []\n")


def test_missing_extra_is_named():
    code = (
        "for name in ('typer', 'rich'):\n"
        "    sys.modules[name] = None\n"
        "    run('demo')\n"
        "    del sys.modules[name]\n"
        "sys.modules['matplotlib'] = None\n"
        "run('evaluate', '.', '--report', 'r.html')\n"
    )
    out, errors = process(code)
    needed = [f"granular-id: the command line needs {name}: {install('app')}" for name in ("typer", "rich")]
    assert out.splitlines() == [*(f"exit {line}" for line in needed), "exit 1"], (
        "Python prints it, and ends in 1"
    )
    errors = " ".join(errors.replace("\\\n", "").split())
    assert errors == f"error: a report needs matplotlib: {install('app')}"


def test_ctrl_c_leaves_no_file(tmp_path):
    save(synthesize(n_per_class=20, duration_s=1.0), tmp_path / "x.npz")
    with started("train", tmp_path / "x.npz", "-o", tmp_path / "m", stdout=subprocess.DEVNULL) as running:
        try:
            assert running.stderr.readline().startswith("220 recordings, 11 materials")
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=30)
        finally:
            running.kill()
    assert running.returncode == 130
    assert errors.splitlines()[-1] == "Interrupted: no file was left half-written."
    assert [path.name for path in tmp_path.iterdir()] == ["x.npz"]


def test_demo_that_is_interrupted_leaves_no_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.synthetic.synthesize", Mock(side_effect=KeyboardInterrupt))
    assert run("demo", "-o", tmp_path / "new" / "demo").exit_code == 130
    assert list(tmp_path.iterdir()) == []


READING = """
import os, signal, sys, threading, time
from granular_id.io import load

load(sys.argv[1])
begun_s = time.monotonic()
load(sys.argv[1])
took_s = time.monotonic() - begun_s
n = int(sys.argv[2])
for k in range(n):
    try:
        threading.Timer(took_s * k / n, os.kill, (os.getpid(), signal.SIGINT)).start()
        data = load(sys.argv[1], on_error="skip")
        time.sleep(took_s)
    except KeyboardInterrupt:
        continue
    print(data.history[-1])
"""


def test_ctrl_c_while_files_are_read_makes_none_bad(tmp_path):
    data = synthesize(["rice"], n_per_class=8)
    running = started(saved(data, tmp_path / "pushes"), cases(20), code=READING)
    assert running.communicate(timeout=60) == ("", "")
    assert running.returncode == 0


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX systems")
@pytest.mark.parametrize(
    "typed",
    [
        "--help",
        "identify {model} {folder} -q",
        "live --source sim:rice?speed=20 --model {model} --robot none",
    ],
)
def test_output_that_nobody_reads_ends_quietly(folder, model, typed):
    read, write = os.pipe()
    os.close(read)
    running = started(*typed.format(folder=folder, model=model).split(), stdout=write)
    os.close(write)
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 141
    assert "error" not in errors
    assert "Ended" not in errors


# -- on a terminal


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo-terminal")
def test_progress_bar_leaves_nothing_behind(folder, tmp_path):
    screen, theirs = os.openpty()
    words = ("archive", "add", tmp_path / "fleet", folder)
    running, shown = started(*words, module="granular_id.cli", stderr=theirs), ""
    os.close(theirs)
    with suppress(OSError):  # how Linux says that the other end was closed
        while more := os.read(screen, 65536):
            shown += more.decode(errors="replace")
    out, _ = running.communicate(timeout=60)
    os.close(screen)
    assert running.returncode == 0
    assert "recordings: uniform" in shown
    assert shown.rstrip().endswith(("\x1b[2K", "\x1b[?25h"))
    assert "recordings: uniform" not in out
    assert out.startswith("added 30 recordings")


class ClosesItself:
    """As archives do: a Ctrl-C that arrives meanwhile is dropped by Python."""

    def __del__(self):
        raise KeyboardInterrupt


def test_ctrl_c_during_a_deletion_is_not_lost(monkeypatch):
    def load(*_, **__):
        ClosesItself()
        for _ in range(1000):
            time.sleep(0.01)

    monkeypatch.setattr("granular_id.io.load", load)
    ended = run("evaluate", ".")
    assert ended.exit_code == 130
    assert ended.stderr == "Interrupted: no file was left half-written.\n"
