"""A simulated sensor and the robot in front of it: everything works without hardware, and says that it is synthetic.

The samples come from `granular_id.synthetic`; nothing they show is evidence about real materials.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import sampling_rate, whole_number
from granular_id._core import WrenchBuffer
from granular_id.live.robot import checked_move
from granular_id.live.source import Pace, SourceInfo, SourceUrl, ThreadedSource
from granular_id.recording import SampleFlag
from granular_id.synthetic import (
    FRAME,
    PAPER_MATERIALS,
    SIGN,
    Conditions,
    Material,
    Nuisance,
    Rig,
    Sensor,
    draw_push,
    push_meta,
    random_stream,
    resolve_materials,
    simulate_push,
)

__all__ = ["SimRobot", "SimSource", "open_url"]

UNKNOWN = "unknown"
"""Name of the source that draws its materials."""

LEAD_S = 0.5
"""From a command to the motion: a robot plans that long, and a recording's rest fits into it."""

# First element of the key of each random stream: what was simulated live is none of what `synthesize` makes.
_LIVE, _REST, _CHOICE, _PHASE = 10, 0, 1, 2
# Pushes through unknown materials are others than those through named ones, under the same seed too.
_FIRST_UNKNOWN = 1_000_000


@dataclass
class PlannedPush:
    """A push with its samples from the command on; the motion begins between two of them."""

    first_tick: int
    start_tick: float
    end_tick: int
    wrench: NDArray[np.float64]
    meta: dict[str, Any]


