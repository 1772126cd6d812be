"""A robot never moves on after its program: whatever ends it, `stop()` is called first."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import granular_id as gid
from granular_id.cli.interrupts import stopping_the_robot

if not hasattr(signal, "SIGHUP"):
    pytest.skip("processes are ended by signals of POSIX systems", allow_module_level=True)
pytestmark = pytest.mark.usefixtures("heeding_interrupts")

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
SCRIPT = Path(__file__).with_name("signals_work.py")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "m.safetensors"
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=3.2)
    gid.Identifier.fit(data, "hfmh", estimate=False).save(path)
    return path


class Session:
    """A session in a process of its own; `notes` is what its robot has noted."""

    def __init__(self, folder, how, *words, **options):
        self.folder, self.notes = folder / "data", []
        read, write = os.pipe()
        piped = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        words = map(str, [sys.executable, SCRIPT, write, how, *(words or (self.folder,))])
        self.process = subprocess.Popen([*words], text=True, pass_fds=[write], **(piped | options))
        os.close(write)
        self.lines = os.fdopen(read, encoding="utf-8")
        self.limit = threading.Timer(60, self.process.kill)  # a test that waits for a note in vain fails
        self.limit.start()

    def wait_for(self, what):
        for line in self.lines:
            self.notes.append(line.rstrip())
            if self.notes[-1] == what:
                return
        raise AssertionError(self.process.communicate())

    def signal(self, number):
        """Send a signal while the tool moves, and wait for stop()."""
        self.wait_for("moves")
        self.process.send_signal(number)
        self.wait_for("stop")

    def ended(self):
        """Wait for its end; return the exit code and what it wrote about errors."""
        _, err = self.process.communicate(timeout=60)
        self.notes += self.lines.read().splitlines()
        assert "stop" in self.notes
        assert self.notes.count("moves") == 1
        assert not [path for path in self.folder.rglob("*") if path.is_file()]
        return self.process.returncode, err


@pytest.fixture
def begin(tmp_path):
    """Begin a session; it does not outlive the test."""
    sessions = []

    def one(how, *words, **options):
        sessions.append(Session(tmp_path, how, *words, **options))
        return sessions[-1]

    yield one
    for session in sessions:
        session.limit.cancel()
        session.process.kill()
        session.process.communicate()
        session.lines.close()


@pytest.fixture
def commands(tmp_path, model):
    return {
        "record": ("record", "--source", "sim:?seed=1", "--label", "rice", "-o", tmp_path / "data"),
        "live": ("live", "--source", "sim:rice?seed=1", "--model", model, "--pre-s", "0.25", "-q"),
    }


def code_of(number):
    """Exit code of a program in Python that a signal has ended."""
    return -number if number == signal.SIGINT else 128 + number


@pytest.mark.parametrize(
    ("how", "number"),
    [
        *(("plain", number) for number in SIGNALS),
        ("nested", signal.SIGHUP),
        ("hangs once", signal.SIGTERM),  # stop() does not return
    ],
)
def test_a_signal_stops_the_robot_and_ends_the_program(begin, how, number):
    session = begin(how)
    session.signal(number)
    assert session.ended()[0] == code_of(number)


@pytest.mark.parametrize(("how", "code"), [("thread", 143), ("deaf", 0)])
def test_nothing_moves_after_a_signal_where_others_go_on(begin, how, code):
    session = begin(how)
    session.signal(signal.SIGTERM)
    assert session.ended()[0] == code
    assert session.notes[-1] == "interrupted"


def test_stop_is_called_though_the_main_thread_hears_nothing(begin):
    session = begin("held up")
    session.signal(signal.SIGTERM)
    assert "goes on" not in session.notes
    session.process.stdin.write("!")
    assert session.ended()[0] == 143


def test_a_second_signal_ends_a_program_whose_driver_hangs(begin):
    session = begin("hangs")
    session.signal(signal.SIGTERM)
    session.wait_for("stop")  # again, while the first call has not returned
    session.process.send_signal(signal.SIGTERM)
    assert session.ended()[0] == 143


def test_the_end_of_the_interpreter_stops_what_a_thread_moves(begin):
    assert begin("exit").ended()[0] == 0


@pytest.mark.parametrize(
    ("command", "number"), [("record", signal.SIGTERM), ("live", signal.SIGINT), ("live", signal.SIGHUP)]
)
def test_a_command_stops_the_robot_and_says_so(begin, commands, command, number):
    session = begin("plain", *commands[command])
    session.signal(number)
    ended = f"Ended by {number.name}: the robot is stopped, no file was left half-written.\n"
    assert session.ended() == (128 + number, ended)


def test_a_robot_that_cannot_be_stopped_is_not_reported_stopped(begin, commands):
    session = begin("broken", *commands["record"], "--duration-s", 0.5)
    session.signal(signal.SIGTERM)
    code, err = session.ended()
    assert code == 2
    assert "the robot could not be stopped: ConnectionError: the arm does not answer" in " ".join(err.split())
    assert "is stopped" not in err


def test_a_closed_terminal_stops_the_robot(begin, commands):
    master, slave = os.openpty()
    terminal = dict.fromkeys(("stdin", "stdout", "stderr"), slave)
    session = begin("plain", *commands["live"], **terminal, preexec_fn=_own)
    os.close(slave)
    session.wait_for("moves")
    os.close(master)
    assert session.ended()[0] == 129


def _own():
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def test_a_lost_connection_without_terminal_stops_the_robot(begin, commands):
    session = begin("plain", *commands["record"], stderr=subprocess.DEVNULL)
    session.wait_for("moves")
    session.process.stdout.close()  # what reads the output is gone; nobody sends a signal
    session.process.stdout = None
    assert session.ended()[0] == 141


@pytest.mark.parametrize("number", SIGNALS)
def test_no_robot_is_reported_where_none_moves(capsys, number):
    with pytest.raises(SystemExit) as ended, stopping_the_robot():
        signal.raise_signal(number)
    assert ended.value.code == 128 + number
    assert capsys.readouterr().err == f"Ended by {number.name}: no file was left half-written.\n"
