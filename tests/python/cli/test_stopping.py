"""A robot never moves on after its program: whatever ends it, `stop()` is called first."""

import os
import signal
import subprocess

import pytest

import granular_id as gid

if not hasattr(signal, "SIGHUP"):
    pytest.skip("processes are ended by signals of POSIX systems", allow_module_level=True)
pytestmark = pytest.mark.usefixtures("heeding_interrupts")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "m.safetensors"
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=3.2)
    gid.Identifier.fit(data, "hfmh", estimate=False).save(path)
    return path


@pytest.fixture
def commands(tmp_path, model):
    return {
        "record": ("record", "--source", "bench://here", "--label", "rice", "-o", tmp_path / "data"),
        "live": ("live", "--source", "bench://here", "--model", model, "--pre-s", "0.25", "-q"),
    }


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
