"""Robots that need no library: a person, and whatever the user's own functions move."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TextIO

from granular_id._checks import finite_number
from granular_id.live.clock import host_ns
from granular_id.live.robot import Pose, TimedMotion, checked_move

__all__ = ["CallbackRobot", "ManualRobot"]

_POLL_S = 0.02

_CROSSING_S = 0.1
"""How long a command may take to reach a robot that was stopped meanwhile."""


class ManualRobot:
    """A person who pushes the tool, told when.

    The motion is taken to begin at the end of the countdown. People are some tenths of a second off, so the
    recorder waits for the force instead, unless another trigger is asked for.

    Parameters
    ----------
    countdown_s : float, default 3
        From the command to "push"; a line is printed for each second.
    console : text file, optional
        Where to print; default: standard error.
    """

    def __init__(self, countdown_s: float = 3.0, console: TextIO | None = None) -> None:
        self._countdown_s = finite_number("countdown_s", countdown_s, least=0)
        self._console = console
        self._motion: TimedMotion | None = None
        self._stopped = threading.Event()

    def tcp_pose(self) -> Pose | None:
        """Return None: nobody knows."""
        return None

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> TimedMotion:
        """Count down; says how fast, and for how long."""
        _, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        start_ns = host_ns() + round(1e9 * self._countdown_s)
        self._motion = TimedMotion(
            start_ns, duration_s, {"robot": "manual", "countdown_s": self._countdown_s}
        )
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
        said = None
        while (left_s := 1e-9 * (start_ns - host_ns())) > 0:
            second = int(left_s) + 1
            if second != said:
                self._say(f"{second} ...")
                said = second
            if stopped.wait(min(left_s, _POLL_S)):
                return
        if not stopped.is_set():
            self._say(words)

    def _say(self, line: str) -> None:
        with suppress(OSError):  # stop() ends the motion also where the terminal is gone
            print(line, file=sys.stderr if self._console is None else self._console, flush=True)


class CallbackMotion(TimedMotion):
    """A motion that runs in the user's function, from `begin` on."""

    def __init__(self, duration_s: float, report: Mapping[str, Any], work: Callable[[], object]) -> None:
        super().__init__(host_ns(), duration_s, report)
        self._lock = threading.Lock()
        self._cancelled = False
        self._calls_work = False
        self._thread = threading.Thread(target=self._work, args=(work,), daemon=True)

    def begin(self) -> None:
        """Call the function in a thread of its own."""
        self._thread.start()

    def finished(self) -> bool:
        """Tell whether the function has returned and the time is over."""
        return not self._thread.is_alive() and (self.error is not None or super().finished())

    def cancel(self) -> None:
        """Take the motion for ended now; a function that was not called yet never will be."""
        with self._lock:
            self._cancelled = True
        super().cancel()

    def is_called(self, wait_s: float = 0.0) -> bool:
        """Tell whether the function is being called; wait so long at most for it to return."""
        if self._calls_work and wait_s:
            self._thread.join(wait_s)
        return self._calls_work

    def _work(self, work: Callable[[], object]) -> None:
        with self._lock:
            if self._cancelled:
                return
            self._calls_work = True
        try:
            work()
        except Exception as error:  # whatever the user's robot raises: `error` tells it
            self.error = f"{type(error).__name__}: {error}"
        finally:
            self._calls_work = False


class CallbackRobot:
    """Any robot that two functions can move.

    Parameters
    ----------
    move : callable
        Called as ``move(direction, speed_m_s, duration_s)`` in a thread of its own; it may return at once or when
        the motion is over. What it raises fails the capture.
    stop : callable
        Called as ``stop()`` on every failure and on Ctrl-C, also when nothing moves; a second time where `move` has
        not returned, because a command may cross with the first one.
    pose : callable, optional
        Returns x y z (m) rx ry rz (rad).
    name : str, default "callback"
        Stored with the recordings.

    Examples
    --------
    >>> from granular_id.live.robots import CallbackRobot
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
    ) -> None:
        for role, function in (
            ("move", move),
            ("stop", stop),
            *([("pose", pose)] if pose is not None else []),
        ):
            if not callable(function):
                raise TypeError(f"{role} must be callable, got {type(function).__name__}")
        self._move, self._stop, self._pose, self._name = move, stop, pose, name
        self._motion: CallbackMotion | None = None

    def tcp_pose(self) -> Pose | None:
        """Return what the user's function says."""
        if self._pose is None:
            return None
        x, y, z, rx, ry, rz = (float(value) for value in self._pose())
        return (x, y, z, rx, ry, rz)

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> CallbackMotion:
        """Call the user's function in a thread; the motion begins now."""
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        report = {
            "robot": self._name,
            "direction": list(ahead),
            "speed_m_s": speed_m_s,
            "duration_s": duration_s,
        }
        motion = CallbackMotion(duration_s, report, lambda: self._move(ahead, speed_m_s, duration_s))
        self._motion = motion  # before it begins: whatever comes in between, `stop` finds it
        motion.begin()
        return motion

    def stop(self) -> None:
        """Call the user's function; no motion that was commanded before begins after it."""
        motion = self._motion
        if motion is not None:
            motion.cancel()
        may_cross = motion is not None and motion.is_called()
        self._stop()
        if motion is not None and may_cross:
            motion.is_called(_CROSSING_S)
            self._stop()
