"""The command line as a process: exit codes, missing extras, Ctrl-C, the progress bar."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

from cli_cases import SMALL, make, saved
from granular_id.cli.errors import guarded

pytestmark = pytest.mark.usefixtures("heeding_interrupts")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(make(), tmp_path_factory.mktemp("cli") / "uniform")


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


def interrupted_after(first_line, module, *words, told=""):
    """Start a command, press Ctrl-C after its first line, and check that it ends as promised."""
    running = subprocess.Popen(
        [sys.executable, "-m", module, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    try:
        assert running.stdout.readline().startswith(first_line)
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130
    assert errors.removeprefix(told) == (
        "Interrupted: no file was left half-written. A run with --checkpoint FOLDER can be continued.\n"
    )


def test_ctrl_c_exits_with_130_and_leaves_no_half_file(folder, tmp_path):
    words = ("evaluate", folder, "--train", 6, "--test", 3, "--partitions", 4000)
    outputs = ("--json", tmp_path / "r.json", "--csv", tmp_path / "p.csv")
    interrupted_after("30 recordings, 3 materials", "granular_id.cli", *words, *outputs)
    assert list(Path(tmp_path).iterdir()) == []


def test_ctrl_c_in_the_demo_leaves_no_empty_folder(tmp_path):
    words = ("demo", "-o", tmp_path / "new" / "demo")
    interrupted_after("SYNTHETIC data", "granular_id", *words, told="simulating 682 pushes\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("started", ["module", "script"])
def test_the_line_to_repeat_names_how_the_program_was_started(folder, tmp_path, started):
    words = [str(word) for word in ("evaluate", folder, *SMALL, "--spaces", "hfmh", "--protocol", "paper")]
    script = tmp_path / "granular-id"
    script.write_text("from granular_id.cli import main\nmain()\n", encoding="utf-8")
    way = [str(script)] if started == "script" else ["-m", "granular_id"]
    done = subprocess.run(
        [sys.executable, *way, *words],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=60,
        check=True,
    )
    name = str(script) if started == "script" else "python -m granular_id"
    assert done.stdout.endswith(f"repeat with: {name} {shlex.join(words)}\n")


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
    words = [str(word) for word in ("evaluate", folder, *SMALL, "--partitions", 400, "--spaces", "hfmh")]
    with Terminal(words) as terminal:  # so many that the bar is drawn anew in every stage
        terminal.read_until("a text that never comes")
        out, _ = terminal.running.communicate(timeout=60)
        assert terminal.running.returncode == 0
    assert "hfmh: paper, partition" in terminal.shown
    assert terminal.shown.rstrip().endswith(("\x1b[2K", "\x1b[?25h"))
    assert "partition 4" not in out
    assert f"repeat with: python -m granular_id.cli {shlex.join(words)}\n" in out


@needs_terminal
def test_the_demo_shows_that_it_simulates(tmp_path):
    with Terminal(["demo", "--quick", "-o", str(tmp_path)]) as terminal:
        terminal.read_until("simulating 132 pushes")
        assert "simulating 132 pushes" in terminal.shown


def test_the_demo_tells_its_steps_in_lines_without_a_terminal(tmp_path):
    running = subprocess.Popen(
        [sys.executable, "-m", "granular_id.cli", "demo", "--quick", "-o", str(tmp_path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    try:
        assert running.stderr.readline() == "simulating 132 pushes\n"
        assert re.fullmatch(r"1 of \d+: .+\n", running.stderr.readline())
    finally:
        running.kill()
        running.communicate()


@needs_terminal
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_amid_the_partitions_ends_the_bar_too(folder, tmp_path, threads):
    words = ("evaluate", folder, "--train", 6, "--test", 3, "--partitions", 4000, "--threads", threads)
    outputs = ("--csv", tmp_path / "p.csv", "--checkpoint", tmp_path / "kept")
    with Terminal([str(word) for word in (*words, *outputs)]) as terminal:
        terminal.read_until("paper, partition")
        assert "paper, partition" in terminal.shown
        terminal.running.send_signal(signal.SIGINT)
        terminal.read_until("a text that never comes")
        terminal.running.communicate(timeout=30)
        assert terminal.running.returncode == 130
    assert "Traceback" not in terminal.shown
    last = terminal.shown.rstrip().splitlines()[-1]
    assert re.search(r"Interrupted: \d+ finished partitions are kept in .*; the same command goes on", last)
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


class ClosesItself:
    """As archives do: a Ctrl-C that arrives meanwhile is dropped by Python."""

    def __del__(self):
        raise KeyboardInterrupt


def test_ctrl_c_during_a_deletion_is_not_lost(capsys):
    @guarded
    def command():
        ClosesItself()
        for _ in range(1000):
            time.sleep(0.01)

    with pytest.raises(typer.Exit) as end:
        command()
    assert end.value.exit_code == 130
    assert capsys.readouterr().err == "Interrupted: no file was left half-written.\n"
