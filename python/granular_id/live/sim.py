"""A simulated sensor and the robot in front of it: everything works without hardware, and says that it is synthetic.

The samples come from `granular_id.synthetic`; nothing they show is evidence about real materials.
"""

from __future__ import annotations

import math
import secrets
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import positive_number, sampling_rate, whole_number
from granular_id.live.clock import host_ns
from granular_id.live.robot import Pose, checked_move
from granular_id.live.sim_faults import Fault, FaultPlan
from granular_id.live.sim_world import PlannedPush, SimWorld
from granular_id.live.source import SourceInfo, WrenchSink
from granular_id.live.source_thread import ThreadedSource
from granular_id.live.source_url import SourceUrl
from granular_id.recording import SampleFlag
from granular_id.synthetic import (
    FRAME,
    PAPER_MATERIALS,
    SIGN,
    Material,
    Nuisance,
    Rig,
    Sensor,
    resolve_materials,
)

__all__ = ["SimMotion", "SimRobot", "SimSource", "open_url"]

UNKNOWN = "unknown"
"""Name of the source that draws its materials."""

_PERIOD_S = 0.004
"""How often samples are handed over, seconds of the host: two at a time at 500 Hz, as packets come."""

_LONGEST_S = 1.0
"""Samples handed over at once at most, device seconds, after the computer was suspended."""


class SimSource(ThreadedSource):
    """A simulated force-torque sensor above a bed of grains.

    Parameters
    ----------
    materials : str, Material, or sequence of these
        What lies under the tool; names are those of `PAPER_MATERIALS`. With several, or with ``"unknown"`` (all
        of them), each push meets one drawn by chance, and `truth` tells which.
    rate_hz : float, default 500
    speed : float, default 1
        Device seconds per second: 20 makes 20 recordings in the time of one.
    seed : int, optional
        Same seed, same samples of each push. Default: another one each time, told in ``info.meta["seed"]``.
    session : int, default 0
        Set-up of bed and sensor; the same seed and session is the same set-up.
    rig, nuisance, sensor : optional
        As in `synthesize`.

    Examples
    --------
    >>> from granular_id.live.sim import SimSource
    >>> SimSource("rice", seed=1).info.name
    'simulated rice'
    """

    def __init__(
        self,
        materials: str | Material | Sequence[str | Material],
        *,
        rate_hz: float = 500.0,
        speed: float = 1.0,
        seed: int | None = None,
        session: int = 0,
        rig: Rig | None = None,
        nuisance: Nuisance | None = None,
        sensor: Sensor | None = None,
    ) -> None:
        unknown = materials == UNKNOWN
        chosen = resolve_materials(PAPER_MATERIALS if unknown else materials)
        unknown = unknown or len(chosen) > 1
        rate_hz, speed = sampling_rate("rate_hz", rate_hz), positive_number("speed", speed)
        seed = secrets.randbits(48) if seed is None else whole_number("seed", seed, least=0)
        session = whole_number("session", session, least=0)
        self.world = SimWorld(
            chosen, rate_hz, seed, session=session, unknown=unknown, rig=rig, nuisance=nuisance, sensor=sensor
        )
        super().__init__(
            SourceInfo(
                f"simulated {UNKNOWN if unknown else chosen[0].name}",
                rate_hz,
                device_clock=True,
                frame=FRAME,
                sign=SIGN,
                compensated=True,
                full_scale=self.world.sensor.full_scale,
                synthetic=True,
                speed=speed,
                meta={"seed": seed, "session": session},
            )
        )
        self._start_ns: int | None = None
        self._faults = FaultPlan()
        self._zero_tick = 0

    @property
    def truth(self) -> str | None:
        """What the latest push went through; None before the first."""
        return self.world.truth

    def robot(self) -> SimRobot:
        """Return the robot that moves the tool of this sensor."""
        return SimRobot(self)

    def inject(self, fault: Fault) -> None:
        """Let something go wrong, see `Fault`."""
        self._faults.add(fault, self.world.tick if fault.after_s is None else None)

    def push(self, speed_m_s: float, duration_s: float) -> PlannedPush:
        """Command a push; what `SimRobot` does."""
        return self.world.plan(
            speed_m_s, duration_s, lambda push: self._faults.follow(push.start_tick, self.info.rate_hz)
        )

    def device_time_s(self, tick: float) -> float:
        """Return the sensor's time of a sample."""
        return (tick - self._zero_tick) / self.info.rate_hz

    def host_ns_at(self, tick: float) -> int:
        """Return the host's time of a sample."""
        if self._start_ns is None:
            raise RuntimeError(f"{self.info.name} is not started")
        return self._start_ns + round(1e9 * tick / (self.info.rate_hz * self.info.speed))

    def start(self, buffer: WrenchSink) -> None:
        """Begin to write rows into `buffer`; time 0 is now."""
        if self._start_ns is None:
            self._start_ns = host_ns()
        super().start(buffer)

    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Write samples as they fall due."""
        period_s = max(_PERIOD_S, 1.0 / (self.info.rate_hz * self.info.speed))
        longest = math.ceil(_LONGEST_S * self.info.rate_hz)
        while not stopping.wait(period_s):
            due = int(1e-9 * (host_ns() - self.host_ns_at(0)) * self.info.speed * self.info.rate_hz)
            while self.world.tick < due and not stopping.is_set():
                self._write(buffer, min(due - self.world.tick, longest), stopping)

    def _write(self, buffer: WrenchSink, n: int, stopping: threading.Event) -> None:
        """Write the next samples: `n` of them, or as many as come before the next fault, or that fault."""
        first = self.world.tick
        due = self._faults.take(before=first + n)
        if due is not None and due[0] > first:
            self._faults.add(due[1], due[0])
            n = min(n, math.ceil(due[0]) - first)
        elif due is not None:
            self._go_wrong(buffer, due[1], stopping)
            return
        wrench, flags = self.world.advance(n)
        buffer.push_block(wrench, self._times_s(first, n), flags=flags)

    def _go_wrong(self, buffer: WrenchSink, fault: Fault, stopping: threading.Event) -> None:
        first = self.world.tick
        if fault.kind == "gap":
            self.world.advance(fault.rows)
        elif fault.kind == "saturation":
            wrench, flags = self.world.advance(fault.rows)
            wrench[:, 0] = self.world.sensor.full_scale[0]
            flags |= np.uint8(SampleFlag.SATURATED)
            buffer.push_block(wrench, self._times_s(first, fault.rows), flags=flags)
        elif fault.kind == "restart":
            buffer.new_epoch()
            self._zero_tick = first
        elif fault.kind == "stall":
            stopping.wait(fault.stall_s)
        else:
            raise ConnectionError("the simulated sensor was told to die")

    def _times_s(self, first: int, n: int) -> NDArray[np.float64]:
        return (np.arange(first, first + n) - self._zero_tick) / self.info.rate_hz


class SimMotion:
    """A push of the simulated robot; it knows the sensor's clock."""

    error: str | None = None

    def __init__(self, source: SimSource, planned: PlannedPush) -> None:
        self._source = source
        self._planned = planned
        self.start_time_s: float | None = source.device_time_s(planned.start_tick)
        self.start_host_ns = source.host_ns_at(planned.start_tick)

    def finished(self) -> bool:
        """Tell whether the tool stands again."""
        return self._source.world.tick >= self._planned.end_tick

    def report(self) -> Mapping[str, Any]:
        """Return what was drawn for this push, the material too."""
        return self._planned.meta

    def cancel(self) -> None:
        """Stop the tool where it is."""
        self._source.world.cut(self._planned)


