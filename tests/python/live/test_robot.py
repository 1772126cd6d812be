"""Robots that need no library: people and callbacks."""

import queue
import threading
from unittest.mock import Mock

import pytest

from granular_id.live import CallbackRobot, ManualRobot, Motion, Robot, host_ns


class Lines(queue.SimpleQueue):
    """A console: `get` waits for a line."""

    def write(self, text):
        if text.strip():
            self.put(text)

    def flush(self):
        pass


def manual(monkeypatch, countdown_s):
    """A person who pushes when the line says so, and the lines on standard error."""
    lines = Lines()
    monkeypatch.setattr("sys.stderr", lines)
    monkeypatch.setattr("granular_id.live.robot._COUNTDOWN_S", countdown_s)
    return ManualRobot(), lines


def test_a_countdown_ends_with_the_word_to_push(monkeypatch):
    robot, lines = manual(monkeypatch, 0.05)
    motion = robot.move_line((1, 0, 0), 0.03, 0.1)
    assert [lines.get(timeout=20) for _ in range(2)] == ["1 ...", "push: 30 mm/s for 0.1 s"]
    assert host_ns() >= motion.start_host_ns
    assert motion.report() == {"robot": "manual", "countdown_s": 0.05}
    assert isinstance(robot, Robot)
    assert isinstance(motion, Motion)


def test_a_countdown_is_ended_by_stop_and_by_a_new_one(monkeypatch):
    robot, lines = manual(monkeypatch, 300)
    robot.stop()  # nothing to be stopped
    for _ in range(2):
        motion = robot.move_line((1, 0, 0), 0.03, 3)
        assert lines.get(timeout=20) == "300 ..."
    assert not motion.finished()
    robot.stop()
    assert motion.finished()
    robot.stop()
    assert (lines.get(timeout=20), lines.empty()) == ("stop", True)


class Gantry:
    """Two functions and the calls that they got; `move` returns when `may_return` is set."""

    def __init__(self, error=None):
        self.calls, self.begun, self.may_return, self.error = [], threading.Event(), threading.Event(), error
        self.robot = CallbackRobot(self.move, lambda: self.calls.append("stop"), name="gantry")

    def move(self, *what):
        self.calls.append(what)
        self.begun.set()
        assert self.may_return.wait(20)
        if self.error is not None:
            raise self.error

    def begin(self, duration_s):
        motion = self.robot.move_line([0, 0, 4], 0.02, duration_s)
        assert self.begun.wait(20)
        return motion

    def end(self, motion):
        self.may_return.set()
        motion._thread.join(20)


@pytest.mark.parametrize("error", [None, ZeroDivisionError("by zero")])
def test_a_callback_moves_until_it_returns_or_raises(error):
    gantry = Gantry(error)
    motion = gantry.begin(60 if error else 1e-9)
    assert not motion.finished()
    gantry.end(motion)
    assert motion.finished()
    assert motion.error == (error and "ZeroDivisionError: by zero")
    assert gantry.calls == [((0.0, 0.0, 1.0), 0.02, motion.report()["duration_s"])]
    assert motion.report()["direction"] == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("crosses", [False, True])
def test_a_callback_is_stopped_again_where_commands_cross(crosses):
    gantry = Gantry()
    motion = gantry.begin(60)
    if not crosses:
        gantry.end(motion)
        assert not motion.finished()
    gantry.robot.stop()
    gantry.end(motion)
    assert motion.finished()
    assert gantry.calls[1:] == ["stop"] * (1 + crosses)


def test_a_motion_that_was_stopped_before_it_began_never_begins(monkeypatch):
    gantry, start = Gantry(), threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda _: None)
    motion = gantry.robot.move_line([0, 0, 4], 0.02, 60)
    gantry.robot.stop()
    start(motion._thread)
    motion._thread.join(20)
    assert gantry.calls == ["stop"]


def test_a_robot_has_a_pose_and_a_way_back_where_it_can():
    whole = CallbackRobot(print, print, pose=lambda: [1, 2, 3], back=print)
    plain = CallbackRobot(print, print)
    assert whole.tcp_pose() == [1, 2, 3]
    assert isinstance(whole.move_back(), Motion)
    assert not hasattr(plain, "tcp_pose")
    assert not hasattr(plain, "move_back")


def test_a_stop_that_raises_ends_no_motion():
    stop = Mock(side_effect=[OSError("no connection"), None])
    robot = CallbackRobot(lambda *_: None, stop)
    motion = robot.move_line((1, 0, 0), 0.03, 60.0)
    motion._thread.join()
    with pytest.raises(OSError, match="no connection"):
        robot.stop()
    assert not motion.finished()
    robot.stop()
    assert motion.finished()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: CallbackRobot(print, None), "^stop must"),
        (lambda: move("xyz", 0.03, 3), "direction must hold three numbers, got 'xyz'"),
        (lambda: move((0, 0, 0), 0.03, 3), "direction must hold three numbers, not all 0"),
        (lambda: move((1, 0, 0), 30, 3), "speed_m_s must be at most 1, got 30: metres per second"),
        (lambda: move((1, 0, 0), 0.03, 0), "duration_s"),
    ],
)
def test_robots_and_moves_that_cannot_be_are_refused(make, match):
    with pytest.raises((TypeError, ValueError), match=match):
        make()


def move(*what):
    CallbackRobot(pytest.fail, print).move_line(*what)
