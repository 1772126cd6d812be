"""Universal Robots arms (e-Series, CB3) through ``ur-rtde``: the force at the tool, and straight pushes.

Not run on hardware. Written against ur-rtde 1.6: https://sdurobotics.gitlab.io/ur_rtde/
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from granular_id.live import SourceInfo, SourceUrl, ThreadedSource, WrenchBuffer, host_ns
from granular_id.live.priority import at_once
from granular_id.live.robot import checked_move
from granular_id_contrib import NOT_RUN, library

__all__ = ["URRobot", "URSource", "open_robot", "open_url"]

_PACKAGE = "ur-rtde"
_HOW = f"pip install {_PACKAGE}"

_PER_SAMPLE = 8
"""How often the controller is polled per sample: it only knows its newest one, and none may pass unseen."""

_RAMP_M_S2, _BRAKE_M_S2 = 1.2, 10.0
"""ur-rtde's own defaults."""

_CROSSING_S = 0.02
"""So long does a call of `stop` wait for another one to end; then that one hangs."""


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

    def start(self, buffer: WrenchBuffer) -> None:
        """Connect, and begin to write rows; a controller that does not answer raises what ur-rtde does."""
        self._receive = self._receive_module.RTDEReceiveInterface(self._host, self.info.rate_hz)
        super().start(buffer)

    def robot(self) -> URRobot:
        """Connect to the arm itself, which shares this source's clock; nothing moves yet."""
        return URRobot(self._host, shares_clock=True)

    def deliver(self, buffer: WrenchBuffer, stopping: threading.Event) -> None:
        """Ask several times per period for the newest sample, and write what is new."""
        last_s: float | None = None
        pause_s = 1.0 / (_PER_SAMPLE * self.info.rate_hz)
        try:
            with at_once():  # a thread that polls late has lost the sample
                while not stopping.is_set():
                    time.sleep(pause_s)
                    sample = self._newest()
                    if sample is None or sample[0] == last_s:
                        continue
                    if last_s is not None and sample[0] < last_s:
                        buffer.new_epoch()  # its controller was started anew
                    last_s, wrench = sample
                    buffer.push(wrench, last_s)
        finally:
            self._receive.disconnect()

    def _newest(self) -> tuple[float, Sequence[float]] | None:
        """Return device time (s) and wrench (6,) of the newest sample, both of one cycle; None where they are not."""
        receive = self._receive
        if not receive.isConnected():
            raise ConnectionError(f"the connection to {self._host} is lost")
        before_s = receive.getTimestamp()
        wrench = receive.getActualTCPForce()
        # Time and force are two calls: a packet may have come in between.
        return (before_s, wrench) if receive.getTimestamp() == before_s else None


class URMotion:
    """A motion that runs in the controller, until the next one is commanded."""

    error: str | None = None

    def __init__(self, control: Any, start_time_s: float | None, report: Mapping[str, Any]) -> None:
        self.start_time_s, self.start_host_ns = start_time_s, host_ns()
        self._control, self._report = control, report

    def finished(self) -> bool:
        """Return whether the motion has ended; what the library raises is for who asks."""
        return not self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()

    def report(self) -> Mapping[str, Any]:
        """Return what was commanded."""
        return self._report


class URRobot:
    """A UR arm that pushes with ``moveL``.

    Parameters
    ----------
    host : str
        Address of the controller, in remote control.
    shares_clock : bool, default False
        The samples are those of this controller (`URSource.robot` says so): the start of a motion is then the
        controller's time at the command, some cycles before the tool moves. A sensor of its own, as on most arms,
        has another clock, and the start is by the host's.
    """

    def __init__(self, host: str, *, shares_clock: bool = False) -> None:
        self._shares_clock = shares_clock
        self._begin: tuple[list[float], float] | None = None  # pose and speed of the last push
        self._stopping = threading.Lock()
        self._receive = library("rtde_receive", _HOW).RTDEReceiveInterface(host)
        self._control = library("rtde_control", _HOW).RTDEControlInterface(host)

    def tcp_pose(self) -> list[float]:
        """Return where the tool is, by the controller."""
        return [float(value) for value in self._receive.getActualTCPPose()]

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> URMotion:
        """Move straight on in the base frame; RuntimeError where the controller refuses."""
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        pose = self.tcp_pose()
        # Two ramps take the time of one: the tool covers speed * (duration - one ramp).
        length_m = speed_m_s * max(duration_s - speed_m_s / _RAMP_M_S2, 0.5 * duration_s)
        target = [begin + length_m * part for begin, part in zip(pose, (*ahead, 0, 0, 0), strict=True)]
        self._begin = pose, speed_m_s
        return self._moved(pose, target, speed_m_s)

    def move_back(self) -> URMotion | None:
        """Move to where the last push began, as fast as it was; None before the first push."""
        if self._begin is None:
            return None
        return self._moved(self.tcp_pose(), *self._begin)

    def _moved(self, pose: list[float], target: list[float], speed_m_s: float) -> URMotion:
        start_time_s = self._receive.getTimestamp() if self._shares_clock else None
        if not self._control.moveL(target, speed_m_s, _RAMP_M_S2, True):
            raise RuntimeError("the controller refused moveL: is the arm in remote control and released?")
        report = {"robot": "ur", "start": pose, "target": target, "speed_m_s": speed_m_s}
        return URMotion(self._control, start_time_s, report)

    def stop(self) -> None:
        """Brake; from any thread, and as often as it takes."""
        is_free = self._stopping.acquire(timeout=_CROSSING_S)
        try:
            self._control.stopL(_BRAKE_M_S2, True)
        finally:
            if is_free:
                self._stopping.release()

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
