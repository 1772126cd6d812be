"""What can go wrong with a sensor, on demand."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Literal, get_args

from granular_id._checks import finite_number, whole_number

__all__ = ["Fault", "FaultKind", "FaultPlan"]

FaultKind = Literal["gap", "saturation", "restart", "stall", "death"]


@dataclass(frozen=True)
class Fault:
    """One fault of a simulated sensor.

    Parameters
    ----------
    kind : {"gap", "saturation", "restart", "stall", "death"}
        Samples are lost; samples stand at the end of the range; the sensor's time begins anew; nothing comes
        for a while and then everything at once; the source dies.
    after_s : float, optional
        Device time from the start of the next motion; may be negative. None: now.
    rows : int, default 1
        How many samples a gap or saturation takes.
    stall_s : float, default 0
        How long a stall takes, seconds of the host.

    Examples
    --------
    >>> from granular_id.live.sim_faults import Fault
    >>> Fault("gap", after_s=1.0, rows=3).rows
    3
    """

    kind: FaultKind
    after_s: float | None = None
    rows: int = 1
    stall_s: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(FaultKind):
            raise ValueError(f"kind must be one of {', '.join(get_args(FaultKind))}, got {self.kind!r}")
        if self.after_s is not None:
            finite_number("after_s", self.after_s)
        whole_number("rows", self.rows)
        finite_number("stall_s", self.stall_s, least=0)


class FaultPlan:
    """Faults that wait for their sample; filled from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[tuple[float | None, Fault]] = []

    def add(self, fault: Fault, tick: float | None) -> None:
        """Let a fault happen at a sample; None: the next motion says which."""
        with self._lock:
            self._waiting.append((tick, fault))

    def follow(self, start_tick: float, rate_hz: float) -> None:
        """Place the faults that wait for a motion: it begins at `start_tick`."""
        with self._lock:
            self._waiting = [
                (start_tick + (fault.after_s or 0.0) * rate_hz if tick is None else tick, fault)
                for tick, fault in self._waiting
            ]

    def take(self, before: float) -> tuple[float, Fault] | None:
        """Remove and return the first fault due before a sample; None where there is none."""
        with self._lock:
            due = [(tick, fault) for tick, fault in self._waiting if tick is not None and tick < before]
            if not due:
                return None
            first = min(due, key=lambda item: item[0])
            self._waiting.remove(first)
            return first
