"""Robots that need no library: people and callbacks."""

from __future__ import annotations

import io
import threading

import pytest

from granular_id._core import host_ns
from granular_id.live.robot import CallbackRobot, ManualRobot, Motion, Robot
from sink_cases import eventually


@pytest.fixture
def console():
    return io.StringIO()


def test_a_countdown_ends_with_the_word_to_push(console):
    robot = ManualRobot(countdown_s=0.2, console=console)
    assert isinstance(robot, Robot)
    assert robot.tcp_pose() is None
    before_ns = host_ns()
    motion = robot.move_line((1, 0, 0), 0.03, 0.05)
    assert isinstance(motion, Motion)
    assert motion.start_time_s is None
    assert before_ns + 0.2e9 <= motion.start_host_ns <= host_ns() + 0.2e9
    eventually(lambda: "push" in console.getvalue())
    assert host_ns() >= motion.start_host_ns
    assert console.getvalue().removeprefix("1 ...\n") == "push: 30 mm/s for 0.1 s\n"
    eventually(motion.finished)
    assert motion.report() == {"robot": "manual", "countdown_s": 0.2}
    robot.stop()
    assert "stop" not in console.getvalue(), "it was over"


def test_a_countdown_is_ended_by_stop_and_by_a_new_one(console):
    threads = threading.active_count()
    robot = ManualRobot(countdown_s=300, console=console)
    robot.stop()
    motion = robot.move_line((1, 0, 0), 0.03, 3)
    eventually(lambda: " ...\n" in console.getvalue())
    assert not motion.finished()
    robot.stop()
    assert motion.finished()
    assert console.getvalue().endswith(" ...\nstop\n")
    brief = ManualRobot(countdown_s=0.1, console=console)
    for _ in range(3):
        brief.move_line((1, 0, 0), 0.03, 3)
    eventually(lambda: threading.active_count() <= threads)
    assert console.getvalue().count("push") == 1


def test_a_callback_moves_in_a_thread_until_it_returns():
    calls, release = [], threading.Event()

    def move(direction, speed_m_s, duration_s):
        calls.append((direction, speed_m_s, duration_s))
        release.wait(20)

    robot = CallbackRobot(move, lambda: calls.append("stop"), pose=lambda: [1, 2, 3, 0, 0, 0], name="gantry")
    assert isinstance(robot, Robot)
    assert robot.tcp_pose() == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    motion = robot.move_line([0, 0, 4], 0.02, 0.01)
    eventually(lambda: calls == [((0.0, 0.0, 1.0), 0.02, 0.01)])
    assert not motion.finished(), "the function has not returned"
    release.set()
    eventually(motion.finished)
    assert motion.error is None
    report = {"robot": "gantry", "direction": [0.0, 0.0, 1.0], "speed_m_s": 0.02, "duration_s": 0.01}
    assert motion.report() == report
    robot.stop()
    assert calls[-1] == "stop"


@pytest.mark.parametrize(
    ("move", "error", "match"),
    [
        ((None, 0.03, 3), TypeError, "direction must hold three numbers, got None"),
        (("xyz", 0.03, 3), TypeError, "direction must hold three numbers, got 'xyz'"),
        (((1, 0), 0.03, 3), ValueError, "direction must hold three numbers, not all 0"),
        (((0, 0, 0), 0.03, 3), ValueError, "direction must hold three numbers, not all 0"),
        (((1, 0, 0), 30, 3), ValueError, "speed_m_s must be at most 1, got 30: metres per second"),
        (((1, 0, 0), 0, 3), ValueError, "speed_m_s"),
        (((1, 0, 0), 0.03, 0), ValueError, "duration_s"),
    ],
)
def test_moves_that_are_refused(move, error, match):
    calls = []
    with pytest.raises(error, match=match):
        CallbackRobot(lambda *_: calls.append("move"), lambda: None).move_line(*move)
    assert calls == []


@pytest.mark.parametrize(
    ("make", "error", "name"),
    [
        (lambda: ManualRobot(-1), ValueError, "countdown_s"),
        (lambda: CallbackRobot(1, print), TypeError, "move"),
        (lambda: CallbackRobot(print, None), TypeError, "stop"),
        (lambda: CallbackRobot(print, print, 3), TypeError, "pose"),
    ],
)
def test_robots_that_cannot_be_made(make, error, name):
    with pytest.raises(error, match=f"^{name} must"):
        make()


def test_a_motion_that_was_stopped_never_begins():
    """The command is given in a thread: where the stop comes first, nothing moves after it."""
    calls = []
    robot = CallbackRobot(lambda *_: calls.append("move"), lambda: calls.append("stop"))
    held = robot.move_line((1, 0, 0), 0.03, 60)
    eventually(lambda: not held._thread.is_alive())
    motion = type(held)(60, {}, lambda: calls.append("late"))
    robot._motion = motion
    robot.stop()
    motion.begin()
    eventually(motion.finished)
    assert calls == ["move", "stop"]


def test_a_command_that_crosses_with_the_stop_is_stopped_after_all():
    calls, under_way, stopped = [], threading.Event(), threading.Event()

    def move(*_):
        under_way.set()
        stopped.wait(20)  # the command is still on its way when the stop arrives ...
        calls.append("moves")

    def stop():
        calls.append("stop")
        stopped.set()

    robot = CallbackRobot(move, stop)
    robot.move_line((1, 0, 0), 0.03, 60)
    assert under_way.wait(20)
    robot.stop()
    eventually(lambda: "moves" in calls)
    assert calls.count("stop") == 2


def test_a_callback_that_returns_at_once_moves_on_until_it_is_stopped_or_has_failed():
    robot = CallbackRobot(lambda *_: None, lambda: None)
    motion = robot.move_line((1, 0, 0), 0.03, 60)
    assert not motion.finished()
    robot.stop()
    eventually(motion.finished)
    assert robot.tcp_pose() is None

    failed = CallbackRobot(lambda *_: 1 / 0, lambda: None).move_line((1, 0, 0), 0.03, 60)
    eventually(failed.finished)
    assert failed.error == "ZeroDivisionError: division by zero"
