"""What moves the tool: the protocol of a robot, a person, and whatever two functions of the user's move."""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Protocol, runtime_checkable

from granular_id._checks import argument_error, finite_number, positive_number
from granular_id._core import GranularIdError, host_ns

__all__ = [
    "CallbackRobot",
    "ManualRobot",
    "Motion",
    "Robot",
    "TimedMotion",
    "checked_motion",
    "checked_move",
    "checked_robot",
    "goes_back",
]

MAX_SPEED_M_S = 1.0
"""Thirty times the paper's: what is faster is a speed in mm/s or cm/s, and would move an arm before anybody notices."""

_COUNTDOWN_S = 3.0


@runtime_checkable
class Motion(Protocol):
    """A motion that has been commanded."""

    @property
    def start_time_s(self) -> float | None:
        """When it begins in the sensor's device time; None where the robot does not know that clock."""

    @property
    def start_host_ns(self) -> int:
        """When it begins by the host's monotonic clock."""

    @property
    def error(self) -> str | None:
        """Why it failed, if it did."""

    def finished(self) -> bool:
        """Tell whether the robot stands again, at its end or stopped: nothing else begins before."""

    def report(self) -> Mapping[str, Any]:
        """Return what is worth keeping with the recording, JSON-like; complete once finished."""


@runtime_checkable
class Robot(Protocol):
    """Anything that pushes a tool.

    :doc:`/sensors/own_sensor` shows how to write one in a few lines.

    A robot may have two more methods, which are used where it has them:

    ``tcp_pose() -> sequence of 6 float, or None``
        Where the tool is: x y z (m) and a rotation vector rx ry rz (rad) in the base frame. A tool beyond its path is
        stopped, a push that begins elsewhere than the first one is refused, and a tool that stands is known to stand.
    ``move_back() -> Motion, or None``
        Begin to move to where the last push began and return at once; None to stay. It is called when a push is over,
        and before the next one where it was stopped on its way. After a limit or an error of the robot it is never
        called by itself.

    Everything but `stop` is called from a thread of the motion, one call after another, which no other thread waits
    for. Use a robot, and all that moves one, within `granular_id.live.stop_on_signals`: without it, SIGTERM (``kill``)
    and SIGHUP (a closed terminal) end the program before `stop` is called.
    """

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> Motion:
        """Begin to move straight on and return at once.

        Parameters
        ----------
        direction : sequence of 3 float
            In the robot's base frame; its length does not matter.
        speed_m_s : float
        duration_s : float
            Of the motion, with the ramps.
        """

    def stop(self) -> None:
        """Stop as soon as it is safe; the motion's `finished` says when it stands.

        Called again every 50 ms until the robot stands, each time from another thread, also while an earlier call has
        not returned, and while `move_line` has not.
        """


def checked_robot(robot: object) -> Robot:
    """Return a robot, or say what it lacks."""
    if not isinstance(robot, Robot):
        raise argument_error(TypeError, "robot", f"must have move_line and stop, got {type(robot).__name__}")
    return robot


def goes_back(robot: object) -> bool:
    """Whether a robot can go back to where its push began."""
    return hasattr(robot, "move_back")


def checked_motion(motion: object, method: str) -> Motion:
    """Return what a method of a robot has returned, or say what it lacks."""
    if not isinstance(motion, Motion):
        wanted = "a motion with start_time_s, start_host_ns, error, finished and report"
        raise TypeError(f"the robot's {method} must return {wanted}; got {type(motion).__name__}")
    return motion


def checked_move(
    direction: Sequence[float], speed_m_s: float, duration_s: float
) -> tuple[tuple[float, float, float], float, float]:
    """Return a direction of length 1, speed and duration, or say what is wrong with them, naming the argument."""
    if isinstance(direction, str) or not isinstance(direction, Iterable):
        raise argument_error(TypeError, "direction", f"must hold three numbers, got {direction!r:.60}")
    parts = [finite_number("direction", part) for part in direction]
    length = math.hypot(*parts)
    if len(parts) != 3 or length == 0:
        problem = f"must hold three numbers, not all 0, got {tuple(parts)!r:.60}"
        raise argument_error(GranularIdError, "direction", problem)
    speed_m_s, duration_s = positive_number("speed_m_s", speed_m_s), positive_number("duration_s", duration_s)
    if speed_m_s > MAX_SPEED_M_S:
        problem = f"must be at most {MAX_SPEED_M_S:g}, got {speed_m_s:g}: metres per second, not millimetres"
        raise argument_error(GranularIdError, "speed_m_s", problem)
    x, y, z = (part / length for part in parts)
    return (x, y, z), speed_m_s, duration_s


class TimedMotion:
    """A motion of which only the commanded start, by the host's clock, and the duration are known."""

    start_time_s: float | None = None

    def __init__(
        self, start_host_ns: int, duration_s: float, report: Mapping[str, Any] | None = None
    ) -> None:
        self.start_host_ns = start_host_ns
        self.error: str | None = None
        self._end_ns = start_host_ns + round(1e9 * duration_s)
        self._report = dict(report or {})

    def finished(self) -> bool:
        """Tell whether the time is over."""
        return host_ns() >= self._end_ns

    def report(self) -> Mapping[str, Any]:
        """Return what was commanded."""
        return self._report

    def cancel(self) -> None:
        """Take the motion for ended now."""
        self._end_ns = host_ns()


