"""The simulated bench: beds of grains, a tool, a sensor; no clock but the count of samples."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.recording import SampleFlag
from granular_id.synthetic import (
    Conditions,
    Material,
    Nuisance,
    Rig,
    Sensor,
    draw_push,
    push_meta,
    random_stream,
    simulate_push,
)

__all__ = ["PlannedPush", "SimWorld"]

LEAD_S = 0.5
"""From a command to the motion: a robot plans that long, and a recording's rest fits into it."""

# First element of the key of each random stream: what was simulated live is none of what `synthesize` makes.
_LIVE, _REST, _CHOICE, _PHASE = 10, 0, 1, 2
# Pushes through unknown materials are others than those through named ones, under the same seed too.
_FIRST_UNKNOWN = 1_000_000


@dataclass
class PlannedPush:
    """A push that has been commanded.

    Attributes
    ----------
    material : Material
    first_tick, end_tick : int
        Samples from the command to the end of the motion.
    start_tick : float
        The motion begins here, as a rule between two samples.
    wrench : ndarray, shape (end_tick - first_tick, 6)
    meta : mapping
        What was drawn for it.
    """

    material: Material
    first_tick: int
    start_tick: float
    end_tick: int
    wrench: NDArray[np.float64]
    meta: dict[str, Any]


class SimWorld:
    """Materials under a tool, sample by sample.

    At rest the sensor reads its zero point and noise. A push plays `simulate_push`, under conditions drawn anew for
    each from a `Nuisance`, from the command to its end: the rest before the motion belongs to it. So the samples
    of push number k follow from the seed alone, whenever it was commanded.

    Parameters
    ----------
    materials : sequence of Material
        What may lie under the tool.
    rate_hz : float
    seed : int
    session : int, default 0
        Mounting, calibration and fill are drawn once per session, and the same in every world of that seed.
    unknown : bool, default False
        Draw the material of each push; False: there is one, and it is the first.
    rig, nuisance, sensor : optional
        As in `synthesize`.
    """

    def __init__(
        self,
        materials: Sequence[Material],
        rate_hz: float,
        seed: int,
        *,
        session: int = 0,
        unknown: bool = False,
        rig: Rig | None = None,
        nuisance: Nuisance | None = None,
        sensor: Sensor | None = None,
    ) -> None:
        self.rate_hz = rate_hz
        self.sensor = sensor or Sensor()
        self._materials = tuple(materials)
        self._seed = random_stream(seed, _LIVE)
        self._session = session
        self._unknown = unknown
        self._rig = rig or Rig()
        self._nuisance = nuisance or Nuisance()
        self._lock = threading.Lock()
        self._tick = 0
        self._n_pushes = 0
        self._push: PlannedPush | None = None
        self._truth: str | None = None
        self._set_up()

    @property
    def tick(self) -> int:
        """Number of the next sample."""
        return self._tick

    @property
    def truth(self) -> str | None:
        """Material of the latest push; None before the first."""
        return self._truth

    @property
    def push(self) -> PlannedPush | None:
        """The push that is commanded or under way."""
        return self._push

    def plan(
        self, speed_m_s: float, duration_s: float, on_plan: Callable[[PlannedPush], object] | None = None
    ) -> PlannedPush:
        """Command a push: it begins about half a second after the next sample.

        Parameters
        ----------
        speed_m_s, duration_s : float
        on_plan : callable, optional
            Called with the push before its first sample can be asked for.

        Raises
        ------
        RuntimeError
            Another one is under way.
        ValueError
            It would run into the wall of the container.
        """
        self._refuse_while_moving()
        material, conditions, stream = self._material, self._conditions, self._stream
        rig = replace(self._rig, speed_m_s=speed_m_s)
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
            self._refuse_while_moving()
            start_tick = self._tick + lead_s * self.rate_hz
            push = PlannedPush(material, self._tick, start_tick, self._tick + len(wrench), wrench, meta)
            if on_plan is not None:
                on_plan(push)
            self._push, self._truth = push, material.name
            return push

    def _refuse_while_moving(self) -> None:
        if self._push is not None:
            raise RuntimeError("the simulated robot is still moving: wait for the motion, or stop it")

    def cut(self, push: PlannedPush) -> None:
        """Stop a push where it is: the tool leaves the bed."""
        with self._lock:
            if self._push is push:
                push.end_tick = self._tick
                self._finish()

    def advance(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
        """Return the next `n` samples: wrench (n, 6) and flags (n,)."""
        wrench, done = np.empty((n, 6)), 0
        with self._lock:
            while done < n:
                if self._push is None:
                    part = self.sensor.read(np.tile(self._conditions.tare, (n - done, 1)), self._rest_noise)
                else:
                    at = self._tick - self._push.first_tick
                    part = self._push.wrench[at : at + n - done]
                wrench[done : done + len(part)] = part
                done += len(part)
                self._tick += len(part)
                if self._push is not None and self._tick >= self._push.end_tick:
                    self._finish()
        saturated = np.any(np.abs(wrench) >= np.asarray(self.sensor.full_scale), axis=1)
        return wrench, saturated.astype(np.uint8) * np.uint8(SampleFlag.SATURATED)

    def _finish(self) -> None:
        self._push = None
        self._n_pushes += 1
        self._set_up()

    def _set_up(self) -> None:
        """Fill the container and zero the sensor for the next push."""
        k = self._n_pushes
        which = 0
        if self._unknown:
            which = int(self._rng(_CHOICE).integers(len(self._materials)))
        self._material = self._materials[which]
        number = k + _FIRST_UNKNOWN if self._unknown else k
        drawn = draw_push(self._material, number, self._session, self._seed, self._nuisance)
        self._conditions: Conditions = drawn[0]
        self._stream: np.random.SeedSequence = drawn[2]
        self._phase = float(self._rng(_PHASE).uniform())
        self._rest_noise = self._rng(_REST)

    def _rng(self, what: int) -> np.random.Generator:
        return np.random.default_rng(random_stream(self._seed, what, int(self._unknown), self._n_pushes))
