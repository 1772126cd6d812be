"""A simulated sensor with which something goes wrong."""

import math
from dataclasses import dataclass

import numpy as np

from granular_id.live.sim import SimSource
from granular_id.recording import SampleFlag


@dataclass(frozen=True)
class Fault:
    """A gap or saturation of some rows, a restart, a stall or death: now, or after the start of the next motion."""

    kind: str
    after_s: float | None = None
    rows: int = 1
    stall_s: float = 0.0


class FaultySource(SimSource):
    """A simulated sensor that takes faults."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self._zero_tick, self._faults = 0, []  # each with its sample; None: not known before the next push

    def inject(self, fault):
        self._faults.append((self.world.tick if fault.after_s is None else None, fault))

    def push(self, speed_m_s, duration_s):
        planned = super().push(speed_m_s, duration_s)
        rate_hz = self.info.rate_hz
        self._faults = [
            (planned.start_tick + fault.after_s * rate_hz if at is None else at, fault)
            for at, fault in self._faults
        ]
        return planned

    def device_time_s(self, tick):
        return super().device_time_s(tick - self._zero_tick)

    def _write(self, buffer, n):
        first = self.world.tick
        due = [(at, fault) for at, fault in self._faults if at is not None and at < first + n]
        if not due:
            super()._write(buffer, n)
            return
        at, fault = min(due, key=lambda item: item[0])
        if at > first:
            super()._write(buffer, math.ceil(at) - first)
            return
        self._faults.remove((at, fault))
        if fault.kind == "gap":
            self.world.advance(fault.rows)
        elif fault.kind == "saturation":
            wrench, _ = self.world.advance(fault.rows)
            wrench[:, 0] = self.world.sensor.full_scale[0]
            times_s = self.device_time_s(np.arange(first, first + fault.rows))
            buffer.push_block(wrench, times_s, flags=np.full(fault.rows, SampleFlag.SATURATED, np.uint8))
        elif fault.kind == "restart":
            buffer.new_epoch()
            self._zero_tick = first
        elif fault.kind == "stall":
            self._stopping.wait(fault.stall_s)
        else:
            raise ConnectionError("the simulated sensor was told to die")
