"""A robot never moves on after its program: whatever ends it, `stop()` is called first."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
import typer

import granular_id as gid
from granular_id.cli.interrupts import stopping_the_robot
from granular_id.live import ForceTrigger, opened, stop_on_signals, stopping
from granular_id.live.drive import capture_from, drive

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
    """A session in a process of its own; `told` is what its robot has noted."""

    def __init__(self, folder, what, *words, **options):
        self.folder, self.log = folder / "data", folder / "log"
        words = words or (self.folder,)
        self.process = subprocess.Popen(
            [sys.executable, SCRIPT, self.log, what, *map(str, words)],
            stdout=options.pop("stdout", subprocess.PIPE),
            stderr=options.pop("stderr", subprocess.PIPE),
            text=True,
            **options,
        )

    @property
    def noted(self):
        lines = (line.split(" ", 1) for line in self.log.read_text("utf-8").splitlines())
        return [(int(stamp), what) for stamp, what in lines]

    @property
    def told(self):
        return [what for _, what in self.noted]

    def wait_for(self, what):
        while not (self.log.exists() and what in self.told):
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.005)

    def end(self, *signals):
        """Send signals while the robot moves; return the exit code and what was said."""
        self.wait_for("moving")
        self.signalled_ns = time.monotonic_ns()
        for number in signals:
            self.process.send_signal(number)
            time.sleep(0.1)
        out, err = self.process.communicate(timeout=60)
        assert "stop" in self.told
        assert not [path for path in self.folder.rglob("*") if path.is_file()]
        return self.process.returncode, out, err


def command(what, folder, model):
    if what == "record":
        return ("record", "--source", "sim:?seed=1", "--label", "rice", "-o", folder / "data")
    return ("live", "--source", "sim:rice?seed=1", "--model", model, "--pre-s", "0.25", "-q")


# A process each takes seconds: every way to end meets every kind of program once, not each with each.
@pytest.mark.parametrize(
    ("what", "of", "number"),
    [
        ("command", "record", signal.SIGTERM),
        ("command", "live", signal.SIGINT),
        ("command", "live", signal.SIGHUP),
        ("blocked", "record", signal.SIGTERM),  # the driver holds the main thread
        ("blocked", None, signal.SIGTERM),
        ("api", None, signal.SIGINT),
        ("thread", None, signal.SIGTERM),
        ("nested", None, signal.SIGHUP),
        ("deaf", None, signal.SIGINT),
    ],
)
def test_whatever_ends_a_program_stops_its_robot_within_half_a_second(tmp_path, model, what, of, number):
    for k in range(3):  # in time once at least, on a machine that is busy otherwise
        folder = tmp_path / str(k)
        folder.mkdir()
        session = Session(folder, what, *(command(of, folder, model) if of else ()))
        code, _, err = session.end(number)
        if of:
            assert code == 128 + number
            assert err == f"Ended by {number.name}: the robot is stopped, no file was left half-written.\n"
        else:
            assert code == (-number if number == signal.SIGINT else 128 + number)
        if what == "blocked":
            after = session.told.index("driver returns")
            assert session.told.index("stop") < after
            assert session.told.index("stop", after), "and again: commands may cross"
        called_ns = next(stamp for stamp, told in session.noted if told == "stop begins")
        if called_ns - session.signalled_ns < 0.5e9:
            return
    pytest.fail("stop() was called too late three times")


@pytest.mark.parametrize("number", SIGNALS)
def test_where_nothing_moves_no_robot_is_said_to_be_stopped(capsys, number):
    def session():
        with stopping_the_robot(), opened("sim:rice?seed=1") as stream:
            live = drive(stream, capture_from(stream, ForceTrigger(), n_samples=200))
            with closing(live):
                next(live)
                signal.raise_signal(number)

    with pytest.raises(typer.Exit) as ended:
        session()
    assert ended.value.exit_code == 128 + number
    assert capsys.readouterr().err == f"Ended by {number.name}: no file was left half-written.\n"


@pytest.mark.parametrize(
    ("what", "number"),
    [("during", signal.SIGINT), ("between", signal.SIGTERM), ("leaving", signal.SIGINT)],
)
def test_nothing_moves_again_after_a_signal(tmp_path, model, what, number):
    ready = "provisional answer" if what == "during" else "answer"
    session = Session(tmp_path, what, model)
    session.wait_for(ready)
    assert session.end(number)[0] == (-number if number == signal.SIGINT else 128 + number)
    assert session.told.count("moving") == 1
    assert session.told.count("answer") == (what != "during"), "what was stopped is no answer"
    assert session.told[-1] == "interrupted", session.told


@pytest.mark.parametrize("numbers", [(signal.SIGINT,) * 3, (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)])
def test_further_signals_do_not_cut_stop_short(tmp_path, numbers):
    session = Session(tmp_path, "slow")
    session.end(*numbers)
    assert session.told == ["moving", "stop begins", "stop"]


def test_a_robot_that_cannot_be_stopped_is_not_said_to_be(tmp_path, model):
    code, _, err = Session(tmp_path, "broken", *command("record", tmp_path, model)).end(signal.SIGTERM)
    assert code == 2
    assert "the robot could not be stopped: ConnectionError: the arm does not answer" in err
    assert "is stopped" not in err


def test_a_closed_terminal(tmp_path, model):
    master, slave = os.openpty()
    words = command("live", tmp_path, model)
    session = Session(
        tmp_path, "command", *words[:-1], stdin=slave, stdout=slave, stderr=slave, preexec_fn=_own
    )
    os.close(slave)
    session.wait_for("moving")
    os.close(master)
    assert session.end()[0] == 129


def test_a_connection_without_a_terminal_that_ends(tmp_path, model):
    session = Session(tmp_path, "command", *command("record", tmp_path, model), stderr=subprocess.DEVNULL)
    session.wait_for("moving")
    session.process.stdout.close()  # what reads the output is gone; nobody sends a signal
    assert session.process.wait(60) == 129
    assert session.told[-1] == "stop"
    assert session.told.count("moving") == 1


def _own():
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def test_the_end_of_the_interpreter_stops_what_a_thread_would_leave_moving(tmp_path):
    session = Session(tmp_path, "exit")
    assert session.end()[0] == 0


def test_what_is_ignored_stays_ignored_and_handlers_come_back():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with stop_on_signals():
            with stop_on_signals(), pytest.raises(SystemExit) as ended:
                signal.raise_signal(signal.SIGTERM)
            assert ended.value.code == 143
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before[signal.SIGHUP])
    assert {number: signal.getsignal(number) for number in SIGNALS} == before
    assert signal.set_wakeup_fd(-1) == -1


def test_signals_of_a_forked_child_do_not_stop_the_parents_robot():
    class Arm:
        n_stops = 0

        def stop(self):
            self.n_stops += 1

    arm = Arm()
    moving = stopping.InMotion(arm)
    moving.begin()
    with stop_on_signals(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside threads
        child = os.fork()
        if not child:
            stopping._at_exit()
            os._exit(arm.n_stops or signal.set_wakeup_fd(-1) != -1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    stopping._at_exit()
    assert arm.n_stops == 1, "it is the parent's"
    moving.over(stands=True)


def test_other_threads_are_refused():
    def enter():
        with stop_on_signals():
            raise AssertionError

    with ThreadPoolExecutor(1) as pool, pytest.raises(RuntimeError, match="main thread"):
        pool.submit(enter).result()
