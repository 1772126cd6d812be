"""What a robot must be able to do: one straight push, and stop."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from granular_id._checks import argument_error, finite_number, positive_number
from granular_id.live.clock import host_ns

__all__ = ["Motion", "Pose", "Robot", "TimedMotion", "checked_move"]

MAX_SPEED_M_S = 1.0
"""Thirty times the paper's: what is faster is a speed in mm/s or cm/s, and would move an arm before anybody notices."""

Pose = tuple[float, float, float, float, float, float]
"""Position x y z (m) and rotation vector rx ry rz (rad) of the tool in the robot's base frame."""


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
        """Tell whether the robot stands again."""

    def report(self) -> Mapping[str, Any]:
        """Return what is worth keeping with the recording, JSON-like; complete once finished."""


@runtime_checkable
class Robot(Protocol):
    """Anything that pushes a tool. ``docs/live/sources.md`` shows how to write one in a few lines.

    Use one within `granular_id.live.stop_on_signals`: without it, SIGTERM (``kill``) and SIGHUP (a closed terminal) end
    the program before `stop` is called.
    """

    def tcp_pose(self) -> Pose | None:
        """Return where the tool is; None where the robot cannot tell."""

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
        """Stop as soon as it is safe.

        Called on every failure and on Ctrl-C, also when nothing moves; a second time, and from another thread, where a
        command may cross with the first call or the main thread is held up (`granular_id.live.stop_on_signals`).
        """


def checked_move(
    direction: Sequence[float], speed_m_s: float, duration_s: float
) -> tuple[tuple[float, float, float], float, float]:
    """Return a direction of length 1, speed and duration, or say what is wrong with them.

    Raises
    ------
    TypeError, ValueError
        Naming the argument.

    Examples
    --------
    >>> from granular_id.live.robot import checked_move
    >>> checked_move([0, 2, 0], 0.03, 3)
    ((0.0, 1.0, 0.0), 0.03, 3.0)
    """
    if isinstance(direction, str) or not isinstance(direction, Iterable):
        raise argument_error(TypeError, "direction", f"must hold three numbers, got {direction!r:.60}")
    parts = [finite_number("direction", part) for part in direction]
    length = math.hypot(*parts)
    if len(parts) != 3 or length == 0:
        raise argument_error(
            ValueError, "direction", f"must hold three numbers, not all 0, got {tuple(parts)!r:.60}"
        )
    speed_m_s, duration_s = positive_number("speed_m_s", speed_m_s), positive_number("duration_s", duration_s)
    if speed_m_s > MAX_SPEED_M_S:
        raise argument_error(
            ValueError,
            "speed_m_s",
            f"must be at most {MAX_SPEED_M_S:g}, got {speed_m_s:g}: metres per second, not millimetres",
        )
    x, y, z = (part / length for part in parts)
    return (x, y, z), speed_m_s, duration_s


class TimedMotion:
    """A motion of which only the commanded start and duration are known.

    Parameters
    ----------
    start_host_ns : int
        Start by the host's monotonic clock; may lie ahead.
    duration_s : float
    report : mapping, optional
        See `Motion.report`.
    """

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