class ManualRobot:
    """A person who pushes the tool when prompted.

    A line on standard error counts each second down, and the motion is taken to begin after the last. People are some
    tenths of a second off, so the recorder waits for the force instead, unless another trigger is requested.
    """

    def __init__(self) -> None:
        self._motion: TimedMotion | None = None
        self._stopped = threading.Event()

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> TimedMotion:
        """Count down; says how fast, and for how long."""
        _, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        start_ns = host_ns() + round(1e9 * _COUNTDOWN_S)
        report = {"robot": "manual", "countdown_s": _COUNTDOWN_S}
        self._motion = TimedMotion(start_ns, duration_s, report)
        self._stopped.set()  # whoever pushed early needs no second "push"
        self._stopped = threading.Event()
        words = f"push: {speed_m_s * 1e3:g} mm/s for {duration_s:.1f} s"
        threading.Thread(target=self._count_down, args=(start_ns, words, self._stopped), daemon=True).start()
        return self._motion

    def stop(self) -> None:
        """End the countdown and the motion."""
        self._stopped.set()
        if self._motion is not None and not self._motion.finished():
            self._motion.cancel()
            self._say("stop")

    def _count_down(self, start_ns: int, words: str, stopped: threading.Event) -> None:
        for left in range(math.ceil(_COUNTDOWN_S), 0, -1):
            self._say(f"{left} ...")
            if stopped.wait(max(0.0, 1e-9 * (start_ns - host_ns()) - left + 1)):
                return
        self._say(words)

    def _say(self, line: str) -> None:
        with suppress(OSError):  # stop() ends the motion also where the terminal is gone
            print(line, file=sys.stderr, flush=True)


class CallbackMotion(TimedMotion):
    """A motion that runs in the user's function, in a thread of its own."""

    def __init__(
        self,
        duration_s: float,
        report: Mapping[str, Any],
        work: Callable[[], object],
        stop: Callable[[], object],
    ) -> None:
        super().__init__(host_ns(), duration_s, report)
        self._lock = threading.Lock()
        self._cancelled = False
        self._thread = threading.Thread(target=self._work, args=(work, stop), daemon=True)
        self._thread.start()

    def finished(self) -> bool:
        """Tell whether the function has returned and the time is over."""
        return not self._thread.is_alive() and (self.error is not None or super().finished())

    def forbid(self) -> None:
        """Say that a function that was not called yet never will be."""
        with self._lock:
            self._cancelled = True

    def _work(self, work: Callable[[], object], stop: Callable[[], object]) -> None:
        with self._lock:
            if self._cancelled:
                return
        try:
            work()
            if self._cancelled:
                stop()  # the command may have reached the robot after the call that was to stop it
        except Exception as error:  # whatever the user's robot raises: `error` tells it
            self.error = f"{type(error).__name__}: {error}"


class CallbackRobot:
    """Any robot that two functions can move.

    Parameters
    ----------
    move : callable
        Called as ``move(direction, speed_m_s, duration_s)`` in a thread of its own; it may return at once or when
        the motion is over. What it raises fails the push.
    stop : callable
        Called as ``stop()`` on every failure and signal, again every 50 ms until the robot stands, and once more where
        `move` returns after it, because the two commands may cross. The robot is taken to stand when both have
        returned.
    pose : callable, optional
        Returns x y z (m) rx ry rz (rad). See `Robot` for what it is used for.
    name : str, default "callback"
        Stored with the recordings.
    back : callable, optional
        Called as ``back()`` in a thread of its own when a push is over: it moves the tool to where the push began, and
        returns when it is there. Default: the tool stays.

    Examples
    --------
    >>> from granular_id.live import CallbackRobot
    >>> robot = CallbackRobot(move=lambda direction, speed_m_s, duration_s: None, stop=lambda: None)
    >>> robot.move_line((1, 0, 0), 0.03, 3.0).error is None
    True
    """

    def __init__(
        self,
        move: Callable[[tuple[float, float, float], float, float], object],
        stop: Callable[[], object],
        pose: Callable[[], Sequence[float]] | None = None,
        name: str = "callback",
        back: Callable[[], object] | None = None,
    ) -> None:
        for role, function in (("move", move), ("stop", stop), ("pose", pose), ("back", back)):
            if not (callable(function) or (function is None and role in ("pose", "back"))):
                raise TypeError(f"{role} must be callable, got {type(function).__name__}")
        self._move, self._stop, self._name = move, stop, name
        self._motion: CallbackMotion | None = None
        # A robot has these two only where it can.
        if pose is not None:
            self.tcp_pose = pose
        if back is not None:
            self.move_back = lambda: self._begin(0.0, {}, back)

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> CallbackMotion:
        """Call the user's function in a thread; the motion begins now."""
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        report = {
            "robot": self._name,
            "direction": list(ahead),
            "speed_m_s": speed_m_s,
            "duration_s": duration_s,
        }
        return self._begin(duration_s, report, lambda: self._move(ahead, speed_m_s, duration_s))

    def stop(self) -> None:
        """Call the user's function; no motion that was commanded before begins after it."""
        motion = self._motion
        if motion is not None:
            motion.forbid()
        self._stop()
        if motion is not None:  # it is not known to stand where that raised
            motion.cancel()

    def _begin(
        self, duration_s: float, report: Mapping[str, Any], work: Callable[[], object]
    ) -> CallbackMotion:
        self._motion = CallbackMotion(duration_s, report, work, self._stop)
        return self._motion