class SimWorld:
    """Materials under a tool, sample by sample: those of push k follow from the seed alone, whenever it begins."""

    def __init__(
        self, materials: Sequence[Material], rate_hz: float, seed: int, unknown: bool = False
    ) -> None:
        self.rate_hz, self.sensor = rate_hz, Sensor()
        self._materials, self._unknown = tuple(materials), unknown
        self._seed = random_stream(seed, _LIVE)
        self._lock = threading.Lock()
        self._n_pushes = 0
        self.tick = 0  # number of the next sample
        self.push: PlannedPush | None = None  # that is commanded or under way
        self.truth: str | None = None  # material of the latest push
        self._set_up()

    def plan(self, speed_m_s: float, duration_s: float) -> PlannedPush:
        """Command a push, which begins about half a second after the next sample; refuse one that cannot be."""
        if self.push is not None:
            raise RuntimeError("the simulated robot is still moving: wait for the motion, or stop it")
        material, conditions, stream = self._material, self._conditions, self._stream
        rig = Rig(speed_m_s=speed_m_s)
        lead_s = (round(LEAD_S * self.rate_hz) - self._phase) / self.rate_hz
        # Takes some milliseconds: outside the lock, so that samples go on meanwhile.
        wrench = simulate_push(
            material,
            rig=rig,
            rate_hz=self.rate_hz,
            duration_s=lead_s + duration_s,
            lead_s=lead_s,
            sensor=self.sensor,
            conditions=conditions,
            seed=stream,
        )
        meta = push_meta(material, rig, conditions, lead_s) | {"push": self._n_pushes}
        with self._lock:
            start_tick = self.tick + lead_s * self.rate_hz
            self.push = PlannedPush(self.tick, start_tick, self.tick + len(wrench), wrench, meta)
            self.truth = material.name
            return self.push

    def cut(self) -> None:
        """Stop the push that is under way, if any: the tool leaves the bed."""
        with self._lock:
            if self.push is not None:
                self._finish()

    def advance(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
        """Return the next `n` samples: wrench (n, 6) and flags (n,)."""
        wrench, done = np.empty((n, 6)), 0
        with self._lock:
            while done < n:
                if self.push is None:
                    part = self.sensor.read(np.tile(self._conditions.tare, (n - done, 1)), self._rest_noise)
                else:
                    at = self.tick - self.push.first_tick
                    part = self.push.wrench[at : at + n - done]
                wrench[done : done + len(part)] = part
                done += len(part)
                self.tick += len(part)
                if self.push is not None and self.tick >= self.push.end_tick:
                    self._finish()
        saturated = np.any(np.abs(wrench) >= np.asarray(self.sensor.full_scale), axis=1)
        return wrench, saturated.astype(np.uint8) * np.uint8(SampleFlag.SATURATED)

    def _finish(self) -> None:
        self.push = None
        self._n_pushes += 1
        self._set_up()

    def _set_up(self) -> None:
        """Fill the container and zero the sensor for the next push."""
        which = int(self._rng(_CHOICE).integers(len(self._materials))) if self._unknown else 0
        self._material = self._materials[which]
        number = self._n_pushes + _FIRST_UNKNOWN * self._unknown
        drawn = draw_push(self._material, number, 0, self._seed, Nuisance())
        self._conditions: Conditions = drawn[0]
        self._stream: np.random.SeedSequence = drawn[2]
        self._phase = float(self._rng(_PHASE).uniform())
        self._rest_noise = self._rng(_REST)

    def _rng(self, what: int) -> np.random.Generator:
        return np.random.default_rng(random_stream(self._seed, what, int(self._unknown), self._n_pushes))


class SimSource(ThreadedSource):
    """A simulated force-torque sensor above a bed of grains.

    Parameters
    ----------
    materials : str, Material, or sequence of these
        What lies under the tool; names are those of `PAPER_MATERIALS`. With several, or with ``"unknown"`` (all
        of them), each push meets one drawn by chance; `truth` says which.
    rate_hz : float, default 500
    speed : float, default 1
        Device seconds per second: 20 makes 20 recordings in the time of one.
    seed : int, optional
        Same seed, same set-up of bed and sensor, and same samples of each push. Default: another one each time, see
        ``info.meta["seed"]``.

    Examples
    --------
    >>> from granular_id.live import SimSource
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
    ) -> None:
        unknown = materials == UNKNOWN
        chosen = resolve_materials(PAPER_MATERIALS if unknown else materials)
        unknown = unknown or len(chosen) > 1
        rate_hz = sampling_rate("rate_hz", rate_hz)
        seed = secrets.randbits(48) if seed is None else whole_number("seed", seed, least=0)
        self.world = SimWorld(chosen, rate_hz, seed, unknown)
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
                meta={"seed": seed},
            )
        )
        self._pace: Pace | None = None

    @property
    def truth(self) -> str | None:
        """What the latest push went through; None before the first."""
        return self.world.truth

    def robot(self) -> SimRobot:
        """Return the robot that moves the tool of this sensor."""
        return SimRobot(self)

    def device_time_s(self, tick: Any) -> Any:
        """Return the sensor's time of a sample, or of an array of them."""
        return tick / self.info.rate_hz

    def host_ns_at(self, tick: float) -> int:
        """Return the host's time of a sample."""
        if self._pace is None:
            raise RuntimeError(f"{self.info.name} is not started")
        return self._pace.start_ns + round(1e9 * tick / self._pace.rows_per_s)

    def deliver(self, buffer: WrenchBuffer, stopping: threading.Event) -> None:
        """Write samples as they fall due."""
        pace, world = Pace(self.info), self.world
        self._pace = pace
        while not stopping.wait(pace.period_s):
            ticks = world.tick + np.arange(pace.due(world.tick))
            wrench, flags = world.advance(len(ticks))
            buffer.push_block(wrench, self.device_time_s(ticks), flags=flags)


class SimMotion:
    """A push of the simulated robot; it knows the sensor's clock."""

    error: str | None = None

    def __init__(self, source: SimSource, planned: PlannedPush) -> None:
        self._source, self._planned = source, planned
        self.start_time_s: float | None = source.device_time_s(planned.start_tick)

    @property
    def start_host_ns(self) -> int:
        """When it begins, by the host's clock: later, where the simulation is slower than its speed."""
        return self._source.host_ns_at(self._planned.start_tick)

    def finished(self) -> bool:
        """Say whether the tool stands again."""
        return self._source.world.push is not self._planned

    def report(self) -> Mapping[str, Any]:
        """Return what was drawn for this push, the material too."""
        return self._planned.meta


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
        return SimMotion(self._source, self._source.world.plan(speed_m_s, duration_s))

    def move_back(self) -> None:
        """Stay: the tool is back at its start as soon as a push has ended."""

    def stop(self) -> None:
        """Stop the push that is under way."""
        self._source.world.cut()


def open_url(url: SourceUrl) -> SimSource:
    """Make the source of ``sim:MATERIAL``, ``sim:MATERIAL,MATERIAL`` or ``sim:unknown``."""
    url.allow("speed", "seed", "rate_hz")
    names = [name.strip() for name in url.path.split(",")]
    return SimSource(
        UNKNOWN if names == [UNKNOWN] else names,
        rate_hz=url.number("rate_hz", 500.0),
        speed=url.number("speed", 1.0),
        seed=url.whole("seed", None),
    )
