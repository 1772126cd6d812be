"""Universal Robots arms (e-Series, CB3) through ``ur-rtde``: the force at the tool, and straight pushes.

Not run on hardware. Written against ur-rtde 1.6: https://sdurobotics.gitlab.io/ur_rtde/
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from granular_id.live import Pose, SourceInfo, SourceUrl, WrenchSink, checked_move
from granular_id_contrib import NOT_RUN
from granular_id_contrib.polling import PolledMotion, PollingSource, PushStart, library

__all__ = ["URRobot", "URSource", "open_url"]

_PACKAGE = "ur-rtde"


class URSource(PollingSource):
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
        self._receive_module = library("rtde_receive", _PACKAGE)
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

    def newest(self) -> tuple[float, Any, int] | None:
        """Return the newest sample, all of one cycle."""
        receive = self._receive
        if not receive.isConnected():
            raise ConnectionError(f"the connection to {self._host} is lost")
        before_s = receive.getTimestamp()
        wrench = receive.getActualTCPForce()
        # Time and force are two calls: a packet may have come in between.
        return (before_s, wrench, 0) if receive.getTimestamp() == before_s else None


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
        self._start = PushStart()
        if not 0 < acceleration_m_s2 < math.inf:
            raise ValueError(f"acceleration_m_s2 must be positive and finite, got {acceleration_m_s2!r}")
        self._acceleration = acceleration_m_s2
        self._receive = library("rtde_receive", _PACKAGE).RTDEReceiveInterface(host)
        self._control = library("rtde_control", _PACKAGE).RTDEControlInterface(host)

    def tcp_pose(self) -> Pose:
        """Return where the tool is, by the controller."""
        x, y, z, rx, ry, rz = (float(value) for value in self._receive.getActualTCPPose())
        return (x, y, z, rx, ry, rz)

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> PolledMotion:
        """Move straight on in the base frame.

        Raises
        ------
        RuntimeError
            The controller refuses the motion, or the tool was not brought back after the last one.
        """
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        pose = self.tcp_pose()
        self._start.check(pose, ahead)
        # Two ramps take the time of one: the tool covers speed * (duration - one ramp).
        length_m = speed_m_s * max(duration_s - speed_m_s / self._acceleration, 0.5 * duration_s)
        place = [begin + length_m * part for begin, part in zip(pose[:3], ahead, strict=True)]
        target = [*place, *pose[3:]]
        start_time_s = self._receive.getTimestamp() if self._shares_clock else None
        if not self._control.moveL(target, speed_m_s, self._acceleration, True):
            raise RuntimeError("the controller refused moveL: is the arm in remote control and released?")
        report = {"robot": "ur", "start": list(pose), "target": target, "speed_m_s": speed_m_s}
        return PolledMotion(start_time_s, self._has_ended, report, error_ends=False)

    def stop(self) -> None:
        """Brake."""
        self._control.stopL(self._acceleration)

    def _has_ended(self) -> bool:
        return not self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()

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
