"""Universal Robots arms (e-Series, CB3) through ``ur-rtde``: the force at the tool, and straight pushes.

Not run on hardware. Written against ur-rtde 1.6: https://sdurobotics.gitlab.io/ur_rtde/
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from granular_id.live import Pose, SourceInfo, SourceUrl, ThreadedSource, WrenchSink, checked_move, host_ns
from granular_id_contrib import NOT_RUN, library

__all__ = ["URRobot", "URSource", "open_robot", "open_url"]

_PACKAGE = "ur-rtde"
_HOW = f"pip install {_PACKAGE}"

_PER_SAMPLE = 4
"""How often the controller is asked per sample: it only knows its newest one, and none may pass unseen."""

_AHEAD_M = 0.01
"""So far ahead of the last push's start may the next one begin: arms, and people who guide them, are not exact."""


class URSource(ThreadedSource):
    """The force that the arm measures or estimates at its tool.

    Parameters
    ----------
    host : str
        Address of the controller.
    rate_hz : float, default 500
        Of the e-Series; 125 for CB3.

    Notes
    -----
    e-Series arms have a sensor at the flange; CB3 arms estimate the force from motor currents, too coarse for
    grains. The controller takes the payload's weight off and refers the force to the base frame: set the payload,
    and push along a fixed direction. Time is the controller's own, and the robot of `robot()` knows it.
    """

    def __init__(self, host: str, rate_hz: float = 500.0) -> None:
        self._receive_module = library("rtde_receive", _HOW)
        self._host = host
        self._receive: Any = None
        super().__init__(
            SourceInfo(
                f"UR {host}",
                rate_hz,
                device_clock=True,
                frame="base frame of the robot, about the TCP",
                sign="as getActualTCPForce tells it",
                compensated=True,
                meta={"status": NOT_RUN, "driver": _PACKAGE},
            )
        )

    def start(self, buffer: WrenchSink) -> None:
        """Connect, and begin to write rows.

        Raises
        ------
        RuntimeError
            The controller does not answer, as ur-rtde says it.
        """
        self._receive = self._receive_module.RTDEReceiveInterface(self._host, self.info.rate_hz)
        super().start(buffer)

    def stop(self) -> None:
        """End the thread and the connection."""
        super().stop()
        if self._receive is not None:
            self._receive.disconnect()
            self._receive = None

    def robot(self) -> URRobot:
        """Connect to the arm itself, which shares this source's clock; nothing moves yet."""
        return URRobot(self._host, shares_clock=True)

    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Ask several times per period for the newest sample, and write what is new."""
        last_s: float | None = None
        pause_s = 1.0 / (_PER_SAMPLE * self.info.rate_hz)
        while not stopping.wait(pause_s):
            sample = self._newest()
            if sample is None or sample[0] == last_s:
                continue
            time_s, wrench = sample
            if last_s is not None and time_s < last_s:
                buffer.new_epoch()  # its controller was started anew
            last_s = time_s
            buffer.push(np.asarray(wrench, dtype=np.float64), time_s)

    def _newest(self) -> tuple[float, Any] | None:
        """Return device time (s) and wrench (6,) of the newest sample, both of one cycle; None where they are not."""
        receive = self._receive
        if not receive.isConnected():
            raise ConnectionError(f"the connection to {self._host} is lost")
        before_s = receive.getTimestamp()
        wrench = receive.getActualTCPForce()
        # Time and force are two calls: a packet may have come in between.
        return (before_s, wrench) if receive.getTimestamp() == before_s else None


class URMotion:
    """A motion that runs in the controller, which tells on request whether it has ended."""

    def __init__(self, control: Any, start_time_s: float | None, report: Mapping[str, Any]) -> None:
        self.start_time_s = start_time_s
        self.start_host_ns = host_ns()
        self.error: str | None = None
        self._control, self._report = control, report
        self._done = False

    def finished(self) -> bool:
        """Tell whether the controller has ended the motion; where it cannot be asked, the motion counts as going on."""
        if not self._done:
            try:
                self._done = not self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()
            except Exception as error:  # whatever the library raises
                self.error = f"{type(error).__name__}: {error}"
        return self._done

    def report(self) -> Mapping[str, Any]:
        """Return what was commanded."""
        return self._report


class URRobot:
    """A UR arm that pushes with ``moveL``.

    Parameters
    ----------
    host : str
        Address of the controller, in remote control.
    acceleration_m_s2 : float, default 1.2
        Of the ramps; ur-rtde's own default.
    shares_clock : bool, default False
        The samples are those of this controller (`URSource.robot` says so): the start of a motion is then the
        controller's time at the command, some cycles before the tool moves. A sensor of its own, as on most arms,
        has another clock, and the start is told by the host's.
    """

    def __init__(self, host: str, acceleration_m_s2: float = 1.2, *, shares_clock: bool = False) -> None:
        self._shares_clock = shares_clock
        self._place: tuple[float, ...] | None = None  # where the last push began
        if not 0 < acceleration_m_s2 < math.inf:
            raise ValueError(f"acceleration_m_s2 must be positive and finite, got {acceleration_m_s2!r}")
        self._acceleration = acceleration_m_s2
        self._receive = library("rtde_receive", _HOW).RTDEReceiveInterface(host)
        self._control = library("rtde_control", _HOW).RTDEControlInterface(host)

    def tcp_pose(self) -> Pose:
        """Return where the tool is, by the controller."""
        x, y, z, rx, ry, rz = (float(value) for value in self._receive.getActualTCPPose())
        return (x, y, z, rx, ry, rz)

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> URMotion:
        """Move straight on in the base frame.

        Raises
        ------
        RuntimeError
            The controller refuses the motion, or the tool was not brought back after the last one.
        """
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        pose = self.tcp_pose()
        self._check_start(pose, ahead)
        # Two ramps take the time of one: the tool covers speed * (duration - one ramp).
        length_m = speed_m_s * max(duration_s - speed_m_s / self._acceleration, 0.5 * duration_s)
        place = [begin + length_m * part for begin, part in zip(pose[:3], ahead, strict=True)]
        target = [*place, *pose[3:]]
        start_time_s = self._receive.getTimestamp() if self._shares_clock else None
        if not self._control.moveL(target, speed_m_s, self._acceleration, True):
            raise RuntimeError("the controller refused moveL: is the arm in remote control and released?")
        report = {"robot": "ur", "start": list(pose), "target": target, "speed_m_s": speed_m_s}
        return URMotion(self._control, start_time_s, report)

    def _check_start(self, pose: Pose, ahead: Sequence[float]) -> None:
        """Refuse a push that begins ahead of the last one: one after another they would end in the container's wall."""
        if self._place is not None:
            ahead_m = sum((n - b) * a for n, b, a in zip(pose[:3], self._place, ahead, strict=True))
            if ahead_m > _AHEAD_M:
                raise RuntimeError(
                    f"the tool stands {1e3 * ahead_m:.0f} mm ahead of where the last push began: bring it back first"
                )
            if ahead_m > 0:
                return  # many short pushes that were stopped must not creep either
        self._place = pose[:3]

    def stop(self) -> None:
        """Brake."""
        self._control.stopL(self._acceleration)

    def close(self) -> None:
        """End the script on the controller and both connections."""
        self._control.stopScript()
        self._control.disconnect()
        self._receive.disconnect()


def open_url(url: SourceUrl) -> URSource:
    """Make the source of ``ur://HOST``. Options: ``rate_hz``."""
    url.allow("rate_hz")
    return URSource(url.need_host(), url.number("rate_hz", 500.0))


def open_robot(url: SourceUrl) -> URRobot:
    """Connect to the arm of ``ur://HOST``."""
    url.allow()
    return URRobot(url.need_host())