class SimRobot:
    """The robot before a simulated sensor; both share one clock.

    Parameters
    ----------
    source : SimSource

    Notes
    -----
    The bed is pushed along the sensor's x whatever the direction: it has no other side. The tool is back at its
    start as soon as a push has ended, the bed filled and levelled anew.
    """

    def __init__(self, source: SimSource) -> None:
        self._source = source
        self._motion: SimMotion | None = None

    def tcp_pose(self) -> Pose:
        """Return the start of the next push."""
        return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> SimMotion:
        """Push, about half a second of device time from now.

        Raises
        ------
        RuntimeError
            The source is not started, or another push is under way.
        ValueError, TypeError
            An argument is wrong, or the push would run into the wall.
        """
        _, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        self._source.host_ns_at(0)  # refuses where no clock runs yet
        self._motion = SimMotion(self._source, self._source.push(speed_m_s, duration_s))
        return self._motion

    def stop(self) -> None:
        """Stop the push that is under way."""
        if self._motion is not None:
            self._motion.cancel()


def open_url(url: SourceUrl) -> SimSource:
    """Make the source of ``sim:MATERIAL``, ``sim:MATERIAL,MATERIAL`` or ``sim:unknown``.

    Options: ``speed``, ``seed``, ``session``, ``rate_hz``, ``materials`` (for ``sim:unknown``: which there are).
    """
    url.allow("speed", "seed", "session", "rate_hz", "materials")
    asked = [name.strip().replace("_", " ") for name in url.path.split(",")]
    among = url.words("materials")
    if among is not None and asked != [UNKNOWN]:
        raise ValueError(f"option materials of url {url.text!r} is for sim:{UNKNOWN} only")
    names = asked if among is None else [name.replace("_", " ") for name in among]
    try:
        return SimSource(
            UNKNOWN if names == [UNKNOWN] else names,
            rate_hz=url.number("rate_hz", 500.0),
            speed=url.number("speed", 1.0),
            seed=url.whole("seed", None),
            session=url.whole("session", 0) or 0,
        )
    except ValueError as error:
        raise ValueError(f"url {url.text!r}: {error}") from error
