"""What starts a recording: the robot's motion, a force, or somebody's word."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import positive_number
from granular_id._core import GranularIdError, host_ns
from granular_id.live.robot import Motion
from granular_id.live.rows import Rows

__all__ = ["ForceTrigger", "ManualTrigger", "MotionTrigger", "TimeTrigger", "Trigger"]

_SLACK_S = 1e-7
"""Device time in seconds is rounded, and a moment that is a sample's own must not become the next one's."""

_CREEP = 0.2
"""Share of the threshold by which the force may creep at rest: more, and the level is that of another moment."""


class Trigger(Protocol):
    """Finds the first row of what is to be recorded; each row is shown once, in order.

    It may only look at the rows themselves, never at how they are cut into pieces: the same stream then gives the
    same recording however it is read.
    """

    name: str

    def arm(self, _rest: Rows, /) -> str | None:
        """Take note of the rows at rest before the motion; return why they are no rest, None where they are."""
        return None

    def index(self, rows: Rows) -> int | None:
        """Return which of these rows is the first of the motion; what fires before `arm` fails the push."""

    def refuse(self, _row: Rows, /) -> str | None:
        """Return why the row that `index` found begins no push; the rest then begins anew."""
        return None


class ManualTrigger(Trigger):
    """Fires when `fire` is called: at the first row that comes in afterwards.

    Examples
    --------
    >>> from granular_id.live import ManualTrigger
    >>> trigger = ManualTrigger()
    >>> trigger.fire()                     # from any thread
    """

    name = "manual"

    def __init__(self) -> None:
        self._fired_ns: int | None = None

    def fire(self) -> None:
        """Begin with the first row that comes in from now on."""
        self._fired_ns = host_ns()

    def index(self, rows: Rows) -> int | None:
        """Find the first row that was due at or after that moment."""
        return None if self._fired_ns is None else _first(rows.host_ns >= self._fired_ns)


class TimeTrigger(Trigger):
    """Fires once at each of some device times, ascending: those of recordings that are played again."""

    name = "time"

    def __init__(self, times_s: ArrayLike) -> None:
        self._times_s = np.asarray(times_s, dtype=np.float64)
        self._seen_s: float | None = None

    def index(self, rows: Rows) -> int | None:
        """Find the first row at or after the first moment that no row shown before has passed."""
        seen_s = rows.time_s[0] - 2 * _SLACK_S if self._seen_s is None else self._seen_s
        self._seen_s = float(rows.time_s[-1])
        ahead = self._times_s[np.searchsorted(self._times_s, seen_s + _SLACK_S, side="right") :]
        return _first(rows.time_s >= ahead[0] - _SLACK_S) if len(ahead) else None


class MotionTrigger(Trigger):
    """Fires where the robot's motion begins.

    Where the robot shares the sensor's clock, that is the first row at or after the start in device time. Otherwise
    it is the first row that was due at or after the start by the host's clock. When rows with device time were due,
    those that came soonest tell: late ones do not move the start. Rows without are due when they come in.
    A delay that all rows share is unknown: the start is early by it.

    Parameters
    ----------
    rest_n : float, default 2
        The force must rest before the robot moves: it may differ by so much from its mean, N. An arm that holds its
        place shakes more than a tool that stands; a tool that swings, or that somebody holds, moves by more.
    """

    name = "motion"

    def __init__(self, rest_n: float = 2.0) -> None:
        self.rest_n = positive_number("rest_n", rest_n)
        self._motion: Motion | None = None

    def follow(self, motion: Motion) -> None:
        """Take the start of this motion."""
        self._motion = motion

    def arm(self, rest: Rows, /) -> str | None:
        """Look whether the force rests; sensors without forces cannot tell."""
        return _unrest(rest, self.rest_n) if rest.wrench.shape[1] == 6 and len(rest) else None

    def index(self, rows: Rows) -> int | None:
        """Find the first row of the motion."""
        if self._motion is None:
            return None
        if self._motion.start_time_s is not None:
            return _first(rows.time_s >= self._motion.start_time_s - _SLACK_S)
        return _first(rows.host_ns >= self._motion.start_host_ns)


class ForceTrigger(Trigger):
    """Fires where the force leaves its level at rest.

    Parameters
    ----------
    threshold_n : float, default 0.5
        Length of the change of (fx, fy, fz) against the mean of the rows at rest, N. The default is ten times the
        noise of a Mini45 and a small part of what grains exert (sugar, the softest of the paper's materials in
        this respect, reaches it within the first millimetres). Raise it where the arm shakes.

    Attributes
    ----------
    direction : ndarray of shape (3,), or None
        Change of the force in the first push of a session. A change against it is no push: the tool is taken out of
        the material, or let go.

    Notes
    -----
    The force needs a moment to grow: the trigger is late by some 10 to 50 ms, differently for each material. Train
    and identify with the same kind of trigger.
    """

    name = "force"

    def __init__(self, threshold_n: float = 0.5) -> None:
        self.threshold_n = positive_number("threshold_n", threshold_n)
        self.direction: NDArray[np.float64] | None = None
        self._level: NDArray[np.float64] | None = None

    def arm(self, rest: Rows, /) -> str | None:
        """Take the mean of these rows for the level at rest, unless the force moves among them already.

        Raises
        ------
        ValueError
            There are none: without rows before the trigger the level is unknown.
        """
        if not len(rest):
            raise GranularIdError("a ForceTrigger needs rows at rest: pre_s must be above 0")
        unrest = _unrest(rest, self.threshold_n)
        if unrest is None:
            self._level = rest.wrench[:, :3].mean(axis=0)
        return unrest

    def index(self, rows: Rows) -> int | None:
        """Find the first row whose force differs from the level by more than the threshold."""
        if self._level is None:
            return None
        change = np.linalg.norm(rows.wrench[:, :3] - self._level, axis=1)
        return _first(change > self.threshold_n)

    def refuse(self, row: Rows, /) -> str | None:
        """Refuse a change against the direction of the first push."""
        if self.direction is None or self._level is None:
            return None
        if float((row.wrench[0, :3] - self._level) @ self.direction) >= 0:
            return None
        self._level = None
        return "the force changed against the direction of the first push, as when the tool is pulled out"


def _unrest(rest: Rows, threshold_n: float) -> str | None:
    """Return by how much the force moves among some rows, None where it rests."""
    force = rest.wrench[:, :3]
    half = len(force) // 2
    crept_n = float(np.linalg.norm(force[half:].mean(axis=0) - force[: half or 1].mean(axis=0)))
    moved_n = float(np.linalg.norm(force - force.mean(axis=0), axis=1).max())
    if moved_n > threshold_n or crept_n > _CREEP * threshold_n:
        return f"the force moved by {max(moved_n, crept_n):.2g} N before the motion"
    return None


def _first(where: NDArray[np.bool_]) -> int | None:
    found = np.flatnonzero(where)
    return int(found[0]) if len(found) else None
